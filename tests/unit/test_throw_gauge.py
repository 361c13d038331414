"""Gauge beside the closed rail: its datum, roll, widening, both routes, and where it is silent."""

from functools import cache

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.panel.profile import evaluate_profile
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

DEFAULT = "uic60-760-1-15"
KEPT = Save(also=("gauge",), stations="all", interval=0.1)


@cache
def thrown(size: float = 0.0, **values: object) -> xr.Dataset:
    """Throw the default panel with changes, whose keys have "__" for a dot."""
    panel = load_panel(DEFAULT, overrides={k.replace("__", "."): v for k, v in values.items()})
    trapped = ForeignObject(size, "sleeper 6") if size else None
    return simulate(panel, foreign_object=trapped, mode="quasi-static", save=KEPT)


def narrowed(dataset: xr.Dataset) -> float:
    """Return by how much the gauge is narrowed [m]."""
    return float(dataset.attrs["gauge_nominal"] - dataset["least_gauge"])


def test_narrowing_of_an_object_and_of_an_assumed_fit_gap() -> None:
    """As a beam study of the same panel found: 12.9, 6.4 and, without friction, 4.2 mm."""
    trapped, alone = thrown(0.013), thrown()
    smooth = thrown(chair__friction_coefficient=0.0)
    found = [round(1e3 * narrowed(dataset), 1) for dataset in (trapped, alone, smooth)]
    assert found == [12.9, 6.4, 4.2]
    assert str(trapped["least_gauge_place"].values) == "sleeper 6"
    assert float(trapped["least_gauge_x"]) == pytest.approx(3.6)
    assert str(trapped["least_gauge_rail"].values) == "straight"


def test_gauge_is_that_of_the_gap_but_for_stock_rail_and_roll() -> None:
    """With both at the height of the contact the rolls agree, and the stock rail is what is left.

    It is pushed outwards where the switch rail presses on it, by less than half a millimetre.
    """
    dataset = thrown(gauge__height=0.1)
    narrow = dataset.attrs["gauge_nominal"] - dataset["gauge"].isel(time=-1)
    apart = narrow - dataset["gap"].sel(rail="straight").isel(time=-1)
    assert float(abs(apart).max()) < 0.5e-3
    rolled = thrown()["gauge"].isel(time=-1) - dataset["gauge"].isel(time=-1)
    assert float(abs(rolled).max()) > 0.02e-3


def test_channel_and_label_agree_at_the_ends_of_movements() -> None:
    dataset = thrown(0.013)
    rests = dataset["gauge"].sel(time=[4.3, 8.5], method="nearest")
    assert float(rests.min()) == pytest.approx(float(dataset["least_gauge"]), abs=2e-5)
    assert int(np.argmin(rests.min("x").to_numpy())) == 1  # the object is in the other route


def test_both_routes_are_judged() -> None:
    """An object between the other rail and its stock rail narrows the diverging route."""
    panel = load_panel(DEFAULT)
    item = ForeignObject("10 mm", "sleeper 6", rail="curved", appears=0.0)
    dataset = simulate(panel, foreign_object=item, mode="quasi-static", save=KEPT)
    assert str(dataset["least_gauge_rail"].values) == "curved"
    assert 1e3 * narrowed(dataset) == pytest.approx(10.0, abs=0.3)


def test_a_meant_fit_gap_and_widening_are_design() -> None:
    panel = load_panel(DEFAULT)
    assumed, meant = thrown(), thrown(gauge__fit_gap_is_design=True)
    gap = panel.rail["straight"].fit_gap
    assert gap is not None
    apart = (meant["gauge"] - assumed["gauge"]).isel(time=-1)
    np.testing.assert_allclose(apart, evaluate_profile(gap, assumed["x"].to_numpy()), atol=1e-12)
    wide = thrown(rail__straight__gauge_widening=0.005)
    np.testing.assert_allclose((wide["gauge"] - assumed["gauge"]).isel(time=-1), 0.005, atol=1e-12)
    assert float(wide["least_gauge"]) > float(assumed["least_gauge"])
    np.testing.assert_array_equal(wide["drive_force"], assumed["drive_force"])


def test_panels_without_data_of_the_gauge_are_silent() -> None:
    dataset = simulate(load_panel("sb1"), mode="quasi-static", save=KEPT)
    assert [str(name) for name in dataset if "gauge" in str(name)] == []
    assert [name for name in dataset.attrs if "gauge" in name] == []


def test_the_screen_of_a_panel_has_its_gauge() -> None:
    shown = {
        name: CliRunner().invoke(app, ["panel", "show", name]).stdout for name in (DEFAULT, "sb1")
    }
    assert "LEAST GAUGE of the closed rail\n" in shown[DEFAULT]
    assert "GAUGE" not in shown["sb1"]


def test_a_limit_may_be_left_out() -> None:
    file = load_panel(DEFAULT).document.tree["gauge"]
    assert "limit" in file
    from turnout.panel.model import TrackGauge

    data = TrackGauge.model_validate({k: v for k, v in file.items() if k != "limit"})
    assert load_panel(DEFAULT).model_copy(update={"gauge": data}).gauge_limit is None
    assert load_panel(DEFAULT).gauge_limit == 1.427
