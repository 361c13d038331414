"""Bilinear bushing between a marker and a held mass: marker work is the area under its curve.

Reference: two springs in series, one of them bilinear, in closed form. A cycle of the elastic
bushing gives all work back; with a foot the loop encloses the friction work. Tolerance 1e-4 for the
inertia of a light mass moved slowly, 1e-6 for the energy residual.
"""

import numpy as np
import pytest
from tests.verification.hand_made import (
    energy_residual,
    hand_made,
    linear_spring,
    run,
    smooth_ramp,
)

from turnout.law.table import LawTableBuilder
from turnout.solver.integration import History

STIFF, SOFT, BEND, HOLD = 7.5e5, 2e4, 0.0077, 3e5
SLIP_FORCE = STIFF * BEND


def held_mass(reach: float, *, cycles: bool, feet: bool = False) -> History:
    """Move the marker to `reach` and, in a cycle, to -`reach` and back to `reach`."""
    laws = LawTableBuilder()
    laws.add_piecewise(
        0,
        breakpoints=np.array([-BEND, BEND]),
        slopes=np.array([SOFT, STIFF, SOFT]),
        input_index=0,
        base_segment=1,
    )
    linear_spring(laws, 0, HOLD)
    if feet:
        normal = laws.add_contact(1, stiffness=1e6, clearance=0.0, base_closed=True)
        laws.add_friction(0, normal=normal, friction_coefficient=0.3, stick_stiffness=1e7)

    def marker(t: np.ndarray) -> np.ndarray:
        there = reach * smooth_ramp(t, start=0.0, end=2.0)
        if not cycles:
            return there
        away = 2 * reach * smooth_ramp(t, start=2.0, end=6.0)
        return there - away + 2 * reach * smooth_ramp(t, start=6.0, end=10.0)

    mechanism = hand_made(laws, mass=[0.1, 1.0], load=[0.0, 2000.0])
    if not feet:
        mechanism = hand_made(laws, mass=[0.1])
    return run(mechanism, marker, end=10.0 if cycles else 2.0)


def static_force(marker: np.ndarray) -> np.ndarray:
    """Drive force for a marker position: first both springs in series, then the soft branch."""
    series = STIFF * HOLD / (STIFF + HOLD)
    bend = SLIP_FORCE / series
    soft = SOFT * HOLD / (SOFT + HOLD)
    size = np.abs(marker)
    force = np.where(size < bend, series * size, SLIP_FORCE + soft * (size - bend))
    return np.sign(marker) * force


@pytest.mark.parametrize("reach", [0.02, 0.08])
def test_force_and_marker_work_follow_the_bilinear_curve(reach: float) -> None:
    history = held_mass(reach, cycles=False)
    marker = history.inputs[:, 0]
    expected = static_force(marker)
    np.testing.assert_allclose(
        -history.law_force[:, 0], expected, rtol=0, atol=1e-4 * expected.max()
    )
    fine = np.linspace(0, reach, 20001)
    area = np.trapezoid(static_force(fine), fine)
    assert history.ledger[-1, 0] == pytest.approx(area, rel=1e-4)
    stored = history.stored[-1] - history.stored[0]
    assert stored[2] == pytest.approx(area, rel=1e-3)  # bushing and holding spring are laws
    slipping = np.any(np.abs(marker - history.g[:, 0]) > BEND)
    assert slipping == (reach > 0.05)
    assert energy_residual(history) < 1e-6


def test_an_elastic_cycle_gives_the_work_back() -> None:
    history = held_mass(0.08, cycles=True)
    start = int(np.argmin(np.abs(history.time - 2.0)))
    work = history.ledger[:, 0]
    assert np.ptp(work[start:]) > 100.0
    assert abs(work[-1] - work[start]) < 1e-4 * np.ptp(work[start:])
    assert energy_residual(history) < 1e-6


def test_a_cycle_with_a_foot_encloses_the_friction_work() -> None:
    """The mass slips 2 s each way; the loop is 4 mu N s less the stick spring's share."""
    history = held_mass(0.08, cycles=True, feet=True)
    limit = 0.3 * 2000.0
    start = int(np.argmin(np.abs(history.time - 2.0)))
    x = history.g[start:, 0]
    area = 4 * limit * (0.5 * np.ptp(x) - limit / 1e7)
    friction_work = history.ledger[-1, 1] - history.ledger[start, 1]
    assert friction_work == pytest.approx(area, rel=1e-3)
    marker_work = history.ledger[-1, 0] - history.ledger[start, 0]
    assert marker_work == pytest.approx(area, rel=5e-3)
    force, marker = -history.law_force[start:, 0], history.inputs[start:, 0]
    assert np.trapezoid(force, marker) == pytest.approx(marker_work, rel=1e-4)
    assert energy_residual(history) < 1e-6
