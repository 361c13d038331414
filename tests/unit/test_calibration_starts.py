"""Where a fit starts whose stages were skipped."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration import starts
from turnout.calibration.misfit import Misfit
from turnout.calibration.starts import starts_of

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
        assert starts.nearest_fit(whole, PARAMETERS, order, (1.0,)).values == near
