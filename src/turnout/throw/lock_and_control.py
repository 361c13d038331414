"""Lock, control and other single states of a run: contact, margins, least flangeway and gauge."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.mechanism import LawIndex
from turnout.panel.lock_rule import DriveStates, lock_holds
from turnout.panel.model import Panel
from turnout.panel.place import place_name
from turnout.solver.record import TIME_TOLERANCE
from turnout.throw.flangeway import (
    FLANGEWAY,
    UNKNOWN,
    DistancesFound,
    MovementEnds,
    least_distances,
    movement_ends,
)
from turnout.throw.gauge import GAUGE
from turnout.throw.recovery import Motion
from turnout.throw.route import DirectedMovement, at_rest, first_instants, rail_closes, throws
from turnout.throw.signals import Channel, object_rows, slip_forces

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

DIRECTIONS = ("opening", "closing")
DISTANCES = (FLANGEWAY, GAUGE)
"""Distances whose least values at the ends of movements are labels of a run."""


def contact_labels(index: LawIndex, first: Floats, placed: Floats) -> dict[str, Channel]:
    """Return room, touch and contact time of the foreign objects, from every step.

    Parameters
    ----------
    index : LawIndex
        For what is part of which object.
    first, placed : ndarray, shape (..., n_laws)
        First contact with, and placing of, what each law of an object stands for, in the order of
        the index; NaN for never; also of many throws with the same `object_rows` [s].
    """
    labels: dict[str, Channel] = {
        "object_placed": ((), np.asarray(~np.isnan(placed).any(axis=-1))),
        "object_touched": ((), np.asarray(~np.isnan(first).all(axis=-1))),
        "contact_time": ((), _earliest(first)),
    }
    if len(index.object_parts) > 1:
        earliest_of = [_earliest(first[..., own]) for own in object_rows(index)]
        labels["object_contact_time"] = (("object",), np.stack(earliest_of, axis=-1))
    return labels


def _earliest(times: Floats) -> Floats:
    """Return the least time along the last axis that is known, NaN without one."""
    found: Floats = np.asarray(np.fmin.reduce(times, axis=-1, initial=np.nan))
    return found


def force_margins(panel: Panel, *, time: Floats, drive_force: Floats) -> Floats:
    """Return the force left below the saturation force in opening and in closing movements.

    Only force in the direction of the movement counts. At the onset of a movement a drive still
    holds the rail with the force of the one before, the other way round; that is not its effort.

    Parameters
    ----------
    panel : Panel
        For saturation forces and movements.
    time : ndarray, shape (n_times,)
        [s]
    drive_force : ndarray, shape (n_drives, n_times)
        [N]

    Returns
    -------
    ndarray, shape (n_drives, 2)
        Saturation force less the largest force in the direction of a movement, from its onset to
        that of the next one; opening first [N]. NaN where there is no such movement.
    """
    moved = throws(panel)
    firsts = np.append(first_instants(panel, time), time.size)
    starts = np.broadcast_to(firsts, (drive_force.shape[0], firsts.size))
    return margins_between(drive_force, starts, slip_forces(panel), [item.to for item in moved])


def margins_between(force: Floats, starts: Ints, limits: Floats, to: Sequence[str]) -> Floats:
    """Return `force_margins` of rows of many throws.

    Parameters
    ----------
    force : ndarray, shape (n_rows, n_times)
        [N]
    starts : ndarray of int, shape (n_rows, n_movements + 1)
        First instant of each movement of each row, and that after its last one.
    limits : ndarray, shape (n_rows,)
        Saturation forces [N].
    to : sequence of str
        Positions to which the movements go, "open" or "closed".

    Returns
    -------
    ndarray, shape (n_rows, 2)
        [N]
    """
    margins = np.full((limits.size, len(DIRECTIONS)), np.nan)
    for number, position in enumerate(to):
        closes = position == "closed"
        first, last = starts[:, number], starts[:, number + 1]
        largest, sign = (np.maximum, 1.0) if closes else (np.minimum, -1.0)
        effort = sign * _between(largest, force, first, last)
        column = DIRECTIONS.index("closing" if closes else "opening")
        margins[:, column] = np.fmin(margins[:, column], limits - np.maximum(effort, 0.0))
    return margins


def _between(ufunc: np.ufunc, values: Floats, first: Ints, last: Ints) -> Floats:
    """Reduce a part of each row, by its first place and that after its last; NaN without one."""
    if not values.size:  # a run without a start
        return np.full(first.shape, np.nan)
    row_begins = np.arange(values.shape[0]) * values.shape[1]
    bounds = np.stack([first + row_begins, last + row_begins], axis=1).ravel()
    inside = np.minimum(bounds, values.size - 1)
    # every other one is what lies between the parts; the last one may end with the values
    reduced = ufunc.reduceat(values.ravel(), inside[:-1] if bounds[-1] == values.size else inside)
    return np.where(first < last, reduced[::2], np.nan)


def control_states(
    panel: Panel,
    *,
    time: Floats,
    slipping: Flags,
    drive_force: Floats,
    drive_gap: Floats,
    sensor_gap: Floats | None,
    moved: Sequence[DirectedMovement] | None = None,
) -> dict[str, Channel]:
    """Return `in_control` of every sensor and `locked` by the panel's rule.

    Nothing is locked while a movement is under way, from its onset until the last marker rests; at
    rest `turnout.panel.lock_rule` decides.

    Parameters
    ----------
    panel : Panel
        For the rule and the limits.
    time : ndarray, shape (n_times,)
        [s]
    slipping : ndarray of bool, shape (n_drives, n_times)
        Whether a drive is at its saturation force.
    drive_force : ndarray, shape (n_drives, n_times)
        On the rail [N].
    drive_gap : ndarray, shape (n_drives, n_times)
        Raw gap at the rods [m].
    sensor_gap : ndarray, shape (n_sensors, n_times), optional
        [m]
    moved : sequence of Throw, optional
        The movements as they were made; default those of the schedule.
    """
    slip_limit, gap_limit, at_sensors = state_limits(panel)
    drives = DriveStates(
        slipping=slipping,
        force=drive_force,
        gap=drive_gap,
        slip_limit=slip_limit,
        gap_limit=gap_limit,
    )
    rests = at_rest(panel, time, moved), rail_closes(panel, time)
    return states_at(panel.lock.rule, drives, rests, (sensor_gap, at_sensors))


def states_at(
    rule: str,
    drives: DriveStates,
    rests: tuple[Flags, Flags],
    sensors: tuple[Floats | None, Floats],
) -> dict[str, Channel]:
    """Return `control_states` at some instants, also of many throws.

    Parameters
    ----------
    rule : str
        For what is locked.
    drives : DriveStates
        At these instants.
    rests : tuple of ndarray of bool, shape (..., n_times)
        Whether no movement is under way, and whether a rail should be closed.
    sensors : tuple of ndarray, shapes (..., n_sensors, n_times) and (..., n_sensors)
        Gaps at sensors, or None, and their limits [m].
    """
    sensor_gap, at_sensors = sensors
    held = lock_holds(rule, drives, rests[1])
    states: dict[str, Channel] = {"locked": (("time",), held & rests[0])}
    if sensor_gap is not None:
        states["in_control"] = (("sensor", "time"), sensor_gap < at_sensors[..., np.newaxis])
    return states


def state_limits(panel: Panel) -> tuple[Floats, Floats, Floats]:
    """Return slip forces [N], and gaps from which drives refuse lock, and sensors control [m]."""
    at_sensors = [sensor.limit for sensor in panel.sensor.values()]
    gaps = np.array(list(panel.gap_limits().values()))
    return slip_forces(panel), gaps, np.array(at_sensors)


def distance_ends(
    panel: Panel, motion: Motion, moved: Sequence[DirectedMovement]
) -> MovementEnds | DistancesFound | None:
    """Return the data for flangeway and gauge at the ends of the movements as they were made."""
    ends = _end_instants(moved, motion.history.time)
    return movement_ends(panel, motion, ends, of=DISTANCES)


def distance_labels(
    runs: Sequence[MovementEnds | DistancesFound | None], panel: Panel
) -> dict[str, Channel]:
    """Return least flangeway and least gauge at the end of any movement, for some runs.

    Parameters
    ----------
    runs : sequence of MovementEnds, DistancesFound or None
        From `distance_ends`.
    panel : Panel
        Of one of them; where it has no data of the gauge, that is left out.

    Returns
    -------
    dict of str to (dims, ndarray)
        Each with its place and its rail. Runs first; the dimensions are those of one run.
        Distances and places in [m].
    """
    least, found = least_distances(runs), dict[str, Channel]()
    for name in [of.name for of in DISTANCES if of is FLANGEWAY or panel.gauge is not None]:
        width, x, rail = zip(*[run.get(name, UNKNOWN) for run in least], strict=True)
        found[f"least_{name}"] = ((), np.array(width))
        found[f"least_{name}_x"] = ((), np.array(x))
        found[f"least_{name}_rail"] = ((), np.array(rail))
    if panel.gauge is not None:
        places = [place_name(panel, at) if at == at else "" for at in x]
        found["least_gauge_place"] = ((), np.array(places))
    return found


def _end_instants(
    moved: Sequence[DirectedMovement], time: Floats
) -> list[tuple[DirectedMovement, int]]:
    """Return movements that end within a run, each with its first stored instant at or after."""
    ends = time.searchsorted([throw.end - TIME_TOLERANCE for throw in moved]).tolist()
    return [(throw, at) for throw, at in zip(moved, ends, strict=True) if at < time.size]
