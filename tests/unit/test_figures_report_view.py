"""A result in a notebook: findings as text and as HTML, and one picture."""

import re

import pytest
import xarray as xr
from tests.unit.campaigns import made
from tests.unit.simulated import sb2_dataset

from turnout.figures.report.view import view
from turnout.metric.finding import findings
from turnout.throw.store import open_response


def test_a_run_shows_every_finding_and_a_picture() -> None:
    dataset = sb2_dataset()
    shown = view(dataset)
    html = shown._repr_html_()
    for item in findings(dataset):
        assert f"<b>{item.answer}</b>" in html
        assert f"{item.question} {item.answer}: {item.detail}" in repr(shown)
    assert html.count("src='data:image/png;base64,") == 1
    assert "✗" in repr(shown).splitlines()[1]
    assert len(html) < 400_000
    assert not re.search(r"<script|https?://", html)


def test_simulate_still_returns_a_dataset() -> None:
    assert isinstance(view(sb2_dataset()).dataset, xr.Dataset)


def test_a_campaign_shows_its_findings() -> None:
    html = view(open_response(made() / "truth.nc"))._repr_html_()
    assert "Smallest size that makes a drive slip, closing" in html
    assert "<img" not in html


@pytest.mark.parametrize("fields", [["drive_force"], ["energy_kinetic"]])
def test_what_a_result_lacks_is_left_out(fields: list[str]) -> None:
    html = view(sb2_dataset()[fields])._repr_html_()
    assert ("<img" in html) == (fields == ["drive_force"])


def test_names_cannot_become_markup() -> None:
    dataset = sb2_dataset()[["drive_force"]].assign_attrs(panel="<script>alert(1)</script>")
    assert "<script>" not in view(dataset)._repr_html_()
