"""Movements of a panel in the order of time, and the spans between them."""

import numpy as np

from turnout.panel.load import load_panel
from turnout.throw.route import closed_spans, throws, wants_closed


def test_changed_movements_and_drives_are_seen() -> None:
    panel = load_panel("sb1")
    before = throws(panel)
    assert throws(panel.with_overrides({"chair.friction_coefficient": 0.3})) == before
    later = throws(panel.with_overrides({"movement.return.duration": 2.5}))
    assert later[1].end - later[1].start > 2.5 - 1e-9
    assert later[0] == before[0]
    assert later[1] != before[1]


def test_a_movement_lasts_until_the_next_one() -> None:
    first, last = throws(load_panel("sb1"))
    assert (first.until, last.until) == (last.start, float("inf"))
    assert first.end < last.start


def test_spans_between_onsets_are_all_instants() -> None:
    panel = load_panel("sb1")
    first, second = throws(panel)
    time = np.array([first.start - 0.5, first.start, first.end, second.start, second.end])
    starts, closes, opens = closed_spans(panel, time)
    assert (starts[:2], closes[:2], opens[:2]) == ((0, 1), (1, 3), (3, 5))
    assert (starts[2], closes[2], opens[2]) == (False, True, False)
    closed = wants_closed(panel, time, np.array([first.start, second.start]))
    assert closed.tolist() == [False, True, True, False, False]
    early = closed_spans(panel, time[:1])
    assert [span for span in early if span[1] > span[0]] == [(0, 1, False)]
