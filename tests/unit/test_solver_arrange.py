"""A condensed mechanism serves all runs that differ in values, and no other."""

from dataclasses import replace

import numpy as np
import pytest

from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.build import clear_mechanisms as clear_linear
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.markers import marker_positions
from turnout.solver import arrange as arrangement
from turnout.solver import condense, start
from turnout.solver.arrange import arrange, clear_memory
from turnout.solver.integration import integrate
from turnout.solver.outcome import Code
from turnout.throw.gaps import watched_gaps
from turnout.throw.simulate import solve_placed

QUICK = Scheme.of("quick")


def forget() -> None:
    clear_memory()
    clear_linear()
    start.clear_starts()


@pytest.fixture(autouse=True)
def _own_memory() -> None:
    clear_memory()


def mechanism(**overrides: object) -> Mechanism:
    return build_mechanism(load_panel("sb1", overrides=overrides))


def test_values_of_laws_share_what_was_condensed_and_keep_their_own_table() -> None:
    slippery = mechanism(**{"chair.friction_coefficient": 0.1})
    coefficient = np.full_like(slippery.laws.friction_coefficient, 0.5)
    rough = replace(slippery, laws=slippery.laws._replace(friction_coefficient=coefficient))
    first, second = arrange(slippery, QUICK), arrange(rough, QUICK)
    assert first.system is second.system
    assert first.model is second.model
    assert np.all(first.table.friction_coefficient == 0.1)
    assert np.all(second.table.friction_coefficient == 0.5)


@pytest.mark.parametrize("law", ["chair 1 of rail switch", "drive 1"])
def test_a_stiffness_that_the_modes_hold_is_condensed_again(law: str) -> None:
    given = mechanism()
    first, laws = arrange(given, QUICK), given.laws
    at = laws.segment_start[given.law_names.index(law)] + 1
    slope = laws.slope.copy()
    slope[at] *= 1.5
    changed = replace(given, laws=laws._replace(slope=slope))
    assert arrange(given, QUICK).system is first.system
    assert arrange(changed, QUICK).system is not first.system
    assert arrange(given, Scheme()).system is not first.system


def test_rows_that_could_be_written_to_are_never_remembered() -> None:
    own = mechanism()
    own = replace(own, core=own.core.copy())
    assert arrange(own, QUICK).system is not arrange(own, QUICK).system


def test_a_drive_of_another_stiffness_shares_what_was_condensed_at_its_home() -> None:
    panel = load_panel("sb1")
    first = arrange(build_mechanism(panel), QUICK)
    other = panel.with_overrides({"drive.1.stiffness": 770e3, "drive.2.stiffness": 1000e3})
    assert arrange(build_mechanism(other), QUICK).system is first.system
    soft = panel.with_overrides({"drive.2.stiffness": 300e3})
    assert arrange(build_mechanism(soft), QUICK).system is not first.system


def drive_forces(given: Mechanism, *, scheme: Scheme) -> np.ndarray:
    panel = load_panel("sb1")
    inputs = lambda t: marker_positions(panel, t)  # noqa: E731
    history = integrate(given, scheme, inputs=inputs, end=2.0)
    assert history.outcome.complete
    return history.law_force[:, list(given.index.drive.values())]


@pytest.mark.parametrize("scheme", [QUICK, Scheme()])
def test_condensing_at_the_home_changes_less_than_a_hundredth_of_the_error(
    scheme: Scheme, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = mechanism(**{"drive.1.stiffness": 555e3, "drive.2.stiffness": 1090e3})
    at_home = drive_forces(given, scheme=scheme)
    clear_memory()
    monkeypatch.setattr(condense, "home_stiffness", lambda stiffness: stiffness)
    itself = drive_forces(given, scheme=scheme)
    # quick mode is off by 2e-3 of the peak, waveform mode by 2e-4 (docs/evidence/accuracy.md)
    limit = 2e-5 if scheme is QUICK else 2e-6
    difference = np.sqrt(np.mean((at_home - itself) ** 2, axis=0)).max()
    assert 0.0 < difference < limit * np.abs(itself).max()


PLACES = ("sleeper 6", "drive 2", "x = 3.333 m", "x = 2 m")


def history(panel: LoadedPanel, place: str) -> np.ndarray:
    """Throw a panel over an object at a place."""
    objects = resolve_objects(panel, (ForeignObject(0.01, place),))
    return solve_placed(panel, objects, scheme=QUICK).history.g


def test_an_object_elsewhere_finds_rails_and_prior_motion_and_gives_the_same_bits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"schedule.end": 8.0})
    moved: list[object] = []

    def move(*given: object) -> tuple[Code, bool]:
        moved.append(given)
        return moving(*given)

    moving = start._move
    monkeypatch.setattr(start, "_move", move)
    start.clear_starts()

    one_after_another = [history(panel, place) for place in PLACES]
    assert len(moved) == 1
    objects = [resolve_objects(panel, (ForeignObject(0.01, place),)) for place in PLACES]
    mechanisms = [build_mechanism(panel, item) for item in objects]
    made = [arrange(item, QUICK) for item in mechanisms]
    assert len({id(item.condensed.row_stiffness) for item in made}) == 1  # laid out once
    gaps = [
        watched_gaps(panel, own)(item.condensed) for own, item in zip(mechanisms, made, strict=True)
    ]
    assert len({id(seen.shapes) for seen in gaps}) == 1
    assert not np.array_equal(gaps[0].of_objects, gaps[1].of_objects)
    kept = {id(part.before.model) for item in made for part in item.condensed.parts if part.before}
    assert len(kept) == 2  # a switch rail and its stock rail
    for place, known in zip(PLACES, one_after_another, strict=True):
        forget()
        np.testing.assert_array_equal(history(panel, place), known)


def test_rails_of_other_sections_share_the_layout_and_give_the_same_bits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"schedule.end": 8.0})
    panels = [panel.with_overrides({"rail.section_scale": scale}) for scale in (0.98, 1.0, 1.02)]
    laid_out: list[object] = []

    def lay_out(*given: object) -> object:
        laid_out.append(given)
        return condensing(*given)

    condensing = arrangement.condensed_system
    monkeypatch.setattr(arrangement, "condensed_system", lay_out)

    one_after_another = [history(scaled, PLACES[2]) for scaled in panels]
    assert len(laid_out) == 1
    for scaled, known in zip(panels, one_after_another, strict=True):
        forget()
        np.testing.assert_array_equal(history(scaled, PLACES[2]), known)
