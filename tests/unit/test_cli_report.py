"""The command `turnout report`."""

from pathlib import Path

import pytest
from tests.unit.simulated import sb2_dataset
from tests.unit.sweeps import here, small_study
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import FileError
from turnout.study.sweep.run import throw_study
from turnout.throw.store import save_response

MOST_BYTES = 4_000_000


@pytest.fixture(scope="module")
def run_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.nc"
    save_response(sb2_dataset(), path)
    return path


def test_a_report_and_its_figures_are_written(run_file: Path, tmp_path: Path) -> None:
    out, figures = tmp_path / "r.html", tmp_path / "figures"
    line = ["report", str(run_file), "-o", str(out), "--figures", str(figures)]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0, done.output
    assert "r.html (" in done.output
    assert out.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert out.stat().st_size < MOST_BYTES, "one small file"
    names = {path.name for path in figures.iterdir()}
    assert {f"throw{suffix}" for suffix in (".pdf", ".png", ".svg")} <= names
    assert len(names) == 15


def test_the_folder_of_a_sweep_is_reported_from_that_of_a_campaign(tmp_path: Path) -> None:
    folder, out = tmp_path / "results", tmp_path / "sweep.html"
    throw_study(small_study(tmp_path, count=3), folder, pool=here)
    done = CliRunner().invoke(app, ["report", str(folder), "-o", str(out)])
    assert done.exit_code == 0, done.output
    html = out.read_text(encoding="utf-8")
    assert "<h1>Sweep tiny</h1>" in html
    assert "chair.friction_coefficient" in html
    assert "of 3 throws" in html


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["report", "nowhere.nc"], "no such file"),
        (["report", "nowhere.nc", "-o", "report.pdf"], "must end in .html"),
        (["report", "RUN", "--panel", "uic60-760-1-15"], "--panel uic60-760-1-15"),
    ],
)
def test_what_cannot_be_reported_is_refused(
    line: list[str], words: str, run_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    line = [str(run_file) if word == "RUN" else word for word in line]
    done = CliRunner().invoke(app, line)
    assert isinstance(done.exception, FileError)
    assert words in str(done.exception)
    assert not (tmp_path / "report.html").exists()
