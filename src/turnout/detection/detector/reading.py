"""Throws from whatever holds them: campaign folders, recordings with a map, datasets, tables."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.detection.conditions import FORCE, UNITS
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_layout import CLOSING, OPENING
from turnout.detection.drive_quantities import CHANNELS
from turnout.errors import FileError, TurnoutError
from turnout.measurement.campaign.build_campaign import (
    CHANNEL_FILE,
    BuiltCampaign,
    build_campaign,
)
from turnout.measurement.campaign.find_throws import FoundThrow, find_throws
from turnout.measurement.chain.apply import apply_chain, load_channel_map
from turnout.measurement.formats.file_format import read_recording

Floats = NDArray[np.float64]

APART = 30.0
"""An opening belongs to the closing that begins at most so long after its onset [s]."""
RATE, START, DIRECTION, NAME = "rate [Hz]", "start [s]", "direction", "throw"
WINDOW = "window [s]"
JOINED = "+"
"""Stands between the names of drives whose motors share one current."""


def read_throws(
    path: Path | str, *, channels: Path | str | None = None, quantity: str = FORCE
) -> list[Recorded]:
    """Return the throws of a campaign folder, a dataset (.nc), a table (.csv), or a recording.

    Parameters
    ----------
    path : path-like
        What was recorded.
    channels : path-like, optional
        Channel map of a recording; without one, a .csv is a table with a row a throw.
    quantity : str
        What of the drives is judged: "force", "current" or "power" (`Detector.quantity`).

    Raises
    ------
    FileError, MeasurementError
        When it cannot be read.
    """
    place = Path(path)
    if not place.exists():
        message = f"{place}: there is no such file or folder"
        raise FileError(message)
    if place.is_dir():
        return _of_folder(place, channels, quantity)
    if channels is not None:
        dataset = apply_chain(read_recording(place), load_channel_map(channels))
        return throws_of_dataset(dataset, name=place.name, quantity=quantity)
    if place.suffix == ".nc":
        from turnout.response.store import open_response

        return throws_of_dataset(open_response(place), name=place.name, quantity=quantity)
    if place.suffix == ".csv":
        return read_table(place, quantity=quantity)
    message = f"{place}: needs a channel map: --channels MAP.toml"
    raise FileError(message)


def _of_folder(folder: Path, channels: Path | str | None, quantity: str) -> list[Recorded]:
    """Return the closings of a campaign; of forces alone, each recording as a whole."""
    campaign = build_campaign(folder, channels=channels)
    found = {item.name: item for item in throws_of_campaign(campaign, quantity)}
    chain = load_channel_map(channels if channels is not None else folder / CHANNEL_FILE)
    if chain.drive_current or quantity != FORCE:
        return list(found.values())
    reasons = {item.run.name: item.reasons for item in campaign.excluded}
    throws: list[Recorded] = []
    for file in dict.fromkeys(run.file for run in campaign.sheet.runs):
        runs = [run for run in campaign.sheet.runs if run.file == file and run.direction == CLOSING]
        if not runs:
            continue
        said = [reason for run in runs for reason in reasons.get(run.name, ())]
        if not all(reason.startswith(OF_FINDING) for reason in said):
            throws += [found[run.name] for run in runs]
            continue
        dataset = apply_chain(read_recording(folder / file), chain)
        if any(reason.startswith(DEAD) for reason in said) and _rests(dataset):
            throws += [found[run.name] for run in runs]
            continue
        whole = _unmarked(
            dataset,
            name=str(Path(file).with_suffix("")),
            shown=[found[run.name].onsets for run in runs if not found[run.name].fault],
        )
        listed = {run.name: {"size": run.size, "place": run.place} for run in runs}
        throws.append(replace(whole, listed=listed))
    return throws


DEAD = "dead channel"
OF_FINDING = (
    *("movement ", "truncated", "drift", "direction", "reversed polarity", "swapped channels"),
    *("sampling rate: the throw begins", DEAD),
)
"""Reasons to leave a movement out that a wrong cut can make; the match checks these again."""
LEAST_RANGE = 200.0
"""Range of a drive force over a recording below which its channel is dead [N]."""


def _rests(dataset: xr.Dataset) -> bool:
    """Whether some drive force hardly changes over a whole recording."""
    low, high = np.nanquantile(dataset["drive_force"].transpose("drive", "time"), [0.01, 0.99], 1)
    return bool(np.any(high - low < LEAST_RANGE))


def _unmarked(dataset: xr.Dataset, *, name: str, shown: Sequence[Mapping[str, float]]) -> Recorded:
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


def throws_of_campaign(campaign: BuiltCampaign, quantity: str = FORCE) -> list[Recorded]:
    """Return the closing movements of a campaign, and what is not usable with its reasons."""
    found = []
    if campaign.dataset is not None:
        found = throws_of_dataset(campaign.dataset, quantity=quantity)
    for item in campaign.excluded:
        if item.run.direction == CLOSING:
            found.append(_faulty(item.run.name, "; ".join(item.reasons)))
    return found


def _faulty(name: str, fault: str) -> Recorded:
    nothing = np.zeros(0)
    return Recorded(
        name=name, time=nothing, force=np.zeros((0, 0)), drives=(), onsets={}, fault=fault
    )


def throws_of_dataset(
    dataset: xr.Dataset, *, name: str = "throw", quantity: str = FORCE
) -> list[Recorded]:
    """Return the throws of a dataset in schema terms, measured or simulated.

    Where no current shows the movements, the one that is returned is the whole recording:
    `Detector.predict` finds the throws in it.
    """
    channel = CHANNELS[quantity]
    if channel not in dataset:
        return [_faulty(name, f"no drive {quantity}s are recorded")]
    if "movement" in dataset.dims:
        return list(_of_movements(dataset, channel))
    if "throw" in dataset.dims:
        each = [(dataset.isel(throw=at), at + 1) for at in range(dataset.sizes["throw"])]
        return [
            item
            for one, at in each
            for item in throws_of_dataset(one, name=f"{name}#{at}", quantity=quantity)
        ]
    whole = dataset.transpose(..., "drive", "time")
    drives = tuple(str(item) for item in whole["drive"].to_numpy())
    time = whole["time"].to_numpy().astype(np.float64)
    force = whole[channel].to_numpy().astype(np.float64)
    found = find_throws(whole)
    closings = [item for item in found if item.direction == CLOSING]
    if quantity == FORCE and _by_forces(whole, found):
        shown = [
            {CLOSING: item.onset}
            | ({} if (before := _opening_before(found, item)) is None else {OPENING: before.onset})
            for item in closings
            if not item.cut_start
        ]
        return [_unmarked(whole, name=name, shown=shown)]
    if not closings:
        return [_faulty(name, "no closing movement was found in it")]
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


def _by_forces(dataset: xr.Dataset, found: tuple[FoundThrow, ...]) -> bool:
    """Whether no channel but the forces shows when movements begin."""
    if found:
        return found[0].source == "force"
    return "drive_current" not in dataset


def _opening_before(found: tuple[FoundThrow, ...], closing: FoundThrow) -> FoundThrow | None:
    """Return the movement before a closing, if it is its opening."""
    at = found.index(closing)
    if at == 0:
        return None
    before = found[at - 1]
    near = closing.onset - before.onset < APART
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
    return row - 1 if same and opening and 0.0 < ago < APART else None


def read_table(path: Path, *, quantity: str = FORCE) -> list[Recorded]:
    """Read a table with a row a throw, as monitoring systems write it.

    Columns: `throw`, `rate [Hz]`, optionally `start [s]` (of the first sample, the movement begins
    at 0), `window [s]` (samples are means or root mean squares over so long before their instants)
    and `direction`, and for each drive `force NAME [N]`, `current NAME [A]` or `power NAME [W]`:
    samples separated by spaces.

    Parameters
    ----------
    path : Path
        Of the table (.csv).
    quantity : str
        Which of these is judged.
    """
    lead, unit = f"{quantity} ", f" [{UNITS[quantity]}]"
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        message = f"{path}: cannot be read as a table ({error})"
        raise FileError(message) from None
    names = list(rows[0]) if rows else []
    drives = tuple(
        name.removeprefix(lead).removesuffix(unit)
        for name in names
        if name and name.startswith(lead) and name.endswith(unit)
    )
    if RATE not in names or not drives:
        message = (
            f"{path}: no table of throws: needs the columns '{RATE}' and '{lead}NAME{unit}'; "
            "a recording with a column a channel needs --channels MAP.toml"
        )
        raise FileError(message)
    return [_of_row(row, number, drives, quantity) for number, row in enumerate(rows, 1)]


SHARED = "one channel stands for the motors of drives"
LONGEST_WINDOW = 0.1
"""A mean over longer smears what a contact changes [s]."""


def _of_row(row: dict[str, str], number: int, drives: tuple[str, ...], quantity: str) -> Recorded:
    name = (row.get(NAME) or "").strip() or f"row {number}"
    direction = (row.get(DIRECTION) or "").strip().lower()
    try:
        rate = float(row[RATE])
        lines = [
            [float(item) for item in (row[f"{quantity} {d} [{UNITS[quantity]}]"] or "").split()]
            for d in drives
        ]
        start = float(row[START]) if (row.get(START) or "").strip() else float("nan")
        window = float(row[WINDOW]) if (row.get(WINDOW) or "").strip() else 0.0
    except (ValueError, TypeError, KeyError) as error:
        return _faulty(name, f"holds what is no number ({error})")
    lengths = {len(line) for line in lines}
    if direction and direction != CLOSING:
        return _faulty(name, f"is {direction}, and closing movements are judged")
    if len(lengths) != 1 or max(lengths) < 10 or not rate > 0.0:
        return _faulty(name, f"has {sorted(lengths)} samples a drive at {rate:g} Hz")
    joined = [name for name in drives if JOINED in name]
    if joined:
        return _faulty(name, f"{SHARED} {', '.join(joined)}; {quantity}s of each are needed")
    if not 0.0 <= window <= LONGEST_WINDOW:
        return _faulty(name, f"'{WINDOW}' is {window:g}; up to {LONGEST_WINDOW:g} can be judged")
    force = np.array(lines)
    if np.isfinite(start):
        # a mean belongs to the middle of its window
        time = start - 0.5 * window + np.arange(force.shape[1]) / rate
        return Recorded(name=name, time=time, force=force, drives=drives, onsets={CLOSING: 0.0})
    time = np.arange(force.shape[1]) / rate
    dataset = xr.Dataset(
        {CHANNELS[quantity]: (("drive", "time"), force)}, {"time": time, "drive": list(drives)}
    )
    try:
        (found,) = throws_of_dataset(dataset, name=name, quantity=quantity)
    except (TurnoutError, ValueError):
        return _faulty(name, "holds several closings; one row is one throw")
    # where forces alone show movements, those that a discrepancy at rest shows are none of them
    return found
