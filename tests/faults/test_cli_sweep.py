"""`turnout sweep` on good and bad input: one message, exit 2, no traceback, nothing lost."""

import json
from pathlib import Path

import pytest
from tests.unit.sweeps import STUDY, here, study_file
from typer.testing import CliRunner, Result

from turnout.calibration.load_study import load_study
from turnout.cli.main import app
from turnout.core.errors import TurnoutError
from turnout.study.sweep.forecast import forecast
from turnout.study.sweep.run import throw_study

# The object of this panel comes a second late, unless another time is given.
TRAPPED = STUDY.replace("[set]", '[set]\n"object_defaults.appears" = "0 s"')
OBJECT = """
[[variable]]
key = "object.size"
values = ["0 mm", "30 mm"]

[[variable]]
key = "object.x"
values = ["1.2 m", "4.8 m"]
"""

STIFFNESS = """
[[variable]]
key = "object.stiffness"
distribution = "uniform"
minimum = "10 kN/mm"
maximum = "40 kN/mm"

[[variable]]
key = "object.x"
values = ["1.2 m"]

[[variable]]
key = "object.size"
values = ["30 mm"]
"""


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["sweep", *map(str, arguments)])


def refused(*arguments: str | Path) -> str:
    """Return the message that the program ends with exit code 2 for."""
    result = run(*arguments)
    assert isinstance(result.exception, TurnoutError), (result.output, result.exception)
    return str(result.exception)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep of 3 states by 2 sizes by 2 places."""
    base = tmp_path_factory.mktemp("swept")
    study = load_study(study_file(base, text=TRAPPED, count=3, more=OBJECT))
    throw_study(study, base / "out", pool=here)
    return base / "out"


@pytest.fixture(scope="module")
def saltelli(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep that Sobol indices can be taken of."""
    base = tmp_path_factory.mktemp("saltelli")
    text = TRAPPED.replace("[sampling]", '[sampling]\nmethod = "saltelli"') + STIFFNESS
    study = load_study(study_file(base, text=text, count=8))
    throw_study(study, base / "out", pool=here)
    return base / "out"


def test_studies_are_listed_and_shown_and_their_schema_given(tmp_path: Path) -> None:
    listed = run("list")
    assert listed.exit_code == 0
    assert "paper-campaign" in listed.output
    assert "143 throws" in listed.output
    shown = run("show", "paper-campaign").output
    (tmp_path / "own.toml").write_text(shown, encoding="utf-8")
    assert load_study(tmp_path / "own.toml").digest == load_study("paper-campaign").digest
    out = tmp_path / "schema.json"
    assert run("schema", "--out", out).exit_code == 0
    assert json.loads(out.read_text())["title"] == "turnout study"


def test_a_plan_tells_ranges_count_time_and_disk(tmp_path: Path) -> None:
    study = study_file(tmp_path, count=3, more=OBJECT)
    reported = run("plan", study, "--workers", "2", "--quiet")
    assert reported.exit_code == 0, reported.output
    assert "12: 3 states, 4 throws in each; states drawn by random" in reported.output
    assert "chair.friction_coefficient  0.1 ... 0.4 uniform" in reported.output
    assert "object.size                 0 mm, 30 mm" in reported.output
    assert "with 2 workers" in reported.output
    assert "are free in this folder" in reported.output


def test_the_predicted_disk_is_what_a_sweep_takes(swept: Path) -> None:
    study = load_study(swept.parent / "study.toml")
    predicted = forecast(study, trials=6)
    batches = list((swept / "batches").glob("*.nc"))
    written = sum(path.stat().st_size for path in batches)
    assert predicted.faults == ()
    assert predicted.disk(study) == pytest.approx(written, rel=0.1)
    assert predicted.throw_time > 0


def test_a_map_and_effects_go_through(swept: Path, tmp_path: Path) -> None:
    for name in ("map", "effects"):
        figure = tmp_path / f"{name}.png"
        reported = run(name, swept, "-o", figure)
        assert reported.exit_code == 0, reported.output
        assert figure.read_bytes().startswith(b"\x89PNG")
    counts = [int(line.split()[0]) for line in run("map", swept).output.splitlines()]
    assert sum(counts) == 12
    effects = run("effects", swept, "--feature", "object_force_peak").output
    assert effects.startswith("object_force_peak\n")
    # The size is 0 or 30 mm: everything depends on it.
    assert effects.splitlines()[1].split()[0] == "object.size"


def test_total_indices_come_from_a_sweep_that_was_made_for_them(saltelli: Path) -> None:
    pytest.importorskip("SALib")
    effects = run("effects", saltelli, "--feature", "object_force_peak").output
    assert effects.count(" total") == 2
    assert "±" in effects


def test_bad_input_is_refused(swept: Path, tmp_path: Path) -> None:
    empty = tmp_path / "study.toml"
    empty.write_text('schema_version = 1\nname = "a"\npanel = "sb1"\n', encoding="utf-8")
    assert "there is no scenario" in refused("plan", empty)
    assert "no such file" in refused("plan", tmp_path / "none.toml")
    assert "no input 'mu' in this sweep" in refused("map", swept, "--x", "mu")
    reported = refused("effects", swept, "--feature", "peak")
    assert "no output 'peak' in this sweep" in reported
    listed = reported.split("there are ")[1].replace("\n", " ").split(", ")
    assert "peak_force" in listed
    # How a scenario was thrown is no output of it.
    assert not {"seed", "attempts"} & set(listed)
    assert "must end in" in refused("map", swept, "-o", tmp_path / "map.bmp")
    assert str(tmp_path) in refused("map", tmp_path)
