r"""Rails that differ from a nominal one in their sections and fastenings, reduced to its shapes.

With the Craig-Bampton shapes T of the nominal rail a varied one has

.. math:: T^T K T = c\, k(\sqrt s) + \sum_j k_j p_j p_j^T, \qquad T^T M T = c\, m(\sqrt s),

where c and s are the ratios of its `section_scale` and `lateral_inertia_scale` to those of the
nominal rail and p_j the projected rows of its fastenings. An element with all of its section scaled
by c has c times the stiffness, mass and weight, since its shear flexibility relative to bending
stays; the lateral scale enters them through its root. Beams are projected at a few roots of s,
and interpolated by the polynomial through these (Chebyshev points, error below 1e-7): nothing is
assembled for a rail, and its rows are those of the nominal one. What else follows from the matrices
of a rail with the nominal fastenings, such as its modes, is a `Surface` over both ratios, a
polynomial through `GRID`, so that no matrix of it is ever formed.

The static shapes are those of the nominal rail, so the interface of a varied one is too stiff, by
an error of second order in the variation. Scales, and the mean stiffness of fastenings in a
direction, that are further than half a `STEP` from the nominal ones belong to another nominal rail,
a whole number of steps away, with shapes of its own. The error at the corners of that range is
estimated by `variation_error`; a rail that exceeds `MOST_ERROR` gets shapes of its own.
"""

import itertools
import logging
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.beam.craig_bampton import reduce_matrix, reduce_vector
from turnout.beam.reduction_error import static_error
from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import Matrices, RailBody, RailData, ReducedRail, Support
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
_DEGREE = 6
"""Of the polynomials of a surface: over the whole range their error is below 1e-5."""
MOST_SURFACE_ERROR = 2e-5
"""Largest error of an array of a surface in a corner of its range, by its largest entry [-]."""
TOGETHER = 8
"""Rails of which a surface is evaluated at once, fewer with zeros beside them: so many take little
longer than one, and what one gets does not depend on the others."""
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
    surfaces : LRUCache
        What follows from the matrices of its rails, by what it is; None where it is not smooth.
    latest : list of Cohort
        The latest one.
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
    surfaces: "LRUCache[tuple[Surface | None]]" = field(default_factory=lambda: LRUCache(16))
    latest: "list[Cohort]" = field(default_factory=list)

    def matrices(self, scale: float, root: float, added: "Floats | None" = None) -> "Matrices":
        """Return the matrices of a rail.

        Parameters
        ----------
        scale, root : float
            c and the root of s, ratios of its scales to the nominal ones.
        added : ndarray, shape (2, n_supports), optional
            Stiffness and damping of its fastenings beyond the nominal ones.
        """
        weights = scale * _lagrange(self.roots, root)
        beam, mass = np.tensordot(weights, self.beams, axes=1)
        of_mass, of_stiffness = self.rayleigh
        stiffness = beam + self.springs
        damping = of_mass * mass + of_stiffness * beam + self.damping
        if added is not None:
            stiffness += (self.rows.T * added[0]) @ self.rows
            damping += (self.rows.T * added[1]) @ self.rows
        found = Matrices(stiffness, mass, damping, weights @ self.weight)
        for array in (stiffness, mass, damping, found.load):
            array.flags.writeable = False
        return found

    def join(self, ratios: tuple[float, float]) -> "tuple[Cohort, int]":
        """Return a cohort that a rail with some ratios joins, and its number there."""
        if not self.latest or not self.latest[0].takes(ratios):
            self.latest[:] = [Cohort()]
        cohort = self.latest[0]
        return cohort, cohort.numbers.setdefault(ratios, len(cohort.numbers))

    def surface(self, key: Hashable, make: "Make") -> "Surface | None":
        """Return the surface of the arrays that `make` takes from matrices, None without one."""
        kept = self.surfaces.get((key,))
        if kept is None:
            kept = self.surfaces.put((key,), (_made_surface(self, make),))
        return kept[0]


Make = Callable[[Matrices], tuple[Floats, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Arrays of a rail as polynomials of the ratios of its scales.

    Attributes
    ----------
    coefficients : ndarray, shape (n_terms, n)
        Of `_terms`, of all arrays.
    shapes : tuple of tuple of int
        Of each array.
    """

    coefficients: Floats
    shapes: tuple[tuple[int, ...], ...]

    def arrays(self, values: Floats) -> tuple[Floats, ...]:
        """Return values of all arrays, shape (n,), in their shapes."""
        found, first = list[Floats](), 0
        for shape in self.shapes:
            found.append(values[first : first + math.prod(shape)].reshape(shape))
            first += math.prod(shape)
        return tuple(found)


class Cohort:
    """Rails of a family that are evaluated together: all that join before the first is evaluated.

    Attributes
    ----------
    numbers : dict
        Number of each rail by c and s.
    """

    def __init__(self) -> None:
        self.numbers: dict[tuple[float, float], int] = {}
        self._found: dict[tuple[Hashable, int], Floats] = {}

    def takes(self, ratios: tuple[float, float]) -> bool:
        """Return True if a rail is one of these, or can still join them."""
        return not self._found or ratios in self.numbers

    @cached_property
    def _terms(self) -> Floats:
        points = np.array([(scale, math.sqrt(lateral)) for scale, lateral in self.numbers])
        padded = -(-len(points) // TOGETHER) * TOGETHER
        return np.pad(_terms(points), ((0, padded - len(points)), (0, 0)))

    def at(self, key: Hashable, surface: Surface, number: int) -> tuple[Floats, ...]:
        """Return the arrays of a surface, which has a key, for one of the rails."""
        group, own = divmod(number, TOGETHER)
        found = self._found.get((key, group))
        if found is None:
            terms = self._terms[group * TOGETHER : (group + 1) * TOGETHER]
            found = self._found[key, group] = terms @ surface.coefficients
            found.flags.writeable = False
        return surface.arrays(found[own])


class VariedRail(ReducedRail):
    """A rail of a family.

    Parameters
    ----------
    family : RailFamily
        Of the nominal rail.
    body : RailBody
        The nominal rail in its place in the mechanism.
    ratios : tuple of float
        c and s of its scales to those of the nominal rail.
    added : ndarray, shape (2, n_supports), optional
        Stiffness and damping of its fastenings beyond the nominal ones.
    """

    family: RailFamily
    _ratios: tuple[float, float]
    _added: Floats | None
    _member: tuple[Cohort, int]

    def __init__(
        self,
        family: RailFamily,
        body: RailBody,
        *,
        ratios: tuple[float, float],
        added: Floats | None,
    ) -> None:
        own = {"body": body, "rows": family.nominal.rows, "family": family}
        own |= {"_ratios": ratios, "_added": added, "_member": family.join(ratios)}
        for name, value in own.items():
            object.__setattr__(self, name, value)

    def follow(self, key: Hashable, make: Make) -> tuple[Floats, ...] | None:
        """Return arrays that follow from the matrices of the rail, from a surface.

        None where its fastenings are not the nominal ones, or there is no surface.

        Parameters
        ----------
        key : hashable
            What they are.
        make : callable
            Takes matrices and returns arrays; there is a surface where these have the same shapes
            for all rails of the family, and vary smoothly.
        """
        surface = None if self._added is not None else self.family.surface(key, make)
        if surface is None:
            return None
        cohort, number = self._member
        return cohort.at(key, surface, number)

    @cached_property
    def matrices(self) -> Matrices:
        """Matrices of the rail."""
        scale, lateral = self._ratios
        return self.family.matrices(scale, math.sqrt(lateral), self._added)

    @property
    def stiffness(self) -> Floats:
        """Stiffness."""
        return self.matrices.stiffness

    @property
    def mass(self) -> Floats:
        """Mass."""
        return self.matrices.mass

    @property
    def damping(self) -> Floats:
        """Damping."""
        return self.matrices.damping

    @property
    def load(self) -> Floats:
        """Weight [N]."""
        return self.matrices.load


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
) -> VariedRail | None:
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
    return VariedRail(family, body, ratios=ratios, added=added if added.any() else None)


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


def _nodes(low: float, high: float, count: int = _NODES) -> Floats:
    """Return the Chebyshev points of a range."""
    angle = np.pi * (np.arange(count) + 0.5) / count
    return 0.5 * (low + high) + 0.5 * (high - low) * np.cos(angle)


_RANGES = np.array([(STEP**-0.5, STEP**0.5), (STEP**-0.25, STEP**0.25)])
"""Of c, and of the root of s."""
GRID = np.array(
    [*itertools.product(*(_nodes(low, high, _DEGREE + 1) for low, high in _RANGES.tolist()))]
)
"""Ratios c and roots of s through which surfaces go."""
_PAIRS = np.array([pair for pair in np.ndindex(_DEGREE + 1, _DEGREE + 1) if sum(pair) <= _DEGREE])


def _terms(points: Floats) -> Floats:
    """Return products of Chebyshev polynomials of c and of the root of s, shape (n, n_terms)."""
    low, high = _RANGES.T
    angles = np.arccos(np.clip((2.0 * points - low - high) / (high - low), -1.0, 1.0))
    found: Floats = np.cos(angles[:, np.newaxis] * _PAIRS).prod(axis=2)
    return found


def _made_surface(family: RailFamily, make: Make) -> Surface | None:
    """Return the surface of some arrays, if they are smooth and there everywhere."""
    made = [make(family.matrices(*point)) for point in (*GRID.tolist(), *_RANGES.T.tolist())]
    shapes, *others = (tuple([array.shape for array in arrays]) for arrays in made)
    if any(other != shapes for other in others):
        return None
    *through, low, high = [np.concatenate([part.ravel() for part in arrays]) for arrays in made]
    fitted, *_ = np.linalg.lstsq(_terms(GRID), np.array(through), rcond=None)
    surface = Surface(fitted, shapes)
    for own, wanted in zip(_terms(_RANGES.T) @ fitted, (low, high), strict=True):
        pairs = zip(surface.arrays(own), surface.arrays(wanted), strict=True)
        if any(abs(a - b).max() > MOST_SURFACE_ERROR * abs(b).max() for a, b in pairs):
            return None
    return surface


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
