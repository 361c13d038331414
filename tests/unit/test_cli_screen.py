"""What the program prints: panels with origins, units, sections, progress, output checks."""

import re
from pathlib import Path

import pytest

from turnout.cli.outputs import check_outputs
from turnout.cli.sections import section_lines
from turnout.cli.show import panel_lines
from turnout.cli.units import shown
from turnout.cli.watch import Watch
from turnout.errors import FileError
from turnout.panel.load import library_names, load_panel

SUFFIXES = {"--out": (".nc",), "--plot": (".png", ".svg")}


def line_of(lines: list[str], start: str) -> str:
    (found,) = [line for line in lines if " ".join(line.split()).startswith(start)]
    return " ".join(found.split())


@pytest.fixture(scope="module")
def default() -> list[str]:
    panel = load_panel("uic60-760-1-15")
    return list(panel_lines(panel.with_settings(["chair.5.friction_coefficient=0.3"])))


@pytest.mark.parametrize(
    ("start", "rest"),
    [
        ("friction_coefficient 0.4", "paper: section 4.1"),
        ("friction_coefficient (5) 0.3", "override: 0.3"),
        ("stiffness (1) 750 kN/m", "paper: section 4.2"),
        ("stroke (2) 75 mm", "computed"),
        ("x 0 ... 14.4 m", "computed"),
        ("extra_time (return) 2: 0.2 s", "paper: section 3"),
        ("limit 13 mm", "paper"),
    ],
)
def test_values_are_shown_with_their_origin(default: list[str], start: str, rest: str) -> None:
    assert rest in line_of(default, start)


def test_the_bushing_is_explained(default: list[str]) -> None:
    text = " ".join(default)
    assert "leaves 4.4 mm at Drive 2" in text
    assert "drive 1 by 1.33 mm for each kN" in text


@pytest.mark.parametrize("name", library_names())
def test_every_number_of_a_library_panel_has_an_origin_or_is_a_default(name: str) -> None:
    kinds = ("paper:", "source:", "computed:", "assumption:", "default")
    lines = list(panel_lines(load_panel(name)))
    body = lines[lines.index("") + 1 : -5]
    numbers = [line for line in body if re.match(r"  \S.{29} -?\d", line)]
    assert len(numbers) > 20
    assert [line for line in numbers if not any(kind in line for kind in kinds)] == []


@pytest.mark.parametrize(
    ("value", "unit", "name", "text"),
    [
        (6000.0, "N", "saturation_force", "6 kN"),
        (4e7, "N/m", "stiffness", "40 kN/mm"),
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
    full = lines[lines.index("rail B, section tongue") - 1].split()
    assert full[0] == "18.600"
    assert full[2] == "92.80"


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
    monkeypatch.setattr("turnout.cli.outputs.os.access", lambda path, mode: path != tmp_path)
    with pytest.raises(FileError, match="is not writable; choose another"):
        check_outputs({"--out": tmp_path / "a.nc"}, SUFFIXES)


def test_all_bad_paths_are_told_at_once(tmp_path: Path) -> None:
    paths = {"--out": tmp_path / "a.txt", "--plot": tmp_path / "none" / "a.png"}
    with pytest.raises(FileError, match=r"(?s)--out.*--plot"):
        check_outputs(paths, SUFFIXES)


def told(capsys: pytest.CaptureFixture[str]) -> list[str]:
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err.splitlines()


def test_progress_is_silent_for_a_quick_run(capsys: pytest.CaptureFixture[str]) -> None:
    with Watch("simulating", compiling=False, quiet=False) as watch:
        watch.report(10, 100)
    assert told(capsys) == []


def test_progress_is_a_plain_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 1.0, 2.5, 3.0, 8.0])
    monkeypatch.setattr("turnout.cli.watch.time.monotonic", lambda: next(clock))
    with Watch("simulating", compiling=True, quiet=False) as watch:
        for done in (10, 20, 30, 40):
            watch.report(done, 100)
    assert told(capsys) == [
        "compiling kernels, first run only (about 30 s)",
        "simulating: 20 %",
        "simulating: 40 %",
    ]


def test_quiet_is_quiet(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 60.0])
    monkeypatch.setattr("turnout.cli.watch.time.monotonic", lambda: next(clock))
    with Watch("simulating", compiling=True, quiet=True) as watch:
        watch.report(50, 100)
    assert told(capsys) == []
