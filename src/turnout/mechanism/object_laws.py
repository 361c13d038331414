"""Laws of foreign objects and of frozen chairs: from their kind to their curve and memory."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from turnout.law.obstruction import BREAKS_AWAY, CRUMBLES, Obstructions, no_obstructions
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import LawIndex
from turnout.panel.foreign_object import LONGEST_PART, PlacedObject
from turnout.panel.records import Chair

BOND_DELAY = 1e-6
"""A bond acts from the first step on, once the rail has come to rest [s]."""


def divided(objects: Iterable[PlacedObject]) -> tuple[PlacedObject, ...]:
    """Divide long objects into parts along the rail, which fail one by one.

    Parameters
    ----------
    objects : iterable of PlacedObject
        Whole ones or parts, which stay as they are.

    Returns
    -------
    tuple of PlacedObject
        Parts of at most `LONGEST_PART`, with equal shares of the length.
    """
    parts: list[PlacedObject] = []
    for item in objects:
        count = 1 if item.whole else math.ceil(item.length / LONGEST_PART - 1e-9)
        if count <= 1:
            parts.append(item)
            continue
        share = item.length / count
        parts += [
            replace(
                item,
                name=f"{item.name}, part {number + 1}",
                whole=item.name,
                length=share,
                x=item.x + (number + 0.5) * share - 0.5 * item.length,
            )
            for number in range(count)
        ]
    return tuple(parts)


def add_object(laws: LawTableBuilder, row: int, item: PlacedObject, *, clearance: float) -> None:
    """Add the law of an object.

    Parameters
    ----------
    laws : LawTableBuilder
        Receives it.
    row : int
        Approach of the switch rail to the stock rail.
    item : PlacedObject
        The object.
    clearance : float
        Approach at which it is touched while nothing has broken off [m].
    """
    curve = item.of_kind.curve(item)
    laws.add_piecewise(
        row,
        breakpoints=curve.breakpoints,
        slopes=curve.slopes,
        offset=clearance + item.lost,
        appears=item.appears,
        disappears=item.disappears,
        waits=True,
    )


def dent_of(item: PlacedObject) -> float:
    """Return the lasting compression that earlier throws have left in an object [m]."""
    if not item.of_kind.remembers or item.deepest <= 0.0:
        return 0.0
    return item.of_kind.curve(item).lasting(item.deepest)


ANY_BOND = 1e3
"""Strength of the ice on chairs of a nominal panel that has none [N]."""


def add_bond(laws: LawTableBuilder, row: int, chair: Chair, *, feet: int) -> None:
    """Add the ice between a rail and a chair, as stiff as sticking feet, without values of place.

    Parameters
    ----------
    laws : LawTableBuilder
        Receives it.
    row : int
        Lateral displacement of the feet.
    chair : Chair
        With the force at which the ice breaks; a nominal one without ice has a bond of any
        strength, for the stiffness that its rails are condensed with.
    feet : int
        Foot points of the rail on it.
    """
    stiffness = feet * chair.stick_stiffness
    reach = (chair.frozen_force or ANY_BOND) / stiffness
    laws.add_piecewise(
        row,
        breakpoints=(-reach, reach),
        slopes=(0.0, stiffness, 0.0),
        appears=BOND_DELAY,
    )


def obstructions_of(index: LawIndex, objects: Sequence[PlacedObject]) -> Obstructions:
    """Return the memory of objects and bonds before the first contact.

    Parameters
    ----------
    index : LawIndex
        Laws of objects and bonds.
    objects : sequence of PlacedObject
        All objects; springs remember nothing.
    """
    laws = index.object
    kept = [item for item in objects if item.of_kind.remembers]
    found = no_obstructions(len(kept) + len(index.bond))
    found.law[len(kept) :] = list(index.bond.values())
    found.breaks[len(kept) :] = BREAKS_AWAY
    for row, item in enumerate(kept):
        curve = item.of_kind.curve(item)
        found.law[row] = laws[item.name]
        found.breaks[row] = curve.breaks
        found.unloading[row] = curve.unloading
        found.piece[row] = curve.piece
        found.limit[row] = curve.limit
        found.crushed[row] = curve.crushed if curve.breaks == CRUMBLES else 0.0
        found.least[row] = curve.least
        found.size[row] = item.size - item.lost
        found.deepest[row] = item.deepest
    return found


def named_obstructions(obstructions: Obstructions, laws: dict[str, int]) -> dict[str, int]:
    """Return the row of each object that remembers, by the name of the object."""
    names = {law: name for name, law in laws.items()}
    return {
        names[law]: row
        for row, law in enumerate(np.asarray(obstructions.law).tolist())
        if law in names
    }
