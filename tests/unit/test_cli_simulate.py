"""The command `simulate` in this process: the same numbers as Python, files, exit codes."""

from pathlib import Path

import pytest
import xarray as xr
from tests.unit.simulated import sb1_dataset, sb1_panel
from typer.testing import CliRunner, Result

from turnout.cli.main import app
from turnout.core.errors import FileError
from turnout.core.scheme import Scheme
from turnout.metric.panel_check import concern_lines
from turnout.panel.foreign_object import resolve_objects
from turnout.panel.load import load_panel
from turnout.throw.store import open_response, save_response

# The panel of `sb1_panel`, as it is said on the command line.
QUICK = [
    "--set=schedule.end=2.5 s",
    "--set=movement.return.start=1.6 s",
    "--set=movement.return.duration=0.6 s",
    "--set=movement.throw.start=0.2 s",
    "--set=movement.throw.duration=1 s",
]


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["simulate", "sb1", *QUICK, *map(str, arguments)])


def test_python_and_program_agree_to_the_last_bit(tmp_path: Path) -> None:
    result = run("--out", tmp_path / "run.nc")
    assert result.exit_code == 0, result.stderr
    written = open_response(tmp_path / "run.nc")
    save_response(sb1_dataset(), tmp_path / "same.nc")
    same = open_response(tmp_path / "same.nc")
    xr.testing.assert_identical(written.drop_attrs(), same.drop_attrs())
    assert written.attrs["panel_hash"] == sb1_panel().hash


def test_summary_and_files_are_reported(tmp_path: Path) -> None:
    result = run("--out", tmp_path / "run.nc", "--plot", tmp_path / "run.svg")
    assert result.stdout.startswith(
        "verdict         Not locked after closing: no object, but Drive "
    )
    assert "locked" in result.stdout
    assert f"{tmp_path / 'run.nc'} (" in result.stdout
    assert f"{tmp_path / 'run.svg'} (" in result.stdout
    assert (tmp_path / "run.svg").read_bytes().startswith(b"<?xml")


def test_the_verdict_is_coloured_on_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    arguments = ["simulate", "sb1", *QUICK]
    plain, shown = (CliRunner().invoke(app, arguments, color=on).stdout for on in (False, True))
    assert "\x1b[" not in plain
    assert "\x1b[31m\x1b[1mNot locked after closing\x1b[0m: no object" in shown
    assert "\nmeaning         The switch does not report" in plain


def test_quiet_shows_nothing() -> None:
    result = run("--quiet")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")


def test_objects_are_placed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []

    def counted(*given: object) -> object:
        calls.append(1)
        return resolve_objects(*given)  # type: ignore[arg-type]

    monkeypatch.setattr("turnout.panel.foreign_object.resolve_objects", counted)
    monkeypatch.setattr("turnout.throw.simulate.resolve_objects", counted)
    assert run("--object", "13mm@sleeper6", "--quiet").exit_code == 0
    assert len(calls) == 1


def test_step_and_cutoff_reach_the_scheme(tmp_path: Path) -> None:
    run("--step", "2ms", "--cutoff", "0.2 kHz", "--out", tmp_path / "run.nc")
    attributes = open_response(tmp_path / "run.nc").attrs
    assert attributes["step"] == 2e-3
    assert attributes["cutoff_frequency"] == 200.0
    assert attributes["highest_mode_frequency"] <= 200.0


def test_an_incomplete_run_is_kept_and_marked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "turnout.core.scheme.Scheme.of",
        lambda *_, **__: Scheme(iterations=1, halvings=0, follow_path=False),
    )
    result = run("--out", tmp_path / "run.nc", "--plot", tmp_path / "run.png")
    assert result.exit_code == 3
    assert "not converged at t = " in result.stderr
    assert "try a smaller step" in result.stderr
    assert "NOT COMPLETE" in result.stdout
    partial = open_response(tmp_path / "run.nc")
    assert partial.attrs["complete"] is False
    assert 0 < partial["time"][-1] < 2.5


def test_ctrl_c_keeps_what_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def press(_watch: object, done: int, _total: int) -> None:
        if done >= 1000:
            raise KeyboardInterrupt

    monkeypatch.setattr("turnout.cli.watch.ProgressBar.report", press)
    result = run("--out", tmp_path / "run.nc")
    assert result.exit_code == 130
    assert "interrupted at t = " in result.stderr
    partial = open_response(tmp_path / "run.nc")
    assert partial.attrs["outcome"] == "interrupted"
    assert 1.0 <= float(partial["time"][-1]) < 2.5


def test_ctrl_c_before_the_first_step_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def press(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("turnout.throw.simulate.build_mechanism", press)
    result = run("--out", tmp_path / "run.nc")
    assert result.exit_code == 130
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["list", "show", "sections", "schema"])
def test_panel_commands_answer(command: str) -> None:
    result = CliRunner().invoke(app, ["panel", command])
    assert result.exit_code == 0, result.stderr
    assert len(result.stdout.splitlines()) >= 3


def test_names_of_library_panels_stand_apart_from_what_they_are() -> None:
    lines = CliRunner().invoke(app, ["panel", "list"]).stdout.splitlines()
    column = {line.index(line.split(maxsplit=1)[1]) for line in lines}
    assert len(column) == 1
    assert "uic60-760-1-15-symmetric" in [line.split()[0] for line in lines]


def test_a_system_of_modes_needs_a_figure() -> None:
    result = CliRunner().invoke(app, ["panel", "modes", "sb1", "--system", "rail C"])
    assert isinstance(result.exception, FileError)
    assert "--plot" in str(result.exception)
    assert result.stdout == ""


def test_panel_check_says_ok(tmp_path: Path) -> None:
    from turnout.panel.load import library_text

    path = tmp_path / "own.toml"
    path.write_text(library_text("sb1"), encoding="utf-8")
    result = CliRunner().invoke(app, ["panel", "check", str(path)])
    assert result.exit_code == 0
    assert "OK" in result.stdout


def test_schema_goes_to_a_file(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["panel", "schema", "--out", str(tmp_path / "s.json")])
    assert result.exit_code == 0
    assert '"$schema"' in (tmp_path / "s.json").read_text(encoding="utf-8")


def checked(panel: str, *arguments: str) -> Result:
    return CliRunner().invoke(app, ["panel", "check", panel, *arguments])


def test_a_panel_is_thrown_to_warn_which_strict_refuses() -> None:
    """The opening throw of SB2 has 0.44 kN of 6 kN left, its closing throw 2.4 kN."""
    result = checked("sb2", "--strict")
    assert result.exit_code == 1
    warnings = [line for line in result.stdout.splitlines() if line.startswith("warning: ")]
    assert len(warnings) == 4
    assert "drive 2 at x = 6.9 m, opening" in warnings[0]
    assert "0.44 kN (7.3 %) left" in warnings[0]
    assert "flangeway below its limit" in warnings[1]
    assert all("locks on the test piece: drive" in line for line in warnings[2:])
    pieces = [line for line in result.stdout.splitlines() if line.startswith("test piece: ")]
    assert [line.split()[3] for line in pieces] == ["1", "2"]
    assert checked("sb2", "--strict", "--no-throw").exit_code == 0


def test_what_has_no_limit_is_not_said_to_be_all_in_order() -> None:
    """SB1 has no flangeway limit, whatever its flangeway is."""
    (reported,) = concern_lines(load_panel("sb1"), [])
    assert "flangeway was not judged" in reported
    (in_order,) = concern_lines(load_panel("60e1-300-1-9"), [])
    assert "no warnings" in in_order
    assert "flangeway was not" not in in_order


@pytest.mark.long
def test_a_panel_in_order_is_thrown_without_a_warning() -> None:
    result = checked("60e1-300-1-9", "--strict")
    assert result.exit_code == 0, result.stdout
    assert "no warnings" in result.stdout


def test_without_a_throw_only_the_file_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("turnout.cli.show.thrown_alone", None)
    result = checked("sb2", "--no-throw")
    assert result.exit_code == 0
    assert result.stdout.startswith("sb2: OK")


def test_a_panel_is_shown_and_drawn(tmp_path: Path) -> None:
    """All of it for a panel with one rail, cut short."""
    path = tmp_path / "plan.svg"
    result = CliRunner().invoke(
        app, ["panel", "show", "sb1", *QUICK, "--throw", "--plot", str(path)]
    )
    assert result.exit_code == 0, result.stderr
    assert "needs throws" not in result.stdout
    assert result.stdout.count("kN") > 10
    assert f"{path} (" in result.stdout
    assert path.read_bytes().startswith(b"<?xml")


def test_a_plan_that_cannot_be_written_is_refused_first(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["panel", "show", "--plot", str(tmp_path / "plan.gif")])
    assert isinstance(result.exception, FileError)
    assert result.stdout == ""


def test_history_of_another_program_is_laid_under_the_figure(tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    other.write_text("time [s],drive_force:1 [kN]\n0,0\n1,0.2\n2.5,0.1\n", encoding="utf-8")
    plot = tmp_path / "run.png"
    result = run("--plot", plot, "--overlay", other)
    assert result.exit_code == 0, result.stderr
    assert plot.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("header", "drawn", "words"),
    [
        ("time [s],drive_force:1", True, "has no unit"),
        ("time [s],drive_force:7 [N]", True, "drive '7' is not in the run"),
        ("time [s],drive_force:1 [N]", False, "name one with --plot"),
    ],
)
def test_a_history_that_does_not_fit_leaves_no_file(
    tmp_path: Path, header: str, drawn: bool, words: str
) -> None:
    other = tmp_path / "other.csv"
    other.write_text(f"{header}\n0,0\n1,1\n", encoding="utf-8")
    outputs = ["--out", tmp_path / "run.nc"] + (["--plot", tmp_path / "run.png"] if drawn else [])
    result = run(*outputs, "--overlay", other)
    assert words in str(result.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["other.csv"]


def test_channels_on_request_are_kept(tmp_path: Path) -> None:
    result = run("--out", tmp_path / "run.nc", "--also", "drive_force", "--also", "fastening_force")
    assert result.exit_code == 0, result.stderr
    written = open_response(tmp_path / "run.nc")
    assert "fastening_force" in written
    assert "fastening_moment" not in written
    assert "gap" in written


def test_a_channel_that_is_none_is_refused() -> None:
    assert "nearest is fastening_force" in str(run("--also", "fastening_forse").exception)
