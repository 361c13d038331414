"""What refinements of the default panel change, and that the model is fine enough to say so.

Reference: an independent study of these dimensions: rigid stock rails change Drive 2 by 0.1 to 3 %
with an object. A table with the outlines' numbers is the same panel. Tolerances: a rail keeps at
most 20 % of its degrees of freedom; doubling either cut-off moves end forces by less than 0.1 %.
"""

from functools import cache

import numpy as np
import pytest
from benchmarks.studies.effects import (
    DEFAULT,
    RADIUS,
    Figures,
    figures,
    rigid_stock_rails,
    run,
    studied,
    tabulated,
)

from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.load import LoadedPanel

PANEL = studied(DEFAULT)


@cache
def end(size: float | None) -> Figures:
    return figures(run(PANEL, size))


def change(panel: LoadedPanel, size: float | None, *, scheme: Scheme | None = None) -> np.ndarray:
    """Return how end forces of the drives change from those of the default panel, relative."""
    found = figures(run(panel, size, scheme=scheme))
    reference = end(size)
    return np.array([found.drive_1 / reference.drive_1 - 1, found.drive_2 / reference.drive_2 - 1])


def test_a_table_with_the_numbers_of_the_outlines_is_the_same_panel() -> None:
    np.testing.assert_allclose(change(tabulated(), 13), 0.0, atol=1e-9)


def test_stock_rails_that_bend_matter_as_much_as_the_study_found() -> None:
    first, second = np.abs(change(rigid_stock_rails(), 13))
    assert 0.001 < second < 0.03
    assert first < 0.03


def test_unsymmetry_lifts_chairs_and_loads_others() -> None:
    large = end(29)
    assert 3 <= large.lifted <= 7
    assert 600.0 < large.chair < 750.0


def test_a_curve_of_760_m_does_next_to_nothing_but_something() -> None:
    curve = {"rail.curved.curve_radius": RADIUS, "stock_rail.curved.curve_radius": RADIUS}
    changed = np.abs(change(PANEL.with_overrides(curve), 13))
    assert np.all(changed < 1e-4)
    assert np.any(changed > 0.0)


def test_rails_keep_a_fifth_of_their_coordinates_at_most() -> None:
    for body in build_mechanism(PANEL).rails:
        assert body.count <= 0.2 * body.n_full, body.name


@pytest.mark.parametrize("size", [None, 13])
def test_doubling_the_cutoff_of_superelements_or_steps_changes_nothing(size: float | None) -> None:
    cutoff = PANEL.discretisation.superelement_cutoff
    finer = PANEL.with_overrides({"discretisation.superelement_cutoff": 2 * cutoff})
    assert np.abs(change(finer, size)).max() < 1e-3
    doubled = Scheme(cutoff_frequency=2 * Scheme().cutoff_frequency)
    assert np.abs(change(PANEL, size, scheme=doubled)).max() < 1e-3
