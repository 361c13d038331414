"""Single numbers and states that a sweep stores of each throw, made of many throws at once.

They need every instant of a few channels, which are small; the history of a throw is gone by then.
"""

import math

import numpy as np
from numpy.typing import NDArray

from turnout.metric.features import FEATURES, run_features
from turnout.metric.trapped import is_trapped
from turnout.study.sweep.throw_group import AlikeThrows, ThrowSignals
from turnout.throw.lock_and_control import (
    contact_labels,
    control_states,
    flangeway_labels,
    force_margins,
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Values = dict[str, tuple[tuple[str, ...], NDArray[np.generic]]]
"""Of many throws: the dimensions of one, and values with throws first."""

LABELS = {
    "object_force_peak": ("N", "largest force on foreign objects"),
    "object_force_end": ("N", "force on foreign objects at the end"),
    "object_trapped": ("1", "whether a foreign object was touched and is still there at the end"),
    "slipped": ("1", "whether a drive slipped in the last movement"),
    "slipped_free": ("1", "whether a drive slipped before any object was touched"),
    "end_locked": ("1", "lock rule met at the end; -1 where a machine had not arrived"),
    "end_in_control": ("1", "sensor gap below its limit at the end"),
}
"""Unit and meaning of the labels that only a sweep has."""

NOT_STORED = ("object_contact_time", "least_flangeway_rail")
"""Labels that sweeps leave out."""

UNKNOWN_LOGICAL = -1
"""Stands for a logical value that is not known: the scenario is not complete, or a machine still
moves."""

MACHINE_LABELS = ("throw_time", "mean_current", "end_current")
"""Stored of each throw as they are, if drives are machines."""


def compute_labels(throws: AlikeThrows) -> Values:
    """Return labels and features of some throws."""
    contact = _contact_labels(throws)
    touched = np.asarray(contact["contact_time"][1], dtype=np.float64)
    found = _drive_features(throws) | object_labels(throws, touched)
    found |= _state_labels(throws) | contact
    found |= flangeway_labels([run.ends for run in throws.runs])
    found["object_trapped"] = ((), _trapped(throws, found))
    for name in NOT_STORED:
        found.pop(name, None)
    for name in MACHINE_LABELS:
        if name in throws.runs[0].labels:
            dims = throws.runs[0].labels[name][0]
            found[name] = (dims, np.array([run.labels[name][1] for run in throws.runs]))
    return found


def _drive_features(throws: AlikeThrows) -> Values:
    """Return the features of each drive and movement, the drives of all throws at once."""
    count = len(throws.runs)
    found = run_features(
        throws.time,
        throws.recorded_force.reshape(-1, throws.time.size),
        spans=throws.spans,
        limits=throws.slip_limits.ravel(),
        travel=throws.displacement.reshape(-1, throws.time.size),
    )
    dims = ("drive", "direction")
    by_throw = found.reshape(found.shape[0], count, -1, found.shape[-1])
    return {name: (dims, row) for name, row in zip(FEATURES, by_throw, strict=True)}


def _state_labels(throws: AlikeThrows) -> Values:
    """Return margins, and gaps and states at the end."""
    first, (drive_gap, sensor_gap) = throws.runs[0], throws.end_gaps
    margins = force_margins(
        first.panel, time=throws.time, drive_force=throws.force, limits=throws.slip_limits
    )
    states = control_states(
        first.panel,
        time=throws.time[-1:],
        slipping=throws.slipping[..., -1:],
        drive_gap=drive_gap,
        sensor_gap=sensor_gap if sensor_gap.size else None,
        moved=first.moved,
        limits=throws.gap_limits,
    )
    if any(item.unfinished or item.end > throws.time[-1] + 1e-9 for item in first.moved):
        states["locked"] = (("time",), np.full((len(throws.runs), 1), UNKNOWN_LOGICAL, np.int8))
    found: Values = {
        "force_margin": (("drive", "direction"), margins),
        "end_gap": (("drive",), drive_gap[..., -1]),
    }
    return found | {
        f"end_{name}": (dims[:-1], values[..., -1]) for name, (dims, values) in states.items()
    }


def _contact_labels(throws: AlikeThrows) -> Values:
    """Return room, touch and contact time of the objects."""
    first = throws.runs[0]
    objects = [list(run.watched.laws[len(first.panel.drive) :]) for run in throws.runs]
    times = [
        (run.watched.law_first[own], run.watched.law_placed[own])
        for run, own in zip(throws.runs, objects, strict=True)
    ]
    touched, placed = np.array(times).swapaxes(0, 1)
    return contact_labels(first.index, touched, placed)


def _trapped(throws: AlikeThrows, contact: Values) -> Flags:
    """Return True for each throw with a touched object that is still there at the end."""
    taken, left = np.array([_objects(run) for run in throws.runs]).swapaxes(0, 1)
    taken = np.where(taken > throws.time[-1], np.inf, taken)
    if "object_contact_time" in contact:
        touched = contact["object_contact_time"][1]
    else:
        touched = contact["contact_time"][1][:, np.newaxis]
    return np.asarray(is_trapped(touched, taken, left).any(axis=-1))


def _objects(run: ThrowSignals) -> tuple[list[float], list[float]]:
    """Return the end of each object [s], and the size that is left of it [m]."""
    taken = [float(run.disappears[own[0]]) for own in run.index.object_laws.values()]
    left = [math.nan] * len(taken)
    if "object_left" in run.labels:
        left = run.labels["object_left"][1].tolist()
    return taken, left


def object_labels(throws: AlikeThrows, contact: Floats) -> Values:
    """Return the largest and last force on the objects, and flags of drives that slipped.

    Parameters
    ----------
    throws : AlikeThrows
        The throws.
    contact : ndarray, shape (n,)
        When any object was first touched, NaN for never [s].
    """
    force = throws.on_objects["object_force"][1].astype(np.float64, copy=False)
    slipped, onset = np.zeros(force.shape, dtype=np.bool_), 0
    for span in throws.spans:
        onset = int(np.searchsorted(throws.time, span.start - 1e-9))
        effort = throws.force[..., onset:]
        # At the onset of a movement a drive may still hold with the force of the one before.
        working = effort > 0 if span.to == "closed" else effort < 0
        slipped[:, onset:] = (throws.slipping[..., onset:] & working).any(axis=1)
    alone = np.searchsorted(throws.time, np.where(np.isfinite(contact), contact, np.inf))
    first = np.where(slipped.any(axis=1), slipped.argmax(axis=1), throws.time.size)
    return {
        "object_force_peak": ((), np.max(force, axis=1, initial=0.0)),
        "object_force_end": ((), force[:, -1]),
        "slipped": ((), np.asarray(slipped[:, onset:].any(axis=1))),
        "slipped_free": ((), first < alone),
    }
