"""The test-piece check: least piece that keeps the panel from locking, and the refusing part.

On the track a gauge piece is held between switch rail and stock rail at a drive, and the switch is
thrown: the drive must not confirm locking. Here the piece is a foreign object at the drive. One as
thick as the gap limit is thrown on, and the least size from which lock is refused is found.
"""

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from turnout.core.errors import PanelError
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.throw.checks import checks
from turnout.throw.save import Save
from turnout.throw.simulate import simulate
from turnout.throw.slip import last_instant_at, unfinished

RESOLUTION = 1e-4
"""Resolution of the least size [m]."""
LARGEST_PIECE_RATIO = 3.0
"""The largest piece that is tried, as a multiple of the gap limit at the drive [-]."""

CHANNELS = ("drive_force", "object_force", "locked", "drive_gap", "drive_slipping", "object_placed")


@dataclass(frozen=True, slots=True)
class PieceResult:
    """Outcome of a throw on a test piece.

    Attributes
    ----------
    drive : str
        Drive at which the piece is.
    size : float
        Its thickness [m].
    seen : bool
        Whether the panel does not lock, by its own rule.
    by : str
        The criterion of the lock rule that refuses first; empty if none does.
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
    by: str = ""
    fault: str = ""

    @classmethod
    def without(cls, drive: str, size: float, fault: str) -> "PieceResult":
        """Return a result that only states the reason for having none."""
        nothing = math.nan
        return cls(drive, size, False, nothing, nothing, nothing, nothing, fault=fault)


@dataclass(frozen=True, slots=True)
class PieceLimit:
    """The least piece at a drive that keeps the panel from locking.

    Attributes
    ----------
    drive : str
        Drive at which the piece is.
    size : float
        Its thickness, to `RESOLUTION` from above [m]; infinite where even the largest locks.
    by : str
        The criterion of the lock rule that refuses first.
    largest : float
        The largest piece that was tried [m].
    fault : str
        Why there is no result; empty if there is one.
    """

    drive: str
    size: float
    by: str
    largest: float
    fault: str = ""

    @property
    def text(self) -> str:
        """Least piece on which the drive refuses to lock, and the refusing part of the rule."""
        if self.fault:
            return f"drive {self.drive}: least piece that is refused not known: {self.fault}"
        if math.isinf(self.size):
            return f"drive {self.drive} locks on every piece up to {1e3 * self.largest:g} mm"
        return f"drive {self.drive} refuses to lock from {1e3 * self.size:.1f} mm on, by {self.by}"


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
        Thickness of the piece [m], default the gap limit of the drive.
    report : callable, optional
        As for `simulate`.

    Returns
    -------
    PieceResult
        How it ended; a run that ends early and a piece without room are given as a fault.

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
    thickness = panel.gap_limits()[drive] if size is None else size
    rail = panel.drive[drive].rail
    piece = ForeignObject(thickness, f"drive {drive}", rail=rail)
    save = Save(fields=CHANNELS)
    dataset = simulate(panel, foreign_object=piece, save=save, throw=False, report=report)
    fault = ""
    if not dataset.attrs["complete"]:
        fault = str(dataset.attrs["outcome_message"])
    elif not dataset["object_placed"]:
        fault = "the piece does not fit: the gap is smaller at all times"
    elif late := unfinished(dataset):
        fault = "; ".join(late.values())
    if fault:
        return PieceResult.without(drive, thickness, fault)
    held = dataset["object_force"].values > 0
    forces = np.abs(dataset["drive_force"].values[:, held])
    to = "closed" if panel.rail[rail].closes == "+y" else "open"
    end = last_instant_at(dataset, to=to)
    made = [check for check in checks(dataset) if check.kind == "lock"]
    lock = next(check for check in reversed(made) if check.movement and check.movement.to == to)
    return PieceResult(
        drive=drive,
        size=thickness,
        seen=not lock.met,
        by="" if lock.met else lock.criterion,
        drive_force=float(end["drive_force"].sel(drive=drive)),
        piece_force=float(end["object_force"]),
        largest_force=float(np.max(forces, initial=0.0)),
        gap=float(end["drive_gap"].sel(drive=drive)),
    )


def least_piece(
    panel: LoadedPanel, drive: str, *, report: Callable[[int, int], None] | None = None
) -> PieceLimit:
    """Find the least piece at a drive from which the panel refuses to lock, by bisection.

    Parameters
    ----------
    panel : LoadedPanel
        The panel.
    drive : str
        Name of the drive.
    report : callable, optional
        Called with throws done and throws in all.

    Returns
    -------
    PieceLimit
        Of a panel that locks on smaller pieces and refuses larger ones. A piece that does not fit
        into the opening, and a rail without a stock rail, are given as a fault.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> least = least_piece(load_panel("uic60-760-1-15"), "2")  # doctest: +SKIP
    >>> round(1e3 * least.size, 1), least.by  # doctest: +SKIP
    (4.9, 'slip')
    """
    try:
        return _bisected(panel, drive, report)
    except PanelError as error:
        return PieceLimit(drive, math.nan, "", math.nan, "; ".join(error.problems))


def _bisected(
    panel: LoadedPanel, drive: str, report: Callable[[int, int], None] | None
) -> PieceLimit:
    count = round(LARGEST_PIECE_RATIO * panel.gap_limits()[drive] / RESOLUTION)
    throws = 1 + math.ceil(math.log2(count))
    tried: dict[int, PieceResult] = {}

    def refused(steps: int) -> bool:
        """Return whether a piece of so many steps of the resolution is."""
        if report is not None and tried:
            report(len(tried), throws)
        found = tried[steps] = check_piece(panel, drive, size=steps * RESOLUTION)
        if found.fault:
            raise PanelError([found.fault])
        return found.seen

    largest = count * RESOLUTION
    if not refused(count):
        return PieceLimit(drive, math.inf, "", largest)
    least = bisect_left(range(count), True, lo=1, key=refused)
    if least == 1:
        fault = "lock is refused without a piece, too"
        return PieceLimit(drive, math.nan, tried[1].by, largest, fault)
    return PieceLimit(drive, least * RESOLUTION, tried[least].by, largest)
