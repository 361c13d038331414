"""Objects that are not as the run sheet says: unknowns of a fit, lines and trust."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import movement

from turnout.calibration.sensors import PLACE, STATE, THICKNESS, Stated, kind_that_leaves
from turnout.calibration.stages import (
    Fitted,
    acts_on,
    common_unknowns,
    object_lines,
    own_places,
    own_thicknesses,
    shift_name,
    thickness_name,
    thrown_object,
)

FREE = replace(movement("free", rng=np.random.default_rng(0)), place="none", size=0.0)
TRAPPED = replace(FREE, name="trapped", place="sleeper 7", size=0.013, x=3.9)


def test_an_object_is_thrown_as_thick_and_where_it_truly_is() -> None:
    values = {
        thickness_name(): 1e-3,
        thickness_name(0.013): -0.2e-3,
        thickness_name(0.010): 5e-3,  # of others
        shift_name(): 0.05,
        shift_name("sleeper 7"): 0.02,
    }
    place, size = thrown_object(TRAPPED, values)
    assert size == pytest.approx(0.0138)
    assert float(place.removeprefix("x = ").removesuffix(" m")) == pytest.approx(3.97)
    assert thrown_object(FREE, values) == ("none", 0.0)
    # As it was stated, throws are those of the place by its name.
    assert thrown_object(TRAPPED, {}) == ("sleeper 7", 0.013)


def test_only_movements_with_an_object_depend_on_it() -> None:
    other = replace(TRAPPED, place="drive 1", size=0.010)
    common = common_unknowns([FREE, TRAPPED])
    assert not common_unknowns([FREE])
    assert [acts_on(item, TRAPPED) for item in common] == [True]
    assert not any(acts_on(item, FREE) for item in common)
    own = [*own_thicknesses([TRAPPED, other]), *own_places([TRAPPED, other])]
    assert [acts_on(item, TRAPPED) for item in own] == [False, True, True, False]


def found(name: str, value: float) -> Fitted:
    return Fitted(
        name=name,
        keys=(),
        unit="m",
        value=value,
        deviation=1e-5,
        lower=-1.0,
        upper=1.0,
        interval=(value, value),
        start=0.0,
    )


def test_what_the_run_sheet_says_wrongly_is_a_line() -> None:
    """Only from two stated deviations on."""
    lines = object_lines(
        [
            found(thickness_name(), 1e-3),
            found(thickness_name(0.013), -3e-4),
            found(shift_name("sleeper 7"), -0.2),
        ],
        leaves=2.0,
    )
    assert lines == [
        "objects: all are 1.00 ± 0.01 mm thicker than the run sheet says; correct it",
        "objects: those at sleeper 7 are 200 ± 0 mm less far from the toe than the run sheet says; "
        "correct it",
    ]


@pytest.mark.parametrize(
    ("away", "kind"),
    [
        ({THICKNESS: [5.0], PLACE: [0.5], STATE: [1.0]}, THICKNESS),
        ({THICKNESS: [0.5], PLACE: [0.3, 4.0, 0.2]}, PLACE),
        # All places off are another panel.
        ({PLACE: [4.0, 3.0, 2.5]}, ""),
        ({THICKNESS: [1.0], STATE: [6.0]}, ""),
    ],
)
def test_one_kind_of_unknown_may_be_off(away: dict[str, list[float]], kind: str) -> None:
    unknowns = [
        Stated(text="", away=size, kind=name) for name, sizes in away.items() for size in sizes
    ]
    assert kind_that_leaves(unknowns) == kind
