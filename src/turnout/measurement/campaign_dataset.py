"""Movements stacked into one dataset, each with time zero at its onset."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from turnout.measurement.condition import moving_average
from turnout.measurement.piece import Piece
from turnout.measurement.quality_channel import MEASURED
from turnout.measurement.sheet import Run
from turnout.schema.channels import label


def stacked(members: Sequence[tuple[Run, Piece]], slipped: Sequence[bool | None]) -> xr.Dataset:
    """Stack movements of one sampling rate.

    Parameters
    ----------
    members : sequence of (Run, Piece)
        Usable movements.
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
    starts = [_onset_sample(piece) for _, piece in members]
    before = max(starts)
    after = max(
        piece.dataset.sizes["time"] - start
        for (_, piece), start in zip(members, starts, strict=True)
    )
    time = (np.arange(before + after) - before) / rate
    drives = list(
        dict.fromkeys(str(name) for _, piece in members for name in piece.dataset["drive"].values)
    )
    variables: dict[str, Any] = {}
    for name in MEASURED:
        if not any(name in piece.dataset for _, piece in members):
            continue
        rows = 1 if name == "object_force" else len(drives)
        raw = np.full((len(members), rows, time.size), np.nan)
        smooth = np.full_like(raw, np.nan)
        for number, ((run, piece), start) in enumerate(zip(members, starts, strict=True)):
            if name not in piece.dataset or (name == "object_force" and not run.load_cell):
                continue
            values = _of_drives(piece.dataset[name], drives)
            place = slice(before - start, before - start + values.shape[-1])
            raw[number, :, place] = values
            for row, line in enumerate(values):
                smooth[number, row, place] = moving_average(line, rate=rate)
        dims = ("movement", "time") if name == "object_force" else ("movement", "drive", "time")
        flat = name == "object_force"
        variables[name] = (dims, smooth[:, 0] if flat else smooth)
        variables[f"{name}_unfiltered"] = (dims, raw[:, 0] if flat else raw)
    coordinates = {"time": time, "drive": np.array(drives), **_coordinates(members, slipped)}
    return label(xr.Dataset(variables, coordinates))


def _coordinates(
    members: Sequence[tuple[Run, Piece]], slipped: Sequence[bool | None]
) -> dict[str, Any]:
    """Return what the sheet and the recordings say of each movement."""
    runs, pieces = zip(*members, strict=True)
    known = [
        bool(run.slip) if measured is None else measured
        for run, measured in zip(runs, slipped, strict=True)
    ]
    columns: dict[str, Any] = {
        "direction": [run.direction for run in runs],
        "size": [float(run.size) for run in runs],
        "place": [run.place for run in runs],
        "repeat": np.array([run.repeat for run in runs], dtype=np.int64),
        "slipped": known,
        "remark": [run.remark for run in runs],
        "file": [run.file for run in runs],
        "start_time": [piece.start_time for piece in pieces],
        "onset": [piece.throw.onset for piece in pieces],
    }
    named: dict[str, Any] = {
        key: ("movement", np.asarray(values)) for key, values in columns.items()
    }
    return {"movement": np.array([run.name for run in runs]), **named}


def _onset_sample(piece: Piece) -> int:
    """Return the number of the sample at the onset of a movement."""
    return round((piece.throw.onset - float(piece.dataset["time"][0])) * piece.rate)


def _of_drives(channel: xr.DataArray, drives: Sequence[str]) -> np.ndarray:
    """Return a row a drive, NaN for a drive that the channel lacks; one row without drives."""
    if "drive" not in channel.dims:
        return np.atleast_2d(channel.values)
    return np.asarray(channel.reindex(drive=list(drives)).transpose("drive", "time").values)
