"""Sizes and rates of detection are of simulated switches: pages, reports and JSON say so."""

import inspect
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from benchmarks.detection.tables import write_table
from tests.unit.detection_throws import toy_throws
from tests.unit.detector_files import detector_file, table_file
from tests.unit.detector_toy import toy_detector
from typer.testing import CliRunner

from turnout.cli import detect
from turnout.cli.limit import write_map
from turnout.cli.main import app
from turnout.cli.output import Output, json_text
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.reference import Conditions
from turnout.figures.report.blind_zones import blind_zone_page
from turnout.figures.report.page import page_html

PAGES = (
    *("use/detection", "use/detection-limit", "use/pod"),
    *("evidence/detection-results", "evidence/blind-zones", "evidence/open-benchmark"),
)
COMMANDS = [
    *("limit", "plan-test", "pod"),
    *(
        f"detect {item.name}"
        for item in detect.app.registered_commands
        if item.callback and "as_json" in inspect.signature(item.callback).parameters
    ),
]


def is_said(text: str) -> bool:
    """Return whether a text says both that it is of simulated switches and what that lacks."""
    plain = " ".join(text.split()).lower()
    return "simulated" in plain and re.search(
        r"no field recording (of a switch )?was compared", plain
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("detector")
    detector_file(place)
    table_file(place, [0.0, 0.0])
    return place


def judged(folder: Path, command: str, *more: object) -> str:
    """Run a command on the table of throws and return its output."""
    files = (folder / "toy.detector", folder / "throws.csv")
    done = CliRunner().invoke(app, ["detect", command, *map(str, (*files, *more))])
    assert done.exit_code == 0, (done.output, done.exception)
    return done.output


@pytest.mark.parametrize("page", PAGES)
def test_a_page_says_so_first(page: str, pytestconfig: pytest.Config) -> None:
    text = (pytestconfig.rootpath / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert is_said(text.split("\n\n")[1])


def test_the_readme_says_so_first_of_trust(pytestconfig: pytest.Config) -> None:
    text = (pytestconfig.rootpath / "README.md").read_text(encoding="utf-8")
    assert is_said(text.partition("How far to trust it")[2].partition(".")[0])


def test_no_page_leaves_open_what_its_switches_are(pytestconfig: pytest.Config) -> None:
    docs = pytestconfig.rootpath / "docs"
    texts = [path.read_text(encoding="utf-8") for path in sorted(docs.glob("*/detection*.md"))]
    found = re.findall(
        r"[^\n]*(?:\d+ switches judged once|measured throws)[^\n]*", "\n".join(texts)
    )
    assert not found


@pytest.mark.parametrize("command", COMMANDS)
def test_json_says_so_and_the_page_names_the_key(command: str, pytestconfig: pytest.Config) -> None:
    assert is_said(json.loads(json_text(command, {}))["origin"])
    page = (pytestconfig.rootpath / "docs" / "use" / "json.md").read_text(encoding="utf-8")
    assert is_said(page.partition("| `origin` |")[2].partition("## Exit codes")[0])


def test_other_commands_have_no_such_key() -> None:
    assert "origin" not in json.loads(json_text("sweep map", {}))


def test_a_verdict_on_recordings_does_not_call_them_simulated(folder: Path) -> None:
    origin = json.loads(judged(folder, "run", "--json"))["origin"]
    assert origin.startswith("thresholds, error rates and intervals are those of simulated")
    shown = judged(folder, "run")
    assert shown.count("0.001 false alarms per simulated throw") == 2
    assert is_said(shown)


def test_the_report_of_judged_throws_says_so(folder: Path, tmp_path: Path) -> None:
    judged(folder, "report", "-o", tmp_path / "page.html")
    assert is_said((tmp_path / "page.html").read_text(encoding="utf-8"))


def test_training_says_so_above_its_thresholds() -> None:
    about = {"panel": "own", "throws": {"sound": 600}}
    knowledge = replace(toy_detector().knowledge, about=about)
    text = "\n".join(detect.training_lines(knowledge))
    assert is_said(text.partition("thresholds")[0])


def test_the_limit_says_so_on_screen_and_page(capsys: pytest.CaptureFixture[str]) -> None:
    found = limit_map(toy_throws(), Conditions(), closing=0.8)
    write_map(found, None, Output("limit", files={"out": None, "plot": None}))
    assert is_said(capsys.readouterr().out)
    html = page_html(blind_zone_page(found))
    assert is_said(html)
    assert "Synthetic: simulated, not measured" in html


def test_a_campaign_of_a_user_is_not_called_simulated(tmp_path: Path) -> None:
    rows = [f"{size},{6 * size + 7 * switch + size % 3},{switch}" for switch in range(3)
            for size in range(2, 60, 6)]  # fmt: skip
    table = tmp_path / "results.csv"
    table.write_text("\n".join(["size [mm],response [N],switch", *rows]))
    line = ["pod", str(table), "--threshold", "150", "--campaigns", "0"]
    shown = CliRunner().invoke(app, line)
    assert shown.exit_code == 0, shown.exception
    assert "note: throws are those of the table" in shown.output
    assert is_said(shown.output)


def test_the_table_of_the_benchmark_says_so_first(tmp_path: Path) -> None:
    text = write_table(tmp_path, "", {}).read_text(encoding="utf-8")
    assert is_said(text.partition("\n\n")[0])
