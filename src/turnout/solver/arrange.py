"""Condense a mechanism for the kernels.

Runs that differ only in values of laws (friction, clearances, saturation forces, times) or in the
motion share modes and structure, which are therefore condensed once and cached. Mechanisms built
from the same records share their matrices, which are read-only then; the cache knows them by their
identity. The rows of foreign objects come last and are added to the condensed rails, so that an
object in another place costs its own displacements and flexibilities, and no modes.

A run takes its memory out and gives it back at its end, so that no two runs ever write to one.
Compliances depend on the condensed rails and the length of the step (`turnout.solver.columns`), not
on laws: throws of a study that differ in friction, stiffness of drives, slip levels and the object
have them alike. Where objects stand matters for their own rows and columns alone, which are made
again. States and scratch arrays are only laid out alike, which takes longer than to fill them.
Rails of which there is a single throw give nothing back.
"""

from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError
from turnout.core.lru_cache import LRUCache
from turnout.core.scheme import Scheme
from turnout.kernels.shared_record import record_like, shared_record
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.condense import (
    BlockModel,
    CondensedRails,
    Leading,
    condense_blocks,
    drop_joining_bases,
    folded_stiffness,
    sum_at_rows,
)
from turnout.solver.modal import ModalModel
from turnout.solver.system import (
    PLACED,
    Floats,
    Places,
    System,
    check_normals,
    condensed_system,
    move_added_ends,
    number_places,
    place_laws,
    refill_system,
)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Condensed rails, without what depends on where in its blocks an object stands.

    Attributes
    ----------
    system : System
        Of one arrangement.
    places : Places
        Of its ends, modes and rows.
    leading : tuple of Leading
        Choices of leading rows; kept, as rails with the same ones share a layout.
    fresh : dict
        Vectors of a state at rest and of scratch arrays, by numbers of inputs and of levels; rails
        of other sections share them.
    feet : dict
        Modes at the feet of frictions whose curves follow speed, by the rows of the frictions.
    """

    system: System
    places: Places
    leading: tuple[Leading, ...]
    fresh: dict[tuple[int, int], tuple[Floats, ...]]
    feet: dict[bytes, dict[str, NDArray[Any]]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Arrangement:
    """A condensed mechanism.

    Attributes
    ----------
    mechanism : Mechanism
        What was condensed; keeps alive the matrices whose identities are the key of the cache.
    laws : LawTable
        The laws as integrated: those that join rails are not part of the linear system.
    table : LawTable
        The same for the kernels, as a shared record whose rows are places.
    condensed : CondensedRails
        Modes and flexibility of the rails, in the coordinates of the mechanism.
    system : System
        Condensed system of the model, laid out for the kernels.
    frame : Frame
        What does not depend on where in its blocks an object stands.
    known : bool
        Whether rails of this layout have been arranged before.
    """

    mechanism: Mechanism
    laws: LawTable
    table: LawTable
    condensed: CondensedRails
    system: System
    frame: Frame
    known: bool

    @property
    def model(self) -> ModalModel:
        """Modes and flexibility of the rails, in the coordinates of the mechanism."""
        return self.condensed.model


@dataclass(frozen=True, slots=True, eq=False)
class _Rails:
    """Condensed rails without objects; frames by the blocks that each object joins.

    The mechanism keeps alive the matrices whose identities are the key of the cache; `placed` are
    the arrangements by the rows of objects.
    """

    mechanism: Mechanism
    parts: tuple[BlockModel, ...]
    base_segment: NDArray[np.int64]
    frames: dict[Hashable, Frame]
    placed: LRUCache[Arrangement]


class _Structure(NamedTuple):
    """Inputs of condensed rails but for their rows: matrices by identity, and the laws."""

    matrices: int
    laws: Hashable


_rails_cache = LRUCache[_Rails](12)  # ten megabytes each with all that they hold
_layouts = LRUCache[Frame](24)


def arrange(mechanism: Mechanism, scheme: Scheme) -> Arrangement:
    """Condense the rails apart from each other; in one piece if one is held by another only.

    Raises
    ------
    MechanicsError
        If a rail is not held, or a law of friction cannot be integrated.
    """
    check_normals(mechanism.laws)
    structure = _structure(mechanism, scheme)
    rails = _find_rails(mechanism, scheme, structure)
    added = mechanism.object_rows
    places = b"" if added is None else added.tobytes()
    found = None if structure is None else rails.placed.get(places)
    if found is None:
        made = _arranged(mechanism, rails, structure)
        return made if structure is None else rails.placed.put(places, made)
    laws = mechanism.laws._replace(base_segment=found.laws.base_segment)
    placed = {name: getattr(found.table, name) for name in PLACED}
    table = record_like(found.table, laws._replace(**placed))
    return replace(found, mechanism=mechanism, laws=laws, table=table, known=True)


def clear_arrangements() -> None:
    """Clear the cache of condensed mechanisms."""
    _rails_cache.clear()
    _layouts.clear()


def _structure(mechanism: Mechanism, scheme: Scheme) -> _Structure | None:
    """Return what condensed rails depend on, but for their rows; None for what may be written."""
    if not mechanism.reduced or mechanism.core.flags.writeable:
        return None
    laws = mechanism.laws
    values = (
        folded_stiffness(laws),
        np.isfinite(laws.appears) | np.isfinite(laws.disappears) | (laws.waits == 1),
        laws.stick_stiffness,
    )
    rails = tuple([(rail.first, rail.count) for rail in mechanism.rails])
    of_laws = [*_places_of(laws), *[part.tobytes() for part in values]]
    return _Structure(id(mechanism.matrices), (rails, scheme.cutoff_frequency, *of_laws))


def _places_of(laws: LawTable) -> list[bytes]:
    """Return where laws act, and which of them have base segments."""
    names = ("row", "input_index", "base_segment", "segment_start", "friction_row")
    return [getattr(laws, name).tobytes() for name in (*names, "friction_normal")]


def _find_rails(mechanism: Mechanism, scheme: Scheme, structure: _Structure | None) -> _Rails:
    """Condense the rails without objects, or find them."""
    key = (id(mechanism.core), structure)
    rails = None if structure is None else _rails_cache.get(key)
    if rails is None:
        rails = _condense_rails(_without_objects(mechanism), scheme)
        if structure is not None:
            _rails_cache.put(key, rails)
    return rails


def _arranged(mechanism: Mechanism, rails: _Rails, structure: _Structure | None) -> Arrangement:
    """Put the objects in their places."""
    first, n_coordinates = mechanism.core.shape
    parts, joined = _with_objects(rails.parts, mechanism.object_rows, first=first)
    further = np.full(mechanism.laws.row.size - rails.base_segment.size, -1)
    laws = mechanism.laws._replace(base_segment=np.concatenate((rails.base_segment, further)))
    frame = rails.frames.get(joined)
    known = frame is not None
    if frame is None:
        frame, known = _laid_out(parts, laws, structure, fixed_rows=first)
        rails.frames[joined], system = frame, frame.system
    else:
        system = move_added_ends(frame.system, parts, laws, frame.places)
    row_stiffness = sum_at_rows(laws, folded_stiffness(laws), mechanism.n_rows)
    row_stiffness.flags.writeable = False  # throws share it
    condensed = CondensedRails(
        parts,
        n_coordinates=n_coordinates,
        row_stiffness=row_stiffness,
        alone=mechanism.nominal is not None,
    )
    table = shared_record(place_laws(laws, system.row_place))
    return Arrangement(mechanism, laws, table, condensed, system, frame, known)


def _laid_out(
    parts: tuple[BlockModel, ...],
    laws: LawTable,
    structure: _Structure | None,
    *,
    fixed_rows: int,
) -> tuple[Frame, bool]:
    """Lay out the system, or fill one that is known of rails that differ in their sections."""
    bases = [part if part.before is None else part.before for part in parts]
    leading = tuple(part.leading for part in bases)
    shapes = tuple((p.model.load.size, p.block.rows.tobytes(), id(p.leading)) for p in bases)
    ends = (fixed_rows, *(part.block.rows.tobytes() for part in parts))
    key = None if structure is None else (structure.laws, laws.base_segment.tobytes(), shapes, ends)
    layout = None if key is None else _layouts.get(key)
    if layout is not None:
        system = refill_system(layout.system, parts, laws, layout.places)
        return replace(layout, system=system, feet={}), True
    places = number_places(parts)
    system = condensed_system(parts, laws, places, fixed_rows=fixed_rows)
    frame = Frame(system, places, leading, {})
    if key is not None:
        _layouts.put(key, frame)
    return frame, False


def _condense_rails(mechanism: Mechanism, scheme: Scheme) -> _Rails:
    """Condense rails each on its own, or together where one is held by another only."""
    cutoff_frequency, nominal = scheme.cutoff_frequency, mechanism.nominal
    known: tuple[BlockModel, ...] = ()
    if nominal is not None and _places_of(nominal.laws) == _places_of(mechanism.laws):
        found = _find_rails(nominal, scheme, _structure(nominal, scheme))
        known, laws = found.parts, mechanism.laws._replace(base_segment=found.base_segment)
    else:
        laws = drop_joining_bases(mechanism, mechanism.laws)
    try:
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff_frequency, nominal=known)
    except MechanicsError:
        laws = mechanism.laws
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff_frequency)
    # Objects in other places: under a megabyte each in quick mode.
    return _Rails(mechanism, parts, laws.base_segment, {}, LRUCache[Arrangement](96))


def _without_objects(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without the objects whose rows were added to the others."""
    laws = mechanism.laws
    if mechanism.object_rows is None:
        return mechanism
    count = int(np.count_nonzero(laws.row < mechanism.core.shape[0]))
    trimmed = laws._replace(
        row=laws.row[:count],
        input_index=laws.input_index[:count],
        base_segment=laws.base_segment[:count],
        segment_start=laws.segment_start[: count + 1],
    )
    return replace(mechanism, laws=trimmed, object_rows=None)


def _with_objects(
    parts: tuple[BlockModel, ...], rows: Floats | None, *, first: int
) -> tuple[tuple[BlockModel, ...], Hashable]:
    """Add the rows of objects, numbered from `first` on, to the blocks they reach into.

    Returns also which these are.
    """
    if rows is None:
        return parts, ()
    found, joined = [], []
    for part in parts:
        own = rows[:, part.block.coordinates]
        reaching = np.flatnonzero(own.any(axis=1))
        added = part.with_ends(first + reaching, own[reaching]) if reaching.size else part
        found.append(added)
        joined.append(tuple(reaching.tolist()))
    return tuple(found), tuple(joined)
