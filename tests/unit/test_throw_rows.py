"""Channels from stored displacements: exact, and right between steps too."""

import dataclasses

import numpy as np
import pytest
import xarray as xr

from turnout.core.scheme import Scheme
from turnout.kernels.lanes import LANES, multiply_add
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.panel.profile import contact_height
from turnout.throw.coordinates import dataset_coordinates, indexed
from turnout.throw.gaps import gap_rows
from turnout.throw.output_rows import (
    HISTORIES,
    OutputRows,
    RowBlock,
    merge_blocks,
    row_blocks,
    sums_of_columns,
    weighted_columns,
)
from turnout.throw.recovery import histories_of, output_rows, recover_motion, row_terms
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
                out = output_rows(motion, terms).over_time(histories_of(solved.history))
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


def over_time(rows: OutputRows, **histories: np.ndarray) -> np.ndarray:
    """Return rows over time; histories that are not given have no columns."""
    count = next(iter(histories.values())).shape[0]
    return rows.over_time({name: histories.get(name, np.zeros((count, 0))) for name in HISTORIES})


@pytest.mark.parametrize("count", [1, 7, 8, 32, 33, 64, 131, 601])
def test_rows_are_their_start_and_their_terms_in_order(count: int) -> None:
    generator = np.random.default_rng(count)
    # Histories are pieces of wider memory.
    g, q = (generator.normal(size=(count, 24))[:, :n] for n in (20, 9))
    of_g, of_q = generator.normal(size=(6, 20)), generator.normal(size=(6, 9))
    of_g[1], of_q[:2] = 0.0, 0.0
    of_g[0], of_g[0, 3] = 0.0, 1.0
    start = np.array([0.0, *range(1, 6)])
    for sign in (1.0, -1.0):
        rows = weighted_columns(start, {"g": sign * of_g, "q": sign * of_q})
        found = over_time(rows, g=g, q=q)
        values, weights = np.hstack((q, g)), sign * np.hstack((of_q, of_g))
        expected = [fused(b, w, values) for b, w in zip(start, weights, strict=True)]
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(found[0], sign * g[:, 3])
        assert found[1].tolist() == [1.0] * count


@pytest.mark.parametrize("count", [3, 70])
def test_histories_with_few_columns_or_columns_apart_are_read_as_they_are(count: int) -> None:
    generator = np.random.default_rng(count)
    few, apart = generator.normal(size=(count, 3)), generator.normal(size=(count, 40))[:, ::4]
    backwards = generator.normal(size=(count, 12))[::-1]
    whole = np.arange(12 * count).reshape(count, 12)
    for history, columns in ((few, 2), (apart, 9), (backwards, 11), (whole, 8)):
        found = over_time(sums_of_columns("law_force", [[columns, 1], [0]]), law_force=history)
        np.testing.assert_array_equal(found, [history[:, 1] + history[:, columns], history[:, 0]])


def fused(start: float, weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a start and weighted columns, each step rounded once."""
    found = np.full(values.shape[0], start)
    for weight, column in zip(weights, values.T, strict=True):
        if weight == 0.0:
            continue
        for t in range(0, found.size, LANES):
            own, size = slice(t, t + LANES), found[t : t + LANES].size
            eight = [np.resize(part, LANES) for part in (column[own], found[own])]
            found[own] = multiply_add(np.full(LANES, weight), *eight)[:size]
    return found


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


def test_histories_that_the_kernel_would_misread_are_refused() -> None:
    rows = sums_of_columns("g", [[0, 3]])
    with pytest.raises(ValueError, match="the history g must hold 5 instants and 4 columns"):
        over_time(rows, q=np.zeros((5, 1)), g=np.zeros((5, 3)))
    with pytest.raises(ValueError, match="the history g must hold 5 instants"):
        over_time(rows, q=np.zeros((5, 1)), g=np.zeros((4, 4)))


def test_weights_are_made_once_for_rails_that_throws_share(solved: Solved) -> None:
    """Other friction leaves them as they are; channels are those of weights made for each throw."""
    panel = load_panel(DEFAULT).with_overrides({"chair.friction_coefficient": 0.2})
    kept = simulate(panel, foreign_object=ForeignObject(0.05, "sleeper 6"), mode="quick")
    made = list[int]()

    def make() -> RowBlock:
        made.append(1)
        return RowBlock(sums_of_columns("g", []), {})

    shared = panel.rail
    assert row_blocks.get((shared,), ("once",), make) is row_blocks.get((shared,), ("once",), make)
    assert row_blocks.get((dict(shared),), ("once",), make)
    assert len(made) == 2
    row_blocks.clear()
    again = simulate(panel, foreign_object=ForeignObject(0.05, "sleeper 6"), mode="quick")
    xr.testing.assert_identical(kept.drop_attrs(), again.drop_attrs())


def test_merged_blocks_hold_what_they_hold_apart() -> None:
    history = np.arange(26.0).reshape(13, 2)
    histories = dict.fromkeys(HISTORIES, history)
    one = RowBlock(sums_of_columns("g", [[0], [0, 1]]), {"one": (0, (2,))})
    two = RowBlock(sums_of_columns("q", [[0], [1]], sign=-1.0), {"two": (1, (1,))})
    apart = one.over_time(histories) | two.over_time(histories)
    together = merge_blocks([one, two]).over_time(histories)
    assert together.keys() == apart.keys()
    for name, values in together.items():
        np.testing.assert_array_equal(values, apart[name])
    np.testing.assert_array_equal(together["two"], -history[:, 1:].T)


def test_rows_of_which_nothing_is_known_are_nan_and_no_zero_is_negative() -> None:
    found = over_time(sums_of_columns("g", [[0], [], [1]], sign=-1.0), g=np.zeros((70, 2)))
    assert np.isnan(found[1]).all()
    assert not np.signbit(found[[0, 2]]).any()


def test_results_of_a_panel_that_lists_its_members_in_another_order_are_its_own() -> None:
    panel = load_panel("60e1-300-1-9")
    turned = {
        name: dict(reversed(list(getattr(panel, name).items())))
        for name in ("rail", "sensor", "stop", "chair")
    }
    other = panel.model_copy(update=turned)
    first, second = simulate(panel, mode="quick"), simulate(other, mode="quick")
    for name in ("sensor_gap", "gap", "chair_normal_force", "stop_force", "drive_force"):
        wanted, found = first[name].values, second[name].reindex_like(first[name]).values
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6 * np.nanmax(np.abs(wanted)))
