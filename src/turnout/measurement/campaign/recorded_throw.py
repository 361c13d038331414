"""One movement of a campaign, cut out of its recording and kept so that it is read once only."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import FileError, MeasurementError, TurnoutError
from turnout.core.files import require_regular_file
from turnout.core.kept_results import read_arrays, write_arrays
from turnout.core.provenance import content_hash, version
from turnout.measurement.campaign.campaign_folder import STORE
from turnout.measurement.campaign.find_throws import Detection, FoundThrow, find_throws
from turnout.measurement.campaign.run_sheet import SheetRow
from turnout.measurement.chain.apply import apply_chain, map_hash
from turnout.measurement.chain.channel_map import ChannelMap
from turnout.measurement.formats.file_format import read_recording, read_throws
from turnout.measurement.quality.channel_faults import MEASURED
from turnout.measurement.recording import Recording

# Raised when what a piece holds, or how it is cut, changes.
STORED_VERSION = 6


@dataclass(frozen=True, slots=True, eq=False)
class RecordedThrow:
    """The part of a recording that holds one movement.

    Attributes
    ----------
    dataset : xarray.Dataset
        Unfiltered channels in SI on the time of the recording.
    throw : FoundThrow
        Place of the movement in `dataset`.
    start_time : str
        Date and time of the recording; empty where it holds none.
    notes : tuple of str
        Repairs made while reading.
    force_rates : mapping of str to float
        Samples a second of those forces whose column has fewer than others, by key of the channel
        map [1/s].
    """

    dataset: xr.Dataset
    throw: FoundThrow
    start_time: str
    notes: tuple[str, ...]
    force_rates: Mapping[str, float] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """Samples a second [1/s]."""
        time = self.dataset["time"].values
        return float((time.size - 1) / (time[-1] - time[0]))


def recorded_throws(
    folder: Path,
    runs: Sequence[SheetRow],
    channel_map: ChannelMap,
    *,
    allow_outside: bool = False,
) -> Iterator[tuple[RecordedThrow | TurnoutError, bool]]:
    """Yield the movements of one recording, from the store of the campaign or cut and stored.

    The file is read once, and only when one of its movements is not in the store. A bad recording
    comes back as the error that says what is wrong with it, so that the others of the campaign are
    built all the same.

    Parameters
    ----------
    folder : Path
        Folder of the campaign.
    runs : sequence of SheetRow
        Lines of the sheet, all of the same file.
    channel_map : ChannelMap
        From columns to forces and currents.
    allow_outside : bool
        Whether a recording may take samples from other files.

    Yields
    ------
    piece : RecordedThrow or TurnoutError
        For each run, in their order.
    reused : bool
        Whether it had been cut before, from the same file and map.
    """
    path = folder / runs[0].file
    try:
        require_regular_file(path)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, FileError) as error:
        why = getattr(error, "strerror", None) or error
        unread = error if isinstance(error, FileError) else FileError(f"{path}: {why}")
        yield from ((unread, False) for _ in runs)
        return
    shared = {
        "file": digest,
        "map": map_hash(channel_map),
        "detection": asdict(Detection()),
        "version": f"{version()} {STORED_VERSION}",
    }
    found: dict[str, _Found | TurnoutError] = {}
    held: dict[str, Recording | FileError] = {}
    for run in runs:
        place = {"movement": run.movement, **({"throw": run.throw} if run.throw else {})}
        key = content_hash({**shared, **place})
        stored = folder / STORE / f"{key[:32]}.npz"
        piece = read_arrays(stored, key, piece_of_arrays)
        if piece is not None:
            yield piece, True
            continue
        if run.throw and not held:
            throws = list(dict.fromkeys(item.throw for item in runs if item.throw))
            read = read_throws(path, throws, allow_outside=allow_outside)
            held = dict(zip(throws, read, strict=True))
        try:
            if run.throw not in found:
                one = held.get(run.throw) or read_recording(path, allow_outside=allow_outside)
                found[run.throw] = _found(path, one, channel_map)
            cut = _cut(found[run.throw], run.movement, path)
        except TurnoutError as error:
            found.setdefault(run.throw, error)
            yield error, False
            continue
        # A folder that may not be written to is read each time.
        with suppress(FileError, OSError):
            stored.parent.mkdir(exist_ok=True)
            write_arrays(stored, key, *piece_arrays(cut))
        yield cut, False


_Found = tuple[xr.Dataset, tuple[FoundThrow, ...]]
"""A recording in SI and every throw in it."""


def _found(
    path: Path,
    one: Recording | FileError,
    channel_map: ChannelMap,
) -> _Found:
    """Find the movements of a recording."""
    if isinstance(one, FileError):
        raise one
    dataset = apply_chain(one, channel_map)
    if not {"drive_force", "drive_current", "drive_power"} & set(dataset):
        message = "the channel map has no drive_force, drive_current or drive_power"
        raise MeasurementError([message], source=str(path))
    return dataset, find_throws(dataset)


def _cut(found: _Found | TurnoutError, movement: int, path: Path) -> RecordedThrow:
    """Return a movement by its number in the recording, from 1."""
    if isinstance(found, TurnoutError):
        raise found
    dataset, throws = found
    if len(throws) < movement:
        held = {0: "nothing moves in it", 1: "it holds one throw"}
        there = held.get(len(throws), f"it holds {len(throws)} throws")
        message = f"movement {movement} is not in the recording: {there}"
        raise MeasurementError([message], source=str(path))
    throw = throws[movement - 1]
    names = [name for name in MEASURED if name in dataset]
    kept = dataset[names].isel(time=slice(throw.first, throw.stop)).reset_coords(drop=True)
    return RecordedThrow(
        dataset=kept.drop_attrs(),
        throw=replace(throw, first=0, stop=throw.stop - throw.first),
        start_time=str(dataset.attrs.get("start_time", "")),
        notes=tuple(filter(None, str(dataset.attrs.get("problems", "")).splitlines())),
        force_rates=json.loads(str(dataset.attrs.get("force_rates", "{}"))),
    )


def piece_arrays(piece: RecordedThrow) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return a piece as arrays and plain data, from which `piece_of_arrays` makes it again."""
    described = {
        "throw": asdict(piece.throw),
        "start_time": piece.start_time,
        "notes": piece.notes,
        "force_rates": dict(piece.force_rates),
        "dims": {name: list(piece.dataset[name].dims) for name in piece.dataset.data_vars},
    }
    arrays = {str(name): piece.dataset[name].values for name in piece.dataset}
    arrays["time"] = piece.dataset["time"].values
    arrays["drive"] = piece.dataset["drive"].values.astype(np.str_)
    return arrays, described


def piece_of_arrays(
    arrays: Mapping[str, NDArray[Any]], described: Mapping[str, Any]
) -> RecordedThrow:
    """Return a piece from its `piece_arrays`."""
    dataset = xr.Dataset(
        {name: (dims, arrays[name]) for name, dims in described["dims"].items()},
        {"time": arrays["time"], "drive": arrays["drive"]},
    )
    throw = {**described["throw"], "drive_ends": tuple(described["throw"]["drive_ends"])}
    rest = {key: described[key] for key in ("start_time", "force_rates")}
    notes = tuple(described["notes"])
    return RecordedThrow(dataset=dataset, throw=FoundThrow(**throw), notes=notes, **rest)
