"""Warnings of a panel check: flutter at its own friction, near it, not at all; test pieces."""

from typing import Any

import pytest
import xarray as xr
from tests.unit.simulated import sb1_dataset, sb1_panel, sb2_panel
from tests.verification.flutter import unsymmetric_panel
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.mechanism.rail_sections import planed_outlines
from turnout.metric.panel_check import (
    Concern,
    concerns,
    file_concerns,
    flutter_concerns,
    panel_concerns,
    piece_concerns,
    planing_concerns,
)
from turnout.metric.stability import FrictionStability, SlidingCase, friction_stability
from turnout.metric.test_piece import PieceLimit
from turnout.panel.load import load_panel
from turnout.panel.model import Panel

NAN = float("nan")


def sliding(
    monkeypatch: pytest.MonkeyPatch, *rows: tuple[float, bool, float], quarter: float = 0.0
) -> list[Concern]:
    """Return concerns where each share of a movement settles or not and grows at a rate [1/s].

    A quarter more friction adds to the rate.
    """

    def found(_panel: Panel, *, friction_factor: float, **_: object) -> FrictionStability:
        more = quarter if friction_factor > 1.0 else 0.0
        cases = tuple(
            SlidingCase("throw", "open", share, settled, 3.0, 0.02, rate + more)
            for share, settled, rate in rows
        )
        return FrictionStability(friction_factor, cases, 600.0)

    monkeypatch.setattr("turnout.metric.panel_check.friction_stability", found)
    return flutter_concerns(sb1_panel())


def test_a_section_that_flutters(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[FrictionStability] = []

    def kept(panel: Panel, **options: Any) -> FrictionStability:
        seen.append(friction_stability(panel, **options))
        return seen[-1]

    monkeypatch.setattr("turnout.metric.panel_check.friction_stability", kept)
    (concern,) = flutter_concerns(unsymmetric_panel(friction=0.5, dashpot="0 N s/m"))
    found = seen[-1]
    assert concern.what == "the section can flutter"
    assert "at the panel's friction" in concern.where
    assert f"'{found.worst.movement}'" in concern.where
    assert f"{found.worst.frequency:.1f} Hz" in concern.number
    assert "chair.damping" in concern.remedy


def test_a_section_that_nearly_flutters(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sliding(monkeypatch, (0.1, True, -0.4)) == []
    (concern,) = sliding(monkeypatch, (0.1, True, -0.4), quarter=0.5)
    assert "at 1.25 times the panel's friction" in concern.where


def test_unknown_is_not_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    (concern,) = sliding(monkeypatch, (0.1, True, -0.4), (0.5, False, NAN))
    assert concern.what == "flutter is not known"
    assert concern.number == "no steady sliding was found in 1 of 2 places"
    assert "50 % of movement 'throw'" in concern.where


def test_steel_that_planing_severs_is_a_warning() -> None:
    """Seated 60 mm high the stock rail's foot cuts through the web: the head stands on nothing."""
    panel = load_panel("uic60-760-1-15", overrides={"planed_section.tongue.seat_height": 0.06})
    (concern,) = planing_concerns(panel)
    assert concern.where == "planed_section.tongue at running_edge_offset 15 mm"
    cut = planed_outlines(panel, "tongue")[5]
    assert cut.running_edge_offset == 0.015
    height = 1e3 * cut.outline.points[:, 1].max()
    assert f"what remains ends {height:.0f} mm above the underside" in concern.number
    assert concern in file_concerns(panel)
    seat = ["uic60-760-1-15", "--set", "planed_section.tongue.seat_height=60 mm"]
    for command in (["check", "--no-throw"], ["sections"]):
        done = CliRunner().invoke(app, ["panel", *command, *seat])
        assert "warning: planing severs a part of the switch rail" in done.output


def test_a_panel_that_never_moves_cannot_flutter() -> None:
    assert flutter_concerns(sb2_panel().model_copy(update={"movement": {}})) == []


def test_all_concerns_are_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    dataset: xr.Dataset = sb1_dataset().assign_attrs(complete=False, outcome_message="stopped")
    monkeypatch.setattr("turnout.metric.panel_check.flutter_concerns", lambda _panel: ["flutter"])
    joined = panel_concerns(sb1_panel(), dataset)
    assert joined == [*concerns(dataset), "flutter"]
    assert len(joined) >= 2


def test_a_piece_as_thick_as_the_limit_must_be_refused() -> None:
    limits = [PieceLimit("1", 5.0e-3, "slip", 15e-3), PieceLimit("2", 5.1e-3, "slip", 15e-3)]
    (concern,) = piece_concerns(sb2_panel(), limits)
    assert concern.where == "drive 2"
    assert concern.number == "refuses to lock from 5.1 mm on, limit 5 mm"
    (concern,) = piece_concerns(sb2_panel(), [PieceLimit("1", float("inf"), "", 15e-3)])
    assert concern.number == "locks on every piece up to 15 mm, limit 5 mm"
    unknown = PieceLimit("1", float("nan"), "", 15e-3, "no room")
    assert piece_concerns(sb2_panel(), [unknown]) == []
