"""Gaps along the rails, whose rows are kept for the throws that follow."""

import numpy as np

from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate


def test_gaps_are_right_when_the_object_changes_its_rail() -> None:
    """An object adds coordinates to its rail, which moves the other rails among them."""
    panel = load_panel("sb2")
    scheme = Scheme.of("quick")
    places = ["sleeper 5", "x = 2.57 m", "sleeper 5", "x = 3.31 m"]

    def gaps(place: str, rail: str) -> np.ndarray:
        thing = ForeignObject(0.004, place, rail=rail)
        return simulate(panel, foreign_object=thing, scheme=scheme)["gap"].to_numpy()

    found = [gaps(place, rail) for place in places for rail in panel.rail]
    assert all(np.isfinite(gap).any() for gap in found)
    np.testing.assert_array_equal(found[0], found[4])  # the same throw after others
    np.testing.assert_array_equal(found[1], found[5])
