"""Movements with a dead rod: its channel is left out, the movement is kept."""

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.errors import TurnoutError
from turnout.measurement.campaign.motion_signals import force_changes
from turnout.measurement.campaign.recorded_throw import RecordedThrow
from turnout.measurement.quality.judge import ThrowQuality


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
