"""The reference case: what is drawn, and that a smaller population is the beginning of a larger."""

from dataclasses import replace

import numpy as np
import pytest

from turnout.core.errors import StudyError
from turnout.detection.detector.allowances import Allowances
from turnout.detection.reference import (
    PER_THROW,
    Conditions,
    reference_study,
    switch_inputs,
)


def test_every_input_is_of_a_switch_or_of_a_throw() -> None:
    study = reference_study()
    names = {*study.variables, *(field.name for field in study.fields)}
    assert set(PER_THROW) < names
    assert set(switch_inputs(study)) == names - set(PER_THROW)
    assert len(switch_inputs(study)) == 14


def test_fewer_states_are_the_first_of_many() -> None:
    few, many = reference_study(count=3), reference_study(count=30)
    assert few.scenario(2).overrides == many.scenario(2).overrides


def test_what_was_added_last_leaves_the_draws_of_the_others() -> None:
    design = reference_study(count=3).design
    fewer = replace(design, drawn=design.drawn[:-3], copula=design.copula[:-3, :-3])
    before, after = fewer.drawn_values(2), design.drawn_values(2)
    added = {"movement.ramp", "object_defaults.face_slope", "drive.rod_slope"}
    assert set(after) - set(before) == added
    assert {name: after[name] for name in before} == before


def test_spreads_are_those_that_are_stated() -> None:
    study = reference_study(count=400)
    drawn = [study.design.drawn_values(state) for state in range(400)]

    def column(name: str) -> np.ndarray:
        return np.array([float(row[name]) for row in drawn])

    assert np.log(column("drive.1.stiffness.factor")).std() == pytest.approx(0.05, abs=0.005)
    assert np.log(column("drive.2.saturation_force.factor")).std() == pytest.approx(0.03, abs=0.003)
    over_travel = column("drive.2.over_travel_closed")
    assert over_travel.min() > 2.8e-3
    assert over_travel.max() < 4.8e-3
    common = column("rail.straight.stress_free") + column("rail.curved.stress_free")
    np.testing.assert_allclose(common, 1.0, atol=2e-3)  # the copula's rank correlation is -0.9999


def test_the_population_lies_about_the_panel_and_is_sampled_as_its_noise() -> None:
    """The study file repeats numbers of the panel, and the rate of the conditions."""
    study = reference_study()
    panel = study.panel
    assert study.output.rate == Conditions().rate
    own = {
        **{f"drive.{n}.over_travel_closed": d.over_travel_closed for n, d in panel.drive.items()},
        **{f"rail.{name}.stress_free": rail.stress_free for name, rail in panel.rail.items()},
        "movement.return.extra_time.2": panel.movement["return"].extra_time["2"],
    }
    laws = {item.name: item.law for item in study.design.drawn}
    middles = {name: np.mean(laws[name].bounds) for name in own}  # type: ignore[union-attr]
    assert middles == pytest.approx(own)
    start = laws["movement.return.start"].parameters["mean"]  # type: ignore[union-attr]
    assert start == panel.movement["return"].start
    for name, law in laws.items():
        if "factor" in name or "_scale" in name:
            parameters = law.parameters  # type: ignore[union-attr]
            ends = [parameters[end] for end in ("minimum", "maximum") if end in parameters]
            assert parameters.get("median", np.mean(ends or 1.0)) == pytest.approx(1.0), name


def test_errors_are_one_record_for_the_bound_and_the_detector() -> None:
    assert Allowances().conditions == Conditions()
    given = Allowances(discrepancy=0.03, current_noise=0.1, timing=1e-3)
    assert given.conditions == Conditions(discrepancy=0.03, current_noise=0.1)
    with pytest.raises(StudyError, match="noise = 0 N: must be more than 0") as found:
        Allowances(noise=0.0, discrepancy=1.0)
    assert len(found.value.problems) == 2


def test_the_fit_is_multiplied_as_a_whole() -> None:
    study = reference_study(count=1)
    scenario = study.scenario(0)
    factor = float(scenario.inputs["rail.fit_gap.value.factor"])
    own = study.panel.rail["straight"].fit_gap.value  # type: ignore[union-attr]
    changed = study.panel.with_overrides(dict(scenario.overrides))
    found = changed.rail["straight"].fit_gap.value  # type: ignore[union-attr]
    np.testing.assert_allclose(found, factor * np.array(own), rtol=1e-12)


def test_conditions_without_meaning_are_refused_together() -> None:
    with pytest.raises(StudyError) as found:
        Conditions(discrepancy=-0.1, false_alarm_rate=0.0, history=-1, kernel="cubic")
    assert len(found.value.problems) == 4
    assert "more than 0" in str(found.value)
