"""One rail from beams and linear supports to a superelement with the points where laws act."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.beam.assembly import BeamModel, assemble_beam, node_index, point_row
from turnout.beam.material import Material
from turnout.mechanism.mechanism import RailBody
from turnout.reduction.craig_bampton import craig_bampton, reduce_matrix, reduce_vector
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
    names the clamped ends, "first" and "last".
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


@dataclass(frozen=True, slots=True)
class ReducedRail:
    """Matrices of one rail in reduced coordinates, and its points as rows."""

    body: RailBody
    stiffness: Floats
    mass: Floats
    damping: Floats
    load: Floats
    rows: Floats


def reduce_rail(data: RailData, *, first: int = 0) -> ReducedRail:
    """Assemble and reduce one rail.

    Parameters
    ----------
    data : RailData
        The rail.
    first : int
        Place of its first coordinate in the mechanism.

    Returns
    -------
    ReducedRail
        ``rows`` has shape (number of points, reduced coordinates).
    """
    beam = assemble_beam(
        data.x, data.sections, data.material, gravity=data.gravity, name=f"rail {data.name}"
    )
    size = beam.gravity_load.size
    free = np.arange(6 if "first" in data.clamped else 0, size - 6 * ("last" in data.clamped))
    support_rows = _rows(beam, data, tuple(s.point for s in data.supports))
    springs = np.array([s.stiffness for s in data.supports])
    dashpots = np.array([s.damping for s in data.supports])
    stiffness = beam.stiffness + support_rows.T @ sp.diags_array(springs) @ support_rows
    mass_factor, stiffness_factor = data.damping
    damping = (
        mass_factor * beam.mass
        + stiffness_factor * beam.stiffness
        + support_rows.T @ sp.diags_array(dashpots) @ support_rows
    )
    rows = _rows(beam, data, data.points).tocsr()[:, free]
    interface = np.unique(rows.nonzero()[1]).astype(np.intp)
    element = craig_bampton(
        _free(stiffness, free),
        _free(beam.mass, free),
        interface,
        cutoff_frequency=data.cutoff_frequency,
    )
    reduced_damping = reduce_matrix(element, _free(damping, free))
    reduced_rows = np.asarray(rows @ element.transformation)
    dashpot_rows = _rows(beam, data, tuple(s.point for s in data.dashpots)).tocsr()[:, free]
    at_dashpots = np.asarray(dashpot_rows @ element.transformation)
    constants = np.array([s.damping for s in data.dashpots])
    reduced_damping += (at_dashpots.T * constants) @ at_dashpots
    recovery = np.zeros((size, element.stiffness.shape[0]))
    recovery[free] = element.transformation
    recovery[0::6] -= data.axis_height[:, None] * recovery[4::6]
    recovery[1::6] += data.axis_height[:, None] * recovery[3::6]
    kept = element.frequencies_kept
    body = RailBody(
        name=data.name,
        closes=data.closes,
        x=beam.x,
        first=first,
        count=element.stiffness.shape[0],
        recovery=recovery,
        frequency_kept=float(kept[-1]) if kept.size else float("nan"),
        frequency_omitted=element.frequency_first_omitted,
        n_full=free.size,
        n_interface=interface.size,
    )
    return ReducedRail(
        body=body,
        stiffness=element.stiffness,
        mass=element.mass,
        damping=reduced_damping,
        load=reduce_vector(element, beam.gravity_load[free]),
        rows=reduced_rows,
    )


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


def _rows(beam: BeamModel, data: RailData, points: tuple[Point, ...]) -> sp.csr_array:
    rows = [
        p.sign
        * point_row(beam, p.x, p.direction, y=p.y, z=p.z - data.axis_height[node_index(beam, p.x)])
        for p in points
    ]
    return sp.csr_array(np.array(rows).reshape(len(rows), beam.gravity_load.size))


def _free(matrix: sp.csr_array, free: NDArray[np.intp]) -> sp.csr_array:
    return sp.csr_array(matrix.tocsr()[free][:, free])
