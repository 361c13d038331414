"""Laws as rows of one piecewise-linear table, and friction rows that name their normal law.

Every law is scalar. It reads one generalised displacement (a *row*, `g`) of the mechanism, forms
its argument ``e = g - offset - input(t)`` and resists with ``F = k e + f`` of the segment that
holds `e`; the force on the structure along the row is ``-F``. Contacts, bushings, links and foreign
objects differ in their numbers only. A friction law acts along its own row and has the limit
``friction_coefficient * F`` of its normal law.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.errors import MechanicsError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class LawTable(NamedTuple):
    """All laws of a mechanism as arrays; indices are int64, reals float64.

    In the table for the kernels, `turnout.integrate.numbering.place_laws`, rows are places.

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


@dataclass(slots=True)
class LawTableBuilder:
    """Collect laws one by one; `table` returns all of them."""

    laws: list[tuple[int, float, int, int, float, float, bool]] = field(default_factory=list)
    segments: list[list[tuple[float, float, float, float, float]]] = field(default_factory=list)
    frictions: list[tuple[int, int, float, float]] = field(default_factory=list)

    def add_piecewise(
        self,
        row: int,
        *,
        breakpoints: Floats,
        slopes: Floats,
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
        breakpoints : ndarray, shape (n,)
            Rising arguments between the segments [m].
        slopes : ndarray, shape (n + 1,)
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
        ends = [float(value) for value in breakpoints]  # so few that lists are quicker than arrays
        inner = [float(value) for value in slopes]
        rising = all(before < after for before, after in pairwise(ends))
        if len(inner) != len(ends) + 1 or not rising:
            msg = f"law on row {row}: breakpoints must rise, one slope more than they"
            raise MechanicsError(msg)
        lower, upper = [-math.inf, *ends], [*ends, math.inf]
        zero_segment = bisect_left(ends, 0.0)
        intercept, potential = [0.0] * len(inner), [0.0] * len(inner)
        for s in range(zero_segment + 1, len(inner)):
            _continue(intercept, potential, inner, s, s - 1, lower[s])
        for s in range(zero_segment - 1, -1, -1):
            _continue(intercept, potential, inner, s, s + 1, upper[s])
        self.laws.append((row, offset, input_index, base_segment, appears, disappears, waits))
        self.segments.append(
            list(zip(lower, upper, inner, intercept, potential, strict=True)),
        )
        return len(self.laws) - 1

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
            breakpoints=np.array([0.0]),
            slopes=np.array([0.0, stiffness]),
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
        laws = np.array(self.laws, dtype=float).reshape(-1, 7)
        flat = np.array([s for law in self.segments for s in law], dtype=float).reshape(-1, 5)
        counts = [len(law) for law in self.segments]
        frictions = np.array(self.frictions, dtype=float).reshape(-1, 4)
        columns = [np.ascontiguousarray(c) for c in flat.T]
        return LawTable(
            row=laws[:, 0].astype(np.int64),
            offset=laws[:, 1].copy(),
            input_index=laws[:, 2].astype(np.int64),
            segment_start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
            segment_lower=columns[0],
            segment_upper=columns[1],
            slope=columns[2],
            intercept=columns[3],
            potential=columns[4],
            base_segment=laws[:, 3].astype(np.int64),
            appears=laws[:, 4].copy(),
            disappears=laws[:, 5].copy(),
            waits=laws[:, 6].astype(np.int64),
            friction_row=frictions[:, 0].astype(np.int64),
            friction_normal=frictions[:, 1].astype(np.int64),
            friction_coefficient=frictions[:, 2].copy(),
            stick_stiffness=frictions[:, 3].copy(),
        )


def _continue(
    intercept: list[float],
    potential: list[float],
    slopes: list[float],
    s: int,
    neighbour: int,
    at: float,
) -> None:
    """Set intercept and potential of segment `s` so that both join `neighbour` at `at`."""
    force = slopes[neighbour] * at + intercept[neighbour]
    energy = 0.5 * slopes[neighbour] * at**2 + intercept[neighbour] * at + potential[neighbour]
    intercept[s] = force - slopes[s] * at
    potential[s] = energy - 0.5 * slopes[s] * at**2 - intercept[s] * at
