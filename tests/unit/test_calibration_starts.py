"""Where a fit starts whose stages were skipped."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration import starts
from turnout.calibration.fit import fit
from turnout.calibration.misfit import Misfit
from turnout.calibration.starts import starts_of, with_movements

GRID = (1e5, 3e5, 9e5, 2.7e6)


def test_a_skipped_stage_starts_at_the_best_of_its_grid() -> None:
    whole = misfit([movement("m", rng=np.random.default_rng(0))])
    far = {**TRUE, "k": 2.7e6}
    first, *_ = starts_of(whole, [(PARAMETERS[1], GRID)], PARAMETERS, far)
    assert first == {**TRUE, "k": 9e5}
    assert starts_of(whole, [], PARAMETERS, far) == [far]
    assert starts_of(whole, [(PARAMETERS[1], GRID)], PARAMETERS[:1], far) == [far]


def test_of_several_starts_the_one_that_leaves_least_is_gone_on_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = misfit([movement("m", rng=np.random.default_rng(0))])

    def where_it_starts(
        misfit: Misfit, _: object, values: Mapping[str, float], **__: object
    ) -> Any:
        there = SimpleNamespace(simulated=misfit.responses([values])[0])
        return SimpleNamespace(misfit=misfit, local=there, values=values)

    monkeypatch.setattr(starts, "fit", where_it_starts)
    wrong, near = {**TRUE, "k": 2.7e6}, {**TRUE, "k": 8e5}
    for order in ([wrong, near], [near, wrong]):
        assert starts.nearest_fit(whole, PARAMETERS, order).values == near


def test_movements_that_join_a_fit_are_thrown_at_their_own_values() -> None:
    owns = (0.0, 0.03, -0.04)
    rng = np.random.default_rng(4)
    measured = [movement(f"m{n}", rng=rng, own=own) for n, own in enumerate(owns)]
    few, whole = misfit(measured[:2]), misfit(measured)
    near = fit(few, PARAMETERS, TRUE, rough=True)
    assert with_movements(near, few.movements) is near
    joined = with_movements(near, whole.movements)
    assert joined.misfit.movements == whole.movements
    # As far as the noise of a rough fit lets them.
    effects = np.array(joined.misfit.effects["mu"])
    np.testing.assert_allclose(effects - effects[0], owns, atol=0.015)
    assert np.all(np.abs(effects[1:] - effects[0]) > 0.015)
