"""Bad input to `turnout import`: one message, exit code 2, no traceback, no file left."""

from pathlib import Path

import pytest
from tests.faults.terminal import run_here, run_shell
from tests.unit.test_measurement_optional import tdms

GOOD = "Time (s),Rod 1 (mV/V)\n0,0.1\n0.001,0.2\n0.002,0.3\n"
MAP = """
[drive_force.1]
column = "Rod 1"
kind = "strain bridge"
gauge_factor = 2.1
youngs_modulus = "210 GPa"
diameter = "40 mm"
eccentricity = "60 mm"
"""


@pytest.mark.parametrize(
    ("content", "channel_map", "words"),
    [
        (None, MAP, ("throw.csv: no such file",)),
        ("", MAP, ("throw.csv: the file is empty",)),
        ("hello\n", MAP, ("there are no rows of numbers",)),
        (GOOD.replace("0.2", "x"), MAP, ("line 3, column 'Rod 1': 'x' is not a number",)),
        (GOOD.replace(" (mV/V)", ""), MAP, ("drive_force.1", "states the unit")),
        (GOOD.replace("(mV/V)", "[furlong]"), MAP, ('"furlong" is no unit of a sensor',)),
        (GOOD, MAP.replace("Rod 1", "Rod 3"), ('"Rod 3": is not in the file', "'Rod 1'")),
        (GOOD, MAP.replace("60 mm", "60"), ("map.toml: 1 problem", "write the unit")),
        (GOOD, MAP.replace("= 2.1", "= -1").replace("40 mm", "4 N"), ("map.toml: 2 problems",)),
        (GOOD, MAP + "= 3", ("map.toml: not valid TOML",)),
        (GOOD, None, ("map.toml: no such file",)),
    ],
)
def test_bad_files(
    tmp_path: Path, content: str | None, channel_map: str | None, words: tuple[str, ...]
) -> None:
    given = {"throw.csv": content, "map.toml": channel_map}
    for name, text in given.items():
        if text is not None:
            (tmp_path / name).write_text(text, encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    code, message = run_here(
        *("import", "throw.csv", "--channels", "map.toml", "--out", "throw.nc"), folder=tmp_path
    )
    assert code == 2, message
    assert "Traceback" not in message
    for word in words:
        assert word in message
    assert sorted(tmp_path.iterdir()) == before


def test_all_wrong_options_at_once(tmp_path: Path) -> None:
    (tmp_path / "throw.csv").write_text(GOOD, encoding="utf-8")
    code, message = run_here(
        *("import", "throw.csv", "--out", "throw.nc", "--smooth", "0.1"), folder=tmp_path
    )
    assert code == 2
    assert "--out: needs --channels MAP" in message
    assert "--smooth: needs --channels MAP" in message
    assert "--smooth 0.1: has no unit" in message
    code, message = run_here("import", "throw.csv", "--plot", "a.gif", folder=tmp_path)
    assert code == 2
    assert "must end in .png or .pdf or .svg" in message


def test_a_truncated_tdms_file_is_listed_with_a_note(tmp_path: Path) -> None:
    """What its reader would print does not reach the screen."""
    pytest.importorskip("nptdms", reason="the extra daq is not installed")
    tdms(tmp_path / "throw.tdms")
    content = (tmp_path / "throw.tdms").read_bytes()
    (tmp_path / "throw.tdms").write_bytes(content[: len(content) // 2])
    assert run_shell("import", "throw.tdms", folder=tmp_path) == (0, "")
