"""Rails that vary in the shapes of a nominal one, against rails reduced each on its own.

Reference: the same throws of the population of sound switches with shapes of their own. Tolerance:
drive forces within 1e-4 of their peak over all time, gaps within 2 um, labels equal. One throw of
hundreds is off by more for some milliseconds, as a foot sticks or an object jumps a step sooner; a
change of `SMALL` in the sections of rails reduced anew does the same to it. The throws have
friction, drives, sections, fit and stress-free position of the population, and two of three an
object at a sleeper, at a drive or between places.
"""

import pickle
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from turnout.calibration.load_study import load_study
from turnout.core.content_cache import counts
from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.detection.panel_population import population_for
from turnout.mechanism import build
from turnout.mechanism.build import build_mechanism, clear_mechanisms, rail_data, vary_rails
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.varied_rails import (
    MOST_ERROR,
    MOST_SURFACE_ERROR,
    VariedRail,
    nominal_scale,
    variation_error,
)
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel, library_text, load_panel
from turnout.solver.arrange import arrange, clear_memory
from turnout.solver.modal import ModalModel
from turnout.study.scenario import Scenario
from turnout.study.study import Study
from turnout.study.sweep import row
from turnout.throw.gaps import gaps_over_time
from turnout.throw.recovery import recover_motion
from turnout.throw.simulate import plan_throw, solve_planned

FORCE, GAP, SMALL = 1e-4, 2e-6, 5e-5
PANELS = ("uic60-760-1-15", "sb2", "60e1-300-1-9")


def population(name: str, mode: str = "quick") -> Study:
    study = population_for(load_study("detection-reference"), load_panel(name))
    return replace(study, scheme=Scheme.of(mode))


def members(study: Study, count: int) -> list[Scenario]:
    """Return states of the population, two of three with an object."""
    draw, drive = np.random.default_rng(5), next(iter(study.panel.drive.values()))
    found = []
    for number in range(count):
        at = (
            f"x = {drive.x + draw.uniform(0.2, 5.0):.4f} m",
            "drive 1",
            f"sleeper {draw.choice(list(study.panel.sleeper))}",
        )[number % 3]
        item = ForeignObject(float(draw.uniform(0.008, 0.029)), at)
        objects = () if number % 6 > 3 else (item,)
        found.append(replace(study.scenario(1000 + number), foreign_objects=objects))
    return found


def thrown(
    study: Study, scenario: Scenario, nominal: LoadedPanel | None
) -> tuple[np.ndarray, np.ndarray, Mechanism]:
    """Return drive forces and gaps over time of a throw, and its mechanism."""
    panel = study.panel.with_overrides(dict(scenario.overrides))
    objects = resolve_objects(panel, scenario.foreign_objects)
    with one_blas_thread():
        planned = plan_throw(panel, objects, scheme=study.scheme, nominal=nominal)
        history = solve_planned(planned).history
        gaps = gaps_over_time(panel, recover_motion(planned.mechanism, history))
    assert history.outcome.complete
    drives = [planned.mechanism.index.drive[name] for name in panel.drive]
    return history.forces(drives), gaps, planned.mechanism


def sensitivity(study: Study, scenario: Scenario, force: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Return by how much sections that differ by `SMALL` change forces and gaps at most."""
    found = []
    for factor in (1.0 - SMALL, 1.0 + SMALL):
        changed = {
            key: factor * float(str(value)) if key.endswith("section_scale") else value
            for key, value in scenario.overrides.items()
        }
        other, other_gap, _ = thrown(study, replace(scenario, overrides=changed), None)
        found.append((np.abs(other - force).max(), np.abs(other_gap - gap).max()))
    return 1.2 * np.max(found, axis=0)


def compare(study: Study, scenarios: list[Scenario], monkeypatch: pytest.MonkeyPatch) -> None:
    for scenario in scenarios:
        force, gap, varied = thrown(study, scenario, study.panel)
        wanted, wanted_gap, own = thrown(study, scenario, None)
        assert varied.nominal is not None
        assert own.nominal is None
        off = np.abs(force - wanted).max(), np.abs(gap - wanted_gap).max()
        most = FORCE * np.abs(wanted).max(), GAP
        if off[0] > most[0] or off[1] > most[1]:
            most = np.maximum(most, sensitivity(study, scenario, wanted, wanted_gap))
        assert off[0] <= most[0]
        assert off[1] <= most[1]
    found = row.throw_scenarios(study, scenarios)
    with monkeypatch.context() as patch:
        plan = row.plan_throw
        patch.setattr(row, "plan_throw", lambda *given, nominal, **how: plan(*given, **how))
        wanted_rows = row.throw_scenarios(study, scenarios)
    for one, other in zip(found, wanted_rows, strict=True):
        assert one.outcome == other.outcome == row.COMPLETE
        assert one.stored is not None
        assert other.stored is not None
        for name, (_, values) in one.stored.variables.items():
            if values.dtype.kind != "f":
                label = other.stored.variables[name][1][other.number]
                np.testing.assert_array_equal(values[one.number], label, err_msg=name)


@pytest.mark.parametrize("name", PANELS)
def test_forces_gaps_and_labels_are_those_of_rails_reduced_anew(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = population(name)
    compare(study, members(study, 6), monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize("name", PANELS)
def test_three_hundred_members(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    study = population(name)
    compare(study, members(study, 300), monkeypatch)


@pytest.mark.long
def test_impacts_are_the_same_too(monkeypatch: pytest.MonkeyPatch) -> None:
    study = population(PANELS[0], "waveform")
    compare(study, members(study, 24), monkeypatch)


@pytest.mark.parametrize("factor", [0.9, 1.7])
def test_fastenings_vary_in_the_shapes_of_the_nominal_ones(factor: float) -> None:
    study = population(PANELS[0])
    stiffness = study.panel.values_at("fastening.stiffness_y")
    changes = {key: factor * value for key, value in stiffness.items()}
    changes |= study.panel.values_at("fastening.stiffness_z")
    scenario = replace(study.scenario(0), overrides=changes, foreign_objects=())
    force, gap, varied = thrown(study, scenario, study.panel)
    wanted, wanted_gap, _ = thrown(study, scenario, None)
    nominal, _, _ = thrown(study, replace(scenario, overrides={}), None)
    assert varied.nominal is not None
    assert np.abs(force - wanted).max() < FORCE * np.abs(wanted).max()
    assert np.abs(gap - wanted_gap).max() < GAP
    assert np.abs(nominal - wanted).max() > 2 * np.abs(force - wanted).max()


def test_chairs_frozen_to_varied_rails_hold_them_as_those_of_rails_reduced_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The nominal panel has no ice, so its rails are condensed with a bond of any strength."""
    study = population("uic60-760-1-15")
    scenario = replace(study.scenario(1001), foreign_objects=())
    frozen = {f"chair.{name}.frozen_force": 400.0 for name in ("5", "6")}
    compare(
        study,
        [replace(scenario, overrides={**scenario.overrides, **frozen})],
        monkeypatch,
    )


def condensed(panel: LoadedPanel, nominal: LoadedPanel, scheme: Scheme) -> list[ModalModel]:
    """Return the modal models of the rails of a panel in shapes of a nominal one."""
    with one_blas_thread():
        found = arrange(build_mechanism(panel, nominal=nominal), scheme)
    return [part.model for part in found.condensed.parts]


@pytest.fixture(name="states")
def _states() -> Iterator[tuple[Study, list[LoadedPanel]]]:
    study = population("60e1-300-1-9")
    overrides = [dict(study.scenario(number).overrides) for number in range(11)]
    clear_mechanisms()
    clear_memory()
    yield study, [study.panel.with_overrides(one) for one in overrides]
    clear_mechanisms()
    clear_memory()


def test_modes_and_flexibility_from_surfaces_are_those_of_the_matrices(
    states: tuple[Study, list[LoadedPanel]], monkeypatch: pytest.MonkeyPatch
) -> None:
    study, panels = states
    found = condensed(panels[3], study.panel, study.scheme)
    clear_mechanisms()
    clear_memory()
    monkeypatch.setattr(VariedRail, "follow", lambda rail, key, make: make(rail.matrices))
    wanted = condensed(panels[3], study.panel, study.scheme)
    assert any(np.any(one.modes != other.modes) for one, other in zip(found, wanted, strict=True))
    for one, other in zip(found, wanted, strict=True):
        for name in ("eigenvalues", "stiffness", "modes", "flexibility", "residual_shapes"):
            own, of = getattr(one, name), getattr(other, name)
            most = MOST_SURFACE_ERROR * np.abs(of).max()
            np.testing.assert_allclose(own, of, rtol=0, atol=most, err_msg=name)


def test_rails_that_are_evaluated_together_are_those_alone(
    states: tuple[Study, list[LoadedPanel]],
) -> None:
    study, panels = states
    vary_rails(panels, study.panel)
    together = [condensed(panel, study.panel, study.scheme) for panel in panels]
    clear_mechanisms()
    clear_memory()
    for panel, models in zip(panels, together, strict=True):
        for one, other in zip(condensed(panel, study.panel, study.scheme), models, strict=True):
            np.testing.assert_array_equal(one.flexibility, other.flexibility)
            np.testing.assert_array_equal(one.modes, other.modes)


def test_no_member_is_reduced_and_rows_are_shared() -> None:
    """But once for each slope of the rods, which the population has three of."""
    clear_mechanisms()
    study = population("sb2")
    made = [
        build_mechanism(
            study.panel.with_overrides(dict(study.scenario(number).overrides)),
            nominal=study.panel,
        )
        for number in range(6)
    ]
    of_first = counts["superelement computed"], counts["superelement from memory"]
    made += [
        build_mechanism(
            study.panel.with_overrides(dict(study.scenario(number).overrides)),
            nominal=study.panel,
        )
        for number in range(6, 12)
    ]
    assert (counts["superelement computed"], counts["superelement from memory"]) == of_first
    slopes = [study.scenario(number).overrides["drive.rod_slope"] for number in range(12)]
    assert len({(id(one.rows), slope) for one, slope in zip(made, slopes, strict=True)}) == 3
    assert len({id(one.rows) for one in made}) == len(set(slopes[:6])) == 3
    assert len({one.stiffness.tobytes() for one in made}) == len(made)


def test_throws_of_one_state_share_its_rails() -> None:
    panel = load_panel("sb2")
    scales = {"rail.section_scale": 1.04, "rail.lateral_inertia_scale": 0.97}
    made = [
        build_mechanism(
            panel.with_overrides({**scales, "chair.friction_coefficient": friction}),
            nominal=panel,
        )
        for friction in (0.2, 0.3)
    ]
    assert made[0].nominal is not None
    assert made[0].matrices is made[1].matrices
    assert made[0].laws.friction_coefficient[0] != made[1].laws.friction_coefficient[0]


def test_a_copy_of_a_panel_is_reduced_no_more_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What throws share is known by its values: by a copy, a pickle or a file as well."""
    study = population("sb2")
    frames = list[object]()
    made_frame = build._made_frame

    def noted(*given: Any) -> Any:
        frames.append(given)
        return made_frame(*given)

    monkeypatch.setattr(build, "_made_frame", noted)
    file = tmp_path / "copy.toml"
    file.write_text(library_text("sb2"), encoding="utf-8")
    overrides = dict(study.panel.overrides)
    copies = [
        study.panel,
        deepcopy(study.panel),
        pickle.loads(pickle.dumps(study.panel)),
        load_panel(file).with_overrides(overrides) if overrides else load_panel(file),
        study.panel.model_copy(update={"description": "a copy"}, deep=True),
    ]
    clear_mechanisms()
    found = []
    for panel in copies:
        for number in range(5):
            varied = panel.with_overrides(dict(study.scenario(number).overrides))
            mechanism = build_mechanism(varied, nominal=panel)
            if panel is not study.panel:
                assert mechanism.rows is found[number][2].rows
                np.testing.assert_array_equal(mechanism.stiffness, found[number][2].stiffness)
                assert mechanism.nominal is found[number][2].nominal
            found.append((len(frames), counts["superelement computed"], mechanism))
    assert len({before[:2] for before in found[4:]}) == 1


def test_far_scales_belong_to_other_nominal_rails() -> None:
    panel = load_panel("sb2")
    far = panel.with_overrides({"rail.section_scale": 1.5})
    near = panel.with_overrides({"rail.section_scale": 1.05})
    found, rows = build_mechanism(far, nominal=panel), build_mechanism(near, nominal=panel).rows
    assert found.nominal is not None
    home = nominal_scale(1.5, 1.0)
    base = build_mechanism(panel.with_overrides({"rail.section_scale": home}))
    np.testing.assert_array_equal(found.nominal.stiffness, base.stiffness)
    assert found.rows is base.rows
    assert rows is build_mechanism(panel).rows


def test_the_error_is_of_second_order_and_decides(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    data = rail_data(load_panel("60e1-300-1-9"))[0]
    small, large = (variation_error(data, scales=(1.0 / s, s)) for s in (1.02, 1.04))
    assert large / small == pytest.approx(4.0, rel=0.1)
    assert variation_error(data) < MOST_ERROR
    panel = load_panel("60e1-300-1-9")
    varied = panel.with_overrides({"rail.section_scale": 1.03})
    monkeypatch.setattr("turnout.mechanism.varied_rails.MOST_ERROR", 1e-5)
    clear_mechanisms()
    found = build_mechanism(varied, nominal=panel)
    assert found.nominal is None
    np.testing.assert_array_equal(found.stiffness, build_mechanism(varied).stiffness)
    assert "each varied rail is reduced anew" in caplog.text
    clear_mechanisms()
