"""Exchanged rods are found from objects at sleepers, where a panel says which rod they load."""

from collections.abc import Sequence

import numpy as np
import pytest
from tests.unit.simulated import sb2_panel

from turnout.calibration.evaluate import Evaluator, Response, ThrowInputs
from turnout.calibration.measured_movements import BIN, MeasuredMovement, Signal
from turnout.calibration.requirements import panel_rod_check
from turnout.measurement.campaign.sheet_checks import RodCheck

TIME = (np.arange(100) + 0.5) * BIN
FREE = 2e3 * np.clip(TIME, 0.0, 1.0)


def forces(place: str) -> dict[str, np.ndarray]:
    """An object loads the rod that is nearer: at "middle" both alike."""
    shares = {"none": (0.0, 0.0), "toe": (1.0, 0.3), "heel": (0.1, 0.4), "middle": (0.6, 0.5)}
    shares["near the toe"] = (1.0, 0.05)
    rise = 3e3 * np.clip(TIME - 0.8, 0.0, 1.0)
    return {str(n): FREE + share * rise for n, share in enumerate(shares[place], 1)}


def movement(place: str, *, turned: bool) -> MeasuredMovement:
    rows = forces(place)
    names = {"1": "2", "2": "1"} if turned else {"1": "1", "2": "2"}
    signals = tuple(
        Signal(channel="drive_force", drive=drive, time=TIME, values=rows[names[drive]])
        for drive in ("1", "2")
    )
    return MeasuredMovement(
        name=place,
        direction="closing",
        place=place,
        size=0.0 if place == "none" else 0.013,
        x=1.0,
        signals=signals,
        length=2.0,
        clocked=True,
    )


class Made(Evaluator):
    """Gives the responses by hand."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        """Return what the panel would say of each throw."""
        return [
            Response(
                time=TIME,
                drive_force=forces(item.place),
                object_force=0.0 * TIME,
                onsets={"closing": 0.0},
            )
            for item in throws
        ]


CASES = [
    (("toe", "heel"), RodCheck(("1", "2"), checked=True)),
    (("toe", "heel", "middle"), RodCheck(("1", "2"), checked=True)),
    # One rod alone may be loaded for another reason, unless by far.
    (("toe", "toe", "toe"), RodCheck()),
    (("near the toe",) * 3, RodCheck(("1", "2"), checked=True)),
    # Which rod rises more says nothing where both do.
    (("middle", "middle"), RodCheck()),
    (("toe",), RodCheck()),
]


@pytest.mark.parametrize(("places", "expected"), CASES)
def test_rods_that_are_exchanged_are_found_where_the_panel_loads_one(
    places: tuple[str, ...], expected: RodCheck
) -> None:
    made = Made(sb2_panel())
    turned = [movement(place, turned=True) for place in ("none", *places)]
    assert panel_rod_check(turned, made) == expected
    right = [movement(place, turned=False) for place in ("none", *places)]
    found = panel_rod_check(right, made)
    assert found.pair is None
    assert found.checked == (expected.checked or places == ("toe", "toe", "toe"))


def test_without_a_movement_that_has_no_object_nothing_is_said() -> None:
    made = Made(sb2_panel())
    assert panel_rod_check([movement("toe", turned=True)] * 3, made) == RodCheck()
