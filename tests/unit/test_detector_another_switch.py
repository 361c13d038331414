"""A detector of another switch is noticed: by the panel that throws name, or by their verdicts."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.detector_files import detector_file, table_file
from tests.unit.detector_toy import TIME, toy_throw
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.detection.detector.another_switch import misfit_remark, panel_remark
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.reading import read_throws
from turnout.detection.detector.throw_verdict import Verdict
from turnout.detection.detector.throws_of_dataset import throws_of_dataset
from turnout.figures.report.detection import detection_page
from turnout.throw.store import save_response
from turnout.web.detecting import judged_record

OWN = {"panel": "own", "panel_hash": "12ab"}


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = detector_file(tmp_path_factory.mktemp("detector"))
    known = Detector.load(path).knowledge
    Detector(replace(known, about=OWN)).save(path)
    return path


def dataset(**attributes: str) -> xr.Dataset:
    return xr.Dataset(
        {"drive_force": (("drive", "time"), toy_throw(seed=3).force)},
        {"time": TIME, "drive": ["1", "2"]},
        {"schema_version": SCHEMA_VERSION, **attributes},
    )


def run(command: str, detector: Path, path: Path, *more: str) -> str:
    found = CliRunner().invoke(app, ["detect", command, str(detector), str(path), *more])
    assert found.exit_code == 0 or isinstance(found.exception, FileError)
    return " ".join(f"{found.output} {found.exception or ''}".split())


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ({}, ""),
        (OWN, ""),
        ({"panel": "own"}, ""),
        ({"panel": "copy", "panel_hash": "12ab"}, ""),
        ({"panel": "own", "panel_hash": "34cd", "overrides": '{"a": 1}'}, ""),
        ({"panel": "own", "panel_hash": "34cd"}, "of panel own with hash 34cd, the detector is"),
        ({"panel": "other", "panel_hash": "34cd"}, "of panel other, the detector is of panel own:"),
        ({"sheet_panel": "other"}, "turnout detect train other"),
    ],
)
def test_throws_of_another_panel_are_noticed(attributes: dict[str, str], words: str) -> None:
    throws = throws_of_dataset(dataset(**attributes))
    found = panel_remark(throws, OWN)
    assert bool(found) == bool(words)
    assert words in found
    assert not panel_remark(throws, {})


def test_a_detector_without_a_hash_goes_by_the_name() -> None:
    about = {"panel": "own"}
    assert "of panel other" in panel_remark(throws_of_dataset(dataset(panel="other")), about)
    assert not panel_remark(throws_of_dataset(dataset(panel="own")), about)


def test_the_commands_name_both_panels(detector: Path, tmp_path: Path) -> None:
    path = tmp_path / "other.nc"
    save_response(dataset(panel="other", panel_hash="34cd"), path)
    note = f"turnout: {path}: throws are of panel other, the detector is of panel own"
    assert note in run("run", detector, path)
    assert note in run("report", detector, path, "-o", str(tmp_path / "page.html"))
    assert note in run("learn", detector, path, "-o", str(tmp_path / "learned.detector"))
    shown = judged_record(Detector.load(detector), throws_of_dataset(dataset(panel="other")))
    assert shown["remark"].startswith("throws are of panel other")
    save_response(dataset(**OWN), path)
    assert "the detector is of panel" not in run("run", detector, path)


@pytest.mark.parametrize("current", [False, True])
def test_a_run_sheet_names_the_panel(current: bool, tmp_path: Path) -> None:
    force = toy_throw(seed=3).force
    running = 5.0 * ((TIME > 0.2) & (TIME < 3.4) | (TIME > 4.4) & (TIME < 7.8))
    columns = {"force 1 [N]": force[0], "force 2 [N]": force[1]}
    columns |= {"current 1 [A]": running, "current 2 [A]": running} if current else {}
    channels = "".join(
        f'[drive_{name.split()[0]}.{name.split()[1]}]\ncolumn = "{name.partition(" [")[0]}"\n'
        'kind = "scaled"\n'
        for name in columns
    )
    (tmp_path / "channels.toml").write_text(f"schema_version = 1\n{channels}")
    np.savetxt(
        tmp_path / "a.csv",
        np.column_stack([TIME, *columns.values()]),
        delimiter=",",
        fmt="%.4f",
        header=",".join(["time [s]", *columns]),
        comments="",
    )
    lines = ["# panel: other", "file,movement,direction,size [mm],place"]
    lines += ["a.csv,1,opening,0,none", "a.csv,2,closing,0,none"]
    (tmp_path / "runs.csv").write_text("\n".join(lines))
    (throw,) = read_throws(tmp_path)
    assert (throw.fault, throw.panel) == ("", ("other", ""))


def test_forces_of_another_scale_are_said_once(detector: Path, tmp_path: Path) -> None:
    words = "5 of 5 throws are neither sound nor an object: the detector of panel own may be of"
    path = table_file(tmp_path, [0.0] * 5, factor=2.0)
    found = run("run", detector, path)
    assert found.count(words) == 1
    assert words in run("run", detector, path, "--json")
    assert words in run("learn", detector, path, "-o", str(tmp_path / "learned.detector"))
    fitting = run("run", detector, table_file(tmp_path, [0.0] * 5))
    assert "5 throws: 5 sound" in fitting
    assert "may be of another type" not in fitting


@pytest.mark.parametrize(
    ("statuses", "said"),
    [
        (["unknown deviation"] * 4, False),
        (["unknown deviation", "cannot judge", "unknown deviation", "sound", "sound"], True),
        (["unknown deviation", "unknown deviation", "other cause", "sound", "sound"], False),
        (["other cause"] * 3 + ["object"] * 2, True),
        (["object"] * 5, False),
    ],
)
def test_what_counts_as_no_fit(statuses: list[str], said: bool) -> None:
    assert bool(misfit_remark(statuses, OWN)) == said


@pytest.mark.parametrize(("status", "asked"), [("other cause", True), ("object", False)])
def test_the_page_asks_whether_the_detector_fits(status: str, asked: bool) -> None:
    rows = [asdict(Verdict(name="a", status=status))] * 5
    questions = [item.question for item in detection_page(rows, about=OWN).findings]
    assert ("Does the detector fit the switch?" in questions) == asked
