"""Parameters and stages as data."""

import pytest

from turnout.calibration.stages import (
    CalibrationPlan,
    Parameter,
    Selection,
    Stage,
    default_plan,
    free_parameter,
    unit_in,
    value_in,
)
from turnout.core.errors import PanelError
from turnout.panel.load import load_panel


def test_every_problem_of_a_parameter_is_reported() -> None:
    with pytest.raises(PanelError) as reported:
        Parameter(name="k", keys=("k",), start=5.0, lower=-1.0, upper=2.0, scatter=-1.0)
    assert "outside its bounds" in str(reported.value)
    assert "must be positive" in str(reported.value)
    assert "scatter" in str(reported.value)


@pytest.mark.parametrize("transform", ["log", "linear", "share"])
def test_values_and_coordinates_belong_together(transform: str) -> None:
    item = Parameter(name="k", keys=("k",), start=2.0, lower=1.0, upper=8.0, transform=transform)
    assert item.value(item.coordinate(3.0)) == pytest.approx(3.0, rel=1e-12)
    assert item.value(item.coordinate(3.0) + 100.0) == 8.0
    here = item.coordinate(3.0)
    slope = (item.value(here + 1e-6) - item.value(here - 1e-6)) / 2e-6
    assert item.slope(3.0) == pytest.approx(slope, rel=1e-6)


def test_a_key_that_matches_nothing_names_the_nearest() -> None:
    with pytest.raises(PanelError, match=r"nearest is 'drive\.1\.stiffness'"):
        value_in(load_panel("sb1"), "drive.1.stifness")


def test_a_key_without_a_number_is_refused() -> None:
    with pytest.raises(PanelError, match="not a number"):
        free_parameter(load_panel("sb1"), "drive.1.rail")


def test_units_of_keys() -> None:
    assert unit_in("drive.saturation_force") == "N"
    assert unit_in("material.density") == "kg/m^3"


def test_default_stages_are_those_published() -> None:
    assert default_plan(load_panel("sb1")).stages[-1].movements.most == 20
    plan = default_plan(load_panel("sb1"), free=["gravity"], fixed=["drive.1.saturation_force"])
    assert plan.stages[0].movements.objects == "none"
    assert plan.stages[2].movements.place == "drive 2"
    assert "gravity" in plan.stages[-1].parameters
    varied = [item.name for item in plan.named(plan.stages[1].parameters)]
    assert varied == ["drive.1.stiffness"]


def test_an_unknown_parameter_of_a_stage_is_refused() -> None:
    item = free_parameter(load_panel("sb1"), "gravity")
    stage = Stage(name="one", parameters=("gravty",), movements=Selection())
    with pytest.raises(PanelError, match="nearest is 'gravity'"):
        CalibrationPlan(parameters=(item,), stages=(stage,))


def test_unknown_fixed_key_is_refused() -> None:
    with pytest.raises(PanelError, match="not a parameter of the default stages"):
        default_plan(load_panel("sb1"), fixed=["drive.1.stroke"])


def test_a_free_key_stays_within_the_bounds_of_its_record() -> None:
    panel = load_panel("sb1").with_overrides({"chair.friction_coefficient": 1.2})
    found = free_parameter(panel, "chair.friction_coefficient")
    assert (found.lower, found.upper) == (pytest.approx(0.4), 2.0)
    panel.with_overrides({found.name: found.upper})
