"""Laws as rows of one piecewise-linear table, and friction rows that name their normal law.

Every law is scalar. It reads one generalised displacement (a *row*, `g`) of the mechanism, forms
its argument ``e = g - offset - input(t)`` and resists with ``F = k e + f`` of the segment that
holds `e`; the force on the structure along the row is ``-F``. Contacts, bushings, links and foreign
objects differ in their numbers only. A friction law acts along its own row and has the limit
``friction_coefficient * F`` of its normal law.
"""

import math
from bisect import bisect_left
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Segment = tuple[float, float, float, float, float]


class LawTable(NamedTuple):
    """All laws of a mechanism as arrays; indices are int64, reals float64.

    In the table for the kernels, `turnout.solver.system.place_laws`, rows are places.

    Segment `s` of law `l` is entry ``segment_start[l] + s``; it holds for arguments between
    ``segment_lower`` and ``segment_upper``. ``potential`` makes the energy continuous and zero
    where ``e`` is zero. ``base_segment[l]`` is part of the linear system (-1: none). A law with
    ``waits`` appears only once its force would be zero.
    """

    row: Ints
    offset: Floats
    input_index: Ints
    segment_start: Ints
    segment_lower: Floats
    segment_upper: Floats
    slope: Floats
    intercept: Floats
    potential: Floats
    base_segment: Ints
    appears: Floats
    disappears: Floats
    waits: Ints
    friction_row: Ints
    friction_normal: Ints
    friction_coefficient: Floats
    stick_stiffness: Floats


MOST_JOINED = 32
"""Layouts of objects and links behind the same other laws that are kept."""


@dataclass(frozen=True, slots=True, eq=False)
class SharedTableParts:
    """Common parts of tables whose laws differ in values alone.

    Attributes
    ----------
    table : LawTable
        With the arrays of indices, read-only.
    of_laws : ndarray, shape (3, n_laws)
        Offsets, appearances and disappearances.
    of_segments : ndarray, shape (5, n_segments)
        Bounds, slopes, intercepts and potentials.
    """

    table: LawTable
    of_laws: Floats
    of_segments: Floats


_OF_LAWS = ("offset", "appears", "disappears")
_OF_SEGMENTS = ("segment_lower", "segment_upper", "slope", "intercept", "potential")


@dataclass(slots=True)
class LawTableBuilder:
    """Collect laws one by one; `table` returns all of them."""

    indices: list[tuple[int, int, int, bool, int]] = field(default_factory=list)
    values: list[tuple[float, float, float]] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    frictions: list[tuple[int, int, float, float]] = field(default_factory=list)

    def add_piecewise(
        self,
        row: int,
        *,
        breakpoints: Sequence[float] | Floats,
        slopes: Sequence[float] | Floats,
        offset: float = 0.0,
        input_index: int = -1,
        base_segment: int = -1,
        appears: float = -np.inf,
        disappears: float = np.inf,
        waits: bool = False,
    ) -> int:
        """Add a continuous piecewise-linear law with zero force at ``e = 0``.

        Parameters
        ----------
        row : int
            Row whose displacement it reads and along which it acts.
        breakpoints : sequence of float, length n
            Rising arguments between the segments [m].
        slopes : sequence of float, length n + 1
            Stiffness of each segment [N/m].
        offset : float
            Constant subtracted from the row [m].
        input_index : int
            Input (marker) subtracted from the row, -1 for none.
        base_segment : int
            Segment that the linear system already holds, -1 for none.
        appears, disappears : float
            The law acts for ``appears <= t <= disappears`` [s].
        waits : bool
            It appears only once its force would be zero: an object must fit.

        Returns
        -------
        int
            Index of the law.
        """
        found = _segments(tuple(map(float, breakpoints)), tuple(map(float, slopes)))
        if found is None:
            msg = f"law on row {row}: breakpoints must rise, one slope more than they"
            raise MechanicsError(msg)
        self.indices.append((row, input_index, base_segment, waits, len(found)))
        self.values.append((offset, appears, disappears))
        self.segments += found
        return len(self.indices) - 1

    def add_contact(
        self,
        row: int,
        *,
        stiffness: float,
        clearance: float,
        base_closed: bool = False,
        appears: float = -np.inf,
        disappears: float = np.inf,
        waits: bool = False,
    ) -> int:
        """Add a unilateral spring that acts once the row exceeds `clearance` (segment 1)."""
        return self.add_piecewise(
            row,
            breakpoints=(0.0,),
            slopes=(0.0, stiffness),
            offset=clearance,
            base_segment=1 if base_closed else -1,
            appears=appears,
            disappears=disappears,
            waits=waits,
        )

    def add_friction(
        self, row: int, *, normal: int, friction_coefficient: float, stick_stiffness: float
    ) -> int:
        """Add elastic-plastic Coulomb friction along `row`, limited by law `normal`."""
        self.frictions.append((row, normal, friction_coefficient, stick_stiffness))
        return len(self.frictions) - 1

    def table(self) -> LawTable:
        """Return the table of all laws and frictions added so far."""
        indices = np.array(self.indices, dtype=np.int64).reshape(-1, 5).T
        values = np.array(self.values, dtype=float).reshape(-1, len(_OF_LAWS)).T
        segments = np.array(self.segments, dtype=float).reshape(-1, len(_OF_SEGMENTS)).T
        frictions = np.array(self.frictions, dtype=float).reshape(-1, 4).T
        return LawTable(
            row=indices[0].copy(),
            input_index=indices[1].copy(),
            segment_start=np.concatenate(([0], np.cumsum(indices[4]))).astype(np.int64),
            base_segment=indices[2].copy(),
            waits=indices[3].copy(),
            **dict(zip(_OF_LAWS, values.copy(), strict=True)),
            **dict(zip(_OF_SEGMENTS, segments.copy(), strict=True)),
            friction_row=frictions[0].astype(np.int64),
            friction_normal=frictions[1].astype(np.int64),
            friction_coefficient=frictions[2].copy(),
            stick_stiffness=frictions[3].copy(),
        )

    def after(self, first: LawTable, known: dict[Hashable, SharedTableParts]) -> LawTable:
        """Return the laws of a table and after them those added so far, without their frictions.

        Parameters
        ----------
        first : LawTable
            Laws that never change.
        known : dict
            Shared parts of tables in which laws were put after these; missing ones are added.

        Returns
        -------
        LawTable
            Values of laws and segments are its own; other arrays are shared by all tables that are
            laid out alike.
        """
        key = tuple(self.indices)
        shared = known.get(key)
        if shared is None:
            if len(known) >= MOST_JOINED:
                known.clear()
            shared = known[key] = _joined(first, self.table())
        of_laws, of_segments = shared.of_laws.copy(), shared.of_segments.copy()
        if self.indices:
            of_laws[:, -len(self.values) :] = np.array(self.values).T
            of_segments[:, -len(self.segments) :] = np.array(self.segments).T
        return shared.table._replace(
            **dict(zip(_OF_LAWS, of_laws, strict=True)),
            **dict(zip(_OF_SEGMENTS, of_segments, strict=True)),
        )


def segments_at(table: LawTable, law: int, e: Floats | float) -> Ints:
    """Return the places in the table of the segments that hold arguments of a law.

    Examples
    --------
    >>> builder = LawTableBuilder()
    >>> law = builder.add_contact(0, stiffness=2.0, clearance=0.5)
    >>> segments_at(builder.table(), law, np.array([0.0, 1.0])).tolist()
    [0, 1]
    """
    first, end = table.segment_start[law], table.segment_start[law + 1]
    return np.asarray(first + np.searchsorted(table.segment_upper[first : end - 1], e))


def _joined(first: LawTable, second: LawTable) -> SharedTableParts:
    """Return the common parts of two joined tables and of such tables of other values."""
    starts = (first.segment_start, second.segment_start[1:] + first.segment_start[-1])
    table = LawTable(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))._replace(
        segment_start=np.concatenate(starts),
        friction_row=first.friction_row.copy(),
        friction_normal=first.friction_normal.copy(),
        friction_coefficient=first.friction_coefficient.copy(),
        stick_stiffness=first.stick_stiffness.copy(),
    )
    for array in table:
        array.flags.writeable = False
    of_laws = np.array([getattr(table, name) for name in _OF_LAWS])
    of_segments = np.array([getattr(table, name) for name in _OF_SEGMENTS])
    return SharedTableParts(table, of_laws, of_segments)


@lru_cache(maxsize=256)
def _segments(ends: tuple[float, ...], slopes: tuple[float, ...]) -> list[Segment] | None:
    """Return bounds, slope, intercept and potential of each segment; None if the ends do not rise.

    Laws of links and objects are mostly those of the throw before.
    """
    rising = all(before < after for before, after in pairwise(ends))
    if len(slopes) != len(ends) + 1 or not rising:
        return None
    lower, upper = [-math.inf, *ends], [*ends, math.inf]
    zero_segment = bisect_left(ends, 0.0)
    intercept, potential = [0.0] * len(slopes), [0.0] * len(slopes)
    for s in range(zero_segment + 1, len(slopes)):
        _continue(intercept, potential, slopes, s, s - 1, lower[s])
    for s in range(zero_segment - 1, -1, -1):
        _continue(intercept, potential, slopes, s, s + 1, upper[s])
    return list(zip(lower, upper, slopes, intercept, potential, strict=True))


def _continue(
    intercept: list[float],
    potential: list[float],
    slopes: Sequence[float],
    s: int,
    neighbour: int,
    at: float,
) -> None:
    """Set intercept and potential of segment `s` so that both join `neighbour` at `at`."""
    force = slopes[neighbour] * at + intercept[neighbour]
    energy = 0.5 * slopes[neighbour] * at**2 + intercept[neighbour] * at + potential[neighbour]
    intercept[s] = force - slopes[s] * at
    potential[s] = energy - 0.5 * slopes[s] * at**2 - intercept[s] * at
