"""Condense a mechanism for the kernels, and prepare its runs.

Runs that differ only in values of laws (friction, clearances, saturation forces, times) or in the
motion share modes and structure, which are therefore condensed once and cached. Mechanisms built
from the same records share their matrices, which are read-only then; the cache knows them by their
identity. The rows of foreign objects come last and are added to the condensed rails, so that an
object in another place costs its own displacements and flexibilities, and no modes.

A run takes its memory out and gives it back at its end, so that no two runs ever write to one.
Compliances depend on the condensed rails, the places of objects and the length of the step
(`turnout.solver.columns`), not on laws: throws of a study that differ in friction, stiffness of
drives and slip levels have them alike. States and scratch arrays are only laid out alike, which
takes longer than to fill them.
Rails of which there is a single throw give nothing back. What needs no memory of its own is set up
with the plans of other throws, while what Python needs for it is in the processor's caches.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError, SolverError
from turnout.core.lru_cache import LRUCache
from turnout.core.scheme import Scheme
from turnout.kernels.lanes import whole_lines, zeros_in_lines
from turnout.kernels.shared_record import SharedRecord, record_like, shared_record
from turnout.law.friction import FrictionCourses, no_courses
from turnout.law.obstruction import Obstructions, no_obstructions, remember
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism, Wait
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
from turnout.solver.record import SavePlan, empty_record
from turnout.solver.state import (
    Options,
    Run,
    State,
    StepRecord,
    Work,
    fresh_state,
    new_work,
    release_buffers,
)
from turnout.solver.system import (
    PLACED,
    Floats,
    Places,
    System,
    as_unsigned,
    check_normals,
    condensed_system,
    number_places,
    place_laws,
    refill_system,
    with_objects_elsewhere,
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
    """Condensed rails without objects.

    The mechanism keeps alive the matrices whose identities are the key of the cache. `elsewhere`
    are arrangements by the blocks that each object joins, `placed` by the rows of objects.
    """

    mechanism: Mechanism
    parts: tuple[BlockModel, ...]
    base_segment: NDArray[np.int64]
    elsewhere: dict[Hashable, Arrangement]
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
        first = mechanism.core.shape[0]
        parts, joined = _with_objects(rails.parts, added, first=first)
        made = rails.elsewhere.get(joined)
        if made is None:
            made = rails.elsewhere[joined] = _arranged(mechanism, rails, parts, structure)
            return rails.placed.put(places, made)
        system = with_objects_elsewhere(made.system, parts, made.laws, made.frame.places)
        condensed = replace(made.condensed, parts=parts)
        found = rails.placed.put(places, replace(made, condensed=condensed, system=system))
    laws = mechanism.laws._replace(base_segment=found.laws.base_segment)
    placed = {name: getattr(found.table, name) for name in PLACED}
    table = record_like(found.table, laws._replace(**placed))
    return replace(found, mechanism=mechanism, laws=laws, table=table, known=True)


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


def _arranged(
    mechanism: Mechanism,
    rails: _Rails,
    parts: tuple[BlockModel, ...],
    structure: _Structure | None,
) -> Arrangement:
    """Lay out rails with the first objects that join these of their blocks."""
    further = np.full(mechanism.laws.row.size - rails.base_segment.size, -1)
    laws = mechanism.laws._replace(base_segment=np.concatenate((rails.base_segment, further)))
    frame, known = _laid_out(parts, laws, structure)
    system = frame.system
    row_stiffness = sum_at_rows(laws, folded_stiffness(laws), mechanism.n_rows)
    row_stiffness.flags.writeable = False  # throws share it
    condensed = CondensedRails(
        parts,
        n_coordinates=mechanism.core.shape[1],
        row_stiffness=row_stiffness,
        alone=mechanism.nominal is not None,
    )
    table = shared_record(place_laws(laws, system.row_place))
    return Arrangement(mechanism, laws, table, condensed, system, frame, known)


def _laid_out(
    parts: tuple[BlockModel, ...],
    laws: LawTable,
    structure: _Structure | None,
) -> tuple[Frame, bool]:
    """Lay out the system, or fill one that is known of rails that differ in their sections."""
    bases = [part if part.before is None else part.before for part in parts]
    leading = tuple(part.leading for part in bases)
    shapes = tuple((p.model.load.size, p.block.rows.tobytes(), id(p.leading)) for p in bases)
    ends = tuple(part.block.rows.tobytes() for part in parts)
    key = None if structure is None else (structure.laws, laws.base_segment.tobytes(), shapes, ends)
    layout = None if key is None else _layouts.get(key)
    if layout is not None:
        system = refill_system(layout.system, parts, laws, layout.places)
        return replace(layout, system=system, feet={}), True
    places = number_places(parts)
    system = condensed_system(parts, laws, places)
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


# Most memory of a history [bytes], and most steps.
MOST_MEMORY = 2e9
MOST_STEPS = 2_000_000
CHECK_INTERVAL = 0.02
"""At which a run that waits for machines checks whether they still move [s]."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Waits of a run for machines; the last one is at its end.

    Attributes
    ----------
    time : float
        As of `Wait` [s].
    step : int
        The last stored instant before the onset of the next movement, or the last of all.
    rest, longest : int
        Steps of rest once all machines stand, and of the longest wait before it.
    """

    time: float
    step: int
    rest: int
    longest: int


@dataclass(frozen=True, slots=True)
class Grid:
    """Numbers of steps and stored instants.

    Attributes
    ----------
    n_steps : int
        Of the schedule.
    stride : int
        Steps from one stored instant to the next.
    filled_in : bool
        Whether instants between the steps are wanted.
    last : float
        The last instant that is wanted, by the schedule [s].
    stops : tuple of Stop
        Where it may wait, and its end.
    room : int
        Steps that there is memory for, those of the waits among them.
    check : int
        Steps from one check whether machines still move to the next.
    """

    n_steps: int
    stride: int
    filled_in: bool
    last: float
    stops: tuple[Stop, ...]
    room: int
    check: int

    @property
    def n_stored(self) -> int:
        """Stored instants that there is memory for."""
        return self.room // self.stride + 1


def choose_grid(
    mechanism: Mechanism, scheme: Scheme, end: float, waits: Sequence[Wait] = ()
) -> Grid:
    """Choose the steps; refuse a run with too many of them, or too large for the memory.

    Waits take what memory there is beyond that of the schedule.
    """
    for interval, what in ((scheme.step, "steps"), (scheme.output_interval, "stored instants")):
        if end / interval > MOST_STEPS:
            msg = (
                f"end = {end:g} s with {what} every {interval:g} s makes {end / interval:.3g} of "
                f"them, at most {MOST_STEPS} are made; end sooner (schedule.end) or less often"
            )
            raise SolverError(msg)
    n_out = round(end / scheme.output_interval) + 1
    if n_out < 2:
        msg = f"end = {end:g} s is shorter than one output interval"
        raise SolverError(msg)
    stride, filled_in = max(scheme.stride, 1), scheme.stride == 0
    last = (n_out - 1) * scheme.output_interval
    share = last / scheme.step
    n_steps = math.ceil(share - 1e-6) if filled_in else (n_out - 1) * stride
    a_row = 8 * (mechanism.n_rows + mechanism.laws.row.size + mechanism.core.shape[1])
    most = max(n_steps // stride + 1, n_out)
    if most * a_row > MOST_MEMORY:
        msg = (
            f"end = {end:g} s with an output interval of {scheme.output_interval:g} s makes "
            f"{most:.3g} instants, too many to hold; end sooner or store less often"
        )
        raise SolverError(msg)
    check = stride * max(1, round(CHECK_INTERVAL / (stride * scheme.step)))
    stops = _choose_stops(waits or [Wait(end, 0.0, 0.0)], scheme.step, (stride, check, n_steps))
    room = n_steps + sum(stop.longest + stop.rest for stop in stops)
    fits = min(MOST_STEPS, int(MOST_MEMORY / a_row / most * n_steps))
    return Grid(n_steps, stride, filled_in, last, stops, max(n_steps, min(room, fits)), check)


def _choose_stops(
    waits: Sequence[Wait], step: float, counts: tuple[int, int, int]
) -> tuple[Stop, ...]:
    """Return waits in steps; lengths are whole stored intervals, and a rest is one at least."""
    stride, check, n_steps = counts

    def whole(time: float) -> int:
        return stride * math.ceil(time / (stride * step) - 1e-6)

    return tuple(
        Stop(
            wait.time,
            n_steps if number == len(waits) else whole(wait.time) - stride,
            max(whole(wait.rest), check) if wait.longest else 0,
            whole(wait.longest),
        )
        for number, wait in enumerate(waits, 1)
    )


@dataclass(frozen=True, slots=True, eq=False)
class RunSetup:
    """All of a run but the memory of its state; it can be prepared once.

    Attributes
    ----------
    arrangement : Arrangement
        The condensed mechanism.
    table : LawTable
        Its laws by places, or others there; changed by the run.
    options : Options
        Lengths of steps, tolerances.
    positions : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    obstructions : Obstructions
        Laws with memory.
    courses : FrictionCourses
        Friction along the stroke.
    save : SavePlan
        Which instants are stored whole and kept, and what is seen of these.
    """

    arrangement: Arrangement
    table: LawTable
    options: Options
    positions: Floats
    obstructions: Obstructions
    courses: FrictionCourses
    save: SavePlan


def set_up_run(
    arrangement: Arrangement,
    scheme: Scheme,
    positions: Floats,
    save: SavePlan,
    *,
    table: LawTable | None = None,
) -> RunSetup:
    """Set up a run.

    Parameters
    ----------
    arrangement : Arrangement
        From `arrange`.
    scheme : Scheme
        Step [s], spectral radius, tolerances and halvings.
    positions : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    save : SavePlan
        As of `RunSetup`.
    table : LawTable, optional
        Laws by places, in place of those of the arrangement.
    """
    table = arrangement.table if table is None else table
    mechanism = arrangement.mechanism
    return RunSetup(
        arrangement=arrangement,
        table=table,
        options=Options.of(scheme),
        positions=positions,
        obstructions=_set_up_obstructions(mechanism.obstructions, table),
        courses=_set_up_courses(mechanism.courses, arrangement.frame, table),
        save=save,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Buffers:
    """Memory of a run that has ended, for the next one of these rails.

    Attributes
    ----------
    frame : Frame
        Of its rails.
    system : System
        For which the compliances in the state are.
    state, work : State, Work
        Of the run.
    record : StepRecord, optional
        Of a run whose stored instants are of no more use.
    """

    frame: Frame  # kept alive, since the key of the memory names what is in it by its identity
    system: System
    state: State
    work: Work
    record: StepRecord | None


_kept = LRUCache[Buffers](24)  # three megabytes each in quick mode


def _key(frame: Frame, options: Options, n_inputs: int) -> Hashable:
    """Return what memory is laid out by."""
    lengths = options.step, options.alpha_m, options.alpha_f, options.beta, options.gamma
    return (id(frame.fresh), *lengths, options.halvings, n_inputs)


def prepare(setup: RunSetup) -> tuple[Run, State]:
    """Give a run that was set up its state, scratch arrays and record; nothing has moved yet.

    Their memory is that of a run before, where there is one.
    """
    arrangement, table, save = setup.arrangement, setup.table, setup.save
    system, n_inputs = arrangement.system, setup.positions.shape[1]
    levels = setup.options.halvings + 2  # halvings, and no inertia
    fresh, kept = (
        arrangement.frame.fresh,
        _kept.pop(_key(arrangement.frame, setup.options, n_inputs)),
    )
    if kept is None:
        state = fresh_state(system, table, n_inputs=n_inputs, levels=levels)
        work, record = new_work(system, table), None
        fresh[n_inputs, levels] = tuple(_vectors(of).copy() for of in (state, work))
    else:
        state, work, record = kept.state, kept.work, kept.record
        ready = state.level_ready * (kept.system is system)
        _vectors(state)[:], _vectors(work)[:] = fresh[n_inputs, levels]
        state.level_ready[:] = ready
    state.inputs[:] = setup.positions[0]
    if record is None or record.q.shape[0] != save.count or save.velocity or save.watches:
        record = empty_record(system, table, save)
    record.residual[:] = 0.0
    given = setup.options, setup.positions, record, setup.obstructions, setup.courses
    return Run(system, table, work, *given), state


def _vectors(record: State | Work) -> Floats:
    """Return the memory of the vectors of a record."""
    return cast("SharedRecord", record).memory


def give_back(arrangement: Arrangement, run: Run, state: State, *, record: bool = False) -> None:
    """Give back, at its end, what another run of these rails can use; maybe its record too.

    Rails of which there is a single throw give nothing back.
    """
    if arrangement.known:
        memory = (run.system, state, run.work, run.record if record else None)
        key = _key(arrangement.frame, run.options, state.inputs.size)
        _kept.put(key, Buffers(arrangement.frame, *memory))


def clear_buffers() -> None:
    """Forget all memory of runs."""
    _kept.clear()


def clear_memory() -> None:
    """Clear the cache of condensed mechanisms, and release the memory of runs and histories."""
    _rails_cache.clear()
    _layouts.clear()
    clear_buffers()
    release_buffers()


_NO_OBSTRUCTIONS, _NO_COURSES = shared_record(no_obstructions()), shared_record(no_courses())


def _set_up_obstructions(given: Obstructions, table: LawTable) -> Obstructions:
    """Return the obstructions of a run; their laws get the dents that they have already."""
    if given.law.size == 0:
        return _NO_OBSTRUCTIONS
    obstructions = shared_record(given)
    remember(table, obstructions)
    return obstructions


def _set_up_courses(courses: FrictionCourses, frame: Frame, table: LawTable) -> FrictionCourses:
    """Return the courses of a run; without any, all runs share them."""
    if courses.has_curves:
        rows = table.friction_row.tobytes()
        feet = frame.feet.get(rows)
        if feet is None:
            feet = frame.feet[rows] = _foot_modes(frame.system, table)
        width = feet["modes"].shape[1]
        courses = courses._replace(**feet, speed=np.zeros(feet["feet"].size * width))
    elif not courses.friction.size:
        return _NO_COURSES
    return shared_record(courses)


def _foot_modes(system: System, table: LawTable) -> dict[str, NDArray[Any]]:
    """Return the modes at the feet, block by block, and which speed is that of each friction."""
    feet, number = np.unique(table.friction_row.astype(np.int64), return_inverse=True)
    if (system.row_ends[feet, 1] >= 0).any():
        message = "friction that follows speed acts on one rail, not between two"
        raise MechanicsError(message)
    if feet[-1] >= system.end_start[-1]:
        message = "friction that follows speed acts at rows that lead, not at one that follows"
        raise MechanicsError(message)
    start = np.searchsorted(feet, system.end_start)
    count = np.diff(start)
    width = int(whole_lines(count.max()))
    modes = zeros_in_lines(system.load.size + 1, width)
    for block in np.flatnonzero(count):
        own, rows = feet[start[block] :][: count[block]], slice(*system.mode_start[block:][:2])
        modes[rows, : own.size] = system.mode_ends[rows, own - system.end_start[block]]
    block_of = system.block_of_end[feet]
    place = block_of * width + np.arange(feet.size) - start[block_of]
    return {
        "feet": count,
        "modes": modes,
        "speed_of": as_unsigned(place[number]),
    }
