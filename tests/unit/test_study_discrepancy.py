"""Laws of a drive as data, and how to choose between them; without any simulation."""

from dataclasses import replace

import numpy as np
import pytest

from turnout.calibration.drive_law.candidates import drive_laws, lagged, table
from turnout.calibration.drive_law.compare import LawComparison, LawResult, law_lines
from turnout.calibration.drive_law.fit_law import criteria
from turnout.calibration.evaluate import Response
from turnout.core.errors import PanelError
from turnout.panel.load import load_panel

PANEL = load_panel("sb1")
VALUES = {"drive.2.stiffness": 800e3, "drive.2.saturation_force": 4e3}


def force_at(extension: float, **law: float) -> float:
    """Return the force of a drive by its table, which must be one that a panel takes."""
    made = table(PANEL, "2", VALUES, **law)
    changed = PANEL.with_overrides(made)
    drive = changed.drive["2"]
    return float(np.interp(extension, drive.extension, drive.force))


def test_play_carries_nothing_and_shifts_the_law() -> None:
    assert abs(force_at(0.0009, backlash=0.002)) <= 1.0
    assert force_at(0.003, backlash=0.002) == pytest.approx(1600.0, rel=1e-3)
    assert force_at(-0.003, backlash=0.002) == pytest.approx(-1600.0, rel=1e-3)
    # Beyond 4 kN the panel's 10 kN/m go on.
    assert force_at(0.106, backlash=0.002) == pytest.approx(5000.0, abs=2.0)


def test_a_rounded_knee_has_a_quarter_of_the_stiffness_before_it_slips() -> None:
    assert force_at(0.003, knee=0.25) == pytest.approx(2400.0)
    assert force_at(0.00375, knee=0.25) == pytest.approx(3000.0)
    assert force_at(0.00475, knee=0.25) == pytest.approx(3200.0)
    assert force_at(0.00875, knee=0.25) == pytest.approx(4000.0)


def response(contact: float) -> Response:
    time = np.arange(0.0, 3.0, 2e-3)
    ramp = 1e3 * np.clip(time - 1.0, 0.0, 1.0)
    return Response(
        time=time,
        drive_force={"1": ramp, "2": ramp + 500.0},
        marker={"1": time, "2": time},
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


def test_a_drive_that_is_not_there_is_refused() -> None:
    with pytest.raises(PanelError, match="drive '3': not in panel sb1"):
        drive_laws(PANEL, "3")


def test_more_parameters_must_pay() -> None:
    plain = criteria(100.0, parameters=3, samples=200.0)
    other = criteria(99.0, parameters=4, samples=200.0)
    assert other[0] > plain[0]
    assert other[1] > plain[1]
    assert criteria(1.0, parameters=9, samples=5.0)[0] == float("inf")


def compared(*gains: float) -> LawComparison:
    """Return a comparison in which other laws are better than the plain one by so much."""
    names = ["bilinear", "scattering slip level", "backlash"]
    results = [
        LawResult(
            name=name,
            text="a law",
            values={"drive.2.saturation_force": 6.9e3},
            scatter={"drive.2.saturation_force": 0.05} if number == 1 else {},
            parameters=3,
            deviance=0.0,
            akaike=500.0 - gain,
            schwarz=500.0 - gain,
        )
        for number, (name, gain) in enumerate(zip(names, (0.0, *gains), strict=True))
    ]
    return LawComparison(
        drive="2", nominal=6e3, movements=("a",), samples=200.0, results=tuple(results)
    )


def test_the_plain_law_is_kept_unless_another_is_decisively_better() -> None:
    assert compared(9.0, -30.0).best.name == "bilinear"
    assert [r.name for r in compared(9.0, -30.0).rejected] == ["backlash"]
    chosen = compared(200.0, 40.0)
    assert chosen.best.name == "scattering slip level"
    assert [r.name for r in chosen.rejected] == ["bilinear", "backlash"]
    text = "\n".join(law_lines(chosen))
    assert "the bilinear law is rejected (BIC 200 higher)" in text
    assert "slips at 6.90 kN, 15.0 % above the stated 6 kN, scattering by 5.0 %" in text
    assert "no other law is decisively better" in law_lines(compared(9.0, -30.0))[0]


def test_what_is_too_little_to_matter_is_no_law() -> None:
    found = compared(-20.0, 60.0)
    assert found.best.name == "backlash"
    small = replace(found.results[2], slight=True)
    found = replace(found, results=(*found.results[:2], small))
    assert found.best.name == "bilinear"
    assert "no more than the bilinear law" in law_lines(found)[-2]
