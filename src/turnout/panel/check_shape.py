"""Checks of shapes against strokes, of the closing force at rest, and of back drives."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from turnout.core.problems import Problem
from turnout.panel.check_rails import check_drive_table, check_profile, unknown_name
from turnout.panel.model import Panel
from turnout.panel.profile import evaluate_profile
from turnout.panel.records import Drive, Rail
from turnout.panel.validate import Draft, Partial, until_unknown

MOST_CONTRADICTION = 0.5e-3
"""So far a typed shape may be from the stroke at a drive [m]."""
SAME_PLACE = 1e-6


def check_shape(draft: Draft, path: tuple[str, str], rail: Any) -> Iterator[Problem]:
    """Check how the shape of a rail is given, and a typed one against the strokes."""
    if rail.fit_gap is not None and rail.stock_rail_gap is not None:
        text = ": not beside stock_rail_gap, which types the shape that fit_gap has computed"
        yield Problem((*path, "fit_gap"), text)
        return
    for key in ("fit_gap", "stock_rail_gap"):
        if (gap := getattr(rail, key)) is not None:
            found = list(check_profile((*path, key), gap))
            yield from found
            if found:
                return
    linked = any(path[1] in link.rails for link in draft.records["link"].values())
    if rail.fit_gap is not None and not (linked or _moved_by(draft, path[1])):
        text = f": needs strokes, but no drive or link moves rail '{path[1]}'; add one"
        yield Problem((*path, "fit_gap"), text)
    yield from until_unknown(_against_strokes(draft, path, rail))


def _against_strokes(draft: Draft, path: tuple[str, str], rail: Any) -> Iterator[Problem]:
    if rail.stock_rail_gap is None or rail.independent_shape or rail.fraction == 0.0:
        return
    for name in _moved_by(draft, path[1]):
        drive = draft.records["drive"][name]
        gap = float(evaluate_profile(rail.stock_rail_gap, [drive.x])[0])
        wanted = rail.fraction * drive.stroke
        if abs(gap - wanted) > MOST_CONTRADICTION:
            text = (
                f": leaves {1e3 * gap:.1f} mm at drive '{name}', where the stroke of "
                f"{1e3 * drive.stroke:g} mm makes {1e3 * wanted:.1f} mm; type the shape of this "
                "stroke, or give fit_gap in its place and the shape is computed"
            )
            yield Problem((*path, "stock_rail_gap"), text)


def _moved_by(draft: Draft, rail: str) -> list[str]:
    """Return the drives of a rail, and those at whose places links join it to another."""
    drives = draft.records["drive"]
    own = [name for name, drive in drives.items() if drive.rail == rail]
    if own:
        return own
    linked = [link.x for link in draft.records["link"].values() if rail in link.rails]
    at_links = [
        name for name, drive in drives.items() if any(abs(drive.x - x) < SAME_PLACE for x in linked)
    ]
    return at_links


def check_back_drive(draft: Draft, path: tuple[str, str], record: Any) -> Iterator[Problem]:
    """Check that a back drive takes its motion from a drive at another place."""
    names = draft.names["drive"]
    if record.drive not in names:
        yield Problem((*path, "drive"), unknown_name("drive", record.drive, names))
        return
    at = draft.records["drive"][record.drive].x
    if abs(record.x - at) < SAME_PLACE:
        text = f" = {record.x:g} m: is the place of drive '{record.drive}' itself; move it away"
        yield Problem((*path, "x"), text)


def slips_at_rest(draft: Draft, *, before: Panel | None) -> Iterator[Problem]:
    """Find drives that press a closed rail so hard that they slip without moving.

    Parameters
    ----------
    draft : Draft
        The records.
    before : Panel, optional
        The valid panel that this one was made from. Where it has the same over-travel nothing is
        refused: a study may make a rod stiffer than the closing force allows, and sees it slip.
    """
    for name, drive in draft.records["drive"].items():
        known = before.drive.get(name) if before is not None else None
        yield from until_unknown(_slips_at_rest(draft, ("drive", name), drive, known))


def _slips_at_rest(
    draft: Draft, path: tuple[str, str], drive: Any, known: Drive | None
) -> Iterator[Problem]:
    for name, rail in draft.records["rail"].items():
        if isinstance(rail, Partial) or rail.independent_shape:
            continue
        if path[1] not in _moved_by(draft, name):
            continue
        key = "over_travel_closed" if rail.closes == "+y" else "over_travel_open"
        reach = getattr(drive, key)
        if known is not None and getattr(known, key) == reach:
            continue
        fit = _fit_at(rail, drive)
        if fit is None or any(check_drive_table(path, drive)):
            continue
        force = _force_at(drive, reach - fit)
        if force >= drive.saturation_force:
            most = drive.saturation_force / drive.stiffness + fit
            text = (
                f" = {1e3 * reach:g} mm: presses rail '{name}' home with {force / 1e3:.2f} kN, so "
                f"that the drive slips at rest, at {drive.saturation_force / 1e3:g} kN; give less "
                f"than {1e3 * most:.2f} mm"
            )
            yield Problem((*path, key), text)


def _fit_at(rail: Rail, drive: Drive) -> float | None:
    """Return the gap that a closed rail leaves at a drive before it is pressed home [m]."""
    shape = rail.fit_gap if rail.fit_gap is not None else rail.stock_rail_gap
    if shape is None or any(check_profile((), shape)):
        return None
    gap = float(evaluate_profile(shape, [drive.x])[0])
    return gap if rail.fit_gap is not None else gap - rail.fraction * drive.stroke


def _force_at(drive: Drive, extension: float) -> float:
    if drive.extension is not None and drive.force is not None:
        return float(np.interp(extension, drive.extension, drive.force))
    return drive.stiffness * extension
