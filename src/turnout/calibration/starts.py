"""Starts of a fit: grids as published, near by, or in several places where stages were skipped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.comparison import align, predicted
from turnout.calibration.evaluate import Response
from turnout.calibration.fit import Fit, fit, update_movement_effects
from turnout.calibration.linearisation import is_slip_level
from turnout.calibration.measured_movements import (
    BIN,
    MeasuredMovement,
    Signal,
)
from turnout.calibration.misfit import Misfit
from turnout.calibration.stages import (
    THICKER,
    Parameter,
    coordinates,
    thickness_name,
    values_at,
)

Floats = NDArray[np.float64]
# A minimum of the grid whose misfit is at most so many times the least may be the deeper one [-].
DEEP_ENOUGH = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridSearch:
    """Misfit over a grid.

    Attributes
    ----------
    parameter : Parameter
        That was swept.
    grid : tuple of float
        Values of the parameter that were tried, in SI, rising.
    misfit : tuple of float
        Root mean square of measured less simulated, as share of each channel's range; infinite
        where a simulation failed.
    values : mapping of str to float
        Of all parameters at the best value of the grid.
    curves : xarray.Dataset
        Of one movement, to draw: `drive_force` (value, drive, time), `object_force` (value, time),
        and the same with "measured_" in front, without value.
    """

    parameter: Parameter
    grid: tuple[float, ...]
    misfit: tuple[float, ...]
    values: Mapping[str, float]
    curves: xr.Dataset


def sweep(
    misfit: Misfit, parameter: Parameter, grid: Sequence[float], values: Mapping[str, float]
) -> GridSearch:
    """Try each value of a grid, with the force at which drives slip as it is and as measured.

    Parameters
    ----------
    misfit : Misfit
        Movements and how they are compared.
    parameter : Parameter
        Parameter that takes the values of the grid.
    grid : sequence of float
        Its values, those within its bounds are tried.
    values : mapping of str to float
        Of all parameters.

    Returns
    -------
    GridSearch
    """
    tried = tuple(value for value in grid if parameter.lower <= value <= parameter.upper)
    bases = [dict(values)]
    measured = _slip_levels(misfit, values)
    if measured != values:
        bases.append(measured)
    points = [{**base, parameter.name: value} for base in bases for value in tried]
    made = misfit.responses(points)
    sizes = [misfit_share(misfit, row) for row in made]
    count = len(tried)
    per_value = [min(sizes[n::count]) for n in range(count)]
    best = int(np.argmin(sizes))
    shown = int(np.argmax([movement.direction == "closing" for movement in misfit.movements]))
    base = best // count
    rows = [made[base * count + n][shown] for n in range(count)]
    return GridSearch(
        parameter=parameter,
        grid=tried,
        misfit=tuple(per_value),
        values=points[best],
        curves=_curves(misfit.movements[shown], tried, rows)
        .assign(misfit=("value", per_value))
        .assign_attrs(parameter=parameter.name, unit=parameter.unit),
    )


def _slip_levels(misfit: Misfit, values: Mapping[str, float]) -> dict[str, float]:
    """Return values with the largest measured force of each drive as its slip level."""
    changed = dict(values)
    for item in misfit.parameters:
        if item.vary and is_slip_level(item):
            drives = [key.split(".")[1] for key in item.keys]
            largest = [
                float(np.nanmax(np.abs(signal.values)))
                for movement in misfit.movements
                for signal in movement.signals
                if signal.channel == "drive_force" and signal.drive in drives
            ]
            if largest:
                changed[item.name] = min(max(max(largest), item.lower), item.upper)
    return changed


def other_minima(grid: Sequence[float], misfit: Sequence[float]) -> list[float]:
    """Return where else than at its best a misfit has a minimum that may be the deeper one.

    Parameters
    ----------
    grid, misfit : sequence of float
        Values that were tried, rising, and what each leaves.

    Examples
    --------
    >>> other_minima([1.0, 2.0, 3.0, 4.0, 5.0], [0.3, 0.2, 0.4, 0.25, 0.5])
    [4.0]
    >>> other_minima([1.0, 2.0, 3.0, 4.0, 5.0], [0.3, 0.2, 0.4, 0.45, 0.5])
    []
    """
    edged = [float("inf"), *misfit, float("inf")]
    least = min(misfit)
    return [
        value
        for value, before, here, after in zip(grid, edged, misfit, edged[2:], strict=False)
        if least < here <= DEEP_ENOUGH * least and here < before and here < after
    ]


def misfit_share(misfit: Misfit, responses: Sequence[Response]) -> float:
    """Return the root mean square of what is left, over each channel's range."""
    squares: list[Floats] = []
    for movement, response in zip(misfit.movements, responses, strict=True):
        if response.failure:
            return float("inf")
        alignment = align(movement, response, comparison=misfit.comparison, sensitivities={})
        row = alignment.measured - alignment.predicted(response)
        for _, _, piece in alignment.pieces:
            width = float(np.ptp(alignment.measured[piece]))
            squares.append((row[piece] / max(width, 1.0)) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _curves(
    movement: MeasuredMovement, grid: Sequence[float], rows: Sequence[Response]
) -> xr.Dataset:
    """Return measured and simulated signals of a movement, on the time of its bins."""
    time = movement.signals[0].time
    inside = np.flatnonzero((time >= -0.2) & (time + BIN <= movement.length))
    drives = [signal.drive for signal in movement.signals if signal.channel == "drive_force"]

    def simulated(signal: Signal) -> Floats:
        return np.array([predicted(row, movement, signal, inside) for row in rows])

    forces = [signal for signal in movement.signals if signal.channel == "drive_force"]
    variables: dict[str, object] = {
        "measured_drive_force": (("drive", "time"), np.array([s.values[inside] for s in forces])),
        "drive_force": (("value", "drive", "time"), np.stack([simulated(s) for s in forces], 1)),
    }
    for signal in movement.signals:
        if signal.channel == "object_force":
            variables["measured_object_force"] = ("time", signal.values[inside])
            variables["object_force"] = (("value", "time"), simulated(signal))
    coordinates = {"time": time[inside], "drive": drives, "value": list(grid)}
    return xr.Dataset(variables, coordinates, {"movement": movement.text})


# How often movements that join a fit are thrown at their own values before it goes on.
OWN_PASSES = 2


def starts_of(
    misfit: Misfit,
    skipped: Sequence[tuple[Parameter, Sequence[float]]],
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
) -> list[dict[str, float]]:
    """Return values in which those of skipped stages start at the best of their grid, and others.

    No stage has brought them near: from twice the true stiffness a fit follows causes instead. A
    grid is searched while other parameters are still off, so several are searched twice, and where
    one has another minimum that is nearly as deep, a fit starts there too.

    Parameters
    ----------
    misfit : Misfit
        Movements of the present stage.
    skipped : sequence of (Parameter, sequence of float)
        Parameters of skipped stages with their grids.
    parameters : sequence of Parameter
        Of the present stage.
    values : mapping of str to float
        Where earlier stages ended.

    Returns
    -------
    list of dict of str to float
        The likeliest first; the values as they are where nothing was skipped.
    """
    best, others = dict(values), list[dict[str, float]]()
    own = [(parameter, grid) for parameter, grid in skipped if parameter in parameters]
    for last in (False, True) if len(own) > 1 else (True,):
        for parameter, grid in own:
            tried = sorted({*grid, best[parameter.name]})
            searched = sweep(replace(misfit, quick=True), parameter, tried, best)
            best = dict(searched.values)
            if last:
                minima = other_minima(searched.grid, searched.misfit)
                others += [{**best, parameter.name: value} for value in minima]
    return [best, *others]


def nearest_fit(
    misfit: Misfit,
    parameters: Sequence[Parameter],
    starts: Sequence[Mapping[str, float]],
) -> Fit:
    """Fit roughly from each start, and return the fit that leaves least.

    Parameters
    ----------
    misfit, parameters
        As of `fit`.
    starts : sequence of mapping of str to float
        Of all parameters.
    """
    found = [fit(misfit, parameters, start, rough=True) for start in starts]
    return min(found, key=lambda item: misfit_share(item.misfit, item.local.simulated))


def with_thicker(
    misfit: Misfit,
    near: Fit,
) -> Fit:
    """Return a rough fit of objects that are thicker or thinner by more, where that leaves less.

    Each thickness is thrown, with all other values adjusted to first order: whether a drive slips
    may change on the way, which no slope shows.

    Parameters
    ----------
    misfit : Misfit
        Before any fit.
    near : Fit
        Rough, of that misfit.
    """
    names = [item.name for item in near.parameters]
    if thickness_name() not in names:
        return near
    own = names.index(thickness_name())
    J = np.delete(near.jacobian, own, axis=1)
    others = [item for item in near.parameters if item.name != thickness_name()]
    tried = [(near.cost, near.values)]
    points = [{**near.values, thickness_name(): value} for value in THICKER]
    for point, row in zip(points, near.misfit.responses(points), strict=True):
        r = near.misfit.residuals_of(row, near.frame)
        if np.isfinite(r).all():
            step = np.linalg.lstsq(J, -r, rcond=None)[0]
            left = r + J @ step
            there = values_at(others, coordinates(others, point) + step)
            tried.append((float(left @ left), {**point, **there}))
    _, values = min(tried, key=lambda item: item[0])
    if values is near.values:
        return near
    again = fit(misfit, near.parameters, values, rough=True)
    return min((near, again), key=lambda item: misfit_share(item.misfit, item.local.simulated))


def with_movements(near: Fit, movements: Sequence[MeasuredMovement]) -> Fit:
    """Return a rough fit of some movements as one of more, each with its own values.

    Parameters
    ----------
    near : Fit
        Of some of the movements.
    movements : sequence of MeasuredMovement
        Of the fit that goes on.
    """
    if tuple(movements) == near.misfit.movements:
        return near
    places = {item.name: number for number, item in enumerate(near.misfit.movements)}
    effects = {
        name: tuple(row[places[item.name]] if item.name in places else 0.0 for item in movements)
        for name, row in near.misfit.effects.items()
    }
    misfit = replace(near.misfit, movements=tuple(movements), effects=effects)
    # Before slopes of all parameters are thrown where these movements then are not.
    local = misfit.local(near.values, ())
    misfit, local, _ = update_movement_effects(misfit, local, (), passes=OWN_PASSES)
    return replace(near, misfit=misfit, local=replace(local, stepped={}))
