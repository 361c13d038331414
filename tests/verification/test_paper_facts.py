"""Facts a to f of the paper on the default panel; limits and sources: see `facts`."""

import pytest
from tests.verification.facts import ALL
from tests.verification.runs import DEFAULT, energy_balance, throw


@pytest.mark.parametrize("fact", ALL, ids=lambda fact: fact.__name__)
def test_fact(fact):
    failed = [str(check) for check in fact() if not check.passed]
    assert not failed, "\n".join(failed)


def test_books_of_the_default_throw():
    """Residual tests the code, numerical loss the physics: at most 0.5 % on a default throw."""
    for place in (None, "sleeper 6"):
        residual, loss = energy_balance(throw(DEFAULT, place))
        assert residual < 1e-6
        assert loss < 0.005


def test_doubling_the_cutoff_of_the_superelements_changes_nothing():
    coarse = throw(DEFAULT, "sleeper 6")
    fine = throw(DEFAULT, "sleeper 6", overrides=(("discretisation.superelement_cutoff", 1200.0),))
    change = fine["drive_force"][:, -1] / coarse["drive_force"][:, -1] - 1
    assert float(abs(change).max()) < 0.001
