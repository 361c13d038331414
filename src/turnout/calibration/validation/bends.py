"""What throws with wrong values change beyond first order, where a verdict would notice them."""

import json
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.result import Calibration
from turnout.calibration.validation.acceptance import first_order_power, judged_movements
from turnout.calibration.validation.seen_throws import CHECKING, Seen

Floats = NDArray[np.float64]
SIDES = ("up", "down")


def with_bends(
    found: xr.Dataset,
    calibration: Calibration,
    *,
    forces: Floats,
    slopes: Mapping[str, Floats],
    asides: Mapping[str, Sequence[Response]],
    seen: Seen,
) -> xr.Dataset:
    """Throw each value to either side where first order says that the verdict notices it.

    Parameters
    ----------
    found : xarray.Dataset
        As of `validate`, without `bend`.
    calibration : Calibration
        With the values.
    forces : ndarray, shape (n_channels, n_movements, n_times)
        As predicted [N]; NaN where a throw failed.
    slopes : mapping of str to ndarray, shape as forces
        By parameter [N over its unit].
    asides : mapping of str to sequence of Response
        By parameter the throws of all movements that slopes are from.
    seen : Seen
        Throws all movements.

    Returns
    -------
    xarray.Dataset
        With `bend` (side, parameter, channel, movement, time), what forces change beyond first
        order, over the square of a change; 0 where nothing is noticed, and where a throw failed.
        The attribute `unchecked` says of these parameters why, as JSON.
    """
    bends = xr.concat([xr.zeros_like(found["change"])] * len(SIDES), "side")
    bends = bends.assign_coords(side=list(SIDES))
    chosen = judged_movements(found["used"].values, found["left_out"].values)
    part, plain = seen.of(chosen), forces[:, chosen]
    movements = part.movements
    unchecked = {
        name: reason
        for name in found["parameter"].values.tolist()
        if (reason := _failure(movements, [asides[name][n] for n in chosen], plain))
    }
    fitted = {item.name: item for item in calibration.fitted}
    steps = [
        (name, side, amount, amount * (1.0 if fitted[name].unit == "m" else fitted[name].value))
        for name, amounts in first_order_power(found).items()
        for side, amount in zip(SIDES, amounts, strict=True)
        if name not in unchecked
    ]
    settings = [
        {**calibration.values, name: fitted[name].value + step} for name, _, _, step in steps
    ]
    thrown = part.thrown(settings, stage=CHECKING)[0]
    for (name, side, amount, step), row in zip(steps, thrown, strict=True):
        reason = _failure(movements, row, plain)
        if reason:
            unchecked.setdefault(name, reason)
            continue
        linear = plain + step * slopes[name][:, chosen]
        place = {"parameter": name, "side": side, "movement": found["movement"].values[chosen]}
        bends.loc[place] = (part.forces(row) - linear) / amount**2
    return found.assign(bend=bends).assign_attrs(unchecked=json.dumps(unchecked))


def _failure(
    movements: Iterable[MeasuredMovement], responses: Sequence[Response], forces: Floats
) -> str:
    """Return why the first of some throws failed whose movement is predicted; else nothing."""
    predicted = np.asarray(np.isfinite(forces).any(axis=(0, 2)), dtype=np.bool_)
    for item, response, known in zip(movements, responses, predicted, strict=True):
        if response.failure and known:
            return f"{item.text}: {' '.join(response.failure.split())}"
    return ""
