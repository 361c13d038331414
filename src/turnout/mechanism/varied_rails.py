r"""Rails that differ from a nominal one in their sections and fastenings, reduced to its shapes.

With the Craig-Bampton shapes T of the nominal rail a varied one has

.. math:: T^T K T = c\, k(\sqrt s) + \sum_j k_j p_j p_j^T, \qquad T^T M T = c\, m(\sqrt s),

where c and s are the ratios of its `section_scale` and `lateral_inertia_scale` to those of the
nominal rail and p_j the projected rows of its fastenings. An element with all of its section scaled
by c has c times the stiffness, mass and weight, since its shear flexibility relative to bending
stays; the lateral scale enters them through its root. Beams are projected at a few roots of s,
and interpolated by the polynomial through these (Chebyshev points, error below 1e-7): nothing is
assembled for a rail, and its rows are those of the nominal one.

The static shapes are those of the nominal rail, so the interface of a varied one is too stiff, by
an error of second order in the variation. Scales, and the mean stiffness of fastenings in a
direction, that are further than half a `STEP` from the nominal ones belong to another nominal rail,
a whole number of steps away, with shapes of its own. The error at the corners of that range is
estimated by `variation_error`; a rail that exceeds `MOST_ERROR` gets shapes of its own.
"""

import itertools
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.beam.craig_bampton import reduce_matrix, reduce_vector
from turnout.beam.reduction_error import static_error
from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import RailBody, RailData, ReducedRail, Support
from turnout.mechanism.rail_sections import scale_sections
from turnout.mechanism.reduce import content_key, superelement_of
from turnout.mechanism.structure import form_rows, unsupported_beams

Floats = NDArray[np.float64]
STEP = 1.25
"""Ratio of the scales of neighbouring nominal rails."""
MOST_SUPPORT = 1.15
"""A rail with a fastening stiffer or softer than the nominal one by more gets shapes of its own."""
MOST_ERROR = 3e-3
"""Largest error of the interface compliance, relative to the root of the diagonal entries [-]."""
_NODES = 7
_log = logging.getLogger("turnout")


def nominal_scale(scale: float, nominal: float) -> float:
    """Return the scale of the nominal rail that a varied one belongs to.

    Examples
    --------
    >>> nominal_scale(1.1, 1.0), nominal_scale(0.9, 1.0), nominal_scale(1.2, 1.0)
    (1.0, 1.0, 1.25)
    """
    return float(nominal * STEP ** round(math.log(scale / nominal) / math.log(STEP)))


@dataclass(frozen=True, slots=True, eq=False)
class RailFamily:
    """A nominal rail with all that its variations are made of.

    Attributes
    ----------
    nominal : ReducedRail
        With its own shapes.
    supports : tuple of Support
        Its fastenings.
    roots : ndarray, shape (n_nodes,)
        Ratios of the root of the lateral scale that beams were projected at.
    beams : ndarray, shape (n_nodes, 2, n, n)
        Projected stiffness and mass of the beams alone.
    weight : ndarray, shape (n_nodes, n)
        Projected weight [N].
    rows : ndarray, shape (n_supports, n)
        Projected rows of the fastenings.
    springs : ndarray, shape (n, n)
        Projected stiffness of all nominal fastenings.
    damping : ndarray, shape (n, n)
        Projected damping beyond that of the beams.
    rayleigh : tuple of float
        Factors of mass [1/s] and of the stiffness of the beams [s] in the damping.
    error : float
        Estimate of `variation_error` at the corners of the range.
    """

    nominal: ReducedRail
    supports: tuple[Support, ...]
    roots: Floats
    beams: Floats
    weight: Floats
    rows: Floats
    springs: Floats
    damping: Floats
    rayleigh: tuple[float, float]
    error: float


_families = LRUCache[RailFamily](24)


def rail_family(data: RailData, nominal: ReducedRail) -> RailFamily | None:
    """Return the family of a nominal rail; None of rails that came as matrices.

    Parameters
    ----------
    data : RailData
        The nominal rail.
    nominal : ReducedRail
        The same, reduced.
    """
    key = content_key(data)
    if data.matrices is not None or key is None:
        return None
    found = _families.get(key)
    return _families.put(key, _made_family(data, nominal)) if found is None else found


def clear_families() -> None:
    """Empty the memory of families."""
    _families.clear()


def varied_rail(
    family: RailFamily,
    body: RailBody,
    *,
    ratios: tuple[float, float],
    supports: tuple[Support, ...],
) -> ReducedRail | None:
    """Return a rail of a family; None if it needs shapes of its own.

    Parameters
    ----------
    family : RailFamily
        Of the nominal rail.
    body : RailBody
        The nominal rail in its place in the mechanism.
    ratios : tuple of float
        c and s of its scales to those of the nominal rail.
    supports : tuple of Support
        Its fastenings.
    """
    added = _added_supports(family.supports, supports)
    if added is None or family.error > MOST_ERROR:
        return None
    scale, lateral = ratios
    weights = scale * _lagrange(family.roots, math.sqrt(lateral))
    beam, mass = np.tensordot(weights, family.beams, axes=1)
    of_mass, of_stiffness = family.rayleigh
    stiffness = beam + family.springs
    damping = of_mass * mass + of_stiffness * beam + family.damping
    if added.any():
        stiffness += (family.rows.T * added[0]) @ family.rows
        damping += (family.rows.T * added[1]) @ family.rows
    nominal, load = family.nominal, weights @ family.weight
    for array in (stiffness, mass, damping, load):
        array.flags.writeable = False
    return ReducedRail(
        body=body,
        stiffness=stiffness,
        mass=mass,
        damping=damping,
        load=load,
        rows=nominal.rows,
        nominal=nominal,
    )


def variation_error(data: RailData, *, scales: Sequence[float] = (STEP**-0.5, STEP**0.5)) -> float:
    """Return the largest error of a varied rail in the shapes of the nominal one.

    It is the `static_error` of the interface compliance in the corners of a range of both scales.

    Parameters
    ----------
    data : RailData
        The nominal rail, of beams.
    scales : sequence of float
        Ratios of a varied rail's scales to its own.
    """
    structure, element, _ = superelement_of(data)
    beams = unsupported_beams(data)[0]
    springs = sp.csr_array(structure.stiffness - beams)
    found = 0.0
    for lateral in scales:
        own = unsupported_beams(_scaled(data, lateral=lateral))[0]
        for scale in scales:
            whole = sp.csr_array(scale * own + springs)
            error, _ = static_error(
                replace(element, stiffness=reduce_matrix(element, whole)), whole
            )
            found = max(found, error)
    return found


def _made_family(data: RailData, nominal: ReducedRail) -> RailFamily:
    structure, element, _ = superelement_of(data)
    shapes = element.transformation
    roots = _nodes(STEP**-0.25, STEP**0.25)
    count = shapes.shape[1]
    beams, weight = np.empty((_NODES, 2, count, count)), np.empty((_NODES, count))
    for number, root in enumerate(roots.tolist()):
        *matrices, load = unsupported_beams(_scaled(data, lateral=root**2))
        for place, matrix in enumerate(matrices):
            reduced = reduce_matrix(element, matrix)
            beams[number, place] = 0.5 * (reduced + reduced.T)
        weight[number] = reduce_vector(element, load)
    own = reduce_matrix(element, unsupported_beams(data)[0])
    whole = reduce_matrix(element, structure.stiffness)
    rows = form_rows(structure, tuple(s.point for s in data.supports), name=data.name)
    of_mass, of_stiffness = structure.rayleigh
    damping = nominal.damping - of_mass * nominal.mass - of_stiffness * own
    error = variation_error(data)
    if not error <= MOST_ERROR:
        _log.warning(
            "rail %s: sections that differ by %.0f %% make an error of %.0e in its nominal shapes, "
            "at most %.0e; each varied rail is reduced anew, which takes several times as long",
            data.name, 100.0 * (STEP**0.5 - 1.0), error, MOST_ERROR,
        )  # fmt: skip
    return RailFamily(
        nominal=nominal,
        supports=data.supports,
        roots=roots,
        beams=beams,
        weight=weight,
        rows=np.asarray(rows @ shapes).reshape(-1, count),
        springs=0.5 * ((whole - own) + (whole - own).T),
        damping=0.5 * (damping + damping.T),
        rayleigh=(of_mass, of_stiffness),
        error=error,
    )


def _scaled(data: RailData, *, lateral: float) -> RailData:
    return replace(data, sections=scale_sections(data.sections, every=1.0, lateral=lateral))


def _nodes(low: float, high: float) -> Floats:
    """Return the Chebyshev points of a range."""
    angle = np.pi * (np.arange(_NODES) + 0.5) / _NODES
    return 0.5 * (low + high) + 0.5 * (high - low) * np.cos(angle)


def _lagrange(nodes: Floats, at: float) -> Floats:
    """Return the weights of values at some nodes in the polynomial through them."""
    away = nodes - at
    apart = nodes - nodes[:, np.newaxis]
    np.fill_diagonal(apart, 1.0)
    rest = np.where(np.eye(nodes.size, dtype=bool), 1.0, away)
    found: Floats = (rest / apart).prod(axis=1)
    return found


def _added_supports(nominal: tuple[Support, ...], supports: tuple[Support, ...]) -> Floats | None:
    """Return stiffness and damping beyond the nominal ones, shape (2, n_supports), or None.

    None where other points are held, or one far stiffer or softer.
    """
    if supports is nominal:
        return np.zeros((2, len(nominal)))
    pairs = list(itertools.zip_longest(nominal, supports))
    if any(a is None or b is None or a.point != b.point for a, b in pairs):
        return None
    own, of = (
        np.array([(item.stiffness, item.damping) for item in one]).reshape(-1, 2)
        for one in (supports, nominal)
    )
    far = (own[:, 0] > MOST_SUPPORT * of[:, 0]) | (of[:, 0] > MOST_SUPPORT * own[:, 0])
    added: Floats = (own - of).T
    return None if far.any() else added
