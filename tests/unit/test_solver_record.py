"""Records of runs: the same whichever way they go to memory."""

import pytest

from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.solver import record
from turnout.solver.integration import History
from turnout.throw.simulate import solve

STORED = ("q", "g", "law_force", "friction_force")


def test_records_through_the_caches_and_past_them_are_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    panel, foreign = load_panel("sb1"), ForeignObject(0.013, "drive 1")

    def history(least: int, most: int) -> History:
        monkeypatch.setattr(record, "LEAST_CACHED", least)
        monkeypatch.setattr(record, "MOST_CACHED", most)
        return solve(panel, foreign_object=foreign, scheme=Scheme.of("quick")).history

    near, past = history(0, 2**40), history(1, 0)
    for name in STORED:
        assert getattr(near, name).tobytes() == getattr(past, name).tobytes()
