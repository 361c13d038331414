"""From a folder of recordings and its run sheet to one dataset of movements."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from turnout.errors import MeasurementError, TurnoutError
from turnout.files.provenance import provenance
from turnout.measurement.campaign_check import (
    check_files,
    extra_files,
    force_remarks,
    order_remarks,
    series_remarks,
    slip_remarks,
)
from turnout.measurement.campaign_dataset import stacked
from turnout.measurement.chain import load_channel_map, map_hash
from turnout.measurement.channel_map import ChannelMap
from turnout.measurement.motion import force_changes
from turnout.measurement.movement import Detection
from turnout.measurement.piece import Piece, kept_piece
from turnout.measurement.quality import Expected, Verdict, judge
from turnout.measurement.quality_record import Limits
from turnout.measurement.quality_throw import Profile, early_profile, typical_profile
from turnout.measurement.sheet import Run, RunSheet, find_sheet, read_sheet
from turnout.schema.channels import SCHEMA_VERSION

CHANNEL_FILE = "channels.toml"
# A motor that runs longer than the campaign's others by this was switched off by its time-out [s].
OVERRUN = 1.0


@dataclass(frozen=True, slots=True)
class Excluded:
    """A movement that is not in the dataset, and every reason."""

    run: Run
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """What came of a campaign.

    Attributes
    ----------
    dataset : xarray.Dataset or None
        Dimensions movement and time; None where no movement is usable.
    sheet : RunSheet
        As it was read.
    excluded : tuple of Excluded
        What is not in the dataset.
    remarks : tuple of str
        What does not exclude a movement but should be looked at.
    reused : int
        Movements that had been cut before.
    """

    dataset: xr.Dataset | None
    sheet: RunSheet
    excluded: tuple[Excluded, ...]
    remarks: tuple[str, ...]
    reused: int


def build_campaign(
    folder: Path | str,
    *,
    channels: Path | str | None = None,
    strict: bool = False,
    detection: Detection | None = None,
    limits: Limits | None = None,
    report: Callable[[int, int], None] | None = None,
) -> Campaign:
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
    detection : Detection, optional
        What counts as a throw.
    limits : Limits, optional
        From what size on something is a fault.
    report : callable, optional
        Called with movements done and movements in all.

    Returns
    -------
    Campaign

    Raises
    ------
    FileError
        When folder, sheet or channel map cannot be read.
    MeasurementError
        When the sheet is wrong, names missing files, or, if `strict`, a movement is excluded.
    """
    folder = Path(folder)
    sheet = read_sheet(find_sheet(folder))
    check_files(sheet, folder)
    channel_map = load_channel_map(channels if channels is not None else folder / CHANNEL_FILE)
    pieces: list[Piece | TurnoutError] = []
    reused = 0
    for number, run in enumerate(sheet.runs):
        if report is not None:
            report(number, len(sheet.runs))
        piece, known = kept_piece(folder, run, channel_map, detection=detection)
        pieces.append(piece)
        reused += known
    verdicts = _verdicts(sheet.runs, pieces, channel_map, limits=limits)
    excluded = tuple(
        Excluded(run, (str(found),) if isinstance(found, TurnoutError) else found.reasons)
        for run, found in zip(sheet.runs, verdicts, strict=True)
        if isinstance(found, TurnoutError) or not found.usable
    )
    if strict and excluded:
        problems = [
            f"{item.run.where}: {item.run.name}: {'; '.join(item.reasons)}" for item in excluded
        ]
        raise MeasurementError(problems, source=str(folder))
    usable = [
        (run, piece, found)
        for run, piece, found in zip(sheet.runs, pieces, verdicts, strict=True)
        if isinstance(piece, Piece) and isinstance(found, Verdict) and found.usable
    ]
    slipped = _slipped([piece for _, piece, _ in usable])
    remarks = [*extra_files(sheet, folder), *_remarks(usable, slipped)]
    dataset = _dataset(usable, slipped, sheet, channel_map, excluded) if usable else None
    return Campaign(dataset, sheet, excluded, tuple(remarks), reused)


def _verdicts(
    runs: Sequence[Run],
    pieces: Sequence[Piece | TurnoutError],
    channel_map: ChannelMap,
    *,
    limits: Limits | None,
) -> list[Verdict | TurnoutError]:
    """Judge each movement against the rest of the campaign."""
    good = [
        (run, piece) for run, piece in zip(runs, pieces, strict=True) if isinstance(piece, Piece)
    ]
    rates = [round(piece.rate, 3) for _, piece in good]
    usual = max(set(rates), key=rates.count) if rates else None
    profiles: dict[str, list[Profile]] = {}
    for run, piece in good:
        profile = early_profile(piece.dataset, piece.throw)
        if profile is not None and profile.forces.shape[0] == piece.dataset.sizes["drive"]:
            profiles.setdefault(run.direction, []).append(profile)
    typical = {direction: typical_profile(found) for direction, found in profiles.items()}
    verdicts: list[Verdict | TurnoutError] = []
    for run, found in zip(runs, pieces, strict=True):
        if not isinstance(found, Piece):
            verdicts.append(found)
            continue
        expected = Expected(
            direction=run.direction,
            load_cell=run.load_cell and channel_map.object_force is not None,
            rate=usual,
            profile=typical.get(run.direction),
        )
        verdicts.append(judge(found.dataset, found.throw, expected=expected, limits=limits))
    return verdicts


def _slipped(pieces: Sequence[Piece]) -> list[bool | None]:
    """Tell from the currents whether a motor ran until it was switched off; None without them."""
    runs = [np.array(piece.throw.drive_ends) - piece.throw.onset for piece in pieces]
    known = [times[np.isfinite(times)] for times in runs]
    if not any(times.size for times in known):
        return [None] * len(pieces)
    usual = float(np.median(np.concatenate(known)))
    return [bool((times > usual + OVERRUN).any()) if times.size else None for times in known]


def _remarks(
    usable: Sequence[tuple[Run, Piece, Verdict]], slipped: Sequence[bool | None]
) -> list[str]:
    runs = [run for run, _, _ in usable]
    forces = [
        float(force_changes(piece.dataset["drive_force"].values, rate=piece.rate).sum())
        for _, piece, _ in usable
    ]
    return [
        *(
            f"{run.where}: {run.name}: {text}"
            for run, piece, verdict in usable
            for text in (*piece.notes, *verdict.remarks)
        ),
        *order_remarks(runs, [piece.start_time for _, piece, _ in usable]),
        *slip_remarks(runs, slipped),
        *series_remarks(runs, slipped),
        *force_remarks(runs, forces),
    ]


def _dataset(
    usable: Sequence[tuple[Run, Piece, Verdict]],
    slipped: Sequence[bool | None],
    sheet: RunSheet,
    channel_map: ChannelMap,
    excluded: Sequence[Excluded],
) -> xr.Dataset:
    dataset = stacked([(run, piece) for run, piece, _ in usable], slipped)
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
    return dataset.assign_attrs(attributes)
