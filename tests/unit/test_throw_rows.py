"""Channels from stored displacements: exact, and right between steps too."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import xarray as xr

from turnout.core.scheme import Scheme
from turnout.kernels.lanes import LANES, multiply_add
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.panel.profile import contact_height
from turnout.throw.coordinates import dataset_coordinates, indexed
from turnout.throw.gaps import gap_places, gap_rows
from turnout.throw.output_weights import (
    RowBlock,
    RowWeights,
    clear_row_blocks,
    evenly_spaced,
    kept_row_blocks,
    merge_blocks,
    products_of,
    sums_of_columns,
)
from turnout.throw.recovery import histories_of, recover_motion, row_terms, weighted_rows
from turnout.throw.rows_over_time import Product, WeightedRows, rows_in_lines, write_rows
from turnout.throw.save import Save
from turnout.throw.simulate import Solved, simulate, solve
from turnout.throw.stored_displacements import stored_rows, stored_share, stored_weights

DEFAULT = "uic60-760-1-15"
X = np.array([0.6, 3.6, 5.01, 9.6, 12.0])  # chairs, a drive, between nodes, no stop


@pytest.fixture(scope="module")
def solved() -> Solved:
    """A quick throw over an object."""
    panel = load_panel(DEFAULT)
    return solve(panel, foreign_object=ForeignObject(0.05, "sleeper 6"), scheme=Scheme.of("quick"))


def test_stored_displacements_say_what_modes_and_forces_say(solved: Solved) -> None:
    panel, motion = load_panel(DEFAULT), recover_motion(solved.mechanism, solved.history)
    found = {}
    for with_stored in (True, False):
        for rail in panel.rail:
            _, parts = gap_rows(panel, motion, rail, X, contact_height(panel, rail, X))
            for number, some in enumerate((parts[:1], parts)):
                terms = row_terms(motion, some, with_stored=with_stored)
                out = np.empty((X.size, solved.history.time.size))
                write_rows([weighted_rows(motion, terms, out)], histories_of(solved.history))
                found[with_stored, rail, number] = out, terms
    for rail in panel.rail:
        for number in (0, 1):
            (stored, terms), (recovered, _) = (found[w, rail, number] for w in (True, False))
            assert np.abs(recovered).max() > 0.05
            np.testing.assert_allclose(stored, recovered, rtol=0, atol=1e-13)
            assert terms.stored is not None
            assert terms.stored[0].any()
            assert not terms.modes[0].any()
    # A stock rail between stops has no row of its own.
    assert found[True, next(iter(panel.rail)), 1][1].modes[-1].any()


def test_gaps_between_steps_lie_between_those_at_steps() -> None:
    """Forces of laws between steps do not fit what is interpolated: 5 mm were missed by them."""
    panel = load_panel(DEFAULT).with_overrides({"sensor.rail": "straight"})  # pairs change rails
    at_steps = simulate(panel, mode="quasi-static")
    between = simulate(panel, mode="quasi-static", save=Save(interval=0.004))
    assert between.sizes["time"] > 2 * at_steps.sizes["time"]
    for name in ("gap", "lateral_displacement", "sensor_gap"):
        expected = at_steps[name].interp(time=between["time"])
        difference = np.abs(between[name] - expected).max()
        assert float(difference) < 1e-5, name


def test_weights_need_rows_that_say_it() -> None:
    rows = np.array([[1.0, 0.0, 0.0], [1.0, -0.1, 0.0], [0.0, 0.0, 1.0]])
    feet = stored_rows(rows, np.arange(3))
    weights = stored_weights(feet, np.array([0, 1]), np.array([1.0, -0.3]))
    assert weights is not None
    np.testing.assert_allclose(weights, [-2.0, 3.0, 0.0], atol=1e-12)
    one = stored_rows(rows, np.array([1]))
    assert stored_weights(one, np.array([0, 1]), np.array([1.0, -0.3])) is None
    assert stored_weights(one, np.array([2]), np.array([1.0])) is None
    assert stored_weights(feet, np.array([0]), np.array([np.nan])) is None
    many = np.arange(20)
    assert stored_weights(stored_rows(np.eye(20), many), many, np.ones(20)) is None
    nothing = stored_weights(feet, np.array([], dtype=int), np.array([]))
    assert nothing is not None
    assert not nothing.any()


def test_what_is_left_goes_to_the_rail_with_fewer_rows() -> None:
    """A rod at height 0.1 and a stop at 0.2 show how far the rail is from its stock rail at 0.3."""
    rows = np.array([[1.0, -0.1, 0.0, 0.0], [1.0, -0.2, -1.0, 0.0], [0.0, 0.1, 0.0, 0.0]])
    stored = stored_rows(rows, np.array([0, 1]))
    wanted = np.array([1.0, -0.3, 0.0, 0.0])
    weights, rest = stored_share(stored, [(0, 2), (2, 2)], wanted)
    np.testing.assert_allclose(weights @ rows + rest, wanted, atol=1e-12)
    np.testing.assert_allclose(rest, [0.0, 0.0, 2.0, 0.0], atol=1e-12)


def test_rows_are_written_over_all_blocks_of_instants() -> None:
    generator = np.random.default_rng(5)
    values, other = generator.normal(size=(601, 40)), generator.normal(size=(601, 3))
    weights = np.zeros((6, 40))
    weights[0, 3] = 1.0
    weights[1, 2:5] = 0.5, -2.0, 7.0
    weights[3, 39] = 1.0
    weights[4, [0, 38]] = 1.0, 2.0
    weights[5, 6] = -1.0
    start = np.arange(6.0)
    for minus in (False, True):
        out = np.full((6, 601), np.nan)
        rows = WeightedRows(products_of(weights, "g"), out, start, minus)
        write_rows([rows], {"g": values, "q": other})
        expected = start[:, np.newaxis] + (-1 if minus else 1) * weights @ values.T
        np.testing.assert_allclose(out, expected, atol=1e-13)


@pytest.mark.parametrize("count", [1, 7, 32, 64, 131])
def test_rows_are_sums_in_the_order_of_their_products(count: int) -> None:
    generator = np.random.default_rng(count)
    # Histories are pieces of wider memory, and rows begin at any address.
    g, q = (generator.normal(size=(count, 24))[:, :n] for n in (20, 9))
    weights = generator.normal(size=(3, 9))
    products = [
        *sums_of_columns("g", np.array([[1, 2], [3, 3], [0, 19], [5, 7]]), rows=np.arange(4)),
        Product("g", slice(4, 7), np.array([0, 2, 5]), added=False),
        Product("q", slice(0, 9), slice(1, 4), weights, added=True),
    ]
    first = np.stack([g[:, 4], g[:, 3] + g[:, 3], g[:, 5], g[:, 5] + g[:, 7]])
    expected = np.full((6, count), np.nan)
    expected[:4] = first
    expected[1:4] += [fused(row, q) for row in weights]
    expected[5] = g[:, 6]
    start = np.arange(6.0)
    for memory in (np.full((6, count), np.nan), rows_in_lines(6, count)):
        memory[:] = np.nan
        write_rows([WeightedRows(products, memory, start, minus=True)], {"g": g, "q": q})
        np.testing.assert_array_equal(memory, start[:, np.newaxis] - expected)


@pytest.mark.parametrize("count", [3, 70])
def test_histories_with_few_columns_or_columns_apart_are_read_as_they_are(count: int) -> None:
    generator = np.random.default_rng(count)
    few, apart = generator.normal(size=(count, 3)), generator.normal(size=(count, 40))[:, ::4]
    backwards = generator.normal(size=(count, 12))[::-1]
    products = [
        *sums_of_columns("few", np.array([[2], [0]]), rows=np.array([0, 1])),
        *sums_of_columns("apart", np.array([[9], [4]]), rows=np.array([2, 3])),
        *sums_of_columns("backwards", np.array([[11, 3]]), rows=np.array([4])),
    ]
    out = np.full((5, count), np.nan)
    write_rows([WeightedRows(products, out)], {"few": few, "apart": apart, "backwards": backwards})
    last = backwards[:, 11] + backwards[:, 3]
    expected = np.stack([few[:, 2], few[:, 0], apart[:, 9], apart[:, 4], last])
    np.testing.assert_array_equal(out, expected)


def fused(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return weighted sums of columns, each step rounded once."""
    found = np.zeros(values.shape[0])
    for weight, column in zip(weights, values.T, strict=True):
        for t in range(0, found.size, LANES):
            own, size = slice(t, t + LANES), found[t : t + LANES].size
            eight = [np.resize(part, LANES) for part in (column[own], found[own])]
            found[own] = multiply_add(np.full(LANES, weight), *eight)[:size]
    return found


@pytest.mark.parametrize(
    "places", [[], [4], [1, 2, 3], [0, 5, 10], [3, 2, 1], [1, 1, 1], [1, 2, 4]]
)
def test_slices_take_what_indices_take(places: list[int]) -> None:
    indices = np.array(places, dtype=np.int64)
    values = np.arange(12.0)
    assert values[evenly_spaced(indices)].tolist() == values[indices].tolist()


def test_kept_indexes_make_the_same_coordinates(solved: Solved) -> None:
    """And attributes of one dataset do not show in the next one."""
    panel = load_panel(DEFAULT)
    used = ("rail", "drive", "chair", "sensor")
    made = dataset_coordinates(panel, solved.mechanism.index, used=used)
    made["time"] = (("time",), solved.history.time)
    first, second = xr.Dataset(coords=indexed(made)), xr.Dataset(coords=indexed(made))
    assert first.identical(xr.Dataset(coords=made))
    assert first["rail"].dtype == made["rail"][1].dtype
    first["rail"].attrs["units"] = first["time"].attrs["units"] = "s"
    first["drive_x"][:] = 0.0
    assert second.identical(xr.Dataset(coords=made))
    assert "units" not in xr.Dataset(coords=indexed(made))["rail"].attrs


FAMILIES = {
    "rail", "drive", "chair", "stop", "link", "sensor", "object", "fastening", "axis",
}  # fmt: skip


@pytest.mark.parametrize("used", [(), ("drive",), ("fastening", "axis", "link", "stop", "object")])
def test_coordinates_are_those_of_the_dimensions_that_are_used(
    solved: Solved, used: tuple[str, ...]
) -> None:
    given = (load_panel(DEFAULT), solved.mechanism.index)
    every, made = (dataset_coordinates(*given, used=dims) for dims in (FAMILIES, used))
    assert {dims[0] for dims, _ in every.values()} >= {*used}
    assert made.keys() == {name for name, (dims, _) in every.items() if dims[0] in used}
    for name, (dims, values) in made.items():
        assert dims == every[name][0]
        np.testing.assert_array_equal(values, every[name][1])


def test_a_run_without_all_channels_has_those_that_it_keeps(solved: Solved) -> None:
    panel = load_panel(DEFAULT)
    whole = simulate(panel, mode="quick")
    for fields in (("stop_force",), ("drive_gap", "chair_friction_force"), ("locked", "time")[:1]):
        some = simulate(panel, mode="quick", save=dataclasses.replace(Save(), fields=fields))
        assert set(some.data_vars) == set(fields)
        for name in fields:
            assert some[name].equals(whole[name]), name


INTEGERS: Any = np.zeros((2, 3), dtype=np.int64)
FIXED = np.zeros((2, 3))
FIXED.flags.writeable = False
PAIRS = [[0, 1], [2, 3]]


@pytest.mark.parametrize(
    ("out", "columns", "kind", "start", "message"),
    [
        (FIXED, PAIRS, "f8", None, "writeable"),
        (np.zeros((2, 6))[:, ::2], PAIRS, "f8", None, "without gaps"),
        (INTEGERS, PAIRS, "f8", None, "must be floats"),
        (np.zeros((2, 4)), PAIRS, "f8", None, "history g must be floats of 4 instants"),
        (np.zeros((2, 3)), PAIRS, "f8", np.zeros(1), "a start for each row"),
        (np.zeros((2, 3)), PAIRS, "f4", None, "history g must be floats"),
        (np.zeros((2, 3)), [[0, 4], [2, 3]], "f8", None, ""),
    ],
    ids=["fixed", "gaps", "integers", "instants", "start", "single", "beyond"],
)
def test_what_the_kernel_would_misread_is_refused(
    out: Any, columns: list[list[int]], kind: str, start: Any, message: str
) -> None:
    products = sums_of_columns("g", np.array(columns), rows=np.arange(2))
    history: Any = np.arange(12.0).reshape(3, 4).astype(kind)
    with pytest.raises(ValueError if message else IndexError, match=message or None):
        write_rows([WeightedRows(products, out, start=start)], {"g": history, "q": history})


def test_rows_of_other_instants_than_the_first_are_refused() -> None:
    products = sums_of_columns("g", np.array(PAIRS), rows=np.arange(2))
    rows = [WeightedRows(products, np.zeros((2, count))) for count in (3, 2)]
    with pytest.raises(ValueError, match="3 instants"):
        write_rows(rows, {"g": np.zeros((3, 4))})


def test_weights_are_made_once_for_rails_that_throws_share(solved: Solved) -> None:
    """Other friction leaves them as they are; channels are those of weights made for each throw."""
    panel = load_panel(DEFAULT).with_overrides({"chair.friction_coefficient": 0.2})
    kept = simulate(panel, foreign_object=ForeignObject(0.05, "sleeper 6"), mode="quick")
    made = list[int]()

    def make() -> list[RowBlock]:
        made.append(1)
        return [RowBlock([], {})]

    shared = panel.rail
    assert kept_row_blocks((shared,), ("once",), make) is kept_row_blocks(
        (shared,), ("once",), make
    )
    assert kept_row_blocks((dict(shared),), ("once",), make)
    assert len(made) == 2
    clear_row_blocks()
    again = simulate(panel, foreign_object=ForeignObject(0.05, "sleeper 6"), mode="quick")
    xr.testing.assert_identical(kept.drop_attrs(), again.drop_attrs())


def test_merged_blocks_hold_what_they_hold_apart() -> None:
    weights, histories = np.array([[1.0, 0.0], [0.5, 2.0]]), {"g": np.arange(26.0).reshape(13, 2)}
    one = RowBlock([(RowWeights(tuple(products_of(weights, "g"))), 2)], {"one": (0, (2,))})
    two = RowBlock([(RowWeights(tuple(products_of(2.0 * weights, "g"))), 2)], {"two": (1, (1,))})
    found = dict[str, Any]()
    for block in (one, two, merge_blocks([one, two])):
        arrays, rows = block.lay_out(13)
        write_rows(rows, histories)
        for name, values in arrays.items():
            np.testing.assert_array_equal(values, found.setdefault(name, values))
    assert {name: values.shape for name, values in found.items()} == {
        "one": (2, 13),
        "two": (1, 13),
    }


def test_rows_without_weights_are_what_they_start_with_and_others_are_left() -> None:
    out, left = np.empty((2, 13)), np.full((2, 4), 7.0)
    nothing = Product("g", np.arange(3), slice(0, 2), np.zeros((2, 3)))
    write_rows([WeightedRows([nothing], out, start=np.array([1.0, 2.0]))], {"g": np.ones((13, 3))})
    np.testing.assert_array_equal(out, np.broadcast_to([[1.0], [2.0]], out.shape))
    write_rows([RowWeights((), unknown=(1,)).into(left)], {"g": np.zeros((4, 9))})
    np.testing.assert_array_equal(left, [[7.0] * 4, [np.nan] * 4])


def test_places_of_gaps_that_throws_share_cannot_be_changed() -> None:
    panel = load_panel(DEFAULT)
    assert gap_places(panel) is gap_places(panel)
    for _, x, z in gap_places(panel):
        for shared in (x, z):
            with pytest.raises(ValueError, match="read-only"):
                shared[0] = 1.0


def test_rows_of_which_nothing_is_known_are_nan_and_near_rows_are_like_others() -> None:
    history = np.random.default_rng(3).normal(size=(70, 9))
    products = tuple(sums_of_columns("g", np.array([[8], [1]]), rows=np.array([0, 2])))
    found = []
    for near in (False, True):
        out = rows_in_lines(3, 70)
        out[:] = 0.0
        write_rows([RowWeights(products, near=near, unknown=(1,)).into(out)], {"g": history})
        found.append(out)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0][[0, 2]], history[:, [8, 1]].T)
    assert np.isnan(found[0][1]).all()
