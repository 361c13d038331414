"""The dataset of modes: what it says of kind, place and scale; rigid bodies; files; text."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.verification.prismatic_panel import TEXT
from typer.testing import CliRunner, Result

from turnout.cli.main import app
from turnout.core.errors import ResponseError
from turnout.metric.modes import modes, reduction_texts
from turnout.panel.load import load_panel
from turnout.throw.store import open_response, save_response

COUNT = 3


@pytest.fixture(scope="module")
def found() -> xr.Dataset:
    return modes(load_panel("uic60-760-1-15-symmetric"), count=COUNT)


def test_every_system_has_its_modes(found: xr.Dataset) -> None:
    names = list(dict.fromkeys(found["system"].values.tolist()))
    assert names == [
        "rail straight, feet free",
        "rail straight, on its chairs",
        "rail curved, feet free",
        "rail curved, on its chairs",
        "panel at rest, feet free to slide",
        "panel at rest, feet sticking",
    ]
    assert found["number"].values.tolist() == [1, 2, 3] * len(names)


def test_shares_sum_to_one_and_belong_to_the_rail(found: xr.Dataset) -> None:
    np.testing.assert_allclose(found["motion_share"].sum("motion"), 1.0, rtol=1e-12)
    np.testing.assert_allclose(found["rail_share"].sum("rail"), 1.0, rtol=1e-12)
    curved = found.isel(mode=found["system"].values == "rail curved, feet free")
    assert np.all(curved["rail_share"].sel(rail="curved") == 1.0)
    assert np.isnan(curved["shape"].sel(rail="straight")).all()


def test_largest_displacement_is_one_and_where_it_is_said(found: xr.Dataset) -> None:
    for at in range(found.sizes["mode"]):
        mode = found.isel(mode=at)
        shape = mode["shape"].sel(rail=mode["largest_rail"].item(), x=float(mode["largest_x"]))
        foot = shape.sel(direction=["uy", "uz"]).values
        head = shape.sel(direction="uy").item() - 0.1 * shape.sel(direction="rx").item()
        assert max(*foot, head) == pytest.approx(1.0, abs=1e-9)


def test_feet_free_may_swing_up_and_down_and_on_chairs_not(found: xr.Dataset) -> None:
    free = found.isel(mode=found["system"].values == "rail straight, feet free")
    assert free["motion_share"].sel(motion="vertical").values[1] > 0.99
    held = found.isel(mode=found["system"].values == "rail straight, on its chairs")
    assert np.all(held["motion_share"].sel(motion="lateral") > 0.99)


def test_sticking_feet_are_much_stiffer(found: xr.Dataset) -> None:
    sliding, sticking = (
        found.isel(mode=found["system"].values == f"panel at rest, feet {feet}")["frequency"]
        for feet in ("free to slide", "sticking")
    )
    assert float(sticking[0]) > 10 * float(sliding[0])


CHAIRS = """
[chair]
x = { start = "0 m", step = "0.6 m", count = 11 }
foot_offsets = ["-60 mm", "60 mm"]
normal_stiffness = "1e7 N/m"
friction_coefficient = 0.4
stick_stiffness = "5e6 N/m"
[fastening.1]
x = "6 m"
stiffness_x = "1e7 N/m"
stiffness_y = "1e7 N/m"
"""


def test_rigid_modes_of_a_rail_come_first(tmp_path: Path) -> None:
    path = tmp_path / "free.toml"
    # at 2 kHz Lanczos passes over one of the modes between the chairs
    path.write_text(TEXT.replace('"clamped"', '"free"') + CHAIRS, encoding="utf-8")
    found = modes(load_panel(path), count=8)
    hung = found.isel(mode=found["system"].values == "rail A, feet free")
    # up and down, about x, about y; it turns about z on its one fastening
    assert hung["frequency"].values[:4].tolist() == [0.0] * 4
    assert np.isnan(hung["damping_ratio"].values[:4]).all()
    assert hung["frequency"].values[4] > 1.0


def test_damped_rail_has_the_ratio_of_its_panel(found: xr.Dataset) -> None:
    alone = found.isel(mode=0)
    frequency, low, high = float(alone["frequency"]), 2.0, 12.0
    expected = 0.02 * (low * high / frequency + frequency) / (low + high)
    assert float(alone["damping_ratio"]) == pytest.approx(expected, rel=0.01)


def test_count_must_be_positive() -> None:
    with pytest.raises(ResponseError, match="count = 0"):
        modes(load_panel("sb1"), count=0)


def test_a_file_keeps_all(found: xr.Dataset, tmp_path: Path) -> None:
    save_response(found, tmp_path / "modes.nc")
    kept = open_response(tmp_path / "modes.nc")
    assert kept.attrs.pop("Conventions").startswith("CF-")
    xr.testing.assert_identical(kept, found)


def test_reduction_is_reported_rail_by_rail() -> None:
    texts = reduction_texts(load_panel("sb1"))
    assert list(texts) == ["switch"]
    assert "at the interface" in texts["switch"]
    assert "relative error" in texts["switch"]
    assert "in the shapes of this rail: " in texts["switch"]


def command(words: str, *more: str) -> Result:
    return CliRunner().invoke(app, ["panel", "modes", "sb1", *words.split(), *more])


def test_command_prints_draws_and_writes(tmp_path: Path) -> None:
    out, plot = tmp_path / "m.nc", tmp_path / "m.png"
    chosen = f"--count 2 --reduction --out {out} --plot {plot} --system"
    result = command(chosen, "rail switch, feet free")
    assert result.exit_code == 0, result.output
    assert "rail switch, feet free" in result.output
    assert "at 1.25 times the friction all vibrations decay" in result.output
    assert "reduction of rail switch" in result.output
    assert open_response(out).sizes["mode"] == 8
    assert plot.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--plot", "shapes.txt"], "must end in"),
        (
            ["--plot", "x.png", "--system", "rail Z"],
            "no modes of 'rail Z'; there are those of 'rail switch, feet free'",
        ),
    ],
    ids=["suffix", "system"],
)
def test_command_refuses_what_it_cannot_draw_before_it_prints(words: list[str], said: str) -> None:
    result = command("", *words)
    assert said in str(result.exception)
    assert result.output == ""
