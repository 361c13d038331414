"""Movements with a dead rod: its channel is left out, the movement is kept."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import TurnoutError
from turnout.measurement.campaign.motion_signals import force_changes
from turnout.measurement.campaign.recorded_throw import RecordedThrow
from turnout.measurement.quality.judge import ThrowQuality

# A load cell that nothing loads changes by less than this [N], a rod in any movement by more.
IDLE_CELL, LEAST_MOVEMENTS = 200.0, 2


def exchanged_cell(members: Sequence[tuple[float, RecordedThrow]]) -> str | None:
    """Return a drive whose rod has changed columns with the load cell; None where none has.

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
    if not all(float(np.ptp(_known(item["object_force"].values))) > IDLE_CELL for item in free):
        return None
    silent = [
        {str(d) for d in item["drive"].values if item["drive_force"].sel(drive=d).isnull().all()}
        for item in free
    ]
    found = sorted(set.intersection(*silent))
    return found[0] if len(found) == 1 else None


def _known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    known = values[np.isfinite(values)]
    return known if known.size else np.zeros(1)


def change_of_rods(piece: RecordedThrow) -> NDArray[np.float64]:
    """Return how much each rod force changes in a movement, 0 of one that was not recorded [N]."""
    forces = piece.dataset["drive_force"].values
    known = np.where(np.isnan(forces).all(axis=1, keepdims=True), 0.0, forces)
    return force_changes(known, rate=piece.rate)


def without_dead_rods(
    piece: RecordedThrow | TurnoutError, found: ThrowQuality | TurnoutError
) -> tuple[RecordedThrow | TurnoutError, ThrowQuality | TurnoutError]:
    """Return a movement without its dead rods, where nothing else is wrong and one rod lives."""
    if not isinstance(piece, RecordedThrow) or not isinstance(found, ThrowQuality):
        return piece, found
    names = [str(name) for name in piece.dataset["drive"].values]
    dead = {
        fault.channel
        for fault in found.faults
        if fault.kind == "dead channel" and fault.channel.startswith("drive_force")
    }
    of_them = all(not fault.excludes or fault.channel in dead for fault in found.faults)
    if not dead or not of_them or len(dead) == len(names):
        return piece, found
    alive = xr.DataArray([f"drive_force {name}" not in dead for name in names], dims="drive")
    forces = piece.dataset["drive_force"].where(alive).transpose("drive", "time")
    faults = tuple(
        replace(
            fault,
            excludes=False,
            text=f"{fault.text}; the channel is left out, the movement is kept",
        )
        if fault.excludes
        else fault
        for fault in found.faults
    )
    kept = replace(piece, dataset=piece.dataset.assign(drive_force=forces))
    return kept, ThrowQuality(faults=faults)
