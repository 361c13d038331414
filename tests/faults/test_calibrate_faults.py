"""What cannot be calibrated is refused with everything that is wrong, before anything is thrown."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.faults.terminal import run_here

from turnout.calibration.calibrate import calibrate
from turnout.calibration.measured_movements import observe
from turnout.calibration.requirements import check_campaign
from turnout.calibration.stages import Parameter, default_plan
from turnout.core.errors import MeasurementError, PanelError
from turnout.panel.load import load_panel
from turnout.throw.store import save_response

TIME = np.arange(-1.0, 4.0, 1e-3)
FREED, FIXED = ["--free", "drive.1.stiffness"], ["--fix", "drive.1.stiffness"]


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


def test_one_run_is_no_campaign() -> None:
    with pytest.raises(MeasurementError, match="not a built campaign"):
        calibrate(xr.Dataset({"drive_force": ("time", TIME)}), load_panel("sb1"))


def test_bounds_that_exclude_the_start() -> None:
    with pytest.raises(PanelError, match=r"outside its bounds.*widen them, or start inside"):
        Parameter(name="mu", keys=("mu",), start=0.4, lower=0.5, upper=1.0)


def still(number: int) -> np.ndarray:
    """Forces of which those of one drive never change."""
    forces = np.tile(1000.0 * np.clip(TIME, 0.0, 3.0), (2, 2, 1))
    forces[:, number] = 0.0
    return forces


REFUSED: list[tuple[dict[str, object], list[str], str]] = [
    # The five of which every campaign may have one.
    ({"size": [0.005, 0.013], "place": ["drive 1"] * 2}, [], "no movement without an object is"),
    ({}, ["--exclude", "free", "--exclude", "trapped"], "every movement is excluded; keep"),
    ({}, ["--free", "drive.1.stifness"], "nearest is 'drive.1.stiffness'"),
    ({}, ["--set", "chair.friction_coefficient=1.5"], "start = 1.5: is outside its bounds 0.02"),
    (
        {"forces": still(1)},
        [],
        "drive 2: never moves, its force changes by 0 N at most; check its column",
    ),
    # Others.
    ({}, ["--fix", "drive.1.stroke"], "not a parameter of the default stages"),
    ({}, ["--free", "drive.1.height"], "drive.1.height = 0: is not positive"),
    ({}, ["--free", "drive.1.rail"], "is not a number, so it cannot be fitted"),
    ({}, ["--free", "gravity", "--fix", "gravity"], "gravity: is not a parameter of the default"),
    ({}, [*FREED, *FIXED], "drive.1.stiffness: is both freed and fixed; take one"),
    ({}, ["--exclude", "free"], "no movement without an object is left; measure"),
    ({}, ["--exclude", "movement_99"], "exclude movement_99: there is no such movement"),
    ({"drive": ["A", "B"]}, [], "name the drives of the channel map as in the panel"),
    ({"place": ["none", "sleeper 99"]}, [], "there is no sleeper '99'"),
    ({"size": [0.0, 0.150]}, [], "larger than the opening"),
    ({"direction": ["closing", "shut"]}, [], "the panel's schedule has no shut movement"),
    ({}, ["--set", "drive.1.stiffness=800"], "has no unit, 800 would be 800 N/m"),
    ({}, ["--panel", "sb9"], "nearest is 'sb"),
    ({}, ["-o", "result.json"], "must end in .toml"),
    ({}, ["-o", "nowhere/c.toml"], "there is no folder nowhere"),
    ({}, ["--figures", "campaign.nc"], "campaign.nc"),
    ({}, ["--workers", "0"], "--workers"),
]


@pytest.mark.parametrize(
    ("changes", "options", "words"), REFUSED, ids=[words[:40] for _, _, words in REFUSED]
)
def test_the_command_refuses_with_one_message(
    tmp_path: Path, changes: dict[str, object], options: list[str], words: str
) -> None:
    save_response(campaign(**changes), tmp_path / "campaign.nc")
    line = ["calibrate", "campaign.nc", "--panel", "sb1", *options]
    code, said = run_here(*line, folder=tmp_path)
    assert code == 2
    assert words in said
    assert "Traceback" not in said
    assert {path.name for path in tmp_path.iterdir()} == {"campaign.nc"}


def test_without_an_object_free_movement_friction_can_be_fixed() -> None:
    panel = load_panel("sb1")
    dataset = campaign(size=[0.005, 0.013], place=["drive 1"] * 2)
    fixed = default_plan(panel, fixed=["chair.friction_coefficient"])
    check_campaign(observe(dataset, panel), fixed, panel, source="autumn")


def test_a_rod_whose_force_changes_by_less_than_thirty_newtons_is_dead() -> None:
    panel, forces = load_panel("sb1"), still(1)
    forces[:, 1] = 40.0 * np.clip(TIME, 0.0, 1.0)
    check_campaign(
        observe(campaign(forces=forces), panel), default_plan(panel), panel, source="autumn"
    )
    dead = observe(campaign(forces=0.6 * forces), panel)
    with pytest.raises(MeasurementError, match="drive 2: never moves"):
        check_campaign(dead, default_plan(panel), panel, source="autumn")


def test_a_calibration_that_is_none_is_refused_by_simulate(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text("size = 1\n", encoding="utf-8")
    code, said = run_here("simulate", "sb1", "--calibration", "x.toml", folder=tmp_path)
    assert code == 2
    assert "is not a calibration" in said
