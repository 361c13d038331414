"""Whether a run sheet fits the files beside it, and what was measured."""

from collections.abc import Iterable, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path

from turnout.core.problems import nearest
from turnout.errors import MeasurementError
from turnout.measurement.campaign.inside import PERMIT, leads_outside, where_to
from turnout.measurement.campaign.sheet import SHEETS, Run, RunSheet
from turnout.measurement.formats.files import FORMATS

NOT_RECORDINGS = {*SHEETS, "channels.toml", "truth.nc", "campaign.nc"}


def recordings_in(folder: Path) -> list[str]:
    """Return the files of a folder, by name, that can be recordings by their suffix."""
    known = {suffix for item in FORMATS for suffix in item.suffixes}
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
        # Whether there is a file outside is not told.
        if not allow_outside and leads_outside(path, folder):
            text = f"{run.file} {where_to(path, folder)}; copy it into the folder, or {PERMIT}"
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


def order_remarks(runs: Sequence[Run], start_times: Iterable[str]) -> list[str]:
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
    """Understand date and time in ISO 8601; what else recorders write is not compared."""
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None


def series_remarks(runs: Sequence[Run], slipped: Sequence[bool | None]) -> list[str]:
    """Return remarks on series of growing objects: sizes out of order, slip reached or not.

    Parameters
    ----------
    runs : sequence of Run
        In the order of the sheet.
    slipped : sequence of bool or None
        Whether a drive slipped, as measured; None where that is not known.

    Returns
    -------
    list of str
    """
    series: dict[tuple[str, str, int], list[tuple[Run, bool | None]]] = {}
    for run, measured in zip(runs, slipped, strict=True):
        if run.size > 0:
            slip = run.slip if measured is None else measured
            series.setdefault((run.place, run.direction, run.repeat), []).append((run, slip))
    remarks = []
    for (place, _, _), members in series.items():
        remarks += [
            f"{run.where}: {_milli(run)} at {place} comes after {_milli(before)}"
            "; objects usually grow"
            for (before, _), (run, _) in pairwise(members)
            if run.size < before.size
        ]
        first = next((number for number, (_, slip) in enumerate(members) if slip), None)
        if first is None and all(slip is not None for _, slip in members) and len(members) > 1:
            largest = max(members, key=lambda member: member[0].size)[0]
            remarks.append(f"{place}: no drive slipped up to {_milli(largest)}")
        elif first is not None and first < len(members) - 1:
            run = members[first][0]
            remarks.append(
                f"{run.where}: a drive slipped at {place} with {_milli(run)}, "
                f"yet {len(members) - 1 - first} movements of that series follow"
            )
    return remarks


def slip_remarks(runs: Sequence[Run], slipped: Sequence[bool | None]) -> list[str]:
    """Return a remark on each movement whose sheet and current disagree on a slip."""
    return [
        f"{run.where}: the sheet says {'a' if run.slip else 'no'} drive slipped with {_milli(run)} "
        f"at {run.place}, the currents say {'one' if measured else 'none'} did"
        for run, measured in zip(runs, slipped, strict=True)
        if run.slip is not None and measured is not None and run.slip != measured
    ]


def force_remarks(runs: Sequence[Run], forces: Sequence[float]) -> list[str]:
    """Return a remark where a larger object at the same place is squeezed much less.

    Parameters
    ----------
    runs : sequence of Run
        In the order of the sheet.
    forces : sequence of float
        Rod forces at the end of each movement, summed [N].

    Returns
    -------
    list of str
    """
    remarks = []
    groups: dict[tuple[str, str, int], list[tuple[float, float, Run]]] = {}
    for run, force in zip(runs, forces, strict=True):
        if run.size > 0 and run.direction == "closing":
            key = (run.place, run.direction, run.repeat)
            groups.setdefault(key, []).append((run.size, force, run))
    for (place, _, _), members in groups.items():
        for (_, less, before), (_, more, run) in pairwise(sorted(members, key=lambda m: m[0])):
            if more < less - max(250.0, 0.025 * abs(less)):
                remarks.append(
                    f"{run.where}: {_milli(run)} at {place} ends with {more:.0f} N in the rods, "
                    f"{_milli(before)} ({before.where}) with {less:.0f} N; are sizes mixed up?"
                )
    return remarks


def _milli(run: Run) -> str:
    return f"{run.size * 1e3:g} mm"
