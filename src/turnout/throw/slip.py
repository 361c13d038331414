"""Movements of a dataset, their ends, and slips of drives in them or the margins to one."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turnout.solver.driven import Duty
from turnout.solver.record import TIME_TOLERANCE

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

LEAST_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class Span:
    """One movement: its name, target position ("open" or "closed"), onset and end [s]."""

    name: str
    to: str
    start: float
    end: float


@dataclass(frozen=True, slots=True)
class Slip:
    """A drive that reached its saturation force: which, when [s], in which movement.

    `stopped` is empty, or says what switched off a machine that has not slipped before its end.
    """

    drive: str
    time: float
    movement: Span | None
    stopped: str = ""


def movements(dataset: "xr.Dataset") -> tuple[Span, ...]:
    """Return the movements that a dataset names in its attributes, in the order of time."""
    return tuple(Span(**record) for record in _records(dataset, "movements"))


def _records(dataset: "xr.Dataset", name: str) -> list[dict[str, Any]]:
    """Return records of an attribute; one throw of a sequence with machines has its own."""
    own = f"throw_{name}"
    text = dataset.attrs.get(name, "[]")
    if own in dataset and not dataset[own].ndim:
        text = dataset[own].item()
    found: list[dict[str, Any]] = json.loads(text)
    return found


def periods(dataset: "xr.Dataset") -> list[tuple[Span | None, float]]:
    """Return each movement with the onset of the next one [s], or None if none is named."""
    spans = movements(dataset)
    if not spans:
        return [(None, math.inf)]
    return list(zip(spans, [*(span.start for span in spans[1:]), math.inf], strict=True))


def machine_throws(dataset: "xr.Dataset") -> list[dict[str, Any]]:
    """Return the throws of machines on their commands, from the attributes of a dataset."""
    return _records(dataset, "machine_throws")


def kept_duties(dataset: "xr.Dataset") -> list[Duty]:
    """Return the movements of machines that a dataset keeps, without the times of commands [s]."""

    def known(value: float | None) -> float:
        return math.nan if value is None else float(value)

    return [
        Duty(
            drive=item["drive"],
            to=item["to"],
            command=math.nan,
            on=item["on"],
            off=known(item["off"]),
            rest=known(item.get("rest", item["off"])),
            outcome=item["outcome"],
        )
        for item in machine_throws(dataset)
    ]


def unfinished(dataset: "xr.Dataset") -> dict[Span, str]:
    """Say of each movement that is not over at its end which drives have not arrived.

    Its end is the onset of the next movement, or that of the run.

    Examples
    --------
    >>> import xarray as xr
    >>> span = {"name": "throw", "to": "open", "start": 0.2, "end": 9.5}
    >>> made = {"drive": "1", "to": "open", "outcome": "moving", "on": 0.3, "off": None}
    >>> attributes = {"movements": json.dumps([span]), "machine_throws": json.dumps([made])}
    >>> attributes["machine_supplies"] = json.dumps({"1": {}})
    >>> run = xr.Dataset(coords={"time": [0.0, 8.5]}, attrs=attributes)
    >>> list(unfinished(run).values())
    ['Drive 1 still moves at 8.5 s']
    """
    if not dataset.sizes.get("time", 0) or not dataset.attrs.get("complete", True):
        return {}
    machines = json.loads(dataset.attrs.get("machine_supplies", "{}"))
    return late_movements(
        periods(dataset),
        end=float(dataset["time"][-1]),
        made=kept_duties(dataset),
        machines=machines,
    )


def late_movements(
    spans: Sequence[tuple[Span | None, float]],
    *,
    end: float,
    made: Sequence[Duty],
    machines: Iterable[str],
) -> dict[Span, str]:
    """Return the movements that are not over at their ends, with the reason.

    Parameters
    ----------
    spans : sequence of (Span, float)
        Movements, each with the onset of the next one [s].
    end : float
        Last instant of the run [s].
    made : sequence of Duty
        Switching of the machines, and their arrivals.
    machines : iterable of str
        Names of the drives that are machines.
    """
    found, named = {}, list(machines)
    for span, until in spans:
        if span is None:
            continue
        last, text = math.isinf(until), _who_moves(span, min(until, end), made, named)
        if not text and not (last and span.end > end + TIME_TOLERANCE):
            continue
        when = f"at {end:.4g} s" if last else f"when the next movement begins at {until:.4g} s"
        found[span] = f"{text or f'the movement to {span.to} is not over'} {when}"
    return found


def _who_moves(span: Span, by: float, made: Sequence[Duty], machines: Sequence[str]) -> str:
    """Name the drives whose machines have not come to rest in a movement by a time [s]."""
    names: dict[str, list[str]] = {}
    for drive in machines:
        own = [
            item
            for item in made
            if (item.drive, item.to) == (drive, span.to)
            and span.start - TIME_TOLERANCE <= item.on < by
        ]
        if not own or not own[0].rest <= by + TIME_TOLERANCE:
            moves = bool(own) and own[0].outcome in ("moving", "limit")
            names.setdefault("still moves" if moves else "has not arrived", []).append(drive)
    return " and ".join(
        f"Drive {drive} {what}" for what, drives in names.items() for drive in drives
    )


def last_instant_at(dataset: "xr.Dataset", *, to: str) -> "xr.Dataset":
    """Return the last instant before the switch leaves a position for the last time.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with at least one instant.
    to : str
        "open" or "closed", of the instrumented rail.

    Returns
    -------
    xarray.Dataset
        Without "time": the instant before the onset of the movement that follows the last one to
        that position; the start where no movement goes there, the end where none follows.
    """
    spans = movements(dataset)
    going = [number for number, span in enumerate(spans) if span.to == to]
    after = (going[-1] if going else -1) + 1
    time = dataset["time"].values
    if after >= len(spans):
        return dataset.isel(time=-1)
    before = int((time < spans[after].start - TIME_TOLERANCE).sum())
    return dataset.isel(time=max(before - 1, 0))


def slips(dataset: "xr.Dataset") -> list[Slip]:
    """Return the first slip of each drive in each movement, in the order of time."""
    flags = dataset["drive_slipping"].transpose("drive", "time").values.astype(bool)
    spans, made = periods(dataset), kept_duties(dataset)
    onsets = slip_onsets(dataset["time"].values, flags, spans)
    found = [
        Slip(str(drive), begin, span, switched_off_by(made, str(drive), begin))
        for drive, row in zip(dataset["drive"].values, onsets.tolist(), strict=True)
        for begin, (span, _) in zip(row, spans, strict=True)
        if not math.isnan(begin)
    ]
    return sorted(found, key=lambda slip: slip.time)


def slip_onsets(
    time: Floats, slipping: Flags, spans: Sequence[tuple[Span | None, float]]
) -> Floats:
    """Return when each drive first slips in each movement, NaN for never.

    A drive that has slipped and still rests at its saturation force when the next movement begins
    does not begin again.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        Rising [s].
    slipping : ndarray of bool, shape (..., n_drives, n_times)
        Also of many throws.
    spans : sequence of (Span, float)
        Movements, each with the onset of the next one [s]; a slip before the first is of it.

    Returns
    -------
    ndarray, shape (..., n_drives, n_movements)
        [s]
    """
    ends = np.searchsorted(time, [until for _, until in spans[:-1]])
    flags = slipping.reshape(-1, *slipping.shape[-2:])
    found = first_slips(time, flags, np.broadcast_to(ends, (flags.shape[0], ends.size)))
    return found.reshape(*slipping.shape[:-1], len(spans))


def first_slips(time: Floats, slipping: Flags, ends: Ints) -> Floats:
    """Return `slip_onsets` of many throws, shape (n, n_drives, n_movements) [s].

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        Rising [s].
    slipping : ndarray of bool, shape (n, n_drives, n_times)
    ends : ndarray of int, shape (n, n_movements - 1)
        The first instant of each movement of each throw but of the first one.
    """
    begins = slipping.copy()
    begins[..., 1:] &= ~slipping[..., :-1]
    onsets = np.full((*slipping.shape[:-1], ends.shape[1] + 1), np.nan)
    throw, drive, at = (found[::-1] for found in np.nonzero(begins))  # the first one is last
    onsets[throw, drive, (at[:, np.newaxis] >= ends[throw]).sum(axis=1)] = time[at]
    return onsets


STOPPED = {
    "time-out": "is switched off by its time-out before its end position",
    "overload": "is switched off by its overload relay before its end position",
    "stalled": "does not move until it is switched off",
}
"""Outcomes of commands after which the end of a machine is not proved, in words."""


def switched_off_by(made: Iterable[Duty], drive: str, time: float) -> str:
    """Name the switch-off of the machine of a drive by a time [s], other than by its limit.

    Parameters
    ----------
    made : iterable of Duty
        Movements of machines, in the order of time.
    drive : str
        Name of the drive.
    time : float
        [s]

    Examples
    --------
    >>> made = Duty("1", "open", 0.2, 0.3, 7.3, 7.4, "time-out")
    >>> switched_off_by([made], "1", 7.3)
    'is switched off by its time-out before its end position'
    >>> switched_off_by([Duty("1", "open", 0.2, 0.3, 7.3, 7.4, "limit")], "1", 7.3)
    ''
    """
    own = [duty for duty in made if duty.drive == drive and duty.on <= time + TIME_TOLERANCE]
    return STOPPED.get(own[-1].outcome, "") if own and own[-1].off <= time + TIME_TOLERANCE else ""
