"""Throws of a dataset in schema terms: cut out where currents show them, else a whole recording."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.detection.conditions import FORCE
from turnout.detection.detector.another_switch import panel_named
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_layout import CLOSING, OPENING, TOGETHER
from turnout.detection.drive_quantities import CHANNELS
from turnout.measurement.campaign.find_throws import FoundThrow, find_throws

Floats = NDArray[np.float64]


def faulty(name: str, fault: str) -> Recorded:
    """Return what stands for a throw that cannot be judged."""
    nothing = np.zeros(0)
    return Recorded(
        name=name, time=nothing, force=np.zeros((0, 0)), drives=(), onsets={}, fault=fault
    )


def throws_of_dataset(
    dataset: xr.Dataset, *, name: str = "throw", quantity: str = FORCE
) -> list[Recorded]:
    """Return the throws of a dataset in schema terms, measured or simulated.

    Where no current shows the movements, the one that is returned is the whole recording:
    `Detector.predict` finds the throws in it. Currents and powers are judged from exact onsets
    alone: those of the commands that a simulation states.
    """
    panel = panel_named(dataset.attrs)
    found = _throws_of_dataset(dataset, name=name, quantity=quantity)
    return [replace(item, panel=panel) for item in found]


def _throws_of_dataset(dataset: xr.Dataset, *, name: str, quantity: str) -> list[Recorded]:
    channel = CHANNELS[quantity]
    if channel not in dataset:
        return [faulty(name, f"no drive {quantity}s are recorded")]
    lacking = {"drive", "time"} - set(map(str, dataset[channel].dims))
    if lacking:
        return [faulty(name, f"'{channel}' has no dimension '{sorted(lacking)[0]}'")]
    if dataset["time"].dtype.kind == "M":
        since = dataset["time"].to_numpy() - dataset["time"].to_numpy()[:1]
        dataset = dataset.assign_coords(time=since / np.timedelta64(1, "s"))
    if "movement" in dataset.dims:
        return list(_of_movements(dataset, channel))
    if "throw" in dataset.dims:
        each = [(dataset.isel(throw=at), at + 1) for at in range(dataset.sizes["throw"])]
        return [
            item
            for one, at in each
            for item in _throws_of_dataset(one, name=f"{name}#{at}", quantity=quantity)
        ]
    whole = dataset.transpose(..., "drive", "time")
    drives = tuple(str(item) for item in whole["drive"].to_numpy())
    time = whole["time"].to_numpy().astype(np.float64)
    force = whole[channel].to_numpy().astype(np.float64)
    if quantity != FORCE:
        taken = Recorded(name=name, time=time, force=force, drives=drives, onsets={})
        return _commanded(taken, whole)
    found = find_throws(whole)
    closings = [item for item in found if item.direction == CLOSING]
    if _by_forces(whole, found):
        shown = [
            {CLOSING: item.onset}
            | ({} if (before := _opening_before(found, item)) is None else {OPENING: before.onset})
            for item in closings
            if not item.cut_start
        ]
        return [unmarked(whole, name=name, shown=shown)]
    if not closings:
        return [faulty(name, "no closing movement was found in it")]
    throws = []
    for number, item in enumerate(closings, 1):
        before = _opening_before(found, item)
        onsets = {CLOSING: item.onset}
        first = item.first
        if before is not None:
            onsets[OPENING] = before.onset
            first = before.first
        label = name if len(closings) == 1 else f"{name}#{number}"
        kept = slice(first, item.stop)
        throws.append(
            Recorded(
                name=label,
                time=time[kept],
                force=force[:, kept],
                drives=drives,
                onsets=onsets,
                fault="the recording begins after the onset of closing" if item.cut_start else "",
            )
        )
    return throws


def _commanded(whole: Recorded, dataset: xr.Dataset) -> list[Recorded]:
    """Return each closing of a simulation, with its opening, from when it was commanded."""
    if (
        "throw_movements" in dataset
    ):  # a throw of a sequence, with the schedule that it came to have
        moved = json.loads(str(dataset["throw_movements"].item()))
    else:
        moved = json.loads(str(dataset.attrs.get("movements", "[]")))
    if dataset.attrs.get("kind") != "simulation" or not moved:
        return [whole]
    throws = []
    for number, item in enumerate(moved):
        before = moved[number - 1] if number else item
        if item["to"] == "closed":
            onsets = {CLOSING: float(item["start"])}
            if before["to"] == "open" and item["start"] - before["start"] < TOGETHER:
                onsets[OPENING] = float(before["start"])
            throws.append(replace(whole, onsets=onsets, exact=True))
    if len(throws) > 1:
        throws = [replace(t, name=f"{whole.name}#{at}") for at, t in enumerate(throws, 1)]
    return throws or [replace(whole, exact=True)]


def _by_forces(dataset: xr.Dataset, found: tuple[FoundThrow, ...]) -> bool:
    """Return True if no channel but the forces shows when movements begin."""
    if found:
        return found[0].source == "force"
    return "drive_current" not in dataset


def _opening_before(found: tuple[FoundThrow, ...], closing: FoundThrow) -> FoundThrow | None:
    """Return the movement before a closing, if it is its opening."""
    at = found.index(closing)
    if at == 0:
        return None
    before = found[at - 1]
    near = closing.onset - before.onset < TOGETHER
    return before if before.direction == OPENING and near and not before.cut_start else None


def _of_movements(dataset: xr.Dataset, channel: str) -> Iterator[Recorded]:
    """Yield the closing movements of a campaign's dataset, each with its opening if recorded."""
    key = f"{channel}_unfiltered" if f"{channel}_unfiltered" in dataset else channel
    force = dataset[key].transpose("movement", "drive", "time").to_numpy().astype(np.float64)
    time = dataset["time"].to_numpy().astype(np.float64)
    drives = tuple(str(item) for item in dataset["drive"].to_numpy())
    columns = {
        name: dataset[name].to_numpy().tolist()
        for name in ("movement", "direction", "size", "place", "file", "onset")
        if name in dataset.coords
    }
    for row, direction in enumerate(columns["direction"]):
        if direction != CLOSING:
            continue
        onset = float(columns["onset"][row]) if "onset" in columns else 0.0
        before = _row_before(columns, row, onset)
        instants, values, onsets = time + onset, force[row], {CLOSING: onset}
        kept = np.isfinite(values).any(axis=0)
        instants, values = instants[kept], values[:, kept]
        if before is not None:
            start = float(columns["onset"][before])
            own = np.isfinite(force[before]).any(axis=0) & (time + start < instants[0])
            instants = np.concatenate([time[own] + start, instants])
            values = np.concatenate([force[before][:, own], values], axis=1)
            onsets[OPENING] = start
        labels = {str(name): columns[name][row] for name in ("size", "place") if name in columns}
        yield Recorded(
            name=str(columns["movement"][row]),
            time=instants,
            force=values,
            drives=drives,
            onsets=onsets,
            labels=labels,
        )


def _row_before(columns: dict[str, list[object]], row: int, onset: float) -> int | None:
    """Return the opening that the same recording holds just before a closing."""
    if row == 0 or "file" not in columns or "onset" not in columns:
        return None
    same = columns["file"][row - 1] == columns["file"][row]
    opening = columns["direction"][row - 1] == OPENING
    ago = onset - float(str(columns["onset"][row - 1]))
    return row - 1 if same and opening and 0.0 < ago < TOGETHER else None


def unmarked(dataset: xr.Dataset, *, name: str, shown: Sequence[Mapping[str, float]]) -> Recorded:
    """Return a whole recording whose throws the detector finds."""
    whole = dataset.transpose(..., "drive", "time")
    return Recorded(
        name=name,
        time=whole["time"].to_numpy().astype(np.float64),
        force=whole["drive_force"].to_numpy().astype(np.float64),
        drives=tuple(str(item) for item in whole["drive"].to_numpy()),
        onsets=shown[0] if shown else {},
        marked=False,
        shown=tuple(shown),
    )
