"""Throws with wrong values: what they change beyond slopes, and what is said where one fails."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from tests.faults.test_cli_validate import CALIBRATION
from tests.unit.test_study_validation import hand_made

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.validation.acceptance import judge
from turnout.calibration.validation.seen_throws import Seen
from turnout.calibration.validation.validate import Model, with_bends

NAME = "chair.friction_coefficient"
VALUE = CALIBRATION.parameters[0].value
STOPPED = "chair.friction_coefficient: must be at most 0.4"


def response(*, failure: str = "") -> Response:
    none = np.zeros(0)
    return Response(
        time=none, drive_force={}, marker={}, object_force=none, onsets={}, failure=failure
    )


@dataclass(frozen=True, kw_only=True)
class Thrown:
    """Stands for `Seen`: forces are 1 kN more for all of a value, and 5 kN with its square.

    Friction above `fails_above` cannot be thrown in the last movement.
    """

    forces_before: NDArray[np.float64]
    movements: tuple[MeasuredMovement, ...]
    fails_above: float = np.inf
    thrown = SimpleNamespace(evaluator=None)

    def of(self, numbers: NDArray[np.intp]) -> "Thrown":
        return replace(
            self,
            forces_before=self.forces_before[:, numbers],
            movements=tuple(self.movements[n] for n in numbers),
        )

    def responses(self, settings: Sequence[Mapping[str, float]]) -> list[list[Response]]:
        rows = []
        for setting in settings:
            share = setting[NAME] / VALUE - 1.0
            row = [replace(response(), contact_time=share) for _ in self.movements]
            if setting[NAME] > self.fails_above:
                row[-1] = response(failure=STOPPED)
            rows.append(row)
        return rows

    def forces(self, row: Sequence[Response]) -> NDArray[np.float64]:
        shares = np.array([np.nan if item.failure else item.contact_time for item in row])
        found = self.forces_before + (1e3 * shares + 5e3 * shares**2)[:, None]
        return np.asarray(found)


def bent(*, fails_above: float = np.inf, aside: str = "", known: bool = True) -> xr.Dataset:
    """Return a validation of six movements, two of them fitted, with bends from throws."""
    made = hand_made(band=300.0).assign_attrs(onsets="fitted")
    made = made.assign(left_out=("movement", np.zeros(6, dtype=np.bool_)))
    forces = made["predicted"].values.copy()
    if not known:
        made["measured"][:, -1] = made["predicted"][:, -1] = np.nan
        forces[:, -1] = np.nan
    change = (0.0 * made["predicted"] + 1e3).expand_dims(parameter=[NAME])
    movements = tuple(SimpleNamespace(text=f"m{n}.csv") for n in range(6))
    thrown = Thrown(
        forces_before=forces,
        movements=cast("tuple[MeasuredMovement, ...]", movements),
        fails_above=fails_above,
    )
    model = Model(
        forces=forces,
        later=forces,
        slopes={NAME: np.full(forces.shape, 1e3 / VALUE)},
        asides={NAME: [response() for _ in range(5)] + [response(failure=aside)]},
        contacts=np.zeros(6),
        seen=cast("Seen", thrown),
    )
    changed = made.assign(change=change.assign_coords(unit=("parameter", ["1"])))
    return with_bends(changed, CALIBRATION, model)


def test_bends_are_what_throws_change_beyond_slopes() -> None:
    found = bent()
    assert found["bend"].values[:, 0, :, 2:] == pytest.approx(5e3)
    assert not found["bend"].values[:, 0, :, :2].any()
    assert json.loads(found.attrs["unchecked"]) == {}
    assert judge(found).power[0].startswith(f"{NAME} off by ")


def test_a_value_whose_throw_fails_is_said_not_to_be_checked() -> None:
    """The slope alone was used without a word: it states too little."""
    found = bent(fails_above=VALUE)
    assert judge(found).power[0] == f"{NAME}: not checked by a throw: m5.csv: {STOPPED}"
    assert np.isfinite(found["bend"]).all()


def test_so_is_a_value_whose_slope_was_not_thrown() -> None:
    found = bent(aside="stopped\nearly")
    assert judge(found).power[0] == f"{NAME}: not checked by a throw: m5.csv: stopped early"


def test_a_movement_that_cannot_be_predicted_at_all_says_nothing_of_a_value() -> None:
    found = bent(fails_above=VALUE, known=False)
    assert json.loads(found.attrs["unchecked"]) == {}
