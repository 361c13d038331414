"""Checks of a run sheet against the files beside it and the measured signals."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import MeasurementError
from turnout.core.problems import nearest
from turnout.core.saturating_force import saturates
from turnout.measurement.campaign.campaign_folder import PERMIT, describe_target, is_outside
from turnout.measurement.campaign.run_sheet import NOT_RECORDINGS, RunSheet, SheetRow
from turnout.measurement.formats.file_format import FORMATS

# How much more one rod must rise than any other, by how much on average [N], and in how many
# movements with an object at a drive.
SWAPPED, LEAST_RISE, LEAST_VOTES = 1.5, 50.0, 2


def recordings_in(folder: Path) -> list[str]:
    """Return the files of a folder, by name, that can be recordings by their suffix."""
    known = {suffix for item in FORMATS for suffix in item.endings.split()}
    return sorted(
        path.name
        for path in folder.iterdir()
        if path.is_file()
        and path.suffix.lower() in known
        and path.name not in NOT_RECORDINGS
        and not path.name.startswith(".")
    )


def check_files(sheet: RunSheet, folder: Path, *, allow_outside: bool = False) -> None:
    """Refuse a sheet that names files that are not there, or are not in its folder.

    Raises
    ------
    MeasurementError
        With every missing file, and the nearest name in the folder.
    """
    there = recordings_in(folder)
    problems = []
    for run in sheet.runs:
        path = folder / run.file
        # Whether a file exists outside is not revealed.
        if not allow_outside and is_outside(path, folder):
            text = (
                f"{run.file} {describe_target(path, folder)}; copy it into the folder, or {PERMIT}"
            )
            problems.append(f"{run.where}: {text}")
        elif not path.is_file():
            problems.append(
                f"{run.where}: there is no file {run.file}{nearest(run.file, there)}"
                "; correct the name, or take the line out"
            )
    if problems:
        raise MeasurementError(problems, source=sheet.source)


def extra_files(sheet: RunSheet, folder: Path) -> list[str]:
    """Return a remark on each recording that no line of the sheet names."""
    named = {run.file for run in sheet.runs}
    return [
        f"{name}: is in no line of the run sheet"
        for name in recordings_in(folder)
        if name not in named
    ]


def order_remarks(runs: Sequence[SheetRow], start_times: Iterable[str]) -> list[str]:
    """Return a remark on each movement that was recorded before the one above it in the sheet.

    Examples
    --------
    >>> order_remarks([], [])
    []
    """
    timed = [
        (run, start, moment)
        for run, start in zip(runs, start_times, strict=True)
        if (moment := _moment(start)) is not None
    ]
    return [
        f"{run.where}: {run.file} was recorded at {start}, before {above.file} above it ({earlier})"
        "; is the order of the lines right?"
        for (above, earlier, then), (run, start, now) in pairwise(timed)
        # Clocks with and without a time zone cannot be compared.
        if (now.tzinfo is None) == (then.tzinfo is None) and now < then
    ]


def _moment(text: str) -> datetime | None:
    """Parse date and time in ISO 8601; other forms that recorders write are not compared."""
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None


def series_remarks(
    runs: Sequence[SheetRow], slipped: Sequence[bool | None], forces: Sequence[NDArray[np.float64]]
) -> list[str]:
    """Return remarks on series of growing objects: sizes out of order, slip reached or not.

    Parameters
    ----------
    runs : sequence of SheetRow
        In the order of the sheet.
    slipped : sequence of bool or None
        Whether a drive slipped, as measured; None where that is not known.
    forces : sequence of ndarray, shape (n_drives,)
        Change of each rod force over each movement [N].

    Returns
    -------
    list of str
    """
    series: dict[tuple[str, str, int], list[_Member]] = {}
    for run, measured, force in zip(runs, slipped, forces, strict=True):
        if run.size > 0:
            slip = run.slip if measured is None else measured
            series.setdefault(_series_of(run), []).append((run, slip, force))
    remarks = []
    for (place, *_), members in series.items():
        remarks += [
            f"{run.where}: {_size(run)} at {place} comes after {_size(before)}"
            "; objects usually grow"
            for (before, *_), (run, *_) in pairwise(members)
            if run.size < before.size
        ]
        slips = [slip for _, slip, _ in members]
        largest = max((run for run, *_ in members), key=lambda run: run.size)
        if True in slips:
            first = slips.index(True)
            run, following = members[first][0], _needless(members, first)
            if following:
                said = "1 movement of that series follows"
                if following > 1:
                    said = f"{following} movements of that series follow"
                remarks.append(
                    f"{run.where}: a drive slipped at {place} with {_size(run)}, yet {said}"
                )
        elif None in slips or len(members) < 2:
            continue
        elif saturates([(run.size, force) for run, _, force in members]):
            remarks.append(
                f"{place}: a rod force no longer grows up to {_size(largest)}, yet no drive "
                "is said to slip; check clamps and the column slip"
            )
        else:
            remarks.append(f"{place}: no drive slipped up to {_size(largest)}")
    return remarks


_Member = tuple[SheetRow, bool | None, NDArray[np.float64]]
"""A movement of a series, whether a drive slipped in it, and the change of each rod force [N]."""


def _series_of(run: SheetRow) -> tuple[str, str, int]:
    return run.place, run.direction, run.repeat


@dataclass(frozen=True, slots=True)
class RodCheck:
    """Result of the check for exchanged columns of rods.

    Attributes
    ----------
    pair : tuple of str or None
        Two drives whose rods have changed places, in the order of their names.
    checked : bool
        Whether the movements suffice to say that none have.
    """

    pair: tuple[str, str] | None = None
    checked: bool = False


def rod_check(votes: Sequence[tuple[str, str]], *, both: bool = False) -> RodCheck:
    """Return the check of rods by movements: of each the rod expected to rise, and the actual one.

    Parameters
    ----------
    votes : sequence of (str, str)
        Names of drives.
    both : bool
        Whether each drive of an exchanged pair must be where the force should rise in a movement.

    Examples
    --------
    >>> rod_check([("1", "2"), ("2", "1")])
    RodCheck(pair=('1', '2'), checked=True)
    >>> rod_check([("1", "1"), ("2", "2")]), rod_check([("1", "2")])
    (RodCheck(pair=None, checked=True), RodCheck(pair=None, checked=False))
    """
    if len(votes) < LEAST_VOTES:
        return RodCheck()
    if all(own == most for own, most in votes):
        return RodCheck(checked=True)
    pairs = {(min(vote), max(vote)) for vote in votes}
    first, second = min(pairs)
    if len(pairs) != 1 or first == second or (both and len({own for own, _ in votes}) < 2):
        return RodCheck()
    return RodCheck(pair=(first, second), checked=True)


def check_rods(dataset: xr.Dataset) -> RodCheck:
    """Check rods for exchanged columns: the force rises at the wrong one.

    An object beside a drive loads its rod far more, and earlier, than any other. Where it is
    another rod that rises above what it carries without an object, in every movement with an object
    at a drive and in two at least, columns are exchanged.

    Parameters
    ----------
    dataset : xarray.Dataset
        Stacked movements: `drive_force` (movement, drive, time), time zero at the onset.
    """
    if "drive_force" not in dataset:
        return RodCheck()
    drives = [str(name) for name in dataset["drive"].values]
    forces = dataset["drive_force"].transpose("movement", "drive", "time").values
    forces = forces[:, :, dataset["time"].values >= 0.0]
    sizes, directions = dataset["size"].values, dataset["direction"].values
    votes = []
    for number, place in enumerate(map(str, dataset["place"].values)):
        name = place.removeprefix("drive ")
        free = (sizes == 0) & (directions == directions[number])
        if sizes[number] > 0 and place != name and name in drives and free.any():
            most = rises_most(rises(forces[number], forces[free]))
            votes += [(name, drives[most])] if most is not None else []
    return rod_check(votes)


def rises_most(rise: NDArray[np.float64], *, times: float = SWAPPED) -> int | None:
    """Return the rod that rises clearly more than any other, or None if none does.

    Parameters
    ----------
    rise : ndarray, shape (n_drives,)
        From `rises` [N].
    times : float
        How many times as much as the next one.

    Examples
    --------
    >>> rises_most(np.array([100.0, 900.0])), rises_most(np.array([800.0, 900.0]))
    (1, None)
    """
    most = int(np.argmax(rise))
    next_one = float(np.delete(rise, most).max(initial=0.0))
    return most if rise[most] > max(times * next_one, LEAST_RISE) else None


def rises(forces: NDArray[np.float64], free: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the excess of each rod over its force without an object, as a mean over time [N].

    Parameters
    ----------
    forces : ndarray, shape (n_drives, n)
        Of one movement [N].
    free : ndarray, shape (n_free, n_drives, n)
        Of movements without an object in its direction [N].
    """
    with np.errstate(invalid="ignore"):
        more = np.abs(forces) - np.abs(free).mean(axis=0)
    known = np.isfinite(more)
    total = np.where(known & (more > 0.0), more, 0.0).sum(axis=1)
    return np.asarray(total / np.maximum(known.sum(axis=1), 1))


EXCHANGED = "swapped channels of"
"""Start of remarks on exchanged columns."""


def swap_remarks(pair: Sequence[str] | None) -> list[str]:
    """Return a remark on rods that have changed places.

    Examples
    --------
    >>> swap_remarks(("1", "2"))[0].split(":")[0]
    'swapped channels of drive_force 1 and 2'
    """
    if not pair:
        return []
    one, other = pair
    return [
        f"{EXCHANGED} drive_force {one} and {other}: with an object near a drive the force "
        "of the other one rises; exchange their columns in the channel map, or the places in the "
        "run sheet"
    ]


UNCHECKED = (
    "whether columns of rods are exchanged is not checked: that needs two movements with an object "
    "at a drive, such as 'drive 1'; `turnout campaign check --panel PANEL` takes objects at other "
    "places too"
)
UNCHECKABLE = (
    "whether columns of rods are exchanged cannot be checked with these movements, as no object "
    "loads one rod clearly more than the others; measure one near each drive"
)


def exchange_remarks(attributes: Mapping[Any, Any]) -> list[str]:
    """Return a remark on each pair of columns that the attributes of a campaign say are exchanged.

    Examples
    --------
    >>> exchange_remarks({"swapped_cell": "2"})[0].split(":")[0]
    'swapped channels of drive_force 2 and object_force'
    """
    found = swap_remarks(json.loads(str(attributes.get("swapped", "[]"))))
    cell = attributes.get("swapped_cell")
    if cell:
        found.append(
            f"{EXCHANGED} drive_force {cell} and object_force: without an object the "
            "column of the load cell changes as a rod does, and that of the rod does not; exchange "
            "them in the channel map"
        )
    return found


def slip_remarks(runs: Sequence[SheetRow], slipped: Sequence[bool | None]) -> list[str]:
    """Return a remark on each movement whose sheet and current disagree on a slip."""
    return [
        f"{run.where}: the sheet says {'a' if run.slip else 'no'} drive slipped {_what(run)}, "
        f"the currents say {'one' if measured else 'none'} did"
        for run, measured in zip(runs, slipped, strict=True)
        if run.slip is not None and measured is not None and run.slip != measured
    ]


def force_remarks(runs: Sequence[SheetRow], forces: Sequence[float]) -> list[str]:
    """Return a remark for each larger object that meets much less force at the same place.

    Parameters
    ----------
    runs : sequence of SheetRow
        In the order of the sheet.
    forces : sequence of float
        Rod forces at the end of each movement, summed [N].

    Returns
    -------
    list of str
    """
    remarks = []
    groups: dict[tuple[str, str, int], list[tuple[float, float, SheetRow]]] = {}
    for run, force in zip(runs, forces, strict=True):
        if run.size > 0 and run.direction == "closing":
            groups.setdefault(_series_of(run), []).append((run.size, force, run))
    for (place, _, _), members in groups.items():
        for (_, less, before), (_, more, run) in pairwise(sorted(members, key=lambda m: m[0])):
            if more < less - max(250.0, 0.025 * abs(less)):
                remarks.append(
                    f"{run.where}: {_size(run)} at {place} ends with {more:.0f} N in the rods, "
                    f"{_size(before)} ({before.where}) with {less:.0f} N; are sizes mixed up?"
                )
    return remarks


def _size(run: SheetRow) -> str:
    return f"{run.size * 1e3:g} mm"


def _what(run: SheetRow) -> str:
    return f"with {_size(run)} at {run.place}" if run.size > 0 else "without an object"


def _needless(members: Sequence[_Member], first: int) -> int:
    """Return the number of movements after the first one that slipped and measured the object.

    Until a load cell fits a series may go on, so that the force on the object is known there.
    """
    cells = [n for n in range(first, len(members)) if members[n][0].load_cell]
    return len(members) - 1 - cells[0] if cells else 0
