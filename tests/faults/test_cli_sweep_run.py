"""What the commands of a sweep say to input that is not as it should be."""

from pathlib import Path
from typing import Any

import pytest
from scipy.io import loadmat
from tests.unit.sweeps import here, small_study, study_file
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.cli.watch import progress_line
from turnout.core.errors import FileError, MechanicsError, TurnoutError
from turnout.core.progress import Progress
from turnout.panel.load import LoadedPanel
from turnout.study.sweep import row as sweep_row
from turnout.study.sweep.read import read_labels
from turnout.study.sweep.run import throw_study

CLI = CliRunner()


def refused(*arguments: object) -> str:
    result = CLI.invoke(app, ["sweep", *map(str, arguments)])
    assert isinstance(result.exception, TurnoutError), result.output
    return str(result.exception)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("swept")
    throw_study(small_study(folder, count=3), folder / "sweep", pool=here)
    return folder / "sweep"


def test_a_folder_of_another_study_and_a_file_in_the_place_of_one(
    swept: Path, tmp_path: Path
) -> None:
    study = study_file(tmp_path, count=4)
    assert "name another folder" in refused("run", study, "-o", swept)
    assert "is a file; name a folder" in refused("run", study, "-o", study)
    assert "holds no sweep" in refused("export", tmp_path, "--csv", tmp_path / "a.csv")


def test_options_that_do_not_go_together(swept: Path, tmp_path: Path) -> None:
    study = study_file(tmp_path, count=3)
    both = ("--scheduler", "tcp://127.0.0.1:9", "--slurm", "a.toml")
    assert "use only one" in refused("run", study, "-o", tmp_path / "s", *both)
    assert not (tmp_path / "s").exists()
    assert "name at least one of" in refused("export", swept)
    assert "must end in .csv" in refused("export", swept, "--csv", tmp_path / "a.txt")


def test_nothing_to_do_is_reported(swept: Path, tmp_path: Path) -> None:
    study = study_file(tmp_path, count=3)
    result = CLI.invoke(app, ["sweep", "run", str(study), "-o", str(swept)])
    assert result.exit_code == 0, result.output
    assert "all were present" in result.stdout


def test_tables_hold_what_the_dataset_holds(swept: Path, tmp_path: Path) -> None:
    pd, pyarrow = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    assert pyarrow
    paths = {f"--{name}": tmp_path / f"t.{name}" for name in ("csv", "parquet", "mat")}
    options = [str(part) for pair in paths.items() for part in pair]
    result = CLI.invoke(app, ["sweep", "export", str(swept), *options])
    assert result.exit_code == 0, result.output
    peak = read_labels(swept)["peak_force"].sel(drive="2", direction="closing").values
    name = "peak_force.2.closing"
    assert pd.read_csv(paths["--csv"])[name].to_list() == pytest.approx(peak.tolist(), rel=1e-8)
    assert pd.read_parquet(paths["--parquet"])[name].to_list() == peak.tolist()
    matlab = loadmat(paths["--mat"], simplify_cells=True)
    assert matlab["sweep"]["peak_force_2_closing"].tolist() == peak.tolist()
    assert matlab["units"]["peak_force_2_closing"] == "N"
    assert list(matlab["sweep"]["outcome"]) == ["complete"] * 3


def test_a_damaged_batch_is_named(swept: Path, tmp_path: Path) -> None:
    throw_study(small_study(tmp_path, count=3), tmp_path / "s", pool=here)
    batch = next((tmp_path / "s" / "batches").glob("*.nc"))
    batch.write_bytes(b"no netCDF")
    with pytest.raises(FileError, match=f"{batch.name}: is damaged.*throws these scenarios again"):
        read_labels(tmp_path / "s")


def test_progress_is_one_line() -> None:
    state = Progress(done=50, failed=2, total=250, rate=4.0, left=50.0)
    assert progress_line(state) == "50 of 250 done, 2 failed, 4 a second, 50 s left"
    assert progress_line(Progress(0, 0, 9)) == "0 of 9 done"


def test_scenarios_without_results_are_named_and_none_at_all_is_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rails that cannot be reduced, of one scenario and of all."""
    monkeypatch.setattr("turnout.core.workers.worker_processes", lambda *_: here())
    study, made = study_file(tmp_path, count=3), sweep_row.plan_throw
    bad = [small_study(tmp_path, count=3).scenario(2).overrides["chair.friction_coefficient"]]

    def plan(panel: LoadedPanel, *given: Any, **named: Any) -> Any:
        if not bad or panel.chair["1"].friction_coefficient == bad[0]:
            message = "a mass matrix is not positive"
            raise MechanicsError(message)
        return made(panel, *given, **named)

    monkeypatch.setattr(sweep_row, "plan_throw", plan)
    some = CLI.invoke(app, ["sweep", "run", str(study), "-o", str(tmp_path / "some")])
    assert some.exit_code == 0, some.output
    assert "1 of 3 scenarios gave no results" in some.output
    assert "scenario 2 (state 2): a mass matrix is not positive" in some.output
    bad.clear()
    assert "3 of 3 scenarios gave no results" in refused("run", study, "-o", tmp_path / "none")
