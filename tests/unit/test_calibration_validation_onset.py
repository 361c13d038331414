"""Onsets that only forces marked are found from the part of a movement without contact."""

from dataclasses import replace

import numpy as np
import pytest

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import MeasuredMovement, Signal
from turnout.calibration.validation.validate import onset_shifts

TIME = np.arange(-0.99, 3.2, 0.02)
CELLS = np.arange(0.002, 6.0, 0.004)


def force(time: np.ndarray) -> np.ndarray:
    """Return a force that grows from zero, then slowly."""
    return 2000.0 * np.clip(time, 0.0, 0.4) ** 3 / 0.4**3 + 100.0 * np.clip(time - 0.4, 0.0, None)


def response(contact: float = np.nan) -> Response:
    values = force(CELLS - 1.0)
    return Response(
        time=CELLS,
        drive_force={"1": values},
        object_force=np.zeros(CELLS.size),
        onsets={"closing": 1.0},
        contact_time=contact,
    )


def movement(shift: float, *, clocked: bool = False, size: float = 0.0) -> MeasuredMovement:
    signal = Signal(channel="drive_force", drive="1", time=TIME, values=force(TIME - shift))
    return MeasuredMovement(
        name="a",
        direction="closing",
        place="drive 1" if size else "none",
        size=size,
        x=0.3 if size else np.nan,
        signals=(signal,),
        length=3.0,
        clocked=clocked,
    )


def test_a_mark_that_came_too_early_is_found() -> None:
    found = onset_shifts([movement(0.047), movement(-0.02)], [response(), response()])
    assert found == pytest.approx([0.047, -0.02], abs=0.002)


def test_motors_that_lead_the_rods_are_no_error_of_the_model() -> None:
    """A right calibration was refused where currents began 150 ms before the rods moved."""
    led = [movement(0.15, clocked=True), movement(0.151, clocked=True)]
    assert onset_shifts(led, [response()] * 2) == pytest.approx(0.15, abs=0.002)
    even = [movement(0.003, clocked=True), movement(-0.004, clocked=True)]
    assert not onset_shifts(even, [response()] * 2).any()


@pytest.mark.parametrize(("late", "lead"), [(0.012, 0.0), (0.018, 0.018)])
def test_a_lead_is_more_than_chance_leaves_of_onsets(late: float, lead: float) -> None:
    """Currents mark each onset to 5 ms: three times that is none."""
    found = onset_shifts([movement(late, clocked=True)] * 2, [response()] * 2)
    assert found == pytest.approx(lead, abs=0.001)


def test_a_mark_is_kept_where_forces_say_little() -> None:
    """With E, the sum of (slope / 1 % of the peak)^2, E / (E + (50 ms)^-2) of it is found."""
    moved = movement(0.04)
    slow = 2000.0 + 10.0 * np.clip(TIME - 0.04, 0.0, None)
    moved = replace(moved, signals=(replace(moved.signals[0], values=slow),))
    model = replace(response(), drive_force={"1": 2000.0 + 10.0 * np.clip(CELLS - 1.0, 0.0, None)})
    bins = int(np.sum((TIME > 0.0) & (TIME <= 3.0)))
    evidence = bins * (10.0 / (0.01 * slow.max())) ** 2
    expected = 0.04 * evidence / (evidence + 0.05**-2)
    assert 0.002 < expected < 0.02
    assert onset_shifts([moved], [model]) == pytest.approx(expected, rel=0.1)


def test_an_object_that_is_touched_sooner_than_thought_says_nothing_of_the_onset() -> None:
    loaded = movement(0.047, size=0.013)
    sooner = loaded.signals[0].values + 3000.0 * np.clip(TIME - 1.46, 0.0, None)
    spoiled = replace(loaded, signals=(replace(loaded.signals[0], values=sooner),))
    # By the model it is touched 1.5 s after the onset, which is 47 ms after the mark.
    found = onset_shifts([spoiled], [response(contact=2.5)])
    assert found == pytest.approx(0.047, abs=0.003)


def test_a_motor_current_is_believed() -> None:
    assert onset_shifts([movement(0.047, clocked=True)], [response()]) == 0.0


def test_what_an_object_does_tells_nothing_of_the_onset() -> None:
    loaded = movement(0.047, size=0.013)
    late = loaded.signals[0].values + 3000.0 * np.clip(TIME - 1.5, 0.0, None)
    spoiled = replace(loaded, signals=(replace(loaded.signals[0], values=late),))
    assert onset_shifts([spoiled], [response(contact=2.5)]) == pytest.approx(0.047, abs=0.003)


def test_a_movement_that_touches_at_once_takes_the_median_of_its_like() -> None:
    movements = [movement(0.04), movement(0.05), movement(0.06), movement(0.3, size=0.013)]
    found = onset_shifts(movements, [response()] * 3 + [response(contact=1.1)])
    assert found[3] == pytest.approx(0.05, abs=0.002)
    assert onset_shifts(movements[3:], [response(contact=1.1)]) == 0.0


def test_a_standing_force_before_the_first_instant_is_no_step() -> None:
    """Openings of a panel whose rods press at rest were shifted by 70 ms, and refused."""
    soon = np.arange(0.002, 4.0, 0.004)
    standing = 3000.0 - force(soon - 0.2)
    opened = replace(
        response(), time=soon, drive_force={"1": standing},
        object_force=np.zeros(soon.size), onsets={"opening": 0.2},
    )  # fmt: skip
    moved = movement(0.0)
    off = 3000.0 - 1.02 * force(TIME)  # a model that is a little off tolerates a shift
    moved = replace(moved, direction="opening", signals=(replace(moved.signals[0], values=off),))
    assert onset_shifts([moved], [opened]) == pytest.approx(0.0, abs=0.01)
