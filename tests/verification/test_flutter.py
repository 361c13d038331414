"""Flutter by friction: complex modes against a closed form and against the time integration."""

import numpy as np
import pytest
from tests.verification.flutter import (
    CRITICAL,
    exact_eigenvalues,
    left_with_dashpots,
    mass_on_plate,
    predicted,
    slide,
    unsymmetric_panel,
)

from turnout.metric.sliding import complex_modes, steady_sliding
from turnout.metric.stability import friction_stability
from turnout.solver.condense import condense

NONE = np.zeros(0)


@pytest.mark.parametrize("share", [0.2, 0.9, 1.2, 2.0])
@pytest.mark.parametrize("cutoff", [1e6, 90.0])
def test_mass_on_a_plate_has_its_closed_eigenvalues(share: float, cutoff: float) -> None:
    mechanism = mass_on_plate(share * CRITICAL)
    model = condense(mechanism, cutoff_frequency=cutoff)
    state = steady_sliding(mechanism, model, inputs=NONE, sense=1.0)
    assert state.settled
    found = complex_modes(model, state.coupling).eigenvalues
    exact = exact_eigenvalues(share * CRITICAL)
    if cutoff > 100.0:
        found = found[np.lexsort((found.real, np.round(np.abs(found), 6)))]
        np.testing.assert_allclose(found, exact, rtol=1e-9)
    else:  # one of two modes: nothing can merge, which a cut-off must not be trusted to show
        assert found.size == 1
        assert found.real[0] < 0


@pytest.mark.parametrize(("share", "grows"), [(0.999, False), (1.001, True)])
def test_mass_flutters_from_its_critical_friction_on(share: float, grows: bool) -> None:
    mechanism = mass_on_plate(1.0, dashpot=0.0)
    model = condense(mechanism, cutoff_frequency=1e6)
    state = steady_sliding(
        mechanism, model, inputs=NONE, sense=1.0, friction_factor=share * CRITICAL
    )
    growth = complex_modes(model, state.coupling).growth_rate
    assert (growth.max() > 1e-2) == grows


def test_mass_that_slides_the_other_way_is_stable() -> None:
    mechanism = mass_on_plate(2.0 * CRITICAL)
    model = condense(mechanism, cutoff_frequency=1e6)
    state = steady_sliding(mechanism, model, inputs=NONE, sense=-1.0)
    assert complex_modes(model, state.coupling).growth_rate.max() < 0


def test_unsymmetric_section_flutters_without_dashpots_and_not_with_them() -> None:
    bare = unsymmetric_panel(friction=0.4, dashpot="0 N s/m")
    bad = friction_stability(bare, friction_factor=1.25)
    assert not bad.stable
    assert 120.0 < bad.worst.frequency < 128.0
    cases = {(case.to, case.share): case for case in bad.cases}
    assert cases["open", 0.7].frequency == pytest.approx(98.0, abs=0.5)
    assert cases["open", 0.7].growth_rate == pytest.approx(13.0, rel=0.05)
    mended = unsymmetric_panel(friction=0.4, dashpot="3.75 kN s/m")
    assert friction_stability(mended, friction_factor=1.25).stable


def test_flutter_grows_in_time_as_predicted() -> None:
    run = slide("0 N s/m")
    assert run.history.outcome.complete
    (frequency, rate), (seen, grown) = predicted(), run.found()
    assert grown > 7.0
    assert seen == pytest.approx(frequency, rel=5e-3)
    assert grown == pytest.approx(rate, rel=0.1)


def test_flutter_in_time_is_gone_with_the_dashpots() -> None:
    assert left_with_dashpots() < 0.02
