"""The population of the reference case for other panels: about their values, for their drives."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from turnout.calibration.load_study import load_study
from turnout.core.errors import PanelError, StudyError
from turnout.detection.panel_population import population_for
from turnout.detection.reference import reference_study, switch_inputs
from turnout.detection.throws import checked_throws, refuse_open_end
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.study import Study
from turnout.study.sweep.stored_study import study_data, study_from_data

DEFAULT = "uic60-760-1-15"
OVER_TRAVEL, INERTIA = "drive.1.over_travel_closed", "rail.lateral_inertia_scale"
RETURN = "movement.return.start"
APART = {"rail.straight.stress_free": 0.4, "rail.curved.stress_free": 0.6}


def drawn(study: Study, name: str, count: int = 200) -> np.ndarray:
    return np.array([float(study.design.drawn_values(n)[name]) for n in range(count)])


def test_the_panel_of_the_study_keeps_it_as_it_is() -> None:
    own = load_study("detection-reference")
    given = population_for(own, load_panel(DEFAULT))
    assert given.digest == own.digest


@pytest.mark.parametrize(
    ("panel", "changes", "name", "expected"),
    [
        (DEFAULT, {OVER_TRAVEL: "5.5 mm"}, OVER_TRAVEL, (4.5e-3, 6.5e-3)),
        (DEFAULT, {}, "drive.2.over_travel_closed", (2.8e-3, 4.8e-3)),
        ("60e1-300-1-9-clamp-lock", {}, OVER_TRAVEL, (0.0, 1.5e-3)),
        (DEFAULT, APART, "rail.straight.stress_free", (0.38, 0.42)),
        (DEFAULT, {INERTIA: 1.08}, INERTIA, (0.9 * 1.08, 1.1 * 1.08)),
        # A last movement of another name keeps its start.
        ("60e1-300-1-9", {RETURN: "5 s"}, RETURN, (4.98, 5.02)),
    ],
)
def test_inputs_scatter_about_the_values_of_the_panel(
    panel: str, changes: dict[str, object], name: str, expected: tuple[float, float]
) -> None:
    study = reference_study(load_panel(panel, overrides=changes))
    law = next(item.law for item in study.design.drawn if item.name == name)
    assert law.bounds == pytest.approx(expected)  # type: ignore[union-attr]


def test_the_stress_free_positions_of_both_rails_are_one() -> None:
    study = reference_study(load_panel(DEFAULT, overrides=APART))
    both = drawn(study, "rail.straight.stress_free") + drawn(study, "rail.curved.stress_free")
    np.testing.assert_allclose(both, 1.0, atol=2e-3)


def with_third_drive() -> LoadedPanel:
    from turnout.detection.limit.added_equipment import with_drive

    return with_drive(load_panel(DEFAULT), 3.6)


@pytest.mark.parametrize(
    ("panel", "drives"),
    [
        (load_panel("60e1-300-1-9"), ["1"]),
        (load_panel("60e1-500-1-12"), ["1", "2"]),
        (with_third_drive(), ["1", "2", "3"]),
    ],
    ids=["one drive", "two drives", "three drives"],
)
def test_every_drive_has_its_inputs_and_no_other(panel: LoadedPanel, drives: list[str]) -> None:
    study = reference_study(panel, count=4)
    own = [name for name in switch_inputs(study) if name.startswith("drive.")]
    each = ("stiffness.factor", "saturation_force.factor", "over_travel_closed")
    assert sorted(own) == sorted(
        [*(f"drive.{name}.{rest}" for name in drives for rest in each), "drive.rod_slope"]
    )
    scenario = study.scenario(3)
    changed = panel.with_overrides(dict(scenario.overrides))
    assert set(changed.drive) == set(drives)
    last = changed.movement["return"].extra_time
    assert set(last) == set(drives[1:])


def test_a_further_drive_leaves_the_states_of_the_others() -> None:
    base, more = reference_study(count=3), reference_study(with_third_drive(), count=3)
    before, after = (item.design.drawn_values(2) for item in (base, more))
    assert all(after[name] == pytest.approx(before[name], rel=1e-12) for name in before)


def test_ends_of_the_motion_and_faces_lie_about_those_of_the_panel() -> None:
    changes = {"movement.ramp": 0.5, "object_defaults.face_slope": -0.2}
    study = reference_study(load_panel(DEFAULT, overrides=changes))
    laws = {item.name: item.law for item in study.design.drawn}
    assert laws["movement.ramp"].bounds == pytest.approx((0.4, 0.6))
    assert laws["object_defaults.face_slope"].bounds == pytest.approx((-0.3, -0.1))
    sudden = reference_study(load_panel(DEFAULT, overrides={"movement.ramp": 0.0}))
    law = next(item.law for item in sudden.design.drawn if item.name == "movement.ramp")
    assert law.bounds == pytest.approx((0.0, 0.1))


def test_rods_rise_about_those_of_the_panel() -> None:
    rods = "drive.rod_slope"
    own, bent = (
        reference_study(load_panel(DEFAULT, overrides=changes), count=400)
        for changes in ({}, {rods: 0.03})
    )
    values = drawn(own, rods, 400)
    assert sorted(set(values)) == [-0.05, 0.0, 0.05]
    assert (values == 0.0).mean() == pytest.approx(0.5, abs=0.06)
    np.testing.assert_allclose(drawn(bent, rods, 400), values + 0.03, atol=1e-12)
    thrown = own.panel.with_overrides(dict(own.scenario(0).overrides))
    assert {drive.rod_slope for drive in thrown.drive.values()} == {values[0]}
    unlike = reference_study(load_panel(DEFAULT, overrides={"drive.1.rod_slope": 0.03}))
    assert rods not in unlike.variables
    assert unlike.remarks == (f"panel {DEFAULT} has no number {rods}: it does not vary",)


def test_rollers_scatter_about_those_of_the_panel_and_other_chairs_have_none() -> None:
    """The owner of a switch knows if it has rollers: a panel without them gets none."""
    assert not any("roller" in name for name in reference_study(load_panel(DEFAULT)).variables)
    lifts = {"chair.5.roller_lift": 1e-3, "chair.9.roller_lift": 2e-3}
    study = reference_study(load_panel(DEFAULT, overrides=lifts), count=300)
    thrown = [study.panel.with_overrides(dict(study.scenario(n).overrides)) for n in range(300)]
    found = np.array([[panel.chair[name].roller_lift for name in "59"] for panel in thrown])
    assert (found.min(), found.max()) == pytest.approx((0.8e-3, 2.4e-3), rel=0.02)
    np.testing.assert_allclose(found[:, 1], 2.0 * found[:, 0], rtol=1e-12)
    springs = np.log([panel.chair["5"].roller_stiffness / 5e5 for panel in thrown])
    assert (springs.mean(), springs.std()) == pytest.approx((0.0, 0.1), abs=0.02)
    assert thrown[0].chair["6"].roller_lift is None
    assert {"chair.roller_lift.factor", "chair.roller_stiffness.factor"} < set(switch_inputs(study))
    assert study_from_data(study_data(study)).digest == study.digest
    usual = reference_study(count=300)
    assert usual.design.drawn_values(7).items() < study.design.drawn_values(7).items()


def test_a_fit_of_nothing_does_not_vary_and_that_is_said() -> None:
    study = reference_study(load_panel("60e1-300-1-9"))
    assert not any("fit_gap" in name for name in study.variables)
    assert "panel 60e1-300-1-9 has no number rail.fit_gap.value: it does not vary" in study.remarks
    one = reference_study(load_panel("60e1-300-1-9", overrides={"rail.fit_gap": "0.5 mm"}))
    assert one.variables["rail.fit_gap.value.factor"].key == "rail.fit_gap"
    assert not one.remarks


def test_typed_shapes_and_single_rails_do_not_vary() -> None:
    typed = reference_study(load_panel("sb2"))  # stress-free "closed" and "open", gaps typed
    assert not any("stress_free" in name for name in typed.variables)
    assert "panel sb2 has no number rail.A.stress_free: it does not vary" in typed.remarks
    one = reference_study(load_panel("sb1"))
    assert one.scenario(0).overrides


def plausible(number: int) -> LoadedPanel:
    study = load_study("plausible-panels")
    return study.panel.with_overrides(study.scenario(number).overrides)


def held_by_little() -> LoadedPanel:
    """Return a panel whose Drive 2 holds its rail open with 0.999 of its slip level."""
    panel = load_panel(DEFAULT)
    drive = panel.drive["2"]
    over = 0.999 * drive.saturation_force / drive.stiffness
    return panel.with_overrides({"drive.2.over_travel_open": over})


def slips_at_rest(study: Study, state: int) -> bool:
    """Whether Drive 2 slips at rest in a state: its rail has no gap there to be pressed home."""
    changed = study.scenario(state).overrides
    force = float(changed["drive.2.stiffness"]) * study.panel.drive["2"].over_travel_open
    return force >= float(changed["drive.2.saturation_force"])


def test_no_drive_slips_at_rest_where_the_panel_holds_its_rail_by_little() -> None:
    panel = held_by_little()
    study = reference_study(panel, count=40)
    assert not [state for state in range(40) if slips_at_rest(study, state)]
    free = replace(study, design=replace(study.design, holdings=()))
    slipping = [state for state in range(40) if slips_at_rest(free, state)]
    assert len(slipping) > 15
    for state in range(40):  # what holds stays as it is drawn, friction and all
        same = free.design.drawn_values(state) == study.design.drawn_values(state)
        assert same == (state not in slipping)
    with pytest.raises(PanelError, match="slips at rest"):
        panel.with_overrides(dict(free.scenario(slipping[0]).overrides))
    panel.with_overrides(dict(study.scenario(slipping[0]).overrides))
    assert any("drive 2 presses rail curved home with 6.84" in item for item in study.remarks)


def test_states_drawn_again_are_the_same_after_storage_and_of_other_counts() -> None:
    study = reference_study(held_by_little(), count=5)
    stored = study_from_data(study_data(study))
    more = reference_study(held_by_little(), count=50)
    for state in range(5):
        values = study.design.drawn_values(state)
        assert stored.design.drawn_values(state) == values == more.design.drawn_values(state)
    assert stored.digest == study.digest
    free = replace(study, design=replace(study.design, holdings=()))
    assert free.digest != study.digest


def test_panels_with_margins_keep_their_population() -> None:
    study = reference_study(plausible(0), count=5)
    assert not study.design.holdings
    assert not study.remarks
    with pytest.raises(ValueError, match="cannot be drawn again"):
        replace(reference_study(held_by_little()).design, method="sobol")


def test_a_last_movement_that_opens_and_throws_that_fail_are_refused() -> None:
    panel = load_panel("sb1")  # stress-free where it is open, beyond what its drives hold
    where = {"drive 1": 0.3, "drive 2": 6.9}
    with pytest.raises(StudyError, match=r"leaves rail switch open \(111 mm at drive 1"):
        refuse_open_end(panel, where, np.tile([0.1113, 0.04], (5, 1)))
    refuse_open_end(panel, where, np.tile([0.002, 0.04], (5, 1)))
    sweep = xr.Dataset(
        {"outcome": ("scenario", ["invalid"] * 3 + ["complete"]),
         "reason": ("scenario", ["drive.1: slips at rest"] * 3 + [""])}
    )  # fmt: skip
    with pytest.raises(StudyError, match=r"3 of 4 throws .* The first: drive.1: slips at rest"):
        checked_throws(sweep, panel="own")
    assert checked_throws(sweep.isel(scenario=[2, 3]), panel="own").sizes["scenario"] == 2
