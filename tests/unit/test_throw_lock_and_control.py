"""Labels on hand-made histories, where the answer is known beforehand."""

from typing import Any

import numpy as np
import pytest
from tests.unit.simulated import sb1_panel, sb2_dataset, sb2_panel

from turnout.mechanism.mechanism import LawIndex
from turnout.panel.profile import contact_height
from turnout.throw.lock_and_control import contact_labels, control_states, force_margins
from turnout.throw.route import (
    at_rest,
    closed_rail,
    open_rail,
    rail_closes,
    throws,
    wants_closed,
)
from turnout.throw.signals import energy_channels, energy_scale

# Movements of SB2: opening 0.2 ... 3.4 s, closing 4.4 ... 7.8 s.
TIME = np.linspace(0.0, 8.5, 86)


def touched(first: list[float], placed: float = 4.4) -> dict[str, Any]:
    numbers = range(len(first))
    index = LawIndex(
        object={str(n): n for n in numbers}, object_parts={str(n): (str(n),) for n in numbers}
    )
    found = contact_labels(index, np.array(first), np.full(len(first), placed))
    return {name: value for name, (_, value) in found.items()}


def test_throws_know_when_their_last_drive_arrives() -> None:
    opening, closing = throws(sb2_panel())
    assert (opening.direction, closing.direction) == ("opening", "closing")
    assert opening.end == pytest.approx(3.4)
    assert closing.end == pytest.approx(7.8), "Drive 2 takes 0.2 s longer"
    assert opening.until == closing.start
    assert closing.until == float("inf")


def test_rails_change_their_roles() -> None:
    two, one = sb2_panel(), sb1_panel()
    assert (closed_rail(two, "closed"), closed_rail(two, "open")) == ("A", "B")
    assert (open_rail(two, "closed"), open_rail(two, "open")) == ("B", "A")
    only = next(iter(one.rail))
    assert closed_rail(one, "open") == only
    assert (open_rail(one, "closed"), open_rail(one, "open")) == (None, only)


def test_the_instrumented_rail_is_wanted_closed_but_from_the_throw_to_the_return() -> None:
    closed = wants_closed(sb2_panel(), TIME, np.array([0.2, 4.4]))
    assert (~closed).tolist() == ((TIME >= 0.2) & (TIME < 4.4 - 1e-9)).tolist()
    late = wants_closed(sb2_panel(), np.stack([TIME, TIME]), np.array([[0.2, 4.4], [0.2, 5.4]]))
    assert late[0].tolist() == closed.tolist()
    assert (~late[1]).tolist() == ((TIME >= 0.2) & (TIME < 5.4 - 1e-9)).tolist()


def test_rest_is_outside_the_movements() -> None:
    expected = (TIME < 0.2 - 1e-9) | ((TIME > 3.4 - 1e-9) & (TIME < 4.4 - 1e-9))
    expected |= TIME > 7.8 - 1e-9
    assert at_rest(sb2_panel(), TIME).tolist() == expected.tolist()


def test_margins_count_force_in_the_direction_of_the_movement() -> None:
    force = np.zeros((2, TIME.size))
    force[0, TIME < 4.4 - 1e-9] = -5000.0  # opening effort, held until the return begins
    force[0, TIME > 4.4 - 1e-9] = -5500.0  # what is left of it, not an effort of the return
    force[0, TIME > 7.0] = 2000.0
    force[1, (TIME > 5.0) & (TIME < 6.0)] = 6010.0
    margins = force_margins(sb2_panel(), time=TIME, drive_force=force)
    np.testing.assert_allclose(margins, [[1000.0, 4000.0], [6000.0, -10.0]])


def test_a_movement_that_was_not_reached_has_no_margin() -> None:
    early = TIME[TIME < 4.0]
    margins = force_margins(sb2_panel(), time=early, drive_force=np.zeros((2, early.size)))
    assert np.isnan(margins[:, 1]).all()
    assert not np.isnan(margins[:, 0]).any()


@pytest.mark.parametrize(("gap", "raw"), [(0.004, True), (0.006, False)])
def test_lock_rules(gap: float, raw: bool) -> None:
    slipping = np.zeros((2, TIME.size), dtype=bool)
    given = {
        "time": TIME,
        "slipping": slipping,
        "drive_force": np.zeros((2, TIME.size)),
        "drive_gap": np.full((2, TIME.size), gap),
        "sensor_gap": None,
    }
    by_slip = control_states(sb2_panel(), **given)["locked"][1]  # type: ignore[arg-type]
    panel = sb2_panel().with_overrides({"lock.rule": "raw gap"})
    by_gap = control_states(panel, **given)["locked"][1]  # type: ignore[arg-type]
    assert by_slip[-1]
    assert by_gap[-1] == raw
    assert not by_slip[(TIME > 5.0) & (TIME < 7.0)].any(), "nothing is locked in motion"
    slipping[1, -1] = True
    assert not control_states(sb2_panel(), **given)["locked"][1][-1]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("gaps", "slips", "held"),
    [
        ((0.004, 0.004), False, True),
        ((0.005, 0.004), False, False),
        ((0.004, 0.004), True, False),
        ((0.004, 0.0031), False, False),
        ((0.004, np.nan), False, True),
    ],
    ids=["both small", "at the limit", "slips", "its own limit", "not known"],
)
def test_slip_or_gap_refuses_for_either(gaps: tuple[float, ...], slips: bool, held: bool) -> None:
    rule: dict[str, object] = {"lock.rule": "slip or gap"}
    if gaps[1] == 0.0031:
        rule["drive.2.gap_limit"] = 0.003
    slipping = np.zeros((2, TIME.size), dtype=bool)
    slipping[1, -1] = slips
    states = control_states(
        sb2_panel().with_overrides(rule),
        time=TIME,
        slipping=slipping,
        drive_force=np.zeros(slipping.shape),
        drive_gap=np.tile(np.array(gaps)[:, np.newaxis], TIME.size),
        sensor_gap=None,
    )
    assert bool(states["locked"][1][-1]) == held


def test_a_single_rail_that_is_open_is_not_judged_by_its_gap() -> None:
    """SB1 closes at 0.2 s and opens again at 1.6 s, at rest from 2.4 s on."""
    panel = sb1_panel().with_overrides({"lock.rule": "raw gap"})
    time = np.array([1.5, 2.45])
    given = {"time": time, "drive_gap": np.full((2, 2), 0.1), "sensor_gap": None}
    given["drive_force"] = np.zeros((2, 2))
    quiet, slipping = np.zeros((2, 2), dtype=bool), np.ones((2, 2), dtype=bool)
    assert control_states(panel, slipping=quiet, **given)["locked"][1].tolist() == [False, True]  # type: ignore[arg-type]
    assert not control_states(panel, slipping=slipping, **given)["locked"][1].any()  # type: ignore[arg-type]
    assert rail_closes(panel, time).tolist() == [True, False]
    assert rail_closes(sb2_panel(), time).all()


def test_in_control_below_the_limit() -> None:
    states = control_states(
        sb2_panel(),
        time=TIME[:3],
        slipping=np.zeros((2, 3), dtype=bool),
        drive_force=np.zeros((2, 3)),
        drive_gap=np.zeros((2, 3)),
        sensor_gap=np.array([[0.012, 0.014, np.nan], [0.0, 0.0, 0.0]]),
    )
    assert states["in_control"][1].tolist() == [[True, False, False], [True, True, True]]


def test_contact_labels() -> None:
    assert not touched([])["object_touched"]
    never = touched([np.nan])
    assert not never["object_touched"]
    assert np.isnan(never["contact_time"])
    assert touched([6.5])["contact_time"] == 6.5
    assert touched([6.5])["object_placed"]
    assert not touched([6.5], placed=np.nan)["object_placed"]
    assert "object_contact_time" not in touched([6.5])
    several = touched([np.nan, 7.0, 6.0])
    assert several["contact_time"] == 6.0
    np.testing.assert_array_equal(several["object_contact_time"], [np.nan, 7.0, 6.0])


def test_contact_height_is_that_of_the_stops_or_the_object() -> None:
    x = np.array([0.0, 5.0])
    np.testing.assert_allclose(contact_height(sb2_panel(), "A", x), 0.1)
    bare = sb2_panel().model_copy(update={"stop": {}, "stud": {}})
    defaults = bare.object_defaults.model_copy(update={"height": 0.07})
    bare = bare.model_copy(update={"object_defaults": defaults})
    np.testing.assert_allclose(contact_height(bare, "A", x), 0.07)


def test_energies_are_booked_with_their_signs() -> None:
    stored = np.array([[1.0, 2.0, 3.0, 4.0], [2.0, 4.0, 6.0, 8.0]])
    ledger = np.array([np.zeros(7), [20.0, 5.0, 3.0, 1.5, 2.0, 1.0, 0.25]])
    values = {name: value[-1] for name, (_, value) in energy_channels(stored, ledger).items()}
    assert values["energy_numerical"] == 3.0
    assert values["energy_strain"] == 2.0
    # stored change 10 less (20 + 1.5 - 5 - 3 - 0.25 - 3)
    assert values["energy_residual"] == pytest.approx(-0.25)
    assert energy_scale(stored, ledger) == 30.0
    assert energy_scale(stored[:0], ledger[:0]) == 0.0


def test_books_of_a_run_close() -> None:
    dataset = sb2_dataset()
    scale = dataset.attrs["energy_scale"]
    assert scale > 100.0
    assert float(abs(dataset["energy_residual"]).max()) < 1e-6 * scale
    assert float(abs(dataset["energy_numerical"]).max()) < 5e-3 * scale
    assert float(dataset["energy_friction"].diff("time").min()) > -1e-9 * scale


def test_least_flangeway_and_its_place() -> None:
    """The benchmark's opening throw leaves 50.9 mm; the place is where the planing ends."""
    dataset = sb2_dataset()
    assert float(dataset["least_flangeway"]) == pytest.approx(0.0509, abs=2e-4)
    assert float(dataset["least_flangeway_x"]) == pytest.approx(8.4)
    assert str(dataset["least_flangeway_rail"].values) == "A"


def test_a_panel_without_head_width_has_no_flangeway() -> None:
    from tests.unit.simulated import sb1_dataset

    assert np.isnan(float(sb1_dataset()["least_flangeway"]))
    assert str(sb1_dataset()["least_flangeway_rail"].values) == ""


def test_coordinates_come_in_the_order_of_dimensions() -> None:
    found = [name for name in sb2_dataset().coords if name in ("time", "rail", "drive", "drive_x")]
    assert found == ["time", "rail", "drive", "drive_x"]
