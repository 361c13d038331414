"""Laws of a drive as tables of a panel, and a lag of its force; without any simulation."""

import numpy as np
import pytest

from turnout.calibration.candidate_causes import PLAY_FORCE, bushing, lagged
from turnout.calibration.evaluate import Response
from turnout.panel.load import load_panel

PANEL = load_panel("sb1")
VALUES = {"drive.2.stiffness": 800e3, "drive.2.saturation_force": 4e3}


def force_at(
    extension: float,
    *,
    first: tuple[tuple[float, float], ...] = (),
    softness: float = 0.0,
    knee: float = 0.0,
) -> float:
    """Return the force of a drive by its table, which must be one that a panel takes.

    Over its knee the bushing has a quarter of its stiffness.
    """
    made = bushing(
        PANEL, "2", VALUES, first=first, softness=softness, knee=knee, knee_softness=np.log(4.0)
    )
    drive = PANEL.with_overrides(made).drive["2"]
    return float(np.interp(extension, drive.extension, drive.force))


def test_play_carries_nothing_and_shifts_the_law() -> None:
    play = ((0.001, PLAY_FORCE),)
    assert abs(force_at(0.0009, first=play)) <= 1.0
    assert force_at(0.003, first=play) == pytest.approx(1600.0, rel=1e-3)
    assert force_at(-0.003, first=play) == pytest.approx(-1600.0, rel=1e-3)
    # Beyond 4 kN the panel's 10 kN/m go on.
    assert force_at(0.106, first=play) == pytest.approx(5000.0, abs=2.0)


def test_a_rounded_knee_has_a_quarter_of_the_stiffness_before_it_slips() -> None:
    assert force_at(0.003, knee=0.25) == pytest.approx(2400.0)
    assert force_at(0.00375, knee=0.25) == pytest.approx(3000.0)
    assert force_at(0.00475, knee=0.25) == pytest.approx(3200.0)
    assert force_at(0.00875, knee=0.25) == pytest.approx(4000.0)


def test_a_bushing_goes_on_from_its_first_points_with_a_softness_of_its_own() -> None:
    first = ((0.001, 300.0),)
    assert force_at(0.0005, first=first, softness=np.log(2.0)) == pytest.approx(150.0)
    assert force_at(0.003, first=first, softness=np.log(2.0)) == pytest.approx(300.0 + 2 * 400.0)
    # A knee that would begin below the first point begins there.
    assert force_at(0.002, first=first, knee=0.99) == pytest.approx(300.0 + 200.0)


def response(contact: float) -> Response:
    time = np.arange(0.0, 3.0, 2e-3)
    ramp = 1e3 * np.clip(time - 1.0, 0.0, 1.0)
    return Response(
        time=time,
        drive_force={"1": ramp, "2": ramp + 500.0},
        object_force=ramp,
        onsets={"closing": 0.0},
        contact_time=contact,
    )


def test_a_lag_follows_contact_as_the_closed_form_says() -> None:
    found = lagged(response(1.0), "2", lag=0.25).drive_force["2"]
    time = response(1.0).time
    # The answer of a first-order lag to a ramp from rest.
    since = np.clip(time - 1.0, 0.0, 1.0)
    exact = 500.0 + 1e3 * (since - 0.25 * (1.0 - np.exp(-since / 0.25)))
    ramp = time <= 2.0
    assert found[ramp] == pytest.approx(exact[ramp], abs=2.0)
    other = lagged(response(1.0), "2", lag=0.25).drive_force["1"]
    assert (other == response(1.0).drive_force["1"]).all()


@pytest.mark.parametrize(("contact", "lag"), [(float("nan"), 0.25), (1.0, 0.0), (9.0, 0.25)])
def test_without_contact_or_lag_nothing_changes(contact: float, lag: float) -> None:
    given = response(contact)
    assert lagged(given, "2", lag=lag) is given
