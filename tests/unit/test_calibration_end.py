"""The end of a fit: finer throws, the uncertainty that they leave, and slopes thrown once."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement, response

from turnout.calibration import evaluate
from turnout.calibration.covariance import spread_of
from turnout.calibration.evaluate import Evaluator, Response, ThrowInputs
from turnout.calibration.fit import Fit, fit
from turnout.calibration.misfit import Refined
from turnout.calibration.result_entries import warnings_from
from turnout.core.errors import MeasurementError
from turnout.core.scheme import Scheme
from turnout.panel.load import LoadedPanel, load_panel

NONE = np.zeros(0)
FAILED = Response(
    time=NONE, drive_force={}, object_force=NONE, onsets={}, failure="it did not close"
)


@pytest.fixture(scope="module")
def found() -> Fit:
    """A fit to four movements; no test may change it."""
    measured = [movement(f"m{n}", rng=np.random.default_rng(n)) for n in range(4)]
    return fit(misfit(measured), PARAMETERS, TRUE)


@pytest.fixture(scope="module")
def changed(found: Fit) -> Refined:
    """Finer throws, of which the stiffness is 0.3 % more."""
    coarse, fine = response(found.values), response({**found.values, "k": 1.003 * TRUE["k"]})
    return Refined(plain=coarse, halved=fine, fine=fine)


def ended(found: Fit, *refinement: Refined) -> Fit:
    return replace(found, misfit=replace(found.misfit, refinement=refinement))


def test_no_value_is_surer_than_a_third_of_what_step_and_mesh_change(
    found: Fit, changed: Refined
) -> None:
    before = spread_of(found).coordinate_covariance
    after = spread_of(ended(found, *4 * [changed])).coordinate_covariance
    assert np.sqrt((after - before)[1, 1]) == pytest.approx(0.003 / 3.0, rel=0.05)


def test_the_error_of_the_solver_is_that_of_the_movements_whose_throws_succeeded(
    found: Fit, changed: Refined
) -> None:
    failed = replace(changed, halved=FAILED)
    assert failed.added(changed.plain) is not changed.plain
    there = ended(found, changed, failed, changed, changed)
    spread = spread_of(there)
    # The scale of the error is common: three movements show three quarters of it.
    widened = (spread.coordinate_covariance - spread_of(found).coordinate_covariance)[1, 1]
    assert np.sqrt(widened) == pytest.approx(0.75 * 0.003 / 3.0, rel=0.05)
    assert not [text for text in warnings_from(there, spread) if "finer" in text]


@pytest.mark.parametrize("which", ["plain", "fine"])
def test_a_movement_of_which_nothing_finer_is_known_is_named(
    found: Fit, changed: Refined, which: str
) -> None:
    failed = replace(changed, **{which: FAILED})
    assert failed.added(changed.plain) is changed.plain
    there = ended(found, *3 * [changed], failed)
    spread = spread_of(there)
    assert np.isfinite(spread.intervals).all()
    (said,) = [text for text in warnings_from(there, spread) if "finer" in text]
    last = found.misfit.movements[3]
    assert said.startswith(f"{last.text}: what a finer step and mesh change")
    assert "it did not close" in said


def test_finer_throws_have_half_the_step_and_elements_half_as_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[tuple[float, float, float]] = []

    def solved(panel: LoadedPanel, *, scheme: Scheme, **_: object) -> None:
        seen.append((panel.discretisation.element_length, scheme.step, scheme.cutoff_frequency))
        raise MeasurementError(["enough"], source="test")

    monkeypatch.setattr(evaluate, "solve", solved)
    panel, scheme = load_panel("sb1"), Scheme()
    with Evaluator(panel) as evaluator:
        plain = ThrowInputs(overrides={})
        evaluator.responses([plain, replace(plain, kind="halved"), replace(plain, kind="fine")])
    length, step = panel.discretisation.element_length, scheme.step
    modes = scheme.cutoff_frequency
    assert seen == [
        (length, step, modes),
        (length / 2, step / 2, modes),
        (length / 2, step / 2, 4 * modes),
    ]
    with Evaluator(panel) as evaluator:
        evaluator.responses([plain, replace(plain, kind="quick"), replace(plain, kind="fine")])
    assert len(seen) == 6, "each kind is kept apart"
