"""Checks of tabulated data: sections, stock rail gaps, elastic laws of drives."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from turnout.files.problems import Problem
from turnout.panel.drive_records import Drive
from turnout.panel.profile import section_columns
from turnout.panel.rail_records import Profile
from turnout.panel.section_records import SectionTable

Path = tuple[str, ...]
_POSITIVE = (
    "area",
    "second_moment_vertical",
    "second_moment_lateral",
    "torsion_constant",
)


def rising_fault(values: Sequence[float], *, unit: str) -> str:
    """Say where a sequence does not rise, or give an empty text.

    Examples
    --------
    >>> rising_fault([0.0, 2.0, 1.0], unit="m")
    'must rise, but 1 m comes after 2 m'
    """
    for before, after in itertools.pairwise(values):
        if after <= before:
            return f"must rise, but {after:g} {unit} comes after {before:g} {unit}"
    return ""


def check_profile(path: Path, profile: float | Profile) -> Iterator[Problem]:
    """Check the table, or the constant, of a stock rail gap."""
    if not isinstance(profile, Profile):
        if profile < 0:
            yield Problem(path, f" = {profile:g} m: a gap must be at least 0")
        return
    if len(profile.x) != len(profile.value):
        text = f": has {len(profile.value)} entries, x has {len(profile.x)}"
        yield Problem((*path, "value"), text)
    fault = rising_fault(profile.x, unit="m")
    if fault:
        yield Problem((*path, "x"), f": {fault}")
    if min(profile.value) < 0:
        yield Problem(
            (*path, "value"), f": a gap must be at least 0, least {min(profile.value):g} m"
        )


def check_section(path: Path, table: SectionTable) -> Iterator[Problem]:
    """Check a section table: its stations, the lengths of its columns, what no section can be."""
    kinds = [name for name in ("x", "running_edge_offset") if getattr(table, name) is not None]
    if len(kinds) != 1:
        text = ": needs stations, either x or running_edge_offset" + (", not both" if kinds else "")
        yield Problem(path, text)
        return
    stations = getattr(table, kinds[0])
    fault = rising_fault(stations, unit="m")
    if fault:
        yield Problem((*path, kinds[0]), f": {fault}")
    columns = {
        name: values
        for name, values in section_columns(table).items()
        if getattr(table, name) is not None
    }
    fits = True
    for name, values in columns.items():
        if len(values) != len(stations):
            fits = False
            text = f": has {len(values)} entries, {kinds[0]} has {len(stations)}"
            yield Problem((*path, name), text)
        if name in _POSITIVE and min(values) <= 0:
            fits = False
            yield Problem((*path, name), f": must be more than 0, least is {min(values):g}")
    if fits and table.product_moment is not None:
        product = np.square(table.product_moment)
        limit = np.multiply(table.second_moment_vertical, table.second_moment_lateral)
        if np.any(product >= limit):
            row = int(np.argmax(product >= limit)) + 1
            text = f": entry {row}: its square must be less than vertical times lateral"
            yield Problem((*path, "product_moment"), text)


def check_drive_table(path: Path, drive: Drive) -> Iterator[Problem]:
    """Check the elastic law of a drive where it is given as a table."""
    given = [name for name in ("extension", "force") if getattr(drive, name) is not None]
    if len(given) == 1:
        other = "force" if given == ["extension"] else "extension"
        yield Problem((*path, other), f": is missing; the elastic law has {given[0]}")
    if drive.extension is None or drive.force is None:
        return
    if len(drive.extension) != len(drive.force) or len(drive.force) < 2:
        text = f": has {len(drive.force)} entries, extension has {len(drive.extension)}; at least 2"
        yield Problem((*path, "force"), text)
        return
    faults = [
        (name, fault)
        for name, unit in (("extension", "m"), ("force", "N"))
        if (fault := rising_fault(getattr(drive, name), unit=unit))
    ]
    for name, fault in faults:
        yield Problem((*path, name), f": {fault}")
    if faults:
        return
    inside = drive.extension[0] <= 0.0 <= drive.extension[-1]
    at_zero = float(np.interp(0.0, drive.extension, drive.force))
    if not inside or abs(at_zero) > 1e-9 * max(abs(value) for value in drive.force):
        yield Problem((*path, "force"), ": the law must pass through the origin, 0 N at 0 m")
