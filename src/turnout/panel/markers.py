"""Movement of the drives' markers over time, by formula or by a recorded table.

Positions are in panel axes: positive in the closing direction of the instrumented rail, zero in the
position by stroke at t = 0. "Open" and "closed" are the positions of the instrumented rail, also
for a drive on the other rail, whose marker moves the same way.

Schedules recorded elsewhere: a CSV file with the columns time and fraction.
"""

from collections.abc import Hashable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from turnout.core.errors import FileError, refused_of
from turnout.core.files import user_path
from turnout.core.problems import Problem, shortened, show_value
from turnout.core.sheet_rows import sheet_rows
from turnout.core.toml import decode, read_bytes
from turnout.core.units import MOST_VALUES, SI
from turnout.panel.document import Document
from turnout.panel.model import Panel
from turnout.panel.records import Drive, Movement

FloatArray = npt.NDArray[np.float64]


def ordered_movements(panel: Panel) -> list[tuple[str, Movement]]:
    """Give the movements with their names in the order of their onsets."""
    return sorted(panel.movement.items(), key=lambda item: item[1].start)


def movement_time(movement: Movement, drive: str) -> float:
    """Give the time [s] that the marker of a drive takes for a movement."""
    return movement.duration + movement.extra_time.get(drive, 0.0)


def movement_end(panel: Panel, movement: Movement) -> float:
    """Give the time [s] at which the last marker has arrived."""
    return movement.start + max(movement_time(movement, drive) for drive in panel.drive)


def marker_level(drive: Drive, to: str, *, starts: str) -> float:
    """Give the marker position [m] after a movement to "open" or "closed".

    Parameters
    ----------
    drive : Drive
        Stroke and over-travels; these are added only where a movement goes.
    to : str
        "open" or "closed", of the instrumented rail.
    starts : str
        Its position at t = 0, where the marker is at zero, but for a loaded start.

    Returns
    -------
    float
        Position, positive closing [m].
    """
    if to == "closed":
        return (drive.stroke if starts == "open" else 0.0) + drive.over_travel_closed
    return (-drive.stroke if starts == "closed" else 0.0) - drive.over_travel_open


def start_level(panel: Panel, drive: Drive) -> float:
    """Return the position of a marker at t = 0 [m]: zero, or its over-travel if loaded."""
    starts = panel.schedule.starts
    return marker_level(drive, starts, starts=starts) if panel.schedule.loaded else 0.0


def prior_movement(panel: Panel) -> Movement | None:
    """Return the movement that a loaded start follows, or None if the start is not loaded.

    It is the schedule's last movement to where it starts; where it has none, its first movement
    turned around. A schedule without movements has no movement before it either.
    """
    if not panel.schedule.loaded or not panel.movement:
        return None
    movements = [movement for _, movement in ordered_movements(panel)]
    returns = [movement for movement in movements if movement.to == panel.schedule.starts]
    return (returns or [movements[0].model_copy(update={"to": panel.schedule.starts})])[-1]


def prior_positions(panel: Panel, movement: Movement, time: npt.ArrayLike) -> FloatArray:
    """Give the position of every drive's marker in the movement that a loaded start follows.

    Parameters
    ----------
    panel : Panel
        Drives and schedule.
    movement : Movement
        From `prior_movement`.
    time : array_like, shape (n_times,)
        Since its onset [s].

    Returns
    -------
    ndarray, shape (n_drives, n_times)
        [m], as `marker_positions` does; the last are those with which the schedule starts.
    """
    instants = np.atleast_1d(np.asarray(time, dtype=np.float64))
    starts = panel.schedule.starts
    begins = "open" if starts == "closed" else "closed"
    positions = np.zeros((len(panel.drive), instants.size))
    for row, (name, drive) in enumerate(panel.drive.items()):
        level, target = marker_level(drive, begins, starts=starts), start_level(panel, drive)
        share = movement_fraction(movement, instants, drive=name)
        share = share_behind_lock(panel, drive, movement, share, way=abs(target - level))
        positions[row] = np.where(share < 1.0, level + share * (target - level), target)
    return positions


def motion_key(panel: Panel) -> tuple[Hashable, ...]:
    """Return a key of all that positions of markers follow from, by its values."""
    ways = [
        (
            *(name, drive.stroke, drive.over_travel_open, drive.over_travel_closed),
            *(drive.lost_motion, panel.rail[drive.rail].closes),
        )
        for name, drive in panel.drive.items()
    ]
    return panel.key_of("movement", "schedule"), *ways


def marker_positions(panel: Panel, time: npt.ArrayLike) -> FloatArray:
    """Give the position of every drive's marker.

    Zero is the position by stroke in which the schedule starts; a loaded start lies beyond it.

    Parameters
    ----------
    panel : Panel
        Drives, schedule and movements.
    time : array_like, shape (n_times,)
        Times [s].

    Returns
    -------
    ndarray, shape (n_drives, n_times)
        Marker positions [m] in the order of `panel.drive`, positive closing.
    """
    instants = np.atleast_1d(np.asarray(time, dtype=np.float64))
    positions = np.zeros((len(panel.drive), instants.size))
    rising = bool((instants[1:] >= instants[:-1]).all())
    movements, starts = ordered_movements(panel), panel.schedule.starts
    shares: dict[tuple[str, float], tuple[int, int, FloatArray]] = {}
    for of_drive, (drive_name, drive) in zip(positions, panel.drive.items(), strict=True):
        level = start_level(panel, drive)
        of_drive[:] = level
        for name, movement in movements:
            target = marker_level(drive, movement.to, starts=starts)
            total = movement_time(movement, drive_name)
            found = shares.get((name, total))  # mostly the drives move alike
            if found is None:
                ends = (movement.start, movement.start + total)
                first, last = instants.searchsorted(ends).tolist() if rising else (0, instants.size)
                elapsed = instants[first:last] - movement.start
                share = movement_fraction(movement, elapsed, drive=drive_name)
                found = shares[name, total] = first, last, share
            first, last, share = found
            way = target - level
            share = share_behind_lock(panel, drive, movement, share, way=abs(way))
            of_drive[first:last] += way * share
            of_drive[last:] += way
            level = target
    return positions


def share_behind_lock(
    panel: Panel, drive: Drive, movement: Movement, share: FloatArray, *, way: float
) -> FloatArray:
    """Return the share of its way that a rail behind a clamp lock has covered.

    The slide runs through the lost motion p beside the way w. A rail that opens stands for the
    first p of it, in which it is unlocked; one that closes stands for the last p, in which it is
    locked. So the open rail moves first, and the other one last.

    Parameters
    ----------
    panel, drive, movement
        Rail of the drive, its lost motion, and where the instrumented rail goes.
    share : ndarray, shape (n,)
        Share of its whole way that the slide has covered [-].
    way : float
        Way of the rail [m].
    """
    if drive.lost_motion == 0.0:
        return share
    slide = share * (way + drive.lost_motion)
    opens = (movement.to == "open") == (panel.rail[drive.rail].closes == "+y")
    moved = slide - drive.lost_motion if opens else slide
    return np.asarray((moved / way).clip(0.0, 1.0))


def marker_offsets(panel: Panel) -> FloatArray:
    """Return marker zero relative to the stress-free position of each drive's rail.

    Parameters
    ----------
    panel : Panel
        Drives, rails and schedule.

    Returns
    -------
    ndarray, shape (n_drives,)
        Zero where the rail starts in its stress-free position, else up to the stroke [m], positive
        or negative, positive closing. The bushing is stretched by this at t = 0 if the rail stays
        stress-free.
    """
    return np.array(
        [start_offset(panel, drive.rail, drive.stroke) for drive in panel.drive.values()]
    )


def start_offset(panel: Panel, rail: str, travel: float) -> float:
    """Give the position at t = 0 from the stress-free one [m], positive closing.

    Parameters
    ----------
    panel : Panel
        Rails and schedule.
    rail : str
        Name of the rail.
    travel : float
        Travel between open and closed at the place in question [m].
    """
    return offset_at(panel, rail, travel, position=panel.schedule.starts)


def offset_at(panel: Panel, rail: str, travel: float, *, position: str = "closed") -> float:
    """Give a position of the instrumented rail from a rail's stress-free one [m], positive closing.

    Parameters
    ----------
    panel : Panel
        Rails.
    rail : str
        Name of the rail.
    travel : float
        Travel between open and closed at the place in question [m].
    position : str
        "open" or "closed", of the instrumented rail.
    """
    record = panel.rail[rail]
    # In panel axes the other rail is at its "+y" end exactly when it is open.
    free_at_plus = 1.0 - record.fraction if record.closes == "+y" else record.fraction
    return (float(position == "closed") - free_at_plus) * travel


def movement_fraction(movement: Movement, elapsed: npt.ArrayLike, *, drive: str) -> FloatArray:
    r"""Give the share of the travel that a marker has covered.

    The raised cosine has constant speed V with ends of length r in which the speed is
    :math:`V (1 - \cos(\pi t / r)) / 2`; it covers :math:`V (T - r)` in the time T. The smoothstep
    is :math:`3 s^2 - 2 s^3`. A table is stretched to the drive's own time.

    Parameters
    ----------
    movement : Movement
        Shape, duration, ramp.
    elapsed : array_like, shape (n,)
        Time since the onset [s].
    drive : str
        Name of the drive, for its extra time.

    Returns
    -------
    ndarray, shape (n,)
        0 before the onset, 1 after the end. Read-only, as throws share it.
    """
    times = np.asarray(elapsed, dtype=np.float64)
    table = (tuple(movement.table_time or ()), tuple(movement.table_fraction or ()))
    law = (movement.shape, movement.ramp, table, movement_time(movement, drive))
    return _fraction(law, times.shape, times.tobytes())


@lru_cache(maxsize=64)
def _fraction(
    law: tuple[str, float, tuple[tuple[float, ...], tuple[float, ...]], float],
    size: tuple[int, ...],
    elapsed: bytes,
) -> FloatArray:
    shape, ramp, (times, fractions), total = law
    t = np.frombuffer(elapsed).reshape(size).clip(0.0, total)
    s = t / total
    if shape == "smoothstep":
        fraction = s * s * (3.0 - 2.0 * s)
    elif shape == "table":
        fraction = np.interp(s * times[-1], times, fractions)
    elif shape == "raised cosine" and ramp > 0.0:
        fraction = _raised_cosine(t, total, ramp)
    else:
        fraction = s
    found: FloatArray = np.asarray(fraction, dtype=np.float64)
    found.flags.writeable = False
    return found


def _raised_cosine(t: FloatArray, total: float, ramp: float) -> FloatArray:
    speed = 1.0 / (total - ramp)
    early = t < ramp
    from_end = np.where(early, t, total - t)
    bends = from_end < ramp
    sine = np.sin(np.pi * from_end / ramp, where=bends, out=np.zeros_like(t))
    bent = 0.5 * speed * (from_end - ramp / np.pi * sine)
    middle = speed * (t - 0.5 * ramp)
    fraction = np.where(early, bent, np.where(bends, 1.0 - bent, middle))
    return np.asarray(fraction, dtype=np.float64)


COLUMNS = ("time", "fraction")

MOST_ROWS = 1_000_000
"""Rows that the movements of a panel take from files, together."""


def read_schedule_files(
    document: Document, *, folder: Path | None
) -> tuple[Document, list[Problem]]:
    """Fill the tables of movements that name a CSV file.

    Parameters
    ----------
    document : Document
        The expanded document.
    folder : Path or None
        Folder of the panel file, from which relative paths start.

    Returns
    -------
    document : Document
        The document with `table_time` and `table_fraction` filled; it keeps what was read, so
        that a panel made from it elsewhere does not need the file.
    problems : list of Problem
        Files that could not be read.
    """
    movements = document.tree.get("movement")
    if not isinstance(movements, dict) or not any(_names_file(item) for item in movements.values()):
        return document, []
    problems: list[Problem] = []
    tables = dict(document.tables)
    filled: dict[str, Any] = {}
    rows = 0
    for name, movement in movements.items():
        filled[name] = movement
        if not _names_file(movement):
            continue
        path = ("movement", name, "table_file")
        given = movement["table_file"]
        if movement.get("table_time") is not None or movement.get("table_fraction") is not None:
            text = f" = {show_value(given)}: give either the file or table_time and table_fraction"
            problems.append(Problem(path, text))
            continue
        try:
            if given not in tables:
                tables[given] = read_schedule_csv((folder or Path()) / user_path(given))
        except FileError as error:
            problems.append(Problem(path, f" = {show_value(given)}: {error}"))
            continue
        time, fraction = tables[given]
        rows += len(time)
        if rows > MOST_ROWS:
            text = f" = {show_value(given)}: the movements have more than {MOST_ROWS} rows together"
            problems.append(Problem(path, f"{text}; give fewer instants"))
            continue
        filled[name] = movement | {
            "table_time": [SI(value) for value in time],
            "table_fraction": fraction,
        }
    tree = document.tree | {"movement": filled}
    return replace(document, tree=tree, tables=tables), problems


def _names_file(movement: object) -> bool:
    return isinstance(movement, dict) and isinstance(movement.get("table_file"), str)


def read_schedule_csv(path: Path) -> tuple[list[float], list[float]]:
    """Read the columns time [s] and fraction [-] of a CSV file.

    Raises
    ------
    FileError
        When the file or a cell cannot be read; the text names the line.
    """
    text = decode(read_bytes(path), source=str(path))
    with refused_of(path):
        _, rows = sheet_rows(text)
    columns: dict[str, list[float]] = {name: [] for name in COLUMNS}
    header = [cell.lower() for cell in rows[0][1]] if rows else []
    if sorted(header) != sorted(COLUMNS):
        said = show_value(header)
        message = f"{path}: the first line must name the columns time,fraction; it says {said}"
        raise FileError(message)
    for number, row in rows[1:]:
        _add_row(columns, header, row, place=f"{path}: line {number}")
    return columns["time"], columns["fraction"]


def _add_row(
    columns: dict[str, list[float]], header: list[str], row: list[str], *, place: str
) -> None:
    if len(row) != len(header):
        message = f"{place}: {len(row)} cells, must be {len(header)}"
        raise FileError(message)
    if len(columns["time"]) >= MOST_VALUES:
        message = f"{place}: at most {MOST_VALUES} rows are read; give fewer instants"
        raise FileError(message)
    for name, cell in zip(header, row, strict=True):
        try:
            columns[name].append(float(cell))
        except ValueError:
            message = f"{place}: '{shortened(cell.strip())}' is not a number"
            raise FileError(message) from None
