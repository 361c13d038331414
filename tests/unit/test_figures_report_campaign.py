"""The page about a campaign, from a virtual one as a folder and as a dataset."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.campaigns import copied, made
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.figures.campaign import stacked_sheet
from turnout.figures.report.campaign import campaign_findings, campaign_page
from turnout.figures.report.page import page_html
from turnout.throw.store import open_response


@pytest.fixture(scope="module")
def dataset() -> xr.Dataset:
    return open_response(made() / "truth.nc")


def test_places_against_sizes_are_end_forces_with_slips_framed(dataset: xr.Dataset) -> None:
    page = campaign_page(dataset, suffixes=())
    force, one, two = page.sections[0].heats
    assert (two.rows, two.columns) == (["no object", "sleeper 6"], ["0", "10", "13", "31"])
    assert [heat.heading for heat in (one, two)] == ["Drive 1 force [kN]", "Drive 2 force [kN]"]
    assert np.isnan(force.values[0]).all()
    assert two.values[1][3] == pytest.approx(6.0, abs=0.05)
    assert two.framed == [[False] * 4, [False, False, False, True]]


def test_a_place_over_time_holds_every_size(dataset: xr.Dataset) -> None:
    sheet = stacked_sheet(dataset, place="sleeper 6", direction="closing")
    row = sheet.rows[-1]
    assert [line.label for line in row.lines] == ["none", "10 mm", "13 mm", "31 mm (slips)"]
    peak = float(dataset["drive_force"].sel(drive="2").max()) / 1e3
    assert np.nanmax(row.lines[3].y) == pytest.approx(peak)


def test_findings_name_sizes_repeats_and_what_was_left_out(dataset: xr.Dataset) -> None:
    reported = {item.question: item for item in campaign_findings(dataset)}
    assert reported["Smallest size detected by the drives, closing"].answer.startswith("1")
    assert reported["Smallest size that makes a drive slip, closing"].answer == "31 mm"
    assert "3 throws without an object" in reported["End force of drive 2, closing"].detail
    assert reported["Usable movements"].level == "good"
    (usable,) = campaign_findings(dataset, excluded=[("1", ["clipped"])])[-1:]
    assert (usable.level, usable.detail) == ("look", "some excluded; no remarks under Quality")


def test_the_page_says_that_it_is_synthetic_and_names_no_address(dataset: xr.Dataset) -> None:
    html = page_html(campaign_page(dataset, excluded=[("9", ["clipped <b>"])]))
    assert "Synthetic: simulated" in html
    assert "clipped &lt;b&gt;" in html
    assert set(re.findall(r"https?://[\w.-]+", html)) <= {"http://www.w3.org"}
    records = re.findall(r"<script type='application/json'>(.*?)</script>", html)
    assert [json.loads(record)["name"] for record in records] == ["sleeper-6-closing"]
    assert html.count("download='sleeper-6-closing.pdf'") == 1


def test_the_command_takes_a_folder_and_a_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("turnout.cli.report.FORMS", (".svg",))  # of a limit it writes all
    folder, figures = copied(tmp_path), tmp_path / "figures"
    out = tmp_path / "campaign.html"
    line = ["report", str(folder), "-o", str(out), "--figures", str(figures)]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0, done.output
    assert "Usable movements" in out.read_text(encoding="utf-8")
    names = {path.name for path in figures.iterdir()}
    assert {"overview-closing.svg", "sleeper-6-closing.svg"} <= names
    done = CliRunner().invoke(app, ["report", str(folder / "truth.nc"), "-o", str(out), "-q"])
    assert (done.exit_code, done.output) == (0, "")


def test_slips_without_an_object_say_nothing_of_objects(dataset: xr.Dataset) -> None:
    """A switch whose drives always slip was said to slip "first at drive 1" with 5 mm."""
    always = dataset.assign_coords(slipped=("movement", np.ones(dataset.sizes["movement"], bool)))
    found = {item.question: item for item in campaign_findings(always)}
    slips = found["Smallest size that makes a drive slip, closing"]
    assert (slips.level, slips.answer) == ("look", "Slips without an object")
    assert slips.detail.startswith("in 3 of 3 throws")


def test_no_slip_is_said_only_where_no_force_saturates(dataset: xr.Dataset) -> None:
    none = dataset.assign_coords(slipped=("movement", np.zeros(dataset.sizes["movement"], bool)))
    question = "Smallest size that makes a drive slip, closing"
    plain = {item.question: item for item in campaign_findings(none)}[question]
    assert (plain.answer, plain.detail) == ("None", "no drive slipped with any object")
    flat = none.copy(deep=True)
    largest = flat["drive_force"].values[flat["size"].values == 0.031].copy()
    flat["drive_force"].values[flat["size"].values == 0.013] = largest
    found = {item.question: item for item in campaign_findings(flat)}[question]
    assert found.answer == "Unknown"
    assert "no longer grows at sleeper 6" in found.detail


def test_smaller_objects_are_undecided_with_two_throws_to_compare_with(
    dataset: xr.Dataset,
) -> None:
    free = np.flatnonzero(
        (dataset["size"].values == 0) & (dataset["direction"].values == "closing")
    )
    kept = np.setdiff1d(np.arange(dataset.sizes["movement"]), free[2:])
    two = dataset.isel(movement=kept).copy(deep=True)
    ends = {0.0: (2000.0, 2010.0), 0.010: (2050.0,), 0.013: (2200.0,), 0.031: (6000.0,)}
    for size, values in ends.items():
        which = np.flatnonzero((two["size"].values == size) & (two["direction"] == "closing"))
        for number, value in zip(which, values, strict=True):
            two["drive_force"].values[number] = value
    question = "Smallest size detected by the drives, closing"
    found = {item.question: item for item in campaign_findings(two)}[question]
    assert found.answer == "31 mm"
    assert "to decide on smaller ones at sleeper 6" in found.detail
    row = campaign_page(two, suffixes=()).sections[0].tables[0].rows[0]
    assert row[2] == "31 mm; too few throws without an object to decide from 10 mm"
