"""`--json`: one object that a parser reads, nothing else on stdout, with the documented keys."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.unit.calibrations import calibration
from tests.unit.campaigns import copied
from tests.unit.sweeps import here, small_study, study_file
from typer.testing import CliRunner

from turnout.calibration.result_entries import signals_path
from turnout.cli.main import app
from turnout.measurement.formats.file_format import write_recording
from turnout.measurement.recording import RecordedChannel, Recording
from turnout.panel.load import load_panel
from turnout.study.sweep.run import throw_study

COMMON = {"command", "json_version", "units", "written"}


def refuse_constant(text: str) -> None:
    message = f"{text} is not JSON"
    raise ValueError(message)


@cache
def documented() -> dict[str, set[str]]:
    """Return the keys that the page documents for each command."""
    text = (Path(__file__).parents[2] / "docs/use/json.md").read_text(encoding="utf-8")
    pages = re.split(r"^### ", text, flags=re.MULTILINE)[1:]
    return {
        command: {
            key
            for row in re.findall(r"^\| (`.*?`) \|", page, flags=re.MULTILINE)
            for key in re.findall(r"`([a-z_]+)`", row)
        }
        for page in pages
        for command in re.findall(r"`turnout ([^`]+)`", page.split("\n", 1)[0])
    }


def printed(*line: object, code: int = 0) -> dict[str, Any]:
    """Run a command with `--json` and return what it printed, read by a strict parser.

    It has the documented keys; those of `import` depend on its options.
    """
    done = CliRunner().invoke(app, [*map(str, line), "--json"])
    assert done.exit_code == code, (done.output, done.exception)
    found = json.loads(done.stdout, parse_constant=refuse_constant)
    assert set(found) >= COMMON
    command = next(name for name in documented() if " ".join(map(str, line)).startswith(name))
    assert found["command"] == command
    own = set(found) - COMMON
    assert own <= documented()[command] if command == "import" else own == documented()[command]
    assert all(Path(path).exists() for path in found["written"])
    return found


def test_a_run(tmp_path: Path) -> None:
    out = tmp_path / "run.nc"
    found = printed("simulate", "sb1", "--object", "5mm@drive1", "--mode", "quick", "-o", out)
    assert found["written"] == [str(out)]
    assert found["foreign_objects"][0]["size"] == 0.005
    assert found["units"]["end_force:1"] == "N"
    assert 500.0 < abs(found["figures"]["end_force:1"]) < 5000.0
    assert 0 <= abs(found["energy_residual_share"]) < 1e-6


@pytest.mark.parametrize(
    "line",
    [
        "panel list", "panel show sb1", "panel check sb1 --no-throw", "panel sections sb1",
        "panel modes sb1 --count 2", "machine list", "machine show sb3", "machine run sb3",
        "sweep list",
    ],
)  # fmt: skip
def test_panels_and_machines(line: str) -> None:
    assert printed(*line.split())["written"] == []


def test_a_figure_and_a_new_panel_are_written(tmp_path: Path) -> None:
    figure = tmp_path / "plan.png"
    assert printed("panel", "show", "sb1", "--plot", figure)["written"] == [str(figure)]
    found = printed("panel", "new", tmp_path / "mine.toml", "--from", "sb1")
    assert (found["panel"], found["source"]) == ("mine", "sb1")


def test_a_check_gives_the_least_test_piece_of_every_drive() -> None:
    found = printed("panel", "check", "sb2")  # warns, which is no refusal
    assert found["warnings"]
    assert found["lock_rule"] == load_panel("sb2").lock.rule
    assert [item["drive"] for item in found["test_pieces"]] == ["1", "2"]
    for item in found["test_pieces"]:
        assert item["fault"] or item["size"] is None or 0.0 < item["size"] <= item["largest"]
    assert printed("panel", "check", "sb2", "--no-throw")["test_pieces"] == []


def test_warnings_of_a_check() -> None:
    weak = ("panel", "check", "sb1", "--no-throw", "--set", "gravity=100 m/s^2")
    found = printed(*weak, "--strict", code=1)
    assert set(found["warnings"][0]) == {"what", "where", "number", "remedy"}


def test_throws_of_a_panel() -> None:
    found = printed("panel", "show", "sb2", "--throw")
    assert {item["drive"] for item in found["throw"]["margins"]} == {"1", "2"}
    assert len(found["throw"]["pieces"]) == 2


def test_a_recording(tmp_path: Path) -> None:
    time = np.arange(3000) / 1000
    columns = {"Rod 1": "mV/V", "Rod 2": "mV/V", "Clamp 1": "V", "Clamp 2": "V"}
    channels = {
        n: RecordedChannel(n, unit, 0.3 + 0.0 * time, 1000.0) for n, unit in columns.items()
    }
    path, made = tmp_path / "throw.csv", tmp_path / "map.toml"
    write_recording(Recording(channels, "test", None), path)
    found = printed("import", path, "--map", made)
    assert [item["name"] for item in found["channels"]] == list(columns)
    found = printed("import", path, "--channels", made)
    assert {item["unit"] for item in found["quantities"]} == {"N", "A"}


def test_a_campaign(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    for command in ("check", "build"):
        found = printed("campaign", command, folder)
        assert (found["movements"], found["usable"]) == (9, 9)


def test_a_virtual_campaign(tmp_path: Path) -> None:
    small = ("--repeats", 1, "--place", "drive1", "--size", "13mm", "--format", "csv")
    options = (*small, "--workers", 1, "--out", tmp_path / "v")
    found = printed("campaign", "virtual", "--panel", "sb1", *options)
    assert found["movements"] == 3


def test_a_calibration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = replace(calibration(), distrust=("the model misses 214 N",))
    monkeypatch.setattr("turnout.cli.calibrate.opened_campaign", lambda *_, **__: None)
    monkeypatch.setattr(
        "turnout.calibration.calibrate.calibrate",
        lambda *_, **__: SimpleNamespace(calibration=known, sweeps=(), final=None),
    )
    monkeypatch.setattr(
        "turnout.calibration.result_entries.save_signals",
        lambda _, __, record: signals_path(record).touch(),
    )
    line = ("calibrate", tmp_path, "--panel", "sb1", "-o", tmp_path / "c.toml")
    found = printed(*line, "--strict", code=1)
    assert (found["trustworthy"], found["reasons"]) == (False, ["the model misses 214 N"])
    names = {item["name"] for item in found["parameters"]}
    assert names == set(found["units"])


def test_a_validation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from turnout.calibration.validation.acceptance import Acceptance, ChannelResult

    channel = ChannelResult(
        channel="drive 1", movements=8, rms=90.0, nrmse=0.02, spread=10.0, cover=0.6,
        errors={"contact": (1e-3, 2e-3)},
    )  # fmt: skip
    verdict = Acceptance(
        channels=(channel,), judged=8, used=1, cover=0.6, held_back=True,
        reasons=channel.reasons, worst=(),
    )  # fmt: skip
    calibration().save(tmp_path / "c.toml")
    monkeypatch.setattr("turnout.cli.validate.opened_campaign", lambda *_, **__: None)
    validation = "turnout.calibration.validation"
    monkeypatch.setattr(f"{validation}.validate.validate", lambda *_, **__: None)
    monkeypatch.setattr(f"{validation}.acceptance.judge", lambda _: verdict)
    monkeypatch.setattr(f"{validation}.acceptance.notes", lambda _: ["one note"])
    line = ("validate", tmp_path, "--calibration", tmp_path / "c.toml", "--workers", 1)
    found = printed(*line)
    assert not found["valid"]
    assert found["channels"][0]["spreads"] == 9.0
    assert printed(*line, "--strict", code=1)["remarks"] == ["one note"]


def test_a_sweep(tmp_path: Path) -> None:
    study, out = study_file(tmp_path, count=3), tmp_path / "s"
    plan = printed("sweep", "plan", study, "--trials", 1)
    assert plan["scenarios"] == 3
    throw_study(small_study(tmp_path, count=3), out, pool=here)
    printed("sweep", "run", study, "-o", out)
    key = "chair.friction_coefficient"
    cells = printed("sweep", "map", out, "--x", key, "--y", key)
    assert sum(cells["states"].values()) == 3
    printed("sweep", "effects", out)


def test_one_throw_a_value_has_no_sensitivity(tmp_path: Path) -> None:
    out = tmp_path / "s"
    throw_study(small_study(tmp_path, count=3), out, pool=here)
    done = CliRunner().invoke(app, ["sweep", "effects", str(out)])
    assert done.exit_code == 0, done.output
    assert "nan" not in done.stdout
    assert "no sensitivity: each value of an input occurs in one throw only" in done.stdout
    found = printed("sweep", "effects", out, "--strict", code=1)
    assert found["outputs"][0]["indices"][0]["first"] is None
    assert "occurs in one throw only" in found["outputs"][0]["note"]


def test_bad_input_prints_nothing_on_stdout() -> None:
    done = CliRunner().invoke(app, ["simulate", "nowhere.toml", "--json"])
    assert done.exit_code != 0
    assert done.stdout == ""
