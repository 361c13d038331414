"""What the program prints: panels with origins, units, sections, progress, output checks."""

import re
import time
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from tests.unit.simulated import sb2_panel

from turnout.cli.options import check_outputs
from turnout.cli.output import INTERRUPTED, Output, resumable
from turnout.cli.panel import section_lines
from turnout.cli.show import CheckThrows, panel_lines
from turnout.cli.watch import COMPILING, ProgressBar, watched
from turnout.core.errors import FileError
from turnout.figures.plan import plot_plan
from turnout.figures.report.values import shown, value_lines
from turnout.metric.test_piece import PieceLimit, PieceResult
from turnout.panel.load import library_names, load_panel
from turnout.panel.model import Panel
from turnout.throw.compilation import cache_fault
from turnout.throw.simulate import simulate

SUFFIXES = {"--out": (".nc",), "--plot": (".png", ".svg")}


def line_of(lines: list[str], start: str) -> str:
    (found,) = [line for line in lines if " ".join(line.split()).startswith(start)]
    return " ".join(found.split())


@pytest.fixture(scope="module")
def default() -> list[str]:
    panel = load_panel("uic60-760-1-15")
    return list(value_lines(panel.with_settings(["chair.5.friction_coefficient=0.3"])))


@pytest.mark.parametrize(
    ("start", "rest"),
    [
        ("friction_coefficient 0.4", "paper: section 4.1"),
        ("friction_coefficient (5) 0.3", "override: 0.3"),
        ("stiffness (1) 750 kN/m", "paper: section 4.2"),
        ("stroke (2) 80 mm", "computed"),
        ("x 0 ... 14.4 m", "computed"),
        ("extra_time (return) 2: 0.2 s", "paper: section 3"),
        ("limit 13 mm", "paper"),
    ],
)
def test_values_are_shown_with_their_origin(default: list[str], start: str, rest: str) -> None:
    assert rest in line_of(default, start)


@cache
def default_lines() -> list[str]:
    return list(panel_lines(load_panel("uic60-760-1-15")))


def screen(thrown: CheckThrows | None = None) -> list[str]:
    return list(panel_lines(sb2_panel(), thrown=thrown))


@pytest.fixture(scope="module")
def thrown() -> CheckThrows:
    pieces = [
        PieceResult("1", 0.005, False, 2960.0, 2445.0, 3500.0, 0.00425),
        PieceResult("2", 0.005, True, -1.0, 0.0, 6001.0, 0.0123),
        PieceResult.without("3", 0.005, "no room"),
    ]
    nothing = float("nan")
    limits = [
        PieceLimit("1", 0.0049, "slip", 0.015),
        PieceLimit("2", float("inf"), "", 0.015),
        PieceLimit("3", nothing, "", nothing, "no room"),
    ]
    return CheckThrows(simulate(sb2_panel()), pieces, limits)


def test_the_screen_has_the_order_of_an_engineer(thrown: CheckThrows) -> None:
    order = ("PLAN", "CLOSED GAP", "FORCE MARGINS", "LEAST FLANGEWAY", "TEST PIECE", "ASSUMPTIONS")
    for lines in (screen(), screen(thrown)):
        heads = [
            next(word for word in order if line.startswith(word))
            for line in lines
            if line.startswith(order)
        ]
        assert tuple(heads) == order


def test_the_least_pieces_are_reported_with_the_part_of_the_rule(thrown: CheckThrows) -> None:
    text = "\n".join(screen(thrown))
    assert "drive 1 refuses to lock from 4.9 mm on, by slip" in text
    assert "drive 2 locks on every piece up to 15 mm" in text
    assert "drive 3: least piece that is refused not known: no room" in text


def test_without_a_throw_the_screen_says_what_one_would_add() -> None:
    lines = screen()
    assert sum("add --throw" in line for line in lines) == 3
    assert any("estimated from the strokes" in line for line in lines)


def test_closed_gaps_are_those_of_the_run(thrown: CheckThrows) -> None:
    lines = screen(thrown)
    at = [number for number, line in enumerate(lines) if line.startswith("  x [m]")]
    places = [float(cell) for number in at for cell in lines[number].split()[2:]]
    cells = [cell for number in at for cell in lines[number + 1].split()[1:]]
    end = thrown.dataset["gap"].sel(rail="A").isel(time=-1)
    assert places == pytest.approx(thrown.dataset["x"].values, abs=0.005)
    closed = np.array([cell == "closed" for cell in cells])
    np.testing.assert_array_equal(closed, end.values < 0.0)
    gaps = [float(cell.replace("closed", "0")) for cell in cells]
    assert gaps == pytest.approx(np.maximum(1e3 * end.values, 0.0), abs=0.0051)


def test_margins_are_those_of_the_run(thrown: CheckThrows) -> None:
    force = thrown.dataset["drive_force"].sel(drive="2")
    opening = -float(force.min()) / 1e3
    line = line_of(screen(thrown), "2 opening")
    assert line.startswith(f"2 opening {opening:.2f} kN 6.00 kN {6 - opening:.2f} kN")
    assert line.endswith("near its slip level")
    assert "near" not in line_of(screen(thrown), "2 closing")


def test_the_flangeway_is_reported_with_its_place(thrown: CheckThrows) -> None:
    least = float(thrown.dataset["least_flangeway"])
    rail = thrown.dataset["least_flangeway_rail"].values
    line = line_of(screen(thrown), f"{1e3 * least:.2f} mm at x = ")
    assert line.endswith(f"rail {rail}; TOO NARROW: at least 58 mm required")


def test_test_pieces_are_reported(thrown: CheckThrows) -> None:
    lines = screen(thrown)
    assert line_of(lines, "1 YES, not seen") == ("1 YES, not seen 2.96 kN 2.44 kN 3.50 kN 4.25 mm")
    assert line_of(lines, "2 no") == "2 no 0.00 kN 0.00 kN 6.00 kN 12.30 mm"
    assert line_of(lines, "3 no result") == "3 no result: no room"


def test_only_assumptions_unless_all_values_are_asked_for() -> None:
    short = default_lines()
    assumed = short[
        short.index("ASSUMPTIONS stated in the file (all values with their origins: --values)")
        + 1 :
    ]
    values = [line for line in assumed if line.startswith("  ")]
    assert len(values) > 20
    assert all("assumption" in line for line in values)
    assert all("assumption" in line or line.split()[0] in Panel.model_fields for line in assumed)
    whole = panel_lines(load_panel("uic60-760-1-15"), values=True)
    assert any("paper:" in line for line in whole)


def test_a_throw_without_equilibrium_shows_what_the_file_says(thrown: CheckThrows) -> None:
    nothing = thrown.dataset.isel(time=slice(0, 0))
    nothing = nothing.assign_attrs(complete=False, outcome_message="no equilibrium at t = 0")
    lines = screen(CheckThrows(nothing, thrown.pieces))
    assert "THROW NOT COMPLETE: no equilibrium at t = 0" in lines
    assert any("estimated from the strokes" in line for line in lines)
    assert plot_plan(sb2_panel(), dataset=nothing).axes[1].get_ylabel().count("estimated") == 1


def test_a_rail_without_stock_rail_has_no_closed_gap(thrown: CheckThrows) -> None:
    panel = sb2_panel()
    bare = panel.rail["B"].model_copy(update={"stock_rail_gap": None})
    changed = panel.model_copy(update={"rail": {**panel.rail, "B": bare}})
    lines = list(panel_lines(changed, thrown=thrown))
    gaps = lines[lines.index(next(x for x in lines if x.startswith("CLOSED GAP"))) :]
    assert any(line.startswith("  A  ") for line in gaps)
    assert not any(line.startswith("  B  ") for line in gaps)


def test_the_bushing_is_explained() -> None:
    text = " ".join(default_lines())
    assert "stretches by force / stiffness" in text
    assert "Lock is refused: 'slip or gap' where a drive is saturated" in text
    assert "drive 1 by 1.33 mm for each kN" in text
    table = {"drive.2.extension": [-0.01, 0.0, 0.01], "drive.2.force": [-6000.0, 0.0, 6000.0]}
    tabulated = load_panel("uic60-760-1-15").with_overrides(table)
    assert "drive 2 by its table" in " ".join(panel_lines(tabulated))


@pytest.mark.parametrize("name", library_names())
def test_every_number_of_a_library_panel_has_an_origin_or_is_a_default(name: str) -> None:
    kinds = ("paper:", "source:", "computed:", "assumption:", "default")
    lines = list(value_lines(load_panel(name)))
    numbers = [line for line in lines if re.match(r"  \S.{29} -?\d", line)]
    assert len(numbers) > 20
    assert [line for line in numbers if not any(kind in line for kind in kinds)] == []


@pytest.mark.parametrize(
    ("value", "unit", "name", "text"),
    [
        (6000.0, "N", "saturation_force", "6 kN"),
        (4e7, "N/m", "stiffness", "40000 kN/m"),
        (3.6, "m", "x", "3.6 m"),
        (2.1e11, "N/m^2", "youngs_modulus", "210 GPa"),
        (0.4, None, "friction_coefficient", "0.4"),
        ([-0.06, 0.06], "m", "foot_offsets", "-60, 60 mm"),
        ({"2": 0.2}, "s", "extra_time", "2: 0.2 s"),
        (["A", "B"], None, "rails", "A, B"),
    ],
)
def test_numbers_in_engineers_units(value: object, unit: str, name: str, text: str) -> None:
    assert shown(value, unit, name) == text


def test_sections_are_tabulated_for_every_rail() -> None:
    lines = list(section_lines(load_panel("sb2")))
    assert sum(line.startswith("rail ") for line in lines) == 2
    full = lines[lines.index("rail B, section tongue: as rail A") - 1].split()
    assert full[0] == "18.600"
    assert full[2] == "92.80"


def test_sections_that_are_alike_are_tabulated_once_and_stock_rails_too() -> None:
    lines = list(section_lines(load_panel("uic60-760-1-15")))
    assert lines.count("rail curved, section tongue: as rail straight") == 1
    assert "stock rail straight, section stock, the same all along: as stock rail curved" in lines
    stock = lines[lines.index("stock rail curved, section stock, the same all along") + 2].split()
    assert float(stock[2]) == pytest.approx(77.25, rel=1e-3)
    places = [line.split()[0] for line in lines if line.startswith("   ")]
    assert places.count("0.000") == 1


def test_good_paths_pass(tmp_path: Path) -> None:
    check_outputs({"--out": tmp_path / "a.nc", "--plot": None}, SUFFIXES)


@pytest.mark.parametrize(
    ("out", "plot", "words"),
    [
        (".", None, "is a folder"),
        ("none/a.nc", None, "there is no folder"),
        ("file/a.nc", None, "is no folder"),
        ("a.txt", None, "must end in .nc"),
        (None, "a.gif", "must end in .png or .svg"),
        ("a.nc", "sub/../a.nc", "is also the file of --out"),
    ],
)
def test_bad_paths_are_refused(
    tmp_path: Path, out: str | None, plot: str | None, words: str
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    (tmp_path / "sub").mkdir()
    paths = {"--out": out and tmp_path / out, "--plot": plot and tmp_path / plot}
    suffixes = {"--out": (".nc",), "--plot": (".png", ".svg", ".nc")}
    with pytest.raises(FileError, match=words):
        check_outputs(paths, suffixes if plot and "nc" in plot else SUFFIXES)  # type: ignore[arg-type]


def test_a_folder_that_is_not_writable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write anywhere, so the system's answer is put in its mouth."""
    monkeypatch.setattr("turnout.cli.options.os.access", lambda path, mode: path != tmp_path)
    with pytest.raises(FileError, match="is not writable; choose another"):
        check_outputs({"--out": tmp_path / "a.nc"}, SUFFIXES)


def test_all_bad_paths_are_reported_at_once(tmp_path: Path) -> None:
    paths = {"--out": tmp_path / "a.txt", "--plot": tmp_path / "none" / "a.png"}
    with pytest.raises(FileError, match=r"(?s)--out.*--plot"):
        check_outputs(paths, SUFFIXES)


def reported(capsys: pytest.CaptureFixture[str]) -> list[str]:
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err.splitlines()


def test_progress_is_silent_for_a_quick_run(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar("simulating", compiling=False, quiet=False) as watch:
        watch.report(10, 100)
    assert reported(capsys) == []


def test_progress_is_a_plain_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 1.0, 2.5, 3.0, 8.0])
    times = SimpleNamespace(monotonic=clock.__next__, perf_counter=time.perf_counter)
    monkeypatch.setattr("turnout.cli.watch.time", times)
    with ProgressBar("simulating", compiling=True, quiet=False) as watch:
        for done in (10, 20, 30, 40):
            watch.report(done, 100)
    assert reported(capsys) == [
        COMPILING,
        "simulating: 20 %",
        "simulating: 40 %",
    ]


def test_quiet_is_quiet(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 60.0])
    times = SimpleNamespace(monotonic=clock.__next__, perf_counter=time.perf_counter)
    monkeypatch.setattr("turnout.cli.watch.time", times)
    with ProgressBar("simulating", compiling=True, quiet=True) as watch:
        watch.report(50, 100)
    assert reported(capsys) == []


def test_time_passes_while_kernels_compile(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("turnout.cli.watch.TICK", 0.01)
    with ProgressBar("simulating", compiling=True, quiet=False) as watch:
        deadline = time.monotonic() + 10.0
        lines: list[str] = []
        while len(lines) < 3 and time.monotonic() < deadline:
            lines += reported(capsys)
        watch.report(0, 100)
        reported(capsys)
        time.sleep(0.05)
        assert reported(capsys) == [], "nothing is shown once steps are made"
    assert lines[0] == COMPILING
    assert lines[1].startswith("still compiling, ")


def test_a_terminal_has_one_line_that_is_written_over(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("turnout.cli.watch.TICK_ON_TERMINAL", 0.01)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with ProgressBar("simulating", compiling=True, quiet=False):
        time.sleep(0.2)
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert f"\r{COMPILING}: 0 s so far" in text


def test_kernels_that_cannot_be_kept_are_reported_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    reason = "/unwritable/kernels is not writable"
    monkeypatch.setattr("turnout.throw.compilation.why_private", lambda: reason)
    for _ in range(2):
        watched("simulating")
    (line,) = reported(capsys)
    assert line.startswith(f"turnout: {reason}, so the kernels are compiled again")
    monkeypatch.setattr("turnout.throw.compilation.why_private", lambda: "")
    assert cache_fault() == ""


def test_a_folder_in_which_nothing_can_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in /proc, where even root seems allowed to write, and is not."""

    def refuse(**_: object) -> None:
        raise OSError(2, "No such file or directory")

    monkeypatch.setattr("turnout.cli.options.tempfile.TemporaryFile", refuse)
    with pytest.raises(FileError, match="no file can be made in .*choose another folder"):
        check_outputs({"--out": tmp_path / "a.nc"}, SUFFIXES)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="there is no /proc here")
def test_proc_is_refused_before_the_run() -> None:
    with pytest.raises(FileError, match=r"--plot /proc/x\.png: "):
        check_outputs({"--plot": Path("/proc/x.png")}, SUFFIXES)


def test_a_link_is_checked_where_it_points(tmp_path: Path) -> None:
    (tmp_path / "link.nc").symlink_to(tmp_path / "none" / "run.nc")
    with pytest.raises(FileError, match="there is no folder .*none"):
        check_outputs({"--out": tmp_path / "link.nc"}, SUFFIXES)


def test_output_is_quiet_where_it_should_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lines, files and rows are shown, unless quiet or beside JSON; files are written always."""
    for given in ({}, {"quiet": True}, {"as_json": True}):
        output = Output("demo", **given)
        output.rows("note", ["one", "two"])
        output.write(tmp_path / "a.txt", "text")
        output.write(None, "nothing")
        assert output.written == [tmp_path / "a.txt"]
        shown = capsys.readouterr().out.splitlines()
        expected = ["note        one", "            two", f"written     {tmp_path / 'a.txt'} (4 B)"]
        assert shown == ([] if given else expected)


def test_an_interrupted_command_says_what_is_kept(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as ended, resumable("throws so far are kept"):
        raise KeyboardInterrupt
    assert ended.value.exit_code == INTERRUPTED
    assert capsys.readouterr().err == "turnout: interrupted; throws so far are kept\n"
