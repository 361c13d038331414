"""Checks of shapes against strokes, of over-travels against slip levels, and of back drives."""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from turnout.core.keys import Path
from turnout.core.problems import Problem
from turnout.panel.check_rails import check_drive_table, check_profile, unknown_name
from turnout.panel.place import SAME_PLACE
from turnout.panel.profile import evaluate_profile
from turnout.panel.records import Drive, Profile, Rail
from turnout.panel.validate import Draft, Partial, until_unknown

MOST_CONTRADICTION = 0.5e-3
"""So far a typed shape may be from the stroke at a drive [m]."""


def check_shape(draft: Draft, path: Path, rail: Any) -> Iterator[Problem]:
    """Check the input of a rail's shape and gauge, and a typed shape against the strokes."""
    if rail.gauge_widening is not None:
        yield from check_profile((*path, "gauge_widening"), rail.gauge_widening, what="widening")
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


def _against_strokes(draft: Draft, path: Path, rail: Any) -> Iterator[Problem]:
    if rail.stock_rail_gap is None or rail.independent_shape:
        return
    for name in _moved_by(draft, path[1]):
        drive = draft.records["drive"][name]
        gap = float(evaluate_profile(rail.stock_rail_gap, [drive.x])[0])
        wanted = rail.fraction * drive.stroke
        if abs(gap - wanted) > MOST_CONTRADICTION:
            makes = (
                f"the stroke of {1e3 * drive.stroke:g} mm makes {1e3 * wanted:.1f} mm"
                if rail.fraction
                else 'stress_free "closed" leaves none'
            )
            text = (
                f": leaves {1e3 * gap:.1f} mm at drive '{name}', where {makes}; type the shape of "
                "this position, or give fit_gap in its place and the shape is computed"
            )
            yield Problem((*path, "stock_rail_gap"), text)


def _moved_by(draft: Draft, rail: str) -> list[str]:
    return _drives_of(draft.records, rail)


def _drives_of(records: Mapping[str, Any], rail: str) -> list[str]:
    """Return the drives of a rail, and those at whose places links join it to another."""
    drives = records["drive"]
    own = [name for name, drive in drives.items() if drive.rail == rail]
    if own:
        return own
    linked = [link.x for link in records["link"].values() if rail in link.rails]
    at_links = [
        name for name, drive in drives.items() if any(abs(drive.x - x) < SAME_PLACE for x in linked)
    ]
    return at_links


def check_back_drive(draft: Draft, path: Path, record: Any) -> Iterator[Problem]:
    """Check that a back drive takes its motion from a drive at another place."""
    if record.drive not in draft.names["drive"]:
        yield Problem((*path, "drive"), unknown_name("drive", record.drive, draft.names["drive"]))
        return
    at = draft.records["drive"][record.drive].x
    if abs(record.x - at) < SAME_PLACE:
        text = f" = {record.x:g} m: is the place of drive '{record.drive}' itself; move it away"
        yield Problem((*path, "x"), text)


MORE = {
    "link": "change the stroke of the drives to move a rail further",
    "back_drive": "change its ratio to move its place further",
}
"""Remedies in place of a larger adjustment."""
MOST_ADJUSTMENT = 10e-3
"""Greatest lengthening or shortening of a linkage by its adjusters in the field [m]."""


def check_adjustment(path: Path, linkage: Any) -> Iterator[Problem]:
    """Check that a linkage is not adjusted by so much that a rail cannot close."""
    if abs(linkage.adjustment) > MOST_ADJUSTMENT:
        text = (
            f" = {1e3 * linkage.adjustment:g} mm: at most {1e3 * MOST_ADJUSTMENT:g} mm either way, "
            f"or the rails cannot close; {MORE[path[0]]}"
        )
        yield Problem((*path, "adjustment"), text)


# Studies and calibrations set these; where one of them makes a drive slip at rest, the verdict and
# `panel check` say so.
_STUDIED = ("stiffness", "saturation_force", "extension", "force")
_REACHES = ("over_travel_closed", "over_travel_open")


def slips_at_rest(draft: Draft, path: Path, drive: Any) -> Iterator[Problem]:
    """Refuse a drive that presses a closed rail so hard that it slips without moving.

    Unless an override has set stiffness, slip level or force table of the drive, and none the
    over-travel. That follows from the document alone, so a stored panel can be made again.
    """
    given, name = draft.given, path[1]
    studied = any(f"drive.{name}.{key}" in given for key in _STUDIED)
    refused = [key for key in _REACHES if not studied or f"drive.{name}.{key}" in given]
    for rail, key, fit in pressed_home(draft.records, name) if refused else ():
        reach, limit = getattr(drive, key), drive.saturation_force
        force, most = elastic_force(drive, reach - fit), limit / drive.stiffness + fit
        if key not in refused or force < limit:
            continue
        text = (
            f" = {1e3 * reach:g} mm: presses rail '{rail}' home with {force / 1e3:.2f} kN, so that "
            f"the drive slips at rest, at {limit / 1e3:g} kN; give less than {1e3 * most:.2f} mm"
        )
        yield Problem((*path, key), text)


def pressed_home(records: Mapping[str, Any], name: str) -> Iterator[tuple[str, str, float]]:
    """Yield the rails that a drive presses home when closed.

    Parameters
    ----------
    records : mapping of str to mapping
        Rails, drives and links of a panel, valid or not.
    name : str
        Of the drive.

    Yields
    ------
    rail, key : str
        Names of the rail and of the over-travel that presses it home.
    fit : float
        Gap that the closed rail leaves at the drive before [m].
    """
    drive = records["drive"][name]
    for rail_name, rail in records["rail"].items():
        if isinstance(rail, Partial) or rail.independent_shape:
            continue
        if name not in _drives_of(records, rail_name):
            continue
        fit = _fit_at(rail, drive)
        if fit is None or any(check_drive_table(("drive", name), drive)):
            continue
        yield rail_name, _REACHES[0] if rail.closes == "+y" else _REACHES[1], fit


def _fit_at(rail: Rail, drive: Drive) -> float | None:
    """Return the gap that a closed rail leaves at a drive before it is pressed home [m]."""
    shape = rail.fit_gap if rail.fit_gap is not None else rail.stock_rail_gap
    if shape is None:
        return None
    gap = _gap_at(shape, drive.x)
    if gap is None:
        return None
    return gap if rail.fit_gap is not None else gap - rail.fraction * drive.stroke


@lru_cache(maxsize=256)
def _gap_at(shape: Profile, x: float) -> float | None:
    """Return a profile at a place [m]; None for a faulty one."""
    faulty = any(check_profile((), shape))
    return None if faulty else float(evaluate_profile(shape, [x])[0])


def elastic_force(drive: Drive, extension: float) -> float:
    """Return the typed force [N] of a bushing at an extension [m], before the drive slips."""
    if drive.extension is not None and drive.force is not None:
        return float(np.interp(extension, drive.extension, drive.force))
    return drive.stiffness * extension
