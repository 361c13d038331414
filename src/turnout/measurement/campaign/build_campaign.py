"""Build one dataset from a folder of recordings and its run sheet.

Movements are stacked, each with time zero at its onset.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.channels import SCHEMA_VERSION, label
from turnout.core.errors import ListedError, MeasurementError, TurnoutError
from turnout.core.moving_average import moving_average
from turnout.core.provenance import provenance
from turnout.measurement.campaign.campaign_folder import STORE, refuse_links_outside, refuse_outside
from turnout.measurement.campaign.motion_signals import force_changes
from turnout.measurement.campaign.recorded_throw import RecordedThrow, recorded_throws
from turnout.measurement.campaign.run_sheet import RunSheet, SheetRow, find_sheet, read_sheet
from turnout.measurement.campaign.sheet_checks import (
    UNCHECKED,
    check_files,
    check_rods,
    exchange_remarks,
    extra_files,
    force_remarks,
    order_remarks,
    series_remarks,
    slip_remarks,
)
from turnout.measurement.chain.apply import (
    UNLIKE_PHASES,
    load_channel_map,
    map_hash,
    stated_uncertainties,
)
from turnout.measurement.chain.channel_map import ChannelMap, drives_together
from turnout.measurement.chain.recorder import stated_recorder
from turnout.measurement.quality.channel_faults import MEASURED
from turnout.measurement.quality.throw_faults import (
    Expected,
    ForceProfile,
    ThrowQuality,
    early_profile,
    judge_recording,
    open_level,
    typical_profile,
)


def stack_movements(
    members: Sequence[tuple[SheetRow, RecordedThrow]], slipped: Sequence[bool | None]
) -> xr.Dataset:
    """Stack movements of one sampling rate.

    Parameters
    ----------
    members : sequence of (SheetRow, RecordedThrow)
        Usable movements, all of the same sampling rate.
    slipped : sequence of bool or None
        Whether a drive slipped, as measured; the sheet's word counts where that is None.

    Returns
    -------
    xarray.Dataset
        Channels (movement, [drive,] time), filtered over 0.1 s, and unfiltered under the same name
        with "_unfiltered". Time is zero at the onset; NaN where a movement was not recorded, and in
        `object_force` where no load cell was mounted.
    """
    rate = round(members[0][1].rate, 3)
    pieces = [piece for _, piece in members]
    starts = [
        round((piece.throw.onset - float(piece.dataset["time"][0])) * piece.rate)
        for piece in pieces
    ]
    before = max(starts)
    after = max(p.dataset.sizes["time"] - start for p, start in zip(pieces, starts, strict=True))
    time = (np.arange(before + after) - before) / rate
    drives = list(dict.fromkeys(str(d) for piece in pieces for d in piece.dataset["drive"].values))
    variables: dict[str, Any] = {}
    for name in (name for name in MEASURED if any(name in piece.dataset for piece in pieces)):
        flat = name == "object_force"
        raw = np.full((len(members), 1 if flat else len(drives), time.size), np.nan)
        smooth = np.full_like(raw, np.nan)
        for number, ((run, piece), start) in enumerate(zip(members, starts, strict=True)):
            if name not in piece.dataset or (flat and not run.load_cell):
                continue
            channel = piece.dataset[name]
            if not flat:
                channel = channel.reindex(drive=drives).transpose("drive", "time")
            values = np.atleast_2d(channel.values)
            place = slice(before - start, before - start + values.shape[-1])
            raw[number, :, place] = values
            for row, line in enumerate(values):
                smooth[number, row, place] = moving_average(line, rate=rate)
        dims = ("movement", "time") if flat else ("movement", "drive", "time")
        variables[name] = (dims, smooth[:, 0] if flat else smooth)
        variables[f"{name}_unfiltered"] = (dims, raw[:, 0] if flat else raw)
    coordinates = {"time": time, "drive": np.array(drives), **_coordinates(members, slipped)}
    return label(xr.Dataset(variables, coordinates))


def _coordinates(
    members: Sequence[tuple[SheetRow, RecordedThrow]], slipped: Sequence[bool | None]
) -> dict[str, Any]:
    """Return the coordinates of each movement from the sheet and the recordings."""
    runs, pieces = zip(*members, strict=True)
    columns: dict[str, Any] = {
        "direction": [run.direction for run in runs],
        "size": [float(run.size) for run in runs],
        "place": [run.place for run in runs],
        "repeat": np.array([run.repeat for run in runs], dtype=np.int64),
        "slipped": [
            bool(run.slip) if measured is None else measured
            for run, measured in zip(runs, slipped, strict=True)
        ],
        "remark": [run.remark for run in runs],
        "file": [run.file for run in runs],
        "start_time": [piece.start_time for piece in pieces],
        "onset": [piece.throw.onset for piece in pieces],
    }
    named = {key: ("movement", np.asarray(values)) for key, values in columns.items()}
    return {"movement": np.array([run.name for run in runs]), **named}


CHANNEL_FILE = "channels.toml"
# A motor that runs longer than the campaign's others by this was switched off by its time-out [s].
OVERRUN = 1.0
# Share of motors that ran as long as one without slip, or less.
SHORTEST_MOVEMENT = 0.03


@dataclass(frozen=True, slots=True)
class Excluded:
    """A movement that is not in the dataset, and every reason."""

    run: SheetRow
    reasons: tuple[str, ...]


Usable = tuple[SheetRow, RecordedThrow, ThrowQuality]
"""A movement of the dataset."""


@dataclass(frozen=True, slots=True, eq=False)
class BuiltCampaign:
    """Result of building a campaign.

    Attributes
    ----------
    dataset : xarray.Dataset or None
        Dimensions movement and time; None where no movement is usable.
    sheet : RunSheet
        As it was read.
    excluded : tuple of Excluded
        Movements that are not in the dataset, with reasons.
    remarks : tuple of str
        Remarks on movements that are kept but should be checked.
    reused : int
        Movements that had been cut before.
    """

    dataset: xr.Dataset | None
    sheet: RunSheet
    excluded: tuple[Excluded, ...]
    remarks: tuple[str, ...]
    reused: int

    @property
    def recorder(self) -> str:
        """Response of the recorder to forces, in words; empty if none is stated."""
        return stated_recorder(self.dataset.attrs).text if self.dataset is not None else ""


def build_campaign_dataset(
    folder: Path | str,
    *,
    channels: Path | str | None = None,
    strict: bool = False,
    allow_outside: bool = False,
    report: Callable[[int, int], None] | None = None,
) -> BuiltCampaign:
    """Read a campaign: cut, judge and filter each movement, and stack the usable ones.

    Each movement is stored in the folder as soon as it is cut. A later build takes up what it
    finds, whatever went wrong in between.

    Parameters
    ----------
    folder : path-like
        With a run sheet and the recordings.
    channels : path-like, optional
        Channel map; default `channels.toml` in the folder.
    strict : bool
        Whether a movement that must be excluded is an error.
    allow_outside : bool
        Whether files of the campaign may lie outside its folder.
    report : callable, optional
        Called with movements done and movements in all.

    Returns
    -------
    BuiltCampaign

    Raises
    ------
    FileError
        When folder, sheet or channel map cannot be read.
    MeasurementError
        When the sheet is wrong, names files that are missing or outside the folder, or, if
        `strict`, a movement is excluded.
    """
    folder = Path(folder)
    sheet_file = find_sheet(folder)
    if not allow_outside:
        for path in (sheet_file, *([folder / CHANNEL_FILE] if channels is None else [])):
            refuse_outside(path, folder)
    refuse_links_outside(folder / STORE, folder)
    sheet = read_sheet(sheet_file, allow_outside=allow_outside)
    check_files(sheet, folder, allow_outside=allow_outside)
    channel_map = load_channel_map(channels if channels is not None else folder / CHANNEL_FILE)
    report = report or (lambda done, total: None)
    pieces, reused = _pieces(
        folder, sheet.runs, channel_map, allow_outside=allow_outside, report=report
    )
    usable, excluded = _judged(sheet.runs, pieces, channel_map)
    if strict and excluded:
        problems = [
            f"{item.run.where}: {item.run.name}: {'; '.join(item.reasons)}" for item in excluded
        ]
        raise MeasurementError(problems, source=str(folder))
    slipped = slipped_movements([piece for _, piece, _ in usable])
    dataset = _dataset(usable, slipped, sheet, channel_map, excluded) if usable else None
    remarks = [
        *(exchange_remarks(dataset.attrs) if dataset is not None else []),
        *extra_files(sheet, folder),
        *_remarks(usable, slipped),
        *([UNCHECKED] if dataset is not None and _may_be_exchanged(dataset) else []),
    ]
    unlike = [text for text in remarks if f": {UNLIKE_PHASES}" in text]
    if dataset is not None and unlike:
        dataset.attrs["unbalanced"] = "\n".join(unlike)
    return BuiltCampaign(dataset, sheet, tuple(excluded), tuple(remarks), reused)


def _pieces(
    folder: Path,
    runs: Sequence[SheetRow],
    channel_map: ChannelMap,
    *,
    allow_outside: bool,
    report: Callable[[int, int], None],
) -> tuple[list[RecordedThrow | TurnoutError], int]:
    """Return the movement of each run, and the number cut before; a file is read once."""
    members: dict[str, list[int]] = {}
    for number, run in enumerate(runs):
        members.setdefault(run.file, []).append(number)
    pieces: dict[int, RecordedThrow | TurnoutError] = {}
    reused = 0
    report(0, len(runs))
    for numbers in members.values():
        own = [runs[number] for number in numbers]
        found = recorded_throws(folder, own, channel_map, allow_outside=allow_outside)
        for number, (piece, known) in zip(numbers, found, strict=True):
            pieces[number] = piece
            reused += known
            report(len(pieces), len(runs))
    return [pieces[number] for number in range(len(runs))], reused


def _judged(
    runs: Sequence[SheetRow],
    pieces: Sequence[RecordedThrow | TurnoutError],
    channel_map: ChannelMap,
) -> tuple[list[Usable], list[Excluded]]:
    """Judge each movement against the rest of the campaign."""
    good = [
        (run.direction, piece)
        for run, piece in zip(runs, pieces, strict=True)
        if isinstance(piece, RecordedThrow)
    ]
    rates = [round(piece.rate, 3) for _, piece in good]
    usual = max(set(rates), key=rates.count) if rates else None
    profiles: dict[str, list[ForceProfile]] = {}
    levels: dict[tuple[str, int], list[NDArray[np.float64]]] = {}
    for direction, piece in good:
        profile = early_profile(piece.dataset, piece.throw)
        if profile is not None and profile.forces.shape[0] == piece.dataset.sizes["drive"]:
            profiles.setdefault(direction, []).append(profile)
        level = open_level(piece.dataset, piece.throw, direction=direction)
        if level is not None:
            levels.setdefault((direction, level.size), []).append(level)
    typical = {direction: typical_profile(found) for direction, found in profiles.items()}
    # Two that differ do not show which of them is off.
    usual_levels = {
        key: np.median(found, axis=0) for key, found in levels.items() if len(found) >= 3
    }
    usable: list[Usable] = []
    excluded: list[Excluded] = []
    for run, cut in zip(runs, pieces, strict=True):
        if isinstance(cut, TurnoutError):
            problems = cut.problems if isinstance(cut, ListedError) else (str(cut),)
            excluded.append(Excluded(run, problems))
            continue
        expected = Expected(
            direction=run.direction,
            load_cell=run.load_cell and channel_map.object_force is not None,
            rate=usual,
            profile=typical.get(run.direction),
            open_level=usual_levels.get((run.direction, cut.dataset.sizes["drive"])),
        )
        found = judge_recording(cut.dataset, cut.throw, expected=expected)
        kept, quality = without_dead_rods(cut, found)
        if quality.usable:
            usable.append((run, kept, quality))
        else:
            excluded.append(Excluded(run, quality.reasons))
    return usable, excluded


def slipped_movements(pieces: Sequence[RecordedThrow]) -> list[bool | None]:
    """Flag throws, by currents, with a motor that ran until it was switched off; None without."""
    runs = [np.array(piece.throw.drive_ends) - piece.throw.onset for piece in pieces]
    known = [times[np.isfinite(times)] for times in runs]
    if not any(times.size for times in known):
        return [None] * len(pieces)
    # Among the shortest, as nearly all drives may slip, but not the very shortest, of a motor that
    # was stopped by hand.
    ordered = np.sort(np.concatenate(known))
    usual = float(ordered[max(min(1, ordered.size - 1), int(SHORTEST_MOVEMENT * ordered.size))])
    return [bool((times > usual + OVERRUN).any()) if times.size else None for times in known]


def _remarks(usable: Sequence[Usable], slipped: Sequence[bool | None]) -> list[str]:
    runs = [run for run, _, _ in usable]
    forces = [change_of_rods(piece) for _, piece, _ in usable]
    said: dict[str, tuple[str, list[SheetRow]]] = {}
    for run, piece, verdict in usable:
        for text in (*piece.notes, *verdict.remarks):
            # The same fault in all movements, whatever is left of a silent channel or its size is.
            key = text.split(":")[0] if text.startswith(("dead channel", UNLIKE_PHASES)) else text
            said.setdefault(key, (text, []))[1].append(run)
    return [
        *order_remarks(runs, [piece.start_time for _, piece, _ in usable]),
        *slip_remarks(runs, slipped),
        *series_remarks(runs, slipped, forces),
        *force_remarks(runs, [float(force.sum()) for force in forces]),
        # What the recorder does it does in every file: said once.
        *(f"{_first_of(among)}: {text}" for text, among in said.values()),
    ]


def _first_of(runs: Sequence[SheetRow]) -> str:
    """Name the first of some movements and the number of further ones."""
    more = f" and {len(runs) - 1} more" if len(runs) > 1 else ""
    return f"{runs[0].where}: {runs[0].name}{more}"


def _dataset(
    usable: Sequence[Usable],
    slipped: Sequence[bool | None],
    sheet: RunSheet,
    channel_map: ChannelMap,
    excluded: Sequence[Excluded],
) -> xr.Dataset:
    dataset = stack_movements([(run, piece) for run, piece, _ in usable], slipped)
    out: list[dict[str, Any]] = [
        {"movement": item.run.name, "file": item.run.file, "reasons": list(item.reasons)}
        for item in excluded
    ]
    attributes: dict[str, Any] = {
        "title": sheet.title,
        "kind": "measurement" if not sheet.synthetic else "synthetic measurement",
        "synthetic": sheet.synthetic,
        **provenance(),
        "schema_version": SCHEMA_VERSION,
        "channel_map_hash": map_hash(channel_map),
        "filter": "moving average over 0.1 s",
        "excluded": json.dumps(out),
    }
    rods = check_rods(dataset)
    names = [str(name) for name in dataset["drive"].values]
    structured: dict[str, Any] = {
        "together": {name: drives_together(name) for name in names if drives_together(name)},
        "gain_uncertainty": stated_uncertainties(channel_map),
        "force_rates": {r.name: dict(p.force_rates) for r, p, _ in usable if p.force_rates},
        "swapped": rods.pair,
    }
    plain = {
        "sheet_panel": sheet.panel,
        "rods_checked": "yes" * rods.checked,
        "swapped_cell": exchanged_cell([(run.size, piece) for run, piece, _ in usable]),
    }
    attributes |= {key: json.dumps(value) for key, value in structured.items() if value}
    attributes |= {key: value for key, value in plain.items() if value}
    if channel_map.clock_uncertainty is not None:
        attributes["clock_uncertainty"] = float(channel_map.clock_uncertainty)
    attributes |= channel_map.recorder().attributes()
    return dataset.assign_attrs(attributes)


def _may_be_exchanged(dataset: xr.Dataset) -> bool:
    """Return True if objects were thrown and two rods measured, but rods could not be checked."""
    return (
        "drive_force" in dataset
        and dataset.sizes["drive"] > 1
        and "rods_checked" not in dataset.attrs
        and bool((dataset["size"].values > 0).any())
    )


# A load cell that nothing loads changes by less than this [N], a rod in any movement by more.
IDLE_CELL, LEAST_MOVEMENTS = 200.0, 2


def exchanged_cell(members: Sequence[tuple[float, RecordedThrow]]) -> str | None:
    """Return a drive whose rod has changed columns with the load cell, or None if none has.

    Without an object nothing loads the cell and every rod changes. Where it is the other way round
    in each movement without an object, and in two at least, columns are exchanged.

    Parameters
    ----------
    members : sequence of (float, RecordedThrow)
        Size of the object [m], and the movement, without its dead rods.
    """
    free = [piece.dataset for size, piece in members if size == 0.0]
    free = [item for item in free if "object_force" in item and "drive_force" in item]
    if len(free) < LEAST_MOVEMENTS:
        return None
    for item in free:
        cell = item["object_force"].values
        known = cell[np.isfinite(cell)]
        if not known.size or not float(np.ptp(known)) > IDLE_CELL:
            return None
    silent = [
        {str(d) for d in item["drive"].values if item["drive_force"].sel(drive=d).isnull().all()}
        for item in free
    ]
    found = sorted(set.intersection(*silent))
    return found[0] if len(found) == 1 else None


def change_of_rods(piece: RecordedThrow) -> NDArray[np.float64]:
    """Return the change of each rod force in a movement, 0 of one that was not recorded [N]."""
    if "drive_force" not in piece.dataset:
        return np.zeros(piece.dataset.sizes["drive"])
    forces = piece.dataset["drive_force"].values
    known = np.where(np.isnan(forces).all(axis=1, keepdims=True), 0.0, forces)
    return force_changes(known, rate=piece.rate)


def without_dead_rods(
    piece: RecordedThrow, found: ThrowQuality
) -> tuple[RecordedThrow, ThrowQuality]:
    """Return a movement without its dead rods, if nothing else is wrong and one rod lives."""
    dead = {
        fault.channel
        for fault in found.faults
        if fault.kind == "dead channel" and fault.channel.startswith("drive_force")
    }
    rods = [f"drive_force {name}" for name in piece.dataset["drive"].values]
    of_them = all(not fault.excludes or fault.channel in dead for fault in found.faults)
    if not dead or not of_them or len(dead) == len(rods):
        return piece, found
    alive = xr.DataArray([rod not in dead for rod in rods], dims="drive")
    forces = piece.dataset["drive_force"].where(alive).transpose("drive", "time")
    kept = "; the channel is left out, the movement is kept"
    faults = tuple(
        replace(fault, excludes=False, text=fault.text + kept) if fault.excludes else fault
        for fault in found.faults
    )
    dataset = piece.dataset.assign(drive_force=forces)
    return replace(piece, dataset=dataset), ThrowQuality(faults=faults)
