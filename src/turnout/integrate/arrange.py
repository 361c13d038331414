"""Arrange a mechanism for the kernels: condensed once, prepared for each run.

Condense a mechanism and arrange it for the kernels, once for runs that differ in values only.

Friction, clearances, forces of saturation, times and motion change neither modes nor the structure
of the laws. Mechanisms made of the same records share their matrices, which can then not be
written to: those are recognised by being the same.

Arrange a mechanism for the kernels, and find where it rests.
"""

from collections import OrderedDict
from collections.abc import Hashable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.condense.blocks import without_joining_bases
from turnout.condense.condense import base_stiffness, condense_blocks, joined_model
from turnout.condense.modal import ModalModel
from turnout.errors import MechanicsError
from turnout.integrate.columns import rebuild
from turnout.integrate.equilibrium import begin_at_rest, equilibrium, resting_segments
from turnout.integrate.march import Record
from turnout.integrate.outcome import Code
from turnout.integrate.places import place_laws, whole_lines
from turnout.integrate.rods import Rods
from turnout.integrate.scratch import Work, acquire_buffer, new_work, release_buffers
from turnout.integrate.solve import Tolerances
from turnout.integrate.state import LEVEL, State, fresh_copy, fresh_state, set_segments
from turnout.integrate.step import Stepping
from turnout.integrate.system import System, check_normals, condensed_system
from turnout.kernels.interrupt import call_interruptible
from turnout.kernels.records import clone_record, shared_record
from turnout.law.kernel import SLIP_FORWARD
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism
from turnout.scheme import AlphaCoefficients, Scheme

Ints = NDArray[np.int64]

MOST_KEPT = 24
"""So many condensed mechanisms are kept in memory, the latest used."""


Blanks = dict[tuple[int, int], tuple[State, Work]]


@dataclass(frozen=True, slots=True)
class Arrangement:
    """A condensed mechanism.

    Attributes
    ----------
    laws : LawTable
        The laws as integrated: those that join rails are not part of the linear system.
    table : LawTable
        The same for the kernels.
    model : ModalModel
        Modes and flexibility of the rails.
    system : System
        The same for the kernels.
    blanks : dict
        States at rest and scratch arrays of runs, for numbers of inputs and levels, to be copied.
    """

    laws: LawTable
    table: LawTable
    model: ModalModel
    system: System
    blanks: Blanks


@dataclass(frozen=True, slots=True)
class _Kept:
    """What is the same for all values of the laws; `mechanism` keeps alive what the key names."""

    mechanism: Mechanism
    base_segment: Ints
    model: ModalModel
    system: System
    blanks: Blanks


_memory: OrderedDict[Hashable, _Kept] = OrderedDict()


def arrange(mechanism: Mechanism, scheme: Scheme) -> Arrangement:
    """Condense the rails apart from each other; in one piece if one is held by another only.

    Raises
    ------
    MechanicsError
        If a rail is not held, or a law of friction cannot be integrated.
    """
    check_normals(mechanism.laws)
    key = _key(mechanism, scheme)
    kept = _memory.get(key) if key is not None else None
    if kept is None:
        kept = _made(mechanism, scheme)
        if key is not None:
            _memory[key] = kept
            while len(_memory) > MOST_KEPT:
                _memory.popitem(last=False)
    elif key in _memory:
        _memory.move_to_end(key)
    laws = mechanism.laws._replace(base_segment=kept.base_segment)
    table = shared_record(place_laws(laws, kept.system.row_place))
    return Arrangement(laws, table, kept.model, kept.system, kept.blanks)


def forget() -> None:
    """Empty the memory of condensed mechanisms, and that of histories that are gone."""
    _memory.clear()
    release_buffers()


def _key(mechanism: Mechanism, scheme: Scheme) -> Hashable | None:
    """Return what condensed mechanisms are known by; None where matrices could be written to."""
    matrices = (
        mechanism.stiffness,
        mechanism.mass,
        mechanism.damping,
        mechanism.load,
        mechanism.rows,
    )
    if any(matrix.flags.writeable for matrix in matrices):
        return None
    laws = mechanism.laws
    structure = (
        laws.row,
        laws.input_index,
        laws.base_segment,
        laws.segment_start,
        base_stiffness(laws),
        np.isfinite(laws.appears) | np.isfinite(laws.disappears) | (laws.waits == 1),
        laws.friction_row,
        laws.friction_normal,
        laws.stick_stiffness,
    )
    same = tuple(id(matrix) for matrix in matrices)
    rails = tuple((rail.first, rail.count) for rail in mechanism.rails)
    return (*same, rails, scheme.cutoff_frequency, *(part.tobytes() for part in structure))


def _made(mechanism: Mechanism, scheme: Scheme) -> _Kept:
    cutoff = scheme.cutoff_frequency
    laws = without_joining_bases(mechanism, mechanism.laws)
    try:
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff)
    except MechanicsError:
        laws = mechanism.laws
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff)
    model, system = joined_model(parts, mechanism), condensed_system(parts, laws)
    return _Kept(mechanism, laws.base_segment, model, system, {})


Floats = NDArray[np.float64]
LARGE_PAGE = 1 << 21
"""Of memory, as processors have them [bytes]."""


@dataclass(frozen=True, slots=True)
class Run:
    """What the kernels of one run work on."""

    system: System
    laws: LawTable
    table: LawTable
    state: State
    work: Work
    tolerances: Tolerances
    stepping: Stepping
    positions: Floats
    record: Record
    rods: Rods | None = None


def prepare(
    made: Arrangement,
    scheme: Scheme,
    positions: Floats,
    n_stored: int,
    *,
    filled_in: bool,
) -> Run:
    """Arrange everything that the kernels of one run need; nothing has moved yet.

    `filled_in` tells that instants between the steps are wanted.
    """
    system, laws, table = made.system, made.laws, made.table
    state, work = _fresh(made, n_inputs=positions.shape[1], halvings=scheme.halvings)
    state.inputs[:] = positions[0]
    alpha = AlphaCoefficients.from_spectral_radius(scheme.spectral_radius)
    return Run(
        system=system,
        laws=laws,
        table=table,
        state=state,
        work=work,
        tolerances=Tolerances(
            float(scheme.gap_tolerance), float(scheme.force_tolerance), scheme.iterations
        ),
        stepping=Stepping(
            float(scheme.step),
            alpha.alpha_m,
            alpha.alpha_f,
            alpha.beta,
            alpha.gamma,
            scheme.halvings,
            scheme.follow_path,
            max(scheme.stride, 1),
            scheme.inertia,
        ),
        positions=positions,
        record=_empty_record(system, laws, n_stored, with_velocity=filled_in and scheme.inertia),
    )


def _fresh(made: Arrangement, *, n_inputs: int, halvings: int) -> tuple[State, Work]:
    """Return a state at rest and scratch arrays, copied from those that were made first."""
    levels = halvings + 2  # one a halving, and one without inertia
    blank = made.blanks.get((n_inputs, levels))
    if blank is None:
        state = fresh_state(made.system, made.table, n_inputs=n_inputs, levels=levels)
        blank = made.blanks[n_inputs, levels] = (state, new_work(made.system, made.table))
    return fresh_copy(blank[0], made.table), clone_record(blank[1])


def _empty_record(system: System, laws: LawTable, count: int, *, with_velocity: bool) -> Record:
    """Return room for so many stored instants, one row each, in one piece of memory.

    It starts where a large page of memory does, so that a run touches few pages for the first time.
    """
    n_modes = system.load.size
    vectors = np.array([n_modes, system.row_place.size, laws.friction_row.size, laws.row.size])
    widths = {
        **dict(zip(("q", "g", "friction", "law"), whole_lines(vectors).tolist(), strict=True)),
        "stored": 4,
        "ledger": 6,
    }
    page = LARGE_PAGE // 8
    memory = acquire_buffer(count * sum(widths.values()) + page)
    at, arrays = (-(memory.ctypes.data // 8)) % page, {}
    for name, width in widths.items():
        arrays[name] = memory[at : at + count * width].reshape(count, width)
        at += count * width
    velocity = np.zeros((count if with_velocity else 1, arrays["q"].shape[1]))
    return shared_record(Record(**arrays, residual=np.zeros(1), v=velocity))


def instants_of(run: Run, count: int) -> Record:
    """Return the first stored instants, without what fills the lines of memory."""
    record, n_modes = run.record, run.system.load.size
    return Record(
        q=record.q[:count, :n_modes],
        g=record.g[:count, : run.system.row_place.size],
        friction=record.friction[:count, : run.laws.friction_row.size],
        law=record.law[:count, : run.laws.row.size],
        stored=record.stored[:count],
        ledger=record.ledger[:count],
        residual=record.residual,
        v=record.v[:count, :n_modes],
    )


def start(run: Run, mechanism: Mechanism, thread: Executor) -> Code:
    """Find the static equilibrium without friction, then anchor the feet where they stand."""
    system, laws, table, state, work = run.system, run.laws, run.table, run.state, run.work
    state.present[:] = (laws.appears <= 1e-9) & (laws.disappears >= -1e-9) & (laws.waits == 0)
    state.law_placed[state.present == 1] = 0.0
    set_segments(table, state, state.segment)
    state.friction[:] = SLIP_FORWARD
    table.friction_coefficient[:] = 0.0
    try:
        if not _rests(run, thread):
            segments = resting_segments(mechanism, inputs=state.inputs, present=state.present)
            set_segments(table, state, segments)
            if not _rests(run, thread):
                return Code.NO_EQUILIBRIUM
    finally:
        table.friction_coefficient[:] = laws.friction_coefficient
    begin_at_rest(system, table, state, work)
    if not run.stepping.inertia:
        rebuild(system, table, state, state.counters[LEVEL], work.row)
    return Code.COMPLETE


def _rests(run: Run, thread: Executor) -> bool:
    """Iterate the contact set of the static equilibrium from the present one."""
    patient = run.tolerances._replace(iterations=max(run.tolerances.iterations, 400))
    given = (run.system, run.table, run.state, run.work, patient)
    code = call_interruptible(thread, run.work.stop, equilibrium, *given)
    if code == Code.INTERRUPTED:
        raise KeyboardInterrupt
    return code == Code.COMPLETE
