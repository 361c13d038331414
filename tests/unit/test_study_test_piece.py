"""The test piece at a drive: seen by one lock rule and not by the other, with the run's forces."""

from pathlib import Path

import pytest
from tests.unit.simulated import sb2_panel

from turnout.core.errors import PanelError
from turnout.metric.test_piece import RESOLUTION, check_piece, least_piece
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import library_text, load_panel
from turnout.throw.simulate import simulate


def test_a_small_piece_is_not_seen_by_slip() -> None:
    """The forces are those of the same object in a plain simulation."""
    result = check_piece(sb2_panel(), "1")
    plain = simulate(sb2_panel(), foreign_object=ForeignObject(0.005, "drive 1"))
    end = plain.isel(time=-1)
    assert result.size == sb2_panel().lock.gap_limit == 0.005
    assert not result.seen
    assert result.drive_force == float(end["drive_force"].sel(drive="1"))
    assert result.piece_force == float(end["object_force"]) > 0
    assert result.gap == float(end["end_gap"].sel(drive="1"))
    late = plain["drive_force"].where(plain["object_force"] > 0)
    assert result.largest_force == float(abs(late).max())


def test_a_thick_piece_makes_the_drive_slip() -> None:
    result = check_piece(sb2_panel(), "2", size=0.02)
    assert result.seen
    assert result.largest_force >= 6000.0


def test_the_raw_gap_sees_a_piece_that_slip_does_not() -> None:
    panel = sb2_panel().with_overrides({"lock.rule": "raw gap"})
    assert check_piece(panel, "1", size=0.0075).seen
    assert not check_piece(sb2_panel(), "1", size=0.0075).seen


def test_a_piece_is_judged_once_its_movement_is_over(tmp_path: Path) -> None:
    """A schedule that opens again after closing: the open end says nothing about the piece."""
    again = """
[movement.again]
start = "8.6 s"
duration = "3 s"
to = "open"
shape = "smoothstep"
"""
    text = library_text("sb2").replace('end = "8.5 s"', 'end = "12 s"')
    assert 'end = "12 s"' in text
    path = tmp_path / "again.toml"
    path.write_text(text + again, encoding="utf-8")
    longer, once = check_piece(load_panel(path), "2"), check_piece(sb2_panel(), "2")
    assert longer.gap == pytest.approx(once.gap, rel=1e-3)
    assert longer.drive_force == pytest.approx(once.drive_force, rel=1e-3)


def test_a_piece_without_room_has_no_result() -> None:
    """It is as thick as the estimate of the opening allows, more than the bushing leaves."""
    result = check_piece(sb2_panel(), "2", size=0.0775)
    assert result.fault.startswith("the piece does not fit")


def test_a_piece_larger_than_the_opening_is_refused() -> None:
    with pytest.raises(PanelError, match="larger than the opening"):
        check_piece(sb2_panel(), "2", size=0.2)


@pytest.mark.parametrize(
    ("limit", "rule", "by"), [(0.005, "slip or gap", "slip"), (0.002, "slip or gap", "gap")]
)
def test_the_least_piece_is_refused_and_one_a_tenth_smaller_is_not(
    limit: float, rule: str, by: str
) -> None:
    changes = {"lock.rule": rule, "drive.2.gap_limit": limit}
    panel = load_panel("uic60-760-1-15", overrides=changes)
    seen: list[tuple[int, int]] = []
    least = least_piece(panel, "2", report=lambda done, throws: seen.append((done, throws)))
    assert (least.fault, least.by) == ("", by)
    assert check_piece(panel, "2", size=least.size).seen
    assert not check_piece(panel, "2", size=least.size - RESOLUTION).seen
    assert all(0 < done <= throws for done, throws in seen)


def test_a_panel_that_never_locks_or_never_refuses_has_no_least_piece() -> None:
    never = load_panel("uic60-760-1-15", overrides={"drive.2.gap_limit": 1e-3})
    assert "without a piece" in least_piece(never, "2").fault
    strong = {"drive.saturation_force": 60e3, "lock.rule": "no slip"}
    always = least_piece(load_panel("uic60-760-1-15", overrides=strong), "1")
    assert (always.size, always.by) == (float("inf"), "")
