"""Blades frozen to their chairs, and friction that differs along the stroke.

References: a bond holds elastically up to its force and then not at all, so it dissipates
F^2 / 2k; a stroke with one factor on all of it is that of chairs with as much friction; work of
friction over a stroke of two factors is that of its parts.
"""

import numpy as np
import pytest
from tests.verification.hand_made import energy_residual, hand_made, linear_spring, run

from turnout.core.errors import PanelError
from turnout.law.friction import no_courses
from turnout.law.obstruction import BREAKS_AWAY, no_obstructions
from turnout.law.table import LawTableBuilder
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

PANEL = load_panel("uic60-760-1-15")


def test_a_bond_holds_up_to_its_force_and_is_gone() -> None:
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e8, input_index=0)
    reach, stiffness = 1e-4, 2e7
    bond = laws.add_piecewise(
        0, breakpoints=np.array([-reach, reach]), slopes=np.array([0.0, stiffness, 0.0]),
        appears=1e-6,
    )  # fmt: skip
    frozen = no_obstructions(1)
    frozen.law[0], frozen.breaks[0] = bond, BREAKS_AWAY
    mechanism = hand_made(laws, mass=[1.0], obstructions=frozen, load=[50.0])
    history = run(mechanism, lambda t: 0.01 * np.sin(3.0 * t), end=2.0)
    force = history.law_force[:, bond]
    assert 0.5 < np.abs(force).max() / (reach * stiffness) <= 1.0
    # it stands at rest under its load without force
    assert force[0] == pytest.approx(0.0, abs=1e-9)
    broke = int(np.argmax(np.abs(force)))
    assert np.all(force[broke + 2 :] == 0.0)
    elastic = 0.5 * stiffness * reach**2
    assert history.obstructions.dissipated[0] == pytest.approx(elastic, rel=1e-9)
    assert energy_residual(history) < 1e-6


def block(factor: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Slide a block of 1 kN weight over 0.02 m; return the places and the friction on it."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e8, input_index=0)
    normal = laws.add_contact(1, stiffness=1e7, clearance=0.0, base_closed=True)
    laws.add_friction(0, normal=normal, friction_coefficient=0.3, stick_stiffness=1e7)
    mechanism = hand_made(laws, mass=[10.0, 10.0], load=[0.0, 1000.0])
    course = no_courses()._replace(
        friction=np.zeros(1, dtype=np.int64), coefficient=np.array([0.3]), closed=np.zeros(1),
        side=-np.ones(1), start=np.array([0, len(factor)]),
        opening=np.linspace(0.0, 0.02, len(factor), endpoint=False), factor=np.array(factor),
        at=-np.ones(1, dtype=np.int64),
    )  # fmt: skip
    object.__setattr__(mechanism, "courses", course)
    history = run(mechanism, lambda t: 0.02 * t, end=1.0)
    assert energy_residual(history) < 1e-6
    return history.g[:, 0], history.friction_force[:, 0]


def test_friction_follows_its_course() -> None:
    place, force = block([1.0, 2.0, 0.5])
    for first, last, factor in ((0.001, 0.0066, 1.0), (0.0069, 0.0131, 2.0), (0.0136, 0.0199, 0.5)):
        inside = (place > first) & (place < last)
        assert force[inside] == pytest.approx(300.0 * factor, rel=1e-4)


def test_one_factor_for_the_whole_stroke_is_more_friction() -> None:
    course = {"chair.friction_opening": [0.0], "chair.friction_factor": [1.3]}
    by_course = simulate(PANEL.with_overrides(course), mode="quick")
    rough = 1.3 * PANEL.chair["1"].friction_coefficient
    by_value = simulate(PANEL.with_overrides({"chair.friction_coefficient": rough}), mode="quick")
    assert np.allclose(by_course["drive_force"], by_value["drive_force"], atol=1.0)


def test_snow_behind_the_closed_blade_brakes_its_last_stretch() -> None:
    snow = {
        "chair.friction_opening": [0.0, 0.03],
        "chair.friction_factor": [1.5, 1.0],
    }
    everywhere = {"chair.friction_opening": [0.0], "chair.friction_factor": [1.5]}
    snowed, rough = (
        simulate(PANEL.with_overrides(case), mode="quick") for case in (snow, everywhere)
    )
    free = simulate(PANEL, mode="quick")
    at_end = [float(case["drive_force"][1, -1]) for case in (free, snowed, rough)]
    assert at_end[1] > at_end[0] + 200.0
    middle = free["time"].values == 6.0
    on_the_way = [float(case["drive_force"].values[1, middle][0]) for case in (free, snowed, rough)]
    assert abs(on_the_way[1] - on_the_way[0]) < 0.5 * abs(on_the_way[2] - on_the_way[0])


def test_a_frozen_blade_takes_more_force_until_it_breaks_away() -> None:
    frozen = {f"chair.{name}.frozen_force": 1500.0 for name in ("3", "4", "5", "6")}
    held = simulate(PANEL.with_overrides(frozen), mode="quick")
    free = simulate(PANEL, mode="quick")
    opening = (free["time"].values > 0.2) & (free["time"].values < 1.0)

    def most(dataset):
        return -dataset["drive_force"].values[:, opening].min(axis=1)

    assert np.all(most(held) > most(free) + 200.0), (most(held), most(free))
    assert float(held["energy_object_dissipated"][-1]) > 0.01
    # once loose, nothing is left of it
    assert np.allclose(held["drive_force"][:, -1], free["drive_force"][:, -1], atol=30.0)
    assert "object_left" not in held


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"chair.friction_factor": [1.0]}, "as many values each"),
        ({"chair.friction_factor": [1.0], "chair.friction_opening": [0.01]}, "begin with 0"),
        ({"chair.friction_factor": [-1.0], "chair.friction_opening": [0.0]}, "0 to 10"),
        ({"chair.frozen_force": -1.0}, "greater than or equal to 0|at least 0"),
    ],
)
def test_impossible_courses_are_refused(given: dict, said: str) -> None:
    with pytest.raises(PanelError, match=said):
        PANEL.with_overrides(given)
