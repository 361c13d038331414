"""Single numbers and states that a sweep stores of each throw, made of many throws at once.

They need every instant of a few channels, which are small; the history of a throw is gone by then.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from turnout.metric.features import FEATURES, run_features
from turnout.panel.lock_rule import DriveStates
from turnout.solver.record import TIME_TOLERANCE
from turnout.study.sweep.throw_group import AlikeThrows, ThrowSignals
from turnout.throw.breaking import BLOW_SHARE, COARSE_BLOW_SHARE
from turnout.throw.checks import OF_WHEELS, SWITCHED_OFF, Check, sensor_judges
from turnout.throw.lock_and_control import (
    contact_labels,
    distance_labels,
    margins_between,
    states_at,
)
from turnout.throw.route import rail_closes_after, rests_between, sensor_rails
from turnout.throw.slip import first_slips, switched_off_by
from turnout.throw.verdict import KINDS, Kind, TrappedItem, judge_objects, kind_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]
Values = dict[str, tuple[tuple[str, ...], NDArray[np.generic]]]
"""Of many throws: the dimensions of one, and values with throws first."""

LABELS = {
    "object_force_peak": (
        "N",
        "largest force on foreign objects; the peak of a blow is off by up to "
        f"{COARSE_BLOW_SHARE} % in mode quick, {BLOW_SHARE} % in mode waveform",
    ),
    "object_force_end": ("N", "force on foreign objects at the end"),
    "object_trapped": ("1", "whether a foreign object was touched and is still there at the end"),
    "slipped": ("1", "whether a drive slipped in the last movement"),
    "slipped_free": ("1", "whether a drive slipped before any object was touched"),
    "end_locked": ("1", "lock rule met at the end; -1 where a machine had not arrived"),
    "end_in_control": ("1", "sensor gap below its limit at the end"),
    "verdict": (
        "1",
        "kind of verdict: " + ", ".join(f"{n} {kind}" for n, kind in enumerate(KINDS)),
    ),
}
"""Unit and meaning of the labels that only a sweep has."""

NOT_STORED = (
    *("object_contact_time", "least_flangeway_rail", "least_gauge_rail", "least_gauge_place"),
)
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
    found |= distance_labels([run.ends for run in throws.runs], throws.runs[0].panel)
    items = _items(throws, found)
    found["object_trapped"] = ((), np.array([any(item.trapped for item in own) for own in items]))
    found["verdict"] = ((), _verdicts(throws, found, items))
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
        spans=throws.runs[0].spans,
        onsets=throws.of_rows(throws.starts),
        ends=throws.of_rows(throws.sizes),
        limits=throws.slip_limits.ravel(),
        travel=throws.displacement.reshape(-1, throws.time.size),
    )
    dims = ("drive", "direction")
    by_throw = found.reshape(found.shape[0], count, -1, found.shape[-1])
    return {name: (dims, row) for name, row in zip(FEATURES, by_throw, strict=True)}


def _state_labels(throws: AlikeThrows) -> Values:
    """Return margins, and gaps and states at the end; `_locked` and `_in_control` at all rests."""
    first, (drive_gap, sensor_gap) = throws.runs[0], throws.rest_gaps
    begins = np.concatenate(
        [throws.instants(throws.starts - TIME_TOLERANCE), throws.sizes[:, None]], 1
    )
    margins = margins_between(
        throws.force.reshape(-1, throws.time.size),
        throws.of_rows(begins),
        throws.slip_limits.ravel(),
        [item.to for item in first.moved],
    ).reshape(*throws.slip_limits.shape, -1)
    at = throws.rests[:, np.newaxis]
    drives = DriveStates(
        slipping=np.take_along_axis(throws.slipping, at, axis=-1),
        force=np.take_along_axis(throws.force, at, axis=-1),
        gap=drive_gap,
        slip_limit=throws.slip_limits,
        gap_limit=throws.gap_limits[0],
    )
    sensors = sensor_gap if sensor_gap.size else None, throws.gap_limits[1]
    states = states_at(first.panel.lock.rule, drives, _rest_flags(throws), sensors)
    found: Values = {
        "force_margin": (("drive", "direction"), margins),
        "end_gap": (("drive",), drive_gap[..., -1]),
    }
    for name, (dims, values) in states.items():
        found[f"end_{name}"] = (dims[:-1], values[..., -1])
        found[f"rest_{name}"] = (dims, values)
    if first.late()[-1]:
        found["end_locked"] = ((), np.full(len(throws.runs), UNKNOWN_LOGICAL, np.int8))
    return found


def _rest_flags(throws: AlikeThrows) -> tuple[Flags, Flags]:
    """Return whether the rests are at rest, and whether a rail should be closed there."""
    times = throws.time[throws.rests]
    ends = np.array([[item.end for item in run.moved] for run in throws.runs])
    closes = rail_closes_after(throws.runs[0].panel, times, throws.starts)
    return rests_between(times, throws.starts, ends), closes


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


def _items(throws: AlikeThrows, contact: Values) -> list[list[TrappedItem]]:
    """Return the objects of each throw."""
    touched = contact["contact_time"][1][:, np.newaxis]
    if "object_contact_time" in contact:
        touched = contact["object_contact_time"][1]
    return [
        _items_of(run, own, float(run.watched.time[-1]))
        for run, own in zip(throws.runs, touched.tolist(), strict=True)
    ]


def _items_of(run: ThrowSignals, contact: list[float], end: float) -> list[TrappedItem]:
    if not run.object_rails:
        return []
    taken = [float(run.disappears[own[0]]) for own in run.index.object_laws.values()]
    left = [math.nan] * len(taken)
    if "object_left" in run.labels:
        left = run.labels["object_left"][1].tolist()
    return [
        TrappedItem(
            contact=first,
            gone=math.inf if gone > end else gone,
            position="closed" if rail == run.panel.instrumented_rail else "open",
            left=size,
        )
        for first, gone, size, rail in zip(contact, taken, left, run.object_rails, strict=True)
    ]


def _verdicts(
    throws: AlikeThrows, found: Values, items: Sequence[Sequence[TrappedItem]]
) -> NDArray[np.int8]:
    """Return the kind of verdict on each throw, by its place in `KINDS`."""
    narrow, first = _narrow(throws, found).tolist(), throws.runs[0]
    late, (rests, after) = first.late(), first.at_rest()
    refused = ~found.pop("rest_locked")[1][:, np.newaxis, rests].astype(bool)
    if "rest_in_control" in found:
        out = ~found.pop("rest_in_control")[1][..., rests].astype(bool)
        out &= _asked(first, after)
        refused = np.concatenate([refused, out], axis=1)
    refused[..., np.array(late)[after]] = True  # not judged
    onsets = _slip_onsets(throws)
    plain: Flags = np.asarray(~refused.any(axis=(1, 2)) & np.isnan(onsets).all(axis=(1, 2)))
    made = np.empty(len(throws.runs), dtype=np.int8)
    placed = found["object_placed"][1].tolist()
    for number, own in enumerate(items):
        kind: Kind = "not sound" if narrow[number] else "sound"
        if own and not placed[number]:
            kind = "not judged"
        elif plain[number]:
            kind = "undetected object" if any(item.trapped for item in own) else kind
        else:
            run = throws.runs[number]
            checks = _slip_checks(run, onsets[number])
            checks += _rest_checks(run, refused[number], (rests, after), late)
            if narrow[number]:
                room = OF_WHEELS[0]
                checks.append(Check(kind=room, name=room, criterion=room, met=False))
            kind = kind_of(judge_objects(own, checks, run.periods), checks, late=any(late))
        made[number] = KINDS.index(kind)
    return made


def _narrow(throws: AlikeThrows, found: Values) -> Flags:
    """Return whether the least flangeway or gauge of each throw is below its limit."""
    panels = [run.panel for run in throws.runs]
    limits = [panel.flangeway.limit if panel.flangeway else math.nan for panel in panels]
    narrow = np.asarray(found["least_flangeway"][1] < np.array(limits))
    if "least_gauge" in found:
        least = [math.nan if (limit := panel.gauge_limit) is None else limit for panel in panels]
        narrow |= found["least_gauge"][1] < np.array(least)
    return narrow


def _asked(run: ThrowSignals, after: Ints) -> Flags:
    """Return whether each sensor is on the rail that is closed at rests after some movements."""
    panel, spans = run.panel, [run.periods[movement][0] for movement in after]
    rails, instrumented = sensor_rails(panel), panel.instrumented_rail
    asked = [
        sensor_judges(
            rails.get(name), "closed" if span is None else span.to, instrumented=instrumented
        )
        for name in panel.sensor
        for span in spans
    ]
    return np.array(asked, dtype=np.bool_).reshape(len(panel.sensor), len(spans))


def _slip_onsets(throws: AlikeThrows) -> Floats:
    """Return when each drive first slips in each movement, shape (n, n_drives, n_movements) [s]."""
    flags, ends = throws.slipping, throws.instants(throws.starts[:, 1:])
    onsets = np.full((*flags.shape[:2], ends.shape[1] + 1), np.nan)
    some = flags.any(axis=(1, 2))
    onsets[some] = first_slips(throws.time, flags[some], ends[some])
    return onsets


def _slip_checks(run: ThrowSignals, onsets: Floats) -> list[Check]:
    """Return the slips of one throw."""
    return [
        Check(
            kind="slip",
            name=drive,
            criterion=SWITCHED_OFF if switched_off_by(run.duties, drive, time) else "slip",
            met=False,
            time=time,
            movement=span,
        )
        for drive, times in zip(run.panel.drive, onsets.tolist(), strict=True)
        for time, (span, _) in zip(times, run.periods, strict=True)
        if not math.isnan(time)
    ]


def _rest_checks(
    run: ThrowSignals, refused: Flags, asked: tuple[Ints, Ints], late: Sequence[bool]
) -> list[Check]:
    """Return the locks and sensors of one throw that are not met, or not judged."""
    times, spans = run.watched.time[run.watched.rests[asked[0]]].tolist(), run.periods
    return [
        Check(
            kind="control" if row else "lock",
            name=str(row),
            criterion="",
            met=None if late[asked[1][rest]] else False,
            time=times[rest],
            movement=spans[asked[1][rest]][0],
        )
        for row, rest in zip(*(axis.tolist() for axis in np.nonzero(refused)), strict=True)
    ]


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
    ways = [1.0 if span.to == "closed" else -1.0 for span in throws.runs[0].spans]
    slipped, last = np.zeros((2, *force.shape), dtype=np.bool_)
    some = throws.slipping.any(axis=(1, 2))
    onsets = throws.instants(throws.starts - TIME_TOLERANCE)[some]
    begun = (np.arange(throws.time.size)[:, np.newaxis] >= onsets[:, np.newaxis]).sum(axis=-1)
    # At the onset of a movement a drive may still hold with the force of the one before.
    effort = np.array([0.0, *ways])[begun][:, np.newaxis] * throws.force[some]
    slipped[some] = (throws.slipping[some] & (effort > 0.0)).any(axis=1)
    last[some] = begun == len(ways)
    alone = np.searchsorted(throws.time, np.where(np.isfinite(contact), contact, np.inf))
    first = np.where(slipped.any(axis=1), slipped.argmax(axis=1), throws.time.size)
    return {
        "object_force_peak": ((), np.fmax.reduce(force, axis=1, initial=0.0)),
        "object_force_end": ((), force[np.arange(len(force)), throws.sizes - 1]),
        "slipped": ((), np.asarray((slipped & last).any(axis=1))),
        "slipped_free": ((), first < alone),
    }
