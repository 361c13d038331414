"""Where a fit starts whose stages were skipped."""

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration.starts import nearest_fit, starts_of

GRID = (1e5, 3e5, 9e5, 2.7e6)


def test_a_skipped_stage_starts_at_the_best_of_its_grid() -> None:
    whole = misfit([movement("m", rng=np.random.default_rng(0))])
    far = {**TRUE, "k": 2.7e6}
    first, *_ = starts_of(whole, [(PARAMETERS[1], GRID)], PARAMETERS, far)
    assert first == {**TRUE, "k": 9e5}
    assert starts_of(whole, [], PARAMETERS, far) == [far]
    assert starts_of(whole, [(PARAMETERS[1], GRID)], PARAMETERS[:1], far) == [far]


def test_of_several_starts_the_one_that_leaves_least_is_gone_on_with() -> None:
    whole = misfit([movement("m", rng=np.random.default_rng(0))])
    wrong, right = {**TRUE, "k": 1e7}, {**TRUE, "k": 8e5}
    # Beyond the saturation nothing says which way to go.
    found = nearest_fit(whole, PARAMETERS, [wrong, right], (1.0,))
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=0.05)
