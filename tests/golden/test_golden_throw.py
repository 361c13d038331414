"""Against our own stored figures, rtol 1e-8; what nature says is tested elsewhere."""

import json
from functools import cache

import numpy as np
import pytest
from tests.golden.make import FILE, case, figures

STORED: dict[str, list[float]] = json.loads(FILE.read_text(encoding="utf-8"))


@cache
def computed() -> dict[str, list[float]]:
    return figures(case())


def test_the_same_figures_are_kept() -> None:
    assert set(computed()) == set(STORED)


@pytest.mark.parametrize("name", sorted(STORED))
def test_figures_have_not_moved(name: str) -> None:
    largest = max(abs(value) for value in STORED[name])
    np.testing.assert_allclose(computed()[name], STORED[name], rtol=1e-8, atol=1e-8 * largest)
