"""Bad input on the command line: one message, exit code 2, no traceback, no file left."""

import os
from pathlib import Path

import pytest
import xarray as xr
from tests.faults.terminal import run_here, run_shell
from tests.unit.simulated import sb1_dataset
from tests.unit.test_cli_simulate import QUICK

from turnout.panel.load import library_text
from turnout.throw.store import open_response, save_response


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("--set", "chair.friction_coeficient=0.3"),
            ("chair.friction_coeficient", "nearest is 'chair.friction_coefficient'"),
        ),
        (("--set", "drive.2.stiffness=81 mm"), ("drive.2.stiffness", "stiffness", "kN/m")),
        (("--set", "drive.2.stiffness=81000"), ("drive.2.stiffness", "write the unit")),
        (("--set", "drive.2.stiffness"), ("KEY=VALUE",)),
        (("--set", "chair.friction_coefficient=nan"), ("chair.friction_coefficient",)),
        (("sb3",), ("'sb3'", "nearest is 'sb2'")),
        (("none.toml",), ("none.toml",)),
        (("--object", "13mm"), ("SIZE@PLACE",)),
        (("--object", "13@sleeper6"), ("13 would be 13 m",)),
        (("--object", "13mm@sleeper66"), ("sleeper '66'", "there are '1'")),
        (("--object", "200mm@sleeper6"), ("200 mm", "larger than the opening")),
        (
            ("--object", "20mm stone@drive1, strength=200MPa, stiffness=1kN/mm"),
            ("strength = 200 MPa", "it cannot break", "more stiffness"),
        ),
        (
            ("--object", "13mm ice@drive1, temperature=-40degC, stiffness=300kN/m"),
            ("temperature = 233.15 K", "its strength is 25 MPa", "it cannot break", "less frost"),
        ),
        (
            ("--object", "2mm ice@drive1, piece=0.95"),
            ("piece = 0.95", "it cannot break", "no more than 0.1 mm of its 2 mm", "smaller piece"),
        ),
        (
            ("--object", "13mm stone@drive1, strength=0.1MPa"),
            ("strength = 0.1 MPa", "must be 1 to 200 MPa"),
        ),
        (("--object", "13mm stone@drive1, toughness=-1MPa"), ('no "toughness"',)),
        (("--step", "1"), ("--step 1", "write the unit")),
        (("--step", "0s"), ("must be more than 0",)),
        (("--cutoff", "300ms"), ("--cutoff 300ms", "frequency")),
        (("--out", "."), ("--out .", "is a folder")),
        (("--out", "none/run.nc"), ("--out none/run.nc", "create it first")),
        (("--out", "run.txt"), ("--out run.txt", "must end in .nc")),
        (("--plot", "run.gif"), ("--plot run.gif", "must end in .png or .pdf or .svg")),
        (("--no-such-option",), ("--no-such-option",)),
    ],
)
def test_bad_input_is_one_message(
    tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    outputs = () if {"--out", "--plot"} & set(arguments) else ("--out", "run.nc")
    code, message = run_here("simulate", *arguments, *outputs, folder=tmp_path)
    assert code == 2, message
    assert "Traceback" not in message
    for word in words:
        assert word in message
    assert list(tmp_path.iterdir()) == []


def test_all_that_is_wrong_with_a_line_is_reported_at_once(tmp_path: Path) -> None:
    line = ("--object", "bad", "--object", "5 mm @", "--set", "bad", "--step", "1", "--cutoff", "3")
    code, message = run_here("simulate", *line, folder=tmp_path)
    assert code == 2
    assert "Traceback" not in message
    for part in ('"bad" is not SIZE@PLACE', '"5 mm @" is not SIZE@PLACE', '"bad" is not KEY=VALUE'):
        assert part in message
    assert "--step 1: " in message
    assert "--cutoff 3: " in message


def test_out_and_plot_to_one_file(tmp_path: Path) -> None:
    code, message = run_here("simulate", "--out", "run.nc", "--plot", "./run.nc", folder=tmp_path)
    assert code == 2
    assert "is also the file of --out" in message


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_is_not_writable(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    code, message = run_here("simulate", "--out", str(tmp_path / "run.nc"), folder=tmp_path)
    tmp_path.chmod(0o700)
    assert code == 2
    assert "not writable" in message


@pytest.mark.parametrize(("option", "limit"), [("--out=run.nc", 50_000), ("--plot=run.png", 9_000)])
def test_no_space_left(tmp_path: Path, option: str, limit: int) -> None:
    """The limit holds for every file of the process, so the kernels must be compiled before."""
    resource = pytest.importorskip("resource", reason="this system limits no sizes of files")
    assert sb1_dataset().sizes["time"] > 0
    _, most = before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    try:
        code, message = run_here("simulate", "sb1", *QUICK, option, folder=tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert code == 2, message
    assert "no space left" in message
    assert "Traceback" not in message
    assert list(tmp_path.iterdir()) == []


def test_all_problems_of_a_panel_file_at_once(tmp_path: Path) -> None:
    text = library_text("sb1").replace("friction_coefficient", "friction_coeficient")
    assert 'stroke = "120 mm"' in text
    text = text.replace('stroke = "120 mm"', "stroke = 0.12").replace("750 kN/m", "750 kN")
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    code, message = run_here("panel", "check", "own.toml", folder=tmp_path)
    assert code == 2
    assert "Traceback" not in message
    assert "friction_coeficient" in message
    assert "drive.1.stiffness" in message
    assert "drive.1.stroke" in message
    assert "0.12 m" in message
    assert "problems" in message.splitlines()[0]


def test_the_same_run_from_a_shell(tmp_path: Path) -> None:
    """From the program's start to the file on disk: the same numbers as in this process."""
    code, message = run_shell("simulate", "sb1", *QUICK, "--out", "run.nc", folder=tmp_path)
    assert code == 0, message
    save_response(sb1_dataset(), tmp_path / "same.nc")
    here, there = (open_response(tmp_path / name) for name in ("same.nc", "run.nc"))
    xr.testing.assert_identical(there.drop_attrs(), here.drop_attrs())
