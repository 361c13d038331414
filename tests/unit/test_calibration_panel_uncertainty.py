"""Stated uncertainties of a panel in the intervals of a fit."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, MadeUp, alike, misfit

from turnout.calibration.advice import check_shares, panel_column, panel_doubt_lines, stated_shares
from turnout.calibration.covariance import spread_of
from turnout.calibration.evaluate import Response, ThrowInputs
from turnout.calibration.fit import fit
from turnout.calibration.stages import free_parameter
from turnout.core.errors import PanelError, SolverError
from turnout.panel.load import load_panel

PANEL = load_panel("sb1")
GRAVITY = PANEL.gravity


class Heavy(MadeUp):
    """Friction acts with the weight; a panel half as heavy again cannot be simulated."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        weights = [
            float(str(throw.overrides.get("gravity", GRAVITY))) / GRAVITY for throw in throws
        ]
        pairs = zip(throws, weights, strict=True)
        heavy = [
            replace(
                throw,
                overrides={**throw.overrides, "mu": weight * float(str(throw.overrides["mu"]))},
            )
            for throw, weight in pairs
        ]
        return [
            replace(item, failure="too heavy") if weight > 1.4 else item
            for item, weight in zip(super().responses(heavy), weights, strict=True)
        ]


def test_a_weight_that_friction_imitates_widens_its_interval_and_nothing_else() -> None:
    whole = misfit(alike(4, seed=7))
    whole.evaluator = Heavy(PANEL)
    found = fit(whole, PARAMETERS, TRUE)
    plain = spread_of(found)
    column = panel_column(found, "gravity", 0.05)
    wide = spread_of(found, of_panel=[column])
    mu, k = (np.array(item.deviations) for item in (plain, wide))
    assert k[0] == pytest.approx(np.hypot(mu[0], 0.05 * found.values["mu"]), rel=0.02)
    assert k[1] == pytest.approx(mu[1], rel=0.02)
    (line,) = panel_doubt_lines(found, {"gravity": column}, {"gravity": 0.05})
    assert line.startswith("gravity known to ± 5 %: moves mu by 5")
    with pytest.raises(SolverError, match="gravity ± 50 %: .* too heavy; state less"):
        panel_column(found, "gravity", 0.5)


@pytest.mark.parametrize("text", ["gravity", "gravity=3", "gravity=200 %", "gravity=0 %"])
def test_what_is_no_share_is_refused(text: str) -> None:
    with pytest.raises(PanelError, match="must be KEY=SHARE"):
        stated_shares(["material.density=3 %", text])


def test_an_unknown_key_and_one_that_is_fitted_are_refused_together() -> None:
    fitted = [free_parameter(PANEL, "drive.1.stiffness")]
    with pytest.raises(PanelError) as refused:
        check_shares({"gravty": 0.01, "drive.1.stiffness": 0.02, "gravity": 0.03}, PANEL, fitted)
    assert len(refused.value.problems) == 2
    assert "is fitted itself" in refused.value.problems[0]
