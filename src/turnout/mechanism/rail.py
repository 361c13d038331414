"""One rail as data: beams or matrices, linear supports, the points where laws act."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.beam.material import Material
from turnout.mechanism.mechanism import RailBody
from turnout.panel.rail_matrices import RailMatrices
from turnout.section.properties import SectionProperties

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Point:
    """A displacement of a point fixed to a rail's section; `sign` turns it around."""

    x: float
    direction: str
    y: float = 0.0
    z: float = 0.0
    sign: float = 1.0


@dataclass(frozen=True, slots=True)
class Support:
    """A linear spring and dashpot from a point of the rail to the ground."""

    point: Point
    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True, slots=True)
class RailData:
    """All that shapes one rail, free of any file format.

    `axis_height`, one entry a node, is the height of the beams' reference line above the foot; the
    sections' heights are measured from it, those of points and supports from the foot. `damping`
    holds the factors of mass and beam stiffness; `dashpots` act in addition at points. `clamped`
    names the clamped ends, "first" and "last". `matrices` take the place of beams: `x`,
    `axis_height`, `sections` and `plan` mean nothing then. `plan`, one entry a node, is the lateral
    position of a reference line that is curved in plan; points stay offset along y there.
    """

    name: str
    closes: float
    x: Floats
    axis_height: Floats
    sections: SectionProperties
    material: Material
    gravity: float
    clamped: tuple[str, ...]
    damping: tuple[float, float]
    supports: tuple[Support, ...]
    dashpots: tuple[Support, ...]
    points: tuple[Point, ...]
    cutoff_frequency: float
    matrices: RailMatrices | None = None
    plan: Floats | None = None


@dataclass(frozen=True, slots=True)
class ReducedRail:
    """Matrices of one rail in reduced coordinates, and its points as rows."""

    body: RailBody
    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats
    rows: Floats


def rayleigh_factors(ratio: float, frequencies: list[float]) -> tuple[float, float]:
    """Return the factors of mass [1/s] and stiffness [s] for a damping ratio at frequencies.

    Two frequencies [Hz] fix both factors; one gives stiffness-proportional damping.

    Examples
    --------
    >>> mass, stiffness = rayleigh_factors(0.02, [2.0, 12.0])
    >>> omega = 2 * np.pi * 12.0
    >>> round(mass / (2 * omega) + stiffness * omega / 2, 12)
    0.02
    """
    omega = 2.0 * np.pi * np.asarray(frequencies, dtype=float)
    if omega.size == 1:
        return 0.0, float(2.0 * ratio / omega[0])
    factor = float(2.0 * ratio / (omega[0] + omega[1]))
    return factor * float(omega[0] * omega[1]), factor
