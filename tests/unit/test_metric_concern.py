"""Warnings after a throw: each with a run that has its cause, and one that has not."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb2_panel
from tests.unit.test_throw_simulate import interrupted

from turnout.metric.panel_check import concerns
from turnout.throw.simulate import simulate


def whats(dataset: xr.Dataset) -> list[str]:
    return [concern.what for concern in concerns(dataset)]


@pytest.fixture(scope="module")
def thrown() -> xr.Dataset:
    """SB2 as published: the opening throw is near its slip level and leaves a narrow flangeway."""
    return simulate(sb2_panel())


@pytest.fixture(scope="module")
def sound() -> xr.Dataset:
    """Less friction, more travel at Drive 2 when it opens, a limit that this keeps."""
    changes = {
        "chair.friction_coefficient": 0.2,
        "drive.2.over_travel_open": 0.005,
        "flangeway.limit": 0.05,
    }
    return simulate(sb2_panel().with_overrides(changes))


def test_a_sound_panel_has_no_concerns(sound: xr.Dataset) -> None:
    assert concerns(sound) == []


def test_a_drive_near_its_slip_level(thrown: xr.Dataset) -> None:
    (concern,) = [item for item in concerns(thrown) if "slip" in item.what]
    largest = -float(thrown["drive_force"].sel(drive="2").min())
    assert concern.where == "drive 2 at x = 6.9 m, opening"
    assert f"{largest / 1e3:.2f} of 6 kN" in concern.number
    assert "at least 10 % wanted" in concern.number
    assert "less friction" in concern.remedy


def test_either_direction_counts(sound: xr.Dataset) -> None:
    changed = sound.copy(deep=True)
    late = changed["time"].values > 7.0
    changed["drive_force"].loc[{"drive": "1"}][late] = 6020.0
    changed["drive_slipping"].loc[{"drive": "1"}][late] = True
    (concern,) = concerns(changed)
    assert concern.where == "drive 1 at x = 0.3 m, closing"
    assert "nothing left" in concern.number


def test_a_narrow_flangeway(thrown: xr.Dataset) -> None:
    (concern,) = [item for item in concerns(thrown) if "flangeway" in item.what]
    least = float(thrown["least_flangeway"])
    assert concern.number.startswith(f"{1e3 * least:.2f} of min 58 mm, ")
    assert f"x = {float(thrown['least_flangeway_x']):g} m" in concern.where
    assert "stroke" in concern.remedy


def test_chairs_that_never_carry() -> None:
    """Chairs 5 and 6 stand 5 mm low, under both rails."""
    changes = {
        "chair.5.clearance": 0.005,
        "chair.6.clearance": 0.005,
        "chair.friction_coefficient": 0.2,
        "flangeway.limit": 0.03,
    }
    dataset = simulate(sb2_panel().with_overrides(changes))
    found = concerns(dataset)
    assert {item.what for item in found} == {"chair never carries"}
    assert [item.where for item in found] == [
        f"chair {chair} under rail {rail} at x = {x} m"
        for rail in "AB"
        for chair, x in (("5", 2.4), ("6", 3))
    ]
    assert "chair.5.clearance" in found[0].remedy


def test_a_rail_without_a_chair_is_no_concern(sound: xr.Dataset) -> None:
    changed = sound.copy(deep=True)
    changed["chair_normal_force"].loc[{"rail": "A", "chair": "5"}] = np.nan
    assert concerns(changed) == []


def test_a_run_that_ended_early_is_reported_first() -> None:
    assert whats(interrupted())[0] == "throw not complete"
    assert whats(interrupted().isel(time=slice(0, 0))) == ["throw not complete"]


def test_an_object_of_the_panel_itself_is_reported() -> None:
    changes = {
        "object.stone": {"size": 0.013, "at": "sleeper 6"},
        "chair.friction_coefficient": 0.1,
        "flangeway.limit": 0.03,
    }
    assert whats(simulate(sb2_panel().with_overrides(changes))) == ["thrown with an object"]
