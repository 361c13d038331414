"""Movements are found once for panels that share them, and again where they differ."""

from turnout.panel.load import load_panel
from turnout.response.route import throws


def test_changed_movements_and_drives_are_seen() -> None:
    panel = load_panel("sb1")
    before = throws(panel)
    assert throws(panel.with_overrides({"chair.friction_coefficient": 0.3})) is before
    later = throws(panel.with_overrides({"movement.return.duration": 2.5}))
    assert later[1].end - later[1].start > 2.5 - 1e-9
    assert later[0] == before[0]
    assert later[1] != before[1]


def test_a_movement_lasts_until_the_next_one() -> None:
    first, last = throws(load_panel("sb1"))
    assert (first.until, last.until) == (last.start, float("inf"))
    assert first.end < last.start
