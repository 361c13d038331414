"""A condensed mechanism serves all runs that differ in values, and no other."""

from dataclasses import replace

import numpy as np
import pytest

from turnout.integrate.arrange import arrange, forget
from turnout.integrate.integration import integrate
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.load import load_panel
from turnout.panel.markers import marker_positions
from turnout.scheme import Scheme

QUICK = Scheme.of("quick")


@pytest.fixture(autouse=True)
def _own_memory() -> None:
    forget()


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
def test_a_stiffness_that_the_modes_hold_is_condensed_anew(law: str) -> None:
    given = mechanism()
    first, laws = arrange(given, QUICK), given.laws
    at = laws.segment_start[given.law_names.index(law)] + 1
    slope = laws.slope.copy()
    slope[at] *= 1.5
    changed = replace(given, laws=laws._replace(slope=slope))
    assert arrange(given, QUICK).system is first.system
    assert arrange(changed, QUICK).system is not first.system
    assert arrange(given, Scheme()).system is not first.system


def test_matrices_that_could_be_written_to_are_never_remembered() -> None:
    own = mechanism()
    own = replace(own, stiffness=own.stiffness.copy())
    assert arrange(own, QUICK).system is not arrange(own, QUICK).system


def test_a_run_from_memory_gives_the_same_bits() -> None:
    def history() -> np.ndarray:
        panel = load_panel("sb1")
        inputs = lambda t: marker_positions(panel, t)  # noqa: E731
        return integrate(build_mechanism(panel), QUICK, inputs=inputs, end=2.0).g

    first = history()
    kept = history()
    forget()
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(first, history())
