"""One rail from its structure to a superelement with the points where laws act."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.core.content_cache import cached_arrays, digest
from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import RailBody, RailData, ReducedRail
from turnout.mechanism.structure import Structure, point_rows, rail_structure
from turnout.panel.records import RailMatrices
from turnout.reduction.craig_bampton import (
    Superelement,
    craig_bampton,
    reduce_matrix,
    reduce_vector,
)
from turnout.reduction.truncation import ReductionReport, reduction_report
from turnout.section.properties import SectionProperties

Floats = NDArray[np.float64]
MOST_RAILS = 48
"""So many reduced rails are kept in memory, the latest used."""

_rails = LRUCache[ReducedRail](MOST_RAILS)
_FIELDS = ("stiffness", "mass", "transformation", "frequencies_kept", "frequency_first_omitted")


def reduce_rail(data: RailData, *, first: int = 0) -> ReducedRail:
    """Assemble and reduce one rail, or find what was made of the same data before.

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
    if data.matrices is not None and not data.matrices.digest:  # of unknown content
        return _reduced(data, first=first)
    key = digest(_parts(data))
    found = _rails.get(key)
    if found is None:
        found = _rails.put(key, _reduced(data, first=0))
        for array in (found.stiffness, found.mass, found.damping, found.load, found.rows):
            array.flags.writeable = False
    return replace(found, body=replace(found.body, first=first))


def clear_memory() -> None:
    """Empty the memory of reduced rails."""
    _rails.clear()


def _parts(data: RailData) -> Iterator[object]:
    """Yield all that a reduced rail depends on."""
    for item in fields(data):
        value = getattr(data, item.name)
        if isinstance(value, SectionProperties):
            yield from (getattr(value, part.name) for part in fields(value))
        elif isinstance(value, RailMatrices):
            yield value.digest
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
    rows = point_rows(structure, data.points, name=data.name)
    at_dashpots = point_rows(structure, tuple(s.point for s in data.dashpots), name=data.name)
    reduced_dashpots = np.asarray(at_dashpots @ element.transformation)
    constants = np.array([s.damping for s in data.dashpots])
    damping = damping + (reduced_dashpots.T * constants) @ reduced_dashpots
    kept = element.frequencies_kept
    body = RailBody(
        name=data.name,
        closes=data.closes,
        x=structure.x,
        first=first,
        count=element.stiffness.shape[0],
        recovery=np.asarray(structure.motion @ element.transformation),
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


def superelement_of(data: RailData) -> tuple[Structure, Superelement, Floats]:
    """Return a rail with its fastenings, its superelement, and that one's damping.

    The dashpots of chairs are left out.
    """
    structure = rail_structure(data)
    rows = point_rows(structure, data.points, name=data.name)
    element = superelement(structure, rows, cutoff_frequency=data.cutoff_frequency)
    return structure, element, reduce_matrix(element, structure.damping)


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
    """Reduce a structure, or find what was made of these very matrices before."""
    interface = np.unique(rows.nonzero()[1]).astype(np.intp)
    stiffness, mass = structure.stiffness, structure.mass

    def made() -> dict[str, Floats]:
        element = craig_bampton(stiffness, mass, interface, cutoff_frequency=cutoff_frequency)
        return {name: np.asarray(getattr(element, name)) for name in _FIELDS}

    matrices = (stiffness.tocsr(), mass.tocsr())
    parts = [array for m in matrices for array in (m.data, m.indices, m.indptr)]
    kept = cached_arrays("superelement", [*parts, interface, float(cutoff_frequency)], made)
    return Superelement(
        stiffness=kept["stiffness"],
        mass=kept["mass"],
        transformation=kept["transformation"],
        interface=interface,
        frequencies_kept=kept["frequencies_kept"],
        frequency_first_omitted=float(kept["frequency_first_omitted"]),
        cutoff_frequency=float(cutoff_frequency),
    )
