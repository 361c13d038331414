"""Forces of fastenings: kept on request only, in balance with everything else that acts."""

import numpy as np
import pytest
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.mechanism.build import rail_data
from turnout.panel.load import load_panel
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

BOTH = ("fastening_force", "fastening_moment")
PANEL = load_panel("uic60-760-1-15").with_overrides(
    {
        "rail.heel": "free",
        "schedule.end": 2.6,
        "movement.throw.start": 0.1,
        "movement.throw.duration": 1.0,
        "movement.return.start": 1.5,
        "movement.return.duration": 0.7,
    }
)
OPEN = 1450
"""An instant between the movements, the first open and at rest but for a ripple [ms]."""


@pytest.fixture(scope="module")
def thrown() -> xr.Dataset:
    return simulate(PANEL, save=Save(also=BOTH))


def lateral_sum(ds: xr.Dataset, at: int) -> float:
    """Sum what acts laterally on both rails; the links between them cancel."""
    now = ds.isel(time=at)
    total = float(now["fastening_force"].sel(axis="y").sum() + now["drive_force"].sum())
    sides = xr.DataArray([-1.0, 1.0], coords={"rail": ["straight", "curved"]}, dims="rail")
    return total + float(now["chair_friction_force"].sum() + (sides * now["stop_force"]).sum())


def test_at_rest_fastenings_and_chairs_carry_the_weight(thrown: xr.Dataset) -> None:
    first = thrown.isel(time=0)
    for rail, data in zip(thrown["rail"].values, rail_data(PANEL)[:2], strict=True):
        weight = 9.81 * 7850.0 * float(np.sum(data.sections.area * np.diff(data.x)))
        carried = first["fastening_force"].sel(rail=rail, axis="z").sum()
        carried = float(carried + first["chair_normal_force"].sel(rail=rail).sum())
        # fastenings are no interface: modes above the superelement's cut-off would carry the rest
        assert carried == pytest.approx(weight, rel=5e-4)


def test_lateral_forces_balance_at_rest_and_but_for_inertia_in_motion(thrown: xr.Dataset) -> None:
    assert abs(lateral_sum(thrown, 0)) < 1e-6
    largest = float(np.abs(thrown["drive_force"]).max())
    assert largest > 500.0
    assert abs(lateral_sum(thrown, OPEN)) < 0.05 * largest


def test_opening_drives_are_held_back_by_the_fastenings(thrown: xr.Dataset) -> None:
    force = thrown["fastening_force"].sel(fastening="1", axis="y").isel(time=OPEN)
    moment = thrown["fastening_moment"].sel(fastening="1", axis="z").isel(time=OPEN)
    assert float(thrown["drive_force"].isel(time=OPEN).sum()) < 0
    assert np.all(np.isfinite(force))
    # the rail turns about z as its toe goes towards -y, and the first fastening turns it back
    assert float(moment.sel(rail="straight")) < 0


def test_they_are_left_out_unless_asked_for() -> None:
    assert Save().keeps("drive_force")
    assert not Save().keeps("fastening_force")
    assert Save(fields=("fastening_force",)).keeps("fastening_force")
    assert Save(also=("fastening_force",)).keeps("gap")


def test_unknown_channel_besides_is_refused() -> None:
    with pytest.raises(ResponseError, match="fastening_forse.*nearest is fastening_force"):
        Save(also=("fastening_forse",))
    with pytest.raises(ResponseError, match="must be a tuple"):
        Save(also="fastening_force")  # type: ignore[arg-type]
