"""`turnout campaign` on good and bad input: one message, exit 2, no traceback, nothing lost."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.unit.campaigns import copied, edited, made
from typer.testing import CliRunner, Result

from turnout.cli.main import app
from turnout.core.errors import TurnoutError
from turnout.throw.store import open_response


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["campaign", *map(str, arguments)])


def refused(*arguments: str | Path) -> str:
    """Return the message that the program ends with exit code 2 for."""
    result = run(*arguments)
    assert isinstance(result.exception, TurnoutError), (result.output, result.exception)
    return str(result.exception)


def test_check_build_and_plot_go_through(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    checked = run("check", folder)
    assert checked.exit_code == 0, checked.output
    assert "9 in the sheet, 9 usable" in checked.output
    assert "(synthetic)" in checked.output
    built = run("build", folder)
    assert built.exit_code == 0, built.output
    assert open_response(folder / "campaign.nc").sizes["movement"] == 9
    for extra in ((), ("--place", "Sleeper6")):
        figure = tmp_path / "figure.png"
        drawn = run("plot", folder / "campaign.nc", *extra, "--out", figure)
        assert drawn.exit_code == 0, drawn.output
        assert figure.read_bytes().startswith(b"\x89PNG")
        figure.unlink()


def test_a_virtual_campaign_goes_through(tmp_path: Path) -> None:
    folder = tmp_path / "virtual"
    result = run(
        "virtual", "--panel", "sb2", "--place", "sleeper 6", "--size", "31 mm", "--repeats", "1",
        "--mistype", "2", "--workers", "1", "--format", "h5", "--out", folder,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "3 movements, 1 of them with slip" in result.output
    lines = result.output.splitlines()
    first = next(n for n, line in enumerate(lines) if line.startswith("mistyped"))
    assert [bool(line[:12].strip()) for line in lines[first : first + 3]] == [True, False, True]
    assert run("build", folder).exit_code == 0


def test_a_virtual_campaign_leaves_out_objects_without_room(tmp_path: Path) -> None:
    """`campaign virtual --panel sb1` refused its own places: 1 mm of opening at the last ones."""
    result = run(
        *("virtual", "--panel", "sb1", "--place", "sleeper 1", "--place", "sleeper 11"),
        *("--size", "5 mm", "--size", "29 mm"),
        *("--repeats", "0", "--workers", "1", "--format", "h5", "--out", tmp_path / "virtual"),
    )
    assert result.exit_code == 0, result.output
    assert "left out    no room for 29 mm at sleeper 11" in result.output
    assert "3 movements" in result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--panel", "sb1", "--place", "sleeper 16", "--size", "13 mm"), "about 1 mm at most"),
        (("--panel", "sb1", "--place", "drive 2", "--size", "13 mm"), "13 mm at drive 2: no room"),
        (("--panel", "sb2", "--recorded-rate", "400 Hz"), "must be below 250 Hz"),
        (("--panel", "sb2", "--hide-recorder"), "there is nothing to hide"),
        (("--panel", "sb3"), "nearest is 'sb2'"),
        (("--panel", "sb2", "--place", "sleeper 66"), "sleeper '66'"),
        (("--panel", "sb2", "--size", "13"), "write the unit"),
        (("--panel", "sb2", "--place", "sleper 6"), "nearest is 'sleeper'"),
        (("--panel", "sb2", "--format", "doc"), "format '.doc'"),
        (("--panel", "sb2", "--set", "drive.2.stifness=1 kN/m"), "nearest is"),
    ],
)
def test_a_virtual_campaign_that_cannot_be_leaves_nothing(
    arguments: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    assert words in refused("virtual", *arguments, "--out", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_an_empty_folder_names_what_it_needs(tmp_path: Path) -> None:
    assert "is empty; put runs.csv or runs.toml there" in refused("build", tmp_path)
    assert "no such folder" in refused("check", tmp_path / "none")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_file_is_refused_and_the_last_build_stays(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    assert run("build", folder).exit_code == 0
    before = (folder / "campaign.nc").read_bytes()
    edited(folder, "sleeper-6_13mm_1.mat", "sleeper-6-13mm-1.mat")
    message = refused("build", folder)
    assert "there is no file sleeper-6-13mm-1.mat; nearest is 'sleeper-6_13mm_1.mat'" in message
    assert (folder / "campaign.nc").read_bytes() == before
    edited(folder, "sleeper-6-13mm-1.mat", "sleeper-6_13mm_1.mat")
    assert "9 taken from the cache" in run("build", folder).output


def test_a_bad_file_costs_its_own_movement_only(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    whole = (folder / "sleeper-6_13mm_1.mat").read_bytes()
    (folder / "sleeper-6_13mm_1.mat").write_bytes(whole[:5000])
    built = run("build", folder)
    assert built.exit_code == 0, built.output
    assert "excluded    sleeper-6_13mm_1:" in built.output
    kept = open_response(folder / "campaign.nc")
    assert kept.sizes["movement"] == 8
    assert "sleeper-6_13mm_1" in kept.attrs["excluded"]
    assert "sleeper-6_13mm_1" in refused("build", folder, "--strict")
    assert open_response(folder / "campaign.nc").sizes["movement"] == 8


def test_nothing_usable_is_an_error(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    for path in [*folder.glob("*.mat"), *folder.glob("*_*.csv")]:
        path.write_text("nothing", encoding="utf-8")
    assert "no movement is usable" in refused("build", folder)
    assert not (folder / "campaign.nc").exists()
    checked = run("check", folder)
    assert checked.exit_code == 1
    assert "9 in the sheet, 0 usable" in checked.output


def test_remarks_come_before_what_was_excluded(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    (folder / "extra.csv").write_text("time,x\n0,1\n", encoding="utf-8")
    (folder / "sleeper-6_13mm_1.mat").write_bytes(b"nothing")
    lines = run("check", folder).output.splitlines()
    starts = [line.split()[0] for line in lines if not line.startswith(" ")]
    assert starts.index("remarks") < starts.index("excluded")


def test_a_missing_channel_map_or_column_is_named(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    text = (folder / "channels.toml").read_text(encoding="utf-8")
    (folder / "channels.toml").write_text(text.replace('"Rod 1"', '"Rod one"'), encoding="utf-8")
    message = refused("build", folder)
    assert 'column = "Rod one"' in message
    assert "nearest is 'Rod" in message
    # One mistake in the map is one line, however many recordings it spoils.
    assert message.count("Rod one") == 1
    assert " and 5 more: " in message
    (folder / "channels.toml").unlink()
    assert "channels.toml: no such file" in refused("build", folder)
    assert "campaign.nc" not in [path.name for path in folder.iterdir()]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "figure.doc"), "must end in .png"),
        (("--direction", "up"), "must be closing or opening"),
        (("--place", "drive 1"), "there are sleeper 6"),
        (("--place", "sleper 6"), "nearest is 'sleeper'"),
    ],
)
def test_a_figure_that_cannot_be_drawn_says_why(
    arguments: tuple[str, ...], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert words in refused("plot", made() / "truth.nc", *arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_single_run_is_no_campaign(tmp_path: Path) -> None:
    from turnout.throw.store import save_response

    one = open_response(made() / "truth.nc").isel(movement=0, drop=True).drop_vars(
        ["direction", "size", "place", "repeat", "slipped", "remark", "file", "start_time"],
        errors="ignore",
    )  # fmt: skip
    save_response(one, tmp_path / "run.nc")
    assert "not a campaign" in refused("plot", tmp_path / "run.nc")


def test_a_folder_that_may_not_be_written_is_read_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from turnout.core import kept_results
    from turnout.core.errors import FileError

    def full(*_: object, **__: object) -> None:
        message = "no space"
        raise FileError(message)

    monkeypatch.setattr(kept_results, "write_atomic", full)
    folder = copied(tmp_path, built=False)
    assert run("check", folder).exit_code == 0
    assert list((folder / ".turnout").iterdir()) == []
    shutil.rmtree(folder)
    assert not np.isnan(open_response(made() / "truth.nc")["size"]).any()


def test_a_check_of_exchanged_rods_has_findings(tmp_path: Path) -> None:
    """Everything can be read, yet nothing can be calibrated to."""
    folder = copied(tmp_path)
    assert run("check", folder).exit_code == 0
    channels = folder / "channels.toml"
    text = channels.read_text(encoding="utf-8")
    text = (
        text.replace("Rod 2", "other").replace("Load cell", "Rod 2").replace("other", "Load cell")
    )
    channels.write_text(text, encoding="utf-8")
    result = run("check", folder)
    assert result.exit_code == 1
    assert "usable once columns are exchanged" in result.output
