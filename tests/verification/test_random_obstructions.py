"""Random obstructions: every throw completes, with an energy residual below 1e-6 of its scale."""

import pytest
from tests.verification.random_obstructions import throws

from turnout.solver.outcome import CLOSES


@pytest.mark.parametrize("count", [25, pytest.param(500, marks=pytest.mark.long)])
def test_the_energy_of_random_obstructions_balances(count: int) -> None:
    made = throws(count)
    assert [item.text for item in made if item.outcome != "complete"] == []
    assert max(item.residual for item in made) < CLOSES
    assert sum(item.dissipated > 0 for item in made) > count / 3
