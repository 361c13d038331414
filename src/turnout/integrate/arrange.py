"""Condense a mechanism for the kernels, prepare a run of it, and find where it rests.

Runs that differ only in values of laws (friction, clearances, saturation forces, times) or in the
motion share modes and structure, which are therefore condensed once and cached. Mechanisms built
from the same records share their matrices, which are read-only then; the cache knows them by their
identity.
"""

from collections.abc import Hashable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.condense.blocks import drop_joining_bases
from turnout.condense.condense import assemble_model, base_stiffness, condense_blocks
from turnout.condense.modal import ModalModel
from turnout.core.lru_cache import LRUCache
from turnout.errors import MechanicsError
from turnout.integrate.columns import rebuild
from turnout.integrate.equilibrium import anchor_at_rest, equilibrium, equilibrium_segments
from turnout.integrate.march import Record
from turnout.integrate.numbering import place_laws
from turnout.integrate.outcome import Code
from turnout.integrate.rods import Rods
from turnout.integrate.scratch import Work, acquire_buffer, new_work, release_buffers
from turnout.integrate.solve import Tolerances
from turnout.integrate.state import LEVEL, State, fresh_copy, fresh_state, set_segments
from turnout.integrate.step import Stepping
from turnout.integrate.system import System, check_normals, condensed_system
from turnout.kernels.interrupt import call_interruptible
from turnout.kernels.lanes import whole_lines
from turnout.kernels.shared_record import clone_record, shared_record
from turnout.law.kernel import SLIP_FORWARD
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism
from turnout.scheme import AlphaCoefficients, Scheme

Floats = NDArray[np.float64]
Templates = dict[tuple[int, int], tuple[State, Work]]

MOST_KEPT = 24
"""Condensed mechanisms in the cache, the latest used."""
LARGE_PAGE = 1 << 21
"""Size of a large page of memory [bytes]."""


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
    model : ModalModel
        Modes and flexibility of the rails, in the coordinates of the mechanism.
    system : System
        The same for the kernels.
    templates : dict
        States at rest and scratch arrays, by numbers of inputs and of levels, for runs to copy.
    """

    mechanism: Mechanism
    laws: LawTable
    table: LawTable
    model: ModalModel
    system: System
    templates: Templates


_cache = LRUCache[Arrangement](MOST_KEPT)


def arrange(mechanism: Mechanism, scheme: Scheme) -> Arrangement:
    """Condense the rails apart from each other; in one piece if one is held by another only.

    Raises
    ------
    MechanicsError
        If a rail is not held, or a law of friction cannot be integrated.
    """
    check_normals(mechanism.laws)
    key = _key(mechanism, scheme)
    cached = _cache.get(key) if key is not None else None
    if cached is None:
        made = _condense(mechanism, scheme)
        return made if key is None else _cache.put(key, made)
    laws = mechanism.laws._replace(base_segment=cached.laws.base_segment)
    table = shared_record(place_laws(laws, cached.system.row_place))
    return replace(cached, mechanism=mechanism, laws=laws, table=table)


def forget() -> None:
    """Clear the cache of condensed mechanisms, and release the buffers of histories."""
    _cache.clear()
    release_buffers()


def _key(mechanism: Mechanism, scheme: Scheme) -> Hashable | None:
    """Return the key of a mechanism in the cache; None where its matrices are writeable."""
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


def _condense(mechanism: Mechanism, scheme: Scheme) -> Arrangement:
    cutoff = scheme.cutoff_frequency
    laws = drop_joining_bases(mechanism, mechanism.laws)
    try:
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff)
    except MechanicsError:
        laws = mechanism.laws
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff)
    model, system = assemble_model(parts, mechanism), condensed_system(parts, laws)
    table = shared_record(place_laws(laws, system.row_place))
    return Arrangement(mechanism, laws, table, model, system, {})


@dataclass(frozen=True, slots=True)
class Run:
    """All data of one run; `positions` are the inputs at the ends of the steps [m]."""

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
    arrangement: Arrangement,
    scheme: Scheme,
    positions: Floats,
    n_stored: int,
    *,
    filled_in: bool,
) -> Run:
    """Allocate state, scratch arrays and record of one run; nothing has moved yet.

    Parameters
    ----------
    arrangement : Arrangement
        From `arrange`.
    scheme : Scheme
        Numerical choices.
    positions : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    n_stored : int
        Instants of the record.
    filled_in : bool
        Whether instants between the steps are wanted, which needs velocities.
    """
    system, laws, table = arrangement.system, arrangement.laws, arrangement.table
    state, work = _copy_templates(
        arrangement, n_inputs=positions.shape[1], halvings=scheme.halvings
    )
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


def _copy_templates(
    arrangement: Arrangement, *, n_inputs: int, halvings: int
) -> tuple[State, Work]:
    """Return a state at rest and scratch arrays, copied from the templates."""
    levels = halvings + 2  # one for each halving, and one without inertia
    template = arrangement.templates.get((n_inputs, levels))
    if template is None:
        state = fresh_state(arrangement.system, arrangement.table, n_inputs=n_inputs, levels=levels)
        template = arrangement.templates[n_inputs, levels] = (
            state,
            new_work(arrangement.system, arrangement.table),
        )
    return fresh_copy(template[0], arrangement.table), clone_record(template[1])


def _empty_record(system: System, laws: LawTable, count: int, *, with_velocity: bool) -> Record:
    """Allocate a record of `count` instants in one piece of memory.

    It begins at a large page, so that a run touches few pages for the first time.
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


def trim_record(run: Run, count: int) -> Record:
    """Return the first `count` stored instants, without the padding to whole cache lines."""
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


def start_at_rest(run: Run, mechanism: Mechanism, thread: Executor) -> Code:
    """Find the static equilibrium without friction, then anchor the feet at their places."""
    system, laws, table, state, work = run.system, run.laws, run.table, run.state, run.work
    state.present[:] = (laws.appears <= 1e-9) & (laws.disappears >= -1e-9) & (laws.waits == 0)
    state.law_placed[state.present == 1] = 0.0
    set_segments(table, state, state.segment)
    state.friction[:] = SLIP_FORWARD
    table.friction_coefficient[:] = 0.0
    try:
        if not _find_equilibrium(run, thread):
            segments = equilibrium_segments(mechanism, inputs=state.inputs, present=state.present)
            set_segments(table, state, segments)
            if not _find_equilibrium(run, thread):
                return Code.NO_EQUILIBRIUM
    finally:
        table.friction_coefficient[:] = laws.friction_coefficient
    anchor_at_rest(system, table, state, work)
    if not run.stepping.inertia:
        rebuild(system, table, state, state.counters[LEVEL], work.row)
    return Code.COMPLETE


def _find_equilibrium(run: Run, thread: Executor) -> bool:
    """Iterate the contact set to static equilibrium from the present one; tell if it converged."""
    patient = run.tolerances._replace(iterations=max(run.tolerances.iterations, 400))
    given = (run.system, run.table, run.state, run.work, patient)
    code = call_interruptible(thread, run.work.stop, equilibrium, *given)
    if code == Code.INTERRUPTED:
        raise KeyboardInterrupt
    return code == Code.COMPLETE
