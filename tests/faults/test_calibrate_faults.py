"""What cannot be calibrated is refused with everything that is wrong, before anything is thrown."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from turnout.errors import MeasurementError, PanelError
from turnout.panel.load import load_panel
from turnout.response.store import save_response
from turnout.study.calibration.calibrate import calibrate
from turnout.study.calibration.parameter import Parameter

TIME = np.arange(-1.0, 4.0, 1e-3)


def campaign(**changes: object) -> xr.Dataset:
    """Make a campaign of two movements, one with an object."""
    ramp = 1000.0 * np.clip(TIME, 0.0, 3.0)
    forces = np.array([[ramp, 0.5 * ramp], [2.0 * ramp, ramp]])
    columns = {
        "direction": ["closing", "closing"],
        "size": [0.0, 0.013],
        "place": ["none", "drive 1"],
    }
    columns |= {key: value for key, value in changes.items() if key in columns}
    names = changes.get("drive", ["1", "2"])
    return xr.Dataset(
        {"drive_force": (("movement", "drive", "time"), changes.get("forces", forces))},
        {
            "movement": ["free", "trapped"],
            "drive": names,
            "time": TIME,
            **{key: ("movement", value) for key, value in columns.items()},
        },
        {"title": "autumn", "schema_version": 1},
    )


def test_no_movement_without_an_object() -> None:
    with pytest.raises(MeasurementError, match=r"no movement without an object is left; measure"):
        calibrate(campaign(size=[0.005, 0.013], place=["drive 1"] * 2), load_panel("sb1"))


def test_everything_is_excluded() -> None:
    with pytest.raises(MeasurementError, match="every movement is excluded; keep at least one"):
        calibrate(campaign(), load_panel("sb1"), exclude=["free", "trapped"])


def test_an_unknown_movement_is_excluded() -> None:
    with pytest.raises(MeasurementError, match="exclude fre: there is no such movement"):
        calibrate(campaign(), load_panel("sb1"), exclude=["fre"])


def test_a_drive_that_never_moves() -> None:
    forces = np.zeros((2, 2, TIME.size))
    forces[:, 0] = 1000.0 * np.clip(TIME, 0.0, 3.0)
    with pytest.raises(MeasurementError, match=r"drive 2: never moves.*check its column"):
        calibrate(campaign(forces=forces), load_panel("sb1"))


def test_drives_that_the_panel_has_not() -> None:
    with pytest.raises(MeasurementError, match="name the drives of the channel map as in the pan"):
        calibrate(campaign(drive=["A", "B"]), load_panel("sb1"))


def test_a_place_that_the_panel_has_not() -> None:
    with pytest.raises(MeasurementError, match=r"trapped.*there is no sleeper '99'"):
        calibrate(campaign(place=["none", "sleeper 99"]), load_panel("sb1"))


def test_one_run_is_no_campaign() -> None:
    with pytest.raises(MeasurementError, match="no built campaign"):
        calibrate(xr.Dataset({"drive_force": ("time", TIME)}), load_panel("sb1"))


def test_bounds_that_exclude_the_start() -> None:
    with pytest.raises(PanelError, match=r"outside its bounds.*widen them, or start inside"):
        Parameter(name="mu", keys=("mu",), start=0.4, lower=0.5, upper=1.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--free", "drive.1.stifness"], "nearest is 'drive.1.stiffness'"),
        (["--fix", "drive.1.stroke"], "no parameter of the default stages"),
        (["-o", "result.json"], "must end in .toml"),
        (["--exclude", "nobody"], "there is no such movement"),
    ],
)
def test_the_command_refuses_with_one_message(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    options: list[str],
    words: str,
) -> None:
    from turnout.cli.main import main

    save_response(campaign(), tmp_path / "campaign.nc")
    monkeypatch.chdir(tmp_path)
    line = ["turnout", "calibrate", "campaign.nc", "--panel", "sb1", *options]
    monkeypatch.setattr("sys.argv", line)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "calibration.toml").exists()


def test_a_calibration_that_is_none_is_refused_by_simulate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from turnout.cli.main import main

    (tmp_path / "x.toml").write_text("size = 1\n", encoding="utf-8")
    line = ["turnout", "simulate", "sb1", "--calibration", str(tmp_path / "x.toml")]
    monkeypatch.setattr("sys.argv", line)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "is no calibration" in capsys.readouterr().err
