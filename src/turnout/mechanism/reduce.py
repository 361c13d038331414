"""Reduction of one rail to a superelement with the points that laws act on."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.beam.craig_bampton import (
    InnerShapes,
    Superelement,
    inner_shapes,
    reduce_vector,
    superelement_in,
)
from turnout.beam.reduction_error import ReductionReport, reduction_report
from turnout.beam.section_record import SectionProperties
from turnout.core.content_cache import cached_arrays, counts, digest
from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import RailBody, RailData, ReducedRail
from turnout.mechanism.structure import Structure, form_rows, rail_structure
from turnout.panel.records import RailMatrices

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
STORED_FROM_COORDINATES = 2000
"""Coordinates from which on shapes are always stored as files too."""
FIRST_STORED = 4
"""Of smaller rails the first so many that a process computes are: 15 to 30 ms each, 2 ms to read.
Further ones are mostly of varied sections, which no other process needs."""

_FIELDS = ("transformation", "frequencies", "frequency_first_omitted")
_rails = LRUCache[ReducedRail](24)
_reductions = LRUCache[tuple[Structure, Superelement, Floats]](6)


def reduce_rail(data: RailData, *, first: int = 0) -> ReducedRail:
    """Assemble and reduce one rail, or find the result of the same data from before.

    Parameters
    ----------
    data : RailData
        The rail.
    first : int
        Place of its first coordinate in the mechanism.

    Returns
    -------
    ReducedRail
        ``rows`` has shape (number of points, reduced coordinates). Its arrays are shared with every
        other caller and therefore not writeable.
    """
    key = content_key(data)
    if key is None:
        return _reduced(data, first=first)
    found = _rails.get(key)
    if found is None:
        found = _rails.put(key, _reduced(data, first=0))
        for array in (found.stiffness, found.mass, found.damping, found.load, found.rows):
            array.flags.writeable = False
    return replace(found, body=replace(found.body, first=first))


def content_key(data: RailData) -> str | None:
    """Return a digest of all that a reduced rail depends on; None for matrices without one."""
    if data.matrices is not None and not data.matrices.digest:
        return None
    return digest(_parts(getattr(data, item.name) for item in fields(data)))


def clear_superelements() -> None:
    """Empty the memory of reduced rails."""
    _rails.clear()
    _reductions.clear()


def _parts(values: Iterable[object]) -> Iterator[object]:
    """Yield values as arrays, numbers and texts."""
    for value in values:
        if isinstance(value, RailMatrices):
            yield value.digest
        elif isinstance(value, SectionProperties):
            yield from (getattr(value, part.name) for part in fields(value))
        elif isinstance(value, tuple) and value and is_dataclass(value[0]):
            yield from _columns(value)
        else:
            yield value


def _columns(records: Sequence[object]) -> Iterator[object]:
    """Yield each field of equal records as one array: there are hundreds, and texts are slow."""
    for item in fields(records[0]):  # type: ignore[arg-type]
        column = [getattr(record, item.name) for record in records]
        if is_dataclass(column[0]):
            yield from _columns(column)
        else:
            yield np.array(column)


def _reduced(data: RailData, *, first: int) -> ReducedRail:
    structure, element, damping = superelement_of(data)
    rows = form_rows(structure, data.points, name=data.name)
    at_dashpots = form_rows(structure, tuple(s.point for s in data.dashpots), name=data.name)
    constants = np.array([s.damping for s in data.dashpots])
    reduced_dashpots = np.asarray(at_dashpots @ element.transformation)
    damping = damping + (reduced_dashpots.T * constants) @ reduced_dashpots
    kept = element.frequencies_kept
    body = RailBody(
        name=data.name,
        closes=data.closes,
        x=structure.x,
        first=first,
        count=element.stiffness.shape[0],
        recovery=np.asarray(structure.motion @ element.transformation),
        at_interface=structure.known & ~_moved_beyond(structure.motion, element.interface),
        frequency_kept=float(kept[-1]) if kept.size else float("nan"),
        frequency_omitted=element.frequency_first_omitted,
        n_full=structure.load.size,
        n_interface=element.n_interface,
        with_supports=data.matrices is not None and data.matrices.with_supports,
    )
    return ReducedRail(
        body=body,
        stiffness=element.stiffness,
        mass=element.mass,
        damping=damping,
        load=reduce_vector(element, structure.load),
        rows=np.asarray(rows @ element.transformation),
    )


def _moved_beyond(motion: sp.csr_array, interface: Ints) -> NDArray[np.bool_]:
    """Return which displacements depend on coordinates that are not at the interface."""
    beyond = ~np.isin(motion.indices, interface) & (motion.data != 0.0)
    row = np.repeat(np.arange(motion.shape[0]), np.diff(motion.indptr))
    return np.bincount(row[beyond], minlength=motion.shape[0]) > 0


def superelement_of(data: RailData) -> tuple[Structure, Superelement, Floats]:
    """Return a rail with its fastenings, its superelement, and that one's damping.

    The dashpots of chairs are left out.
    """
    key = content_key(data)
    found = None if key is None else _reductions.get(key)
    if found is not None:
        return found
    structure = rail_structure(data)
    rows = form_rows(structure, data.points, name=data.name)
    element = superelement(structure, rows, cutoff_frequency=data.cutoff_frequency)
    made = structure, element, _reduced_damping(structure, element)
    return made if key is None else _reductions.put(key, made)


def _reduced_damping(structure: Structure, element: Superelement) -> Floats:
    """Return the damping in reduced coordinates; few of the full have other than Rayleigh's."""
    of_mass, of_stiffness = structure.rayleigh
    beyond = sp.csr_array(structure.beyond_rayleigh)
    places = np.flatnonzero(np.diff(beyond.indptr))
    at_places = element.transformation[places]
    reduced: Floats = at_places.T @ (beyond[places] @ element.transformation)
    return of_mass * element.mass + of_stiffness * element.stiffness + reduced


def reduction_of(data: RailData) -> ReductionReport:
    """Compare the superelement of a rail with the structure that it stands for."""
    structure, element, _ = superelement_of(data)
    return reduction_report(element, structure.stiffness, structure.mass)


def superelement(
    structure: Structure, rows: sp.csr_array, *, cutoff_frequency: float
) -> Superelement:
    """Reduce a structure to the coordinates that some rows use, and its modes below a cut-off.

    What came reduced is taken as it is. A superelement is kept by the content of the matrices:
    friction, drives, contacts and dampers are no part of them, so changing these reduces nothing.
    """
    if not structure.reduced:
        return _kept_superelement(structure, rows, cutoff_frequency=cutoff_frequency)
    size = structure.load.size
    return Superelement(
        stiffness=structure.stiffness.toarray(),
        mass=structure.mass.toarray(),
        transformation=np.eye(size),
        interface=np.arange(size),
        frequencies_kept=np.zeros(0),
        frequency_first_omitted=float("nan"),
        cutoff_frequency=cutoff_frequency,
    )


def _kept_superelement(
    structure: Structure, rows: sp.csr_array, *, cutoff_frequency: float
) -> Superelement:
    """Reduce a structure, with shapes that were found for these very matrices before if there are.

    Springs at the interface change no shape, and a rail and its image in the plane of x and z have
    the same ones but for signs: both rails of a symmetric panel share theirs.
    """
    interface = np.unique(rows.indices[rows.data != 0.0]).astype(np.intp)
    stiffness, mass = structure.stiffness, structure.mass
    signs = _signs(structure)
    if signs is not None:
        stiffness, mass = _signed(stiffness, signs), _signed(mass, signs)

    def found() -> dict[str, Floats]:
        shapes = inner_shapes(stiffness, mass, interface, cutoff_frequency=cutoff_frequency)
        return {name: np.asarray(getattr(shapes, name)) for name in _FIELDS}

    at_interface = np.zeros(structure.load.size, dtype=bool)
    at_interface[interface] = True
    row = np.repeat(at_interface, np.diff(stiffness.indptr))
    inner = np.where(row & at_interface[stiffness.indices], 0.0, stiffness.data)
    pattern = (stiffness.indices, stiffness.indptr, mass.indices, mass.indptr)
    parts = [inner, mass.data, *pattern, interface, float(cutoff_frequency)]
    on_disk = (
        structure.load.size >= STORED_FROM_COORDINATES
        or counts["superelement computed"] < FIRST_STORED
    )
    kept = cached_arrays("superelement", parts, found, on_disk=on_disk)
    transformation = kept["transformation"]
    if signs is not None:
        transformation = signs[:, np.newaxis] * transformation
        transformation[:, : interface.size] *= signs[interface]
    shapes = InnerShapes(
        transformation=transformation,
        interface=interface,
        frequencies=kept["frequencies"],
        frequency_first_omitted=float(kept["frequency_first_omitted"]),
        cutoff_frequency=float(cutoff_frequency),
    )
    return superelement_in(shapes, structure.stiffness, structure.mass)


def _signs(structure: Structure) -> Floats | None:
    """Return the signs that mirror a rail, if it is the one of two images to be mirrored.

    That is the one whose first stiffness between coordinates that keep and that change their sign
    is negative.
    """
    mirror, stiffness = structure.mirror, structure.stiffness
    if mirror is None:
        return None
    turned = np.repeat(mirror, np.diff(stiffness.indptr)) * mirror[stiffness.indices] < 0.0
    first = stiffness.data[turned & (stiffness.data != 0.0)][:1]
    return mirror if first.size and first[0] < 0.0 else None


def _signed(matrix: sp.csr_array, signs: Floats) -> sp.csr_array:
    """Return a matrix with signs on its rows and columns."""
    data = np.repeat(signs, np.diff(matrix.indptr)) * matrix.data * signs[matrix.indices]
    return sp.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)
