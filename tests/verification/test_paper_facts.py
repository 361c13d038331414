"""Facts a to f of the paper on the default panel; limits and sources: see `facts`."""

from functools import partial

import numpy as np
import pytest
from tests.verification.facts import ALL, FRICTIONS, STIFFNESSES, least_size, slopes
from tests.verification.runs import DEFAULT, energy_balance, throw

from turnout.calibration.matching.measures import FLUTTER_CUTOFF
from turnout.metric.panel_check import flutter_concerns
from turnout.panel.load import load_panel


@pytest.mark.parametrize("fact", ALL, ids=lambda fact: fact.__name__)
def test_fact(fact, monkeypatch: pytest.MonkeyPatch):
    """Flutter with the modes up to a cut-off; with all of them in the long job."""
    quick = partial(flutter_concerns, cutoff_frequency=FLUTTER_CUTOFF)
    monkeypatch.setattr("turnout.metric.panel_check.flutter_concerns", quick)
    failed = [str(check) for check in fact() if not check.passed]
    assert not failed, "\n".join(failed)


@pytest.mark.long
def test_no_mode_flutters():
    assert flutter_concerns(load_panel(DEFAULT)) == []


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


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_size_seen_grows_with_friction_where_drive_2_is_not_pressed_home(share: float) -> None:
    found = [least_size(share, friction) for friction in FRICTIONS]
    sizes = [item.size for item in found]
    assert np.all(np.diff(sizes) >= 0)
    assert sizes[-1] >= sizes[0] + 3


def test_it_does_not_where_the_closing_force_presses_drive_2_home() -> None:
    """At 0.1 and 0.2 the rail lies on its stock rail at Drive 2, which then shares the force."""
    found = [least_size(1.0, friction) for friction in FRICTIONS]
    assert [item.gap < 0.05 for item in found] == [True, True, False, False, False]
    sizes = [item.size for item in found]
    assert sizes[1] > sizes[2]
    assert np.all(np.diff(sizes[2:]) > 0)


def test_only_the_filtered_slope_can_be_the_papers() -> None:
    """A slip level of 6 kN, averaged over 0.1 s, rises by 60 kN/s at most."""
    stiff, paper = 7500e3, STIFFNESSES[7500e3]
    feature, plain = slopes(stiff)
    assert feature == pytest.approx(paper, rel=0.3)
    assert plain > 2.5 * paper
    assert feature < 60.0
