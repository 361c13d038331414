"""The test-piece check: whether a piece as thick as the gap limit keeps the panel from locking.

On the track a gauge piece is held between switch rail and stock rail at a drive, and the switch is
thrown: the drive must not confirm locking. Here the piece is a foreign object at the drive.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from turnout.metric.slip import settled
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.response.save import Save
from turnout.response.simulate import simulate

CHANNELS = ("drive_force", "object_force", "locked", "drive_gap", "object_placed")


@dataclass(frozen=True, slots=True)
class PieceResult:
    """How a throw on a test piece ended.

    Attributes
    ----------
    drive : str
        Where the piece is.
    size : float
        Its thickness [m].
    seen : bool
        Whether the panel does not lock, by its own rule.
    drive_force, piece_force : float
        On the rail and on the piece once the movement is over [N].
    largest_force : float
        Of any drive, in any direction, while the piece is held [N].
    gap : float
        Raw gap at the drive then [m].
    fault : str
        Why there is no result; empty if there is one.
    """

    drive: str
    size: float
    seen: bool
    drive_force: float
    piece_force: float
    largest_force: float
    gap: float
    fault: str = ""

    @classmethod
    def without(cls, drive: str, size: float, fault: str) -> "PieceResult":
        """Return a result that only says why there is none."""
        nothing = math.nan
        return cls(drive, size, False, nothing, nothing, nothing, nothing, fault)


def check_piece(
    panel: LoadedPanel,
    drive: str,
    *,
    size: float | None = None,
    report: Callable[[int, int], None] | None = None,
) -> PieceResult:
    """Throw a panel with a test piece at one of its drives.

    Parameters
    ----------
    panel : LoadedPanel
        The panel.
    drive : str
        Name of the drive.
    size : float, optional
        Thickness of the piece [m], default the panel's `lock.gap_limit`.
    report : callable, optional
        As for `simulate`.

    Returns
    -------
    PieceResult
        How it ended; a run that ends early and a piece without room are told as a fault.

    Raises
    ------
    PanelError
        When the piece does not fit into the opening, or the rail has no stock rail.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> check_piece(load_panel("sb2"), "1").seen  # doctest: +SKIP
    False
    """
    thickness = panel.lock.gap_limit if size is None else size
    rail = panel.drive[drive].rail
    piece = ForeignObject(thickness, f"drive {drive}", rail=rail)
    save = Save(fields=CHANNELS)
    dataset = simulate(panel, foreign_object=piece, save=save, throw=False, report=report)
    fault = ""
    if not dataset.attrs["complete"]:
        fault = str(dataset.attrs["outcome_message"])
    elif not dataset["object_placed"]:
        fault = "the gap never had room for the piece"
    if fault:
        return PieceResult.without(drive, thickness, fault)
    held = dataset["object_force"].values > 0
    forces = np.abs(dataset["drive_force"].values[:, held])
    end = settled(dataset, to="closed" if panel.rail[rail].closes == "+y" else "open")
    return PieceResult(
        drive=drive,
        size=thickness,
        seen=not bool(end["locked"]),
        drive_force=float(end["drive_force"].sel(drive=drive)),
        piece_force=float(end["object_force"]),
        largest_force=float(np.max(forces, initial=0.0)),
        gap=float(end["drive_gap"].sel(drive=drive)),
    )
