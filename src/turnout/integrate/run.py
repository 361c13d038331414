"""Integrate a mechanism from its static equilibrium through a motion of its markers."""

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.errors import MechanicsError, SolverError
from turnout.integrate.accuracy import equilibrium_residual
from turnout.integrate.columns import make_level, rebuild
from turnout.integrate.energy import account_friction, account_laws, closing_error
from turnout.integrate.equilibrium import resting_segments
from turnout.integrate.interrupt import heard, one_thread
from turnout.integrate.march import Record, march, store
from turnout.integrate.outcome import Code, Outcome
from turnout.integrate.scheme import AlphaCoefficients, Scheme
from turnout.integrate.solve import Tolerances, equilibrium, friction_trials, law_arguments
from turnout.integrate.state import (
    COUNT_FLIPS,
    COUNT_HALVED,
    COUNT_ITERATIONS,
    State,
    fresh_state,
    set_segment,
)
from turnout.integrate.step import Stepping, damp_coordinates
from turnout.integrate.system import System, condensed_system
from turnout.integrate.work import Work, new_work
from turnout.law.kernel import SLIP_FORWARD, STICK
from turnout.law.shared import shared
from turnout.law.table import LawTable
from turnout.mechanism.blocks import without_joining_bases
from turnout.mechanism.condense import BlockModel, ModalModel, condense_blocks, joined_model
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.threads import one_blas_thread

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Progress is told after so many seconds, and at the first after so many steps.
BREATH, FIRST_CHUNK = 0.1, 1000
# Books of energy that are further open than this share of their scale are not to be trusted.
CLOSES = 1e-5
# A history may take so much memory [bytes].
MOST_MEMORY = 64e9


@dataclass(frozen=True, slots=True)
class History:
    """What a run leaves behind; n is the number of stored instants.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Stored instants [s].
    inputs : ndarray, shape (n, n_inputs)
        Marker positions [m].
    q : ndarray, shape (n, n_modes)
        Modal coordinates.
    g : ndarray, shape (n, n_rows)
        Row displacements [m].
    law_force, friction_force : ndarray, shape (n, n_laws), (n, n_frictions)
        Forces with which laws and frictions resist [N].
    stored, ledger : ndarray, shape (n, 4), (n, 6)
        Energies, see `turnout.integrate.energy` for the columns [J].
    law_placed, law_first, law_peak : ndarray, shape (n_laws,)
        When a law began to act (nan: there was never room for it), when it first had a force
        (nan: never) [s], and its largest force [N]; from every step.
    model : ModalModel
        The condensed system, for the recovery of shapes.
    laws : LawTable
        The laws as integrated: those that join rails are not part of the linear system.
    outcome : Outcome
        How the run ended.
    iterations, flips, halved : int
        Contact-set iterations, rank-one updates, halved steps.
    """

    time: Floats
    inputs: Floats
    q: Floats
    g: Floats
    law_force: Floats
    friction_force: Floats
    stored: Floats
    ledger: Floats
    law_placed: Floats
    law_first: Floats
    law_peak: Floats
    model: ModalModel
    laws: LawTable
    outcome: Outcome
    iterations: int
    flips: int
    halved: int


def integrate(
    mechanism: Mechanism,
    scheme: Scheme,
    *,
    inputs: Callable[[Floats], Floats],
    end: float,
    report: Callable[[int, int], None] | None = None,
) -> History:
    """Find the static equilibrium, then step to `end`.

    Parameters
    ----------
    mechanism : Mechanism
        Reduced rails and their laws.
    scheme : Scheme
        Numerical choices.
    inputs : callable
        Marker positions, shape (n_inputs, n), for times of shape (n,) [m].
    end : float
        Duration, rounded to whole output intervals [s].
    report : callable, optional
        Called with steps done and steps in all.

    Returns
    -------
    History
        Complete, or up to where `outcome` says that it ended.
    """
    with one_blas_thread():
        return _integrate(mechanism, scheme, inputs, end, report)


@dataclass(frozen=True, slots=True)
class _Run:
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


def _integrate(
    mechanism: Mechanism,
    scheme: Scheme,
    inputs: Callable[[Floats], Floats],
    end: float,
    report: Callable[[int, int], None] | None,
) -> History:
    n_stored = round(end / scheme.output_interval) + 1
    if n_stored < 2:
        msg = f"end = {end:g} s is shorter than one output interval"
        raise SolverError(msg)
    a_row = 8 * (mechanism.rows.shape[0] + mechanism.laws.row.size + mechanism.rows.shape[1])
    if n_stored * a_row > MOST_MEMORY or end / scheme.step > 1e9:
        msg = (
            f"end = {end:g} s with an output interval of {scheme.output_interval:g} s makes "
            f"{n_stored:.3g} instants, too many to hold; end sooner or store less often"
        )
        raise SolverError(msg)
    laws, parts = _condensed(mechanism, scheme)
    times = scheme.step * np.arange((n_stored - 1) * scheme.stride + 1, dtype=np.float64)
    run = _prepare(parts, laws, scheme, np.ascontiguousarray(inputs(times).T), n_stored)
    _march(run, 0, 0)  # compiles, if need be, while Ctrl-C ends the program at once
    with one_thread() as thread:
        code, done = _start(run, mechanism, thread), 0
        if code == Code.COMPLETE:
            store(run.system, run.table, run.state, run.work, run.record, 0)
            code, done = _march_in_chunks(run, report, thread)
    if code == Code.COMPLETE and not _books_close(run):
        code = Code.INACCURATE
    residual = equilibrium_residual(run.system, run.table, run.state, run.work)
    outcome = Outcome(
        code=code,
        time=done * scheme.step,
        step=done,
        residual=max(float(run.record.residual[0]), float(residual)),
        contacts=_unsettled(mechanism, run.work),
    )
    kept = 0 if code == Code.NO_EQUILIBRIUM else done // scheme.stride + 1
    return _history(run, scheme, joined_model(parts, mechanism), outcome, kept)


def _history(run: _Run, scheme: Scheme, model: ModalModel, outcome: Outcome, kept: int) -> History:
    record, state = run.record, run.state
    return History(
        time=scheme.output_interval * np.arange(kept, dtype=np.float64),
        inputs=run.positions[:: scheme.stride][:kept],
        q=record.q[:kept],
        g=record.g[:kept],
        law_force=record.law[:kept],
        friction_force=record.friction[:kept],
        stored=record.stored[:kept],
        ledger=record.ledger[:kept],
        law_placed=state.law_placed,
        law_first=np.where(np.isinf(state.law_first), np.nan, state.law_first),
        law_peak=state.law_peak,
        model=model,
        laws=run.laws,
        outcome=outcome,
        iterations=int(state.counters[COUNT_ITERATIONS]),
        flips=int(state.counters[COUNT_FLIPS]),
        halved=int(state.counters[COUNT_HALVED]),
    )


def _condensed(mechanism: Mechanism, scheme: Scheme) -> tuple[LawTable, tuple[BlockModel, ...]]:
    """Condense the rails apart from each other; in one piece if one is held by another only."""
    laws = without_joining_bases(mechanism, mechanism.laws)
    try:
        return laws, condense_blocks(mechanism, laws, cutoff_frequency=scheme.cutoff_frequency)
    except MechanicsError:
        laws = mechanism.laws
        return laws, condense_blocks(mechanism, laws, cutoff_frequency=scheme.cutoff_frequency)


def _prepare(
    parts: tuple[BlockModel, ...],
    laws: LawTable,
    scheme: Scheme,
    positions: Floats,
    n_stored: int,
) -> _Run:
    system, table = condensed_system(parts, laws), shared(laws)
    # one level a halving, and one without inertia
    state = fresh_state(system, table, n_inputs=positions.shape[1], levels=scheme.halvings + 2)
    state.inputs[:] = positions[0]
    alpha = AlphaCoefficients.from_spectral_radius(scheme.spectral_radius)
    return _Run(
        system=system,
        laws=laws,
        table=table,
        state=state,
        work=new_work(system, laws),
        tolerances=Tolerances(scheme.gap_tolerance, scheme.force_tolerance, scheme.iterations),
        stepping=Stepping(
            scheme.step,
            alpha.alpha_m,
            alpha.alpha_f,
            alpha.beta,
            alpha.gamma,
            scheme.halvings,
            scheme.follow_path,
            scheme.stride,
        ),
        positions=positions,
        record=shared(
            Record(
                q=np.empty((n_stored, system.eigenvalues.size)),
                g=np.empty((n_stored, system.row_ends.shape[0])),
                friction=np.empty((n_stored, laws.friction_row.size)),
                law=np.empty((n_stored, laws.row.size)),
                stored=np.empty((n_stored, 4)),
                ledger=np.empty((n_stored, 6)),
                residual=np.zeros(1),
                folded=np.zeros(1),
            )
        ),
    )


def _start(run: _Run, mechanism: Mechanism, thread: Executor) -> Code:
    """Find the static equilibrium without friction, then anchor the feet where they stand."""
    system, laws, table, state, work = run.system, run.laws, run.table, run.state, run.work
    slippery = shared(laws._replace(friction_coefficient=np.zeros_like(laws.friction_coefficient)))
    state.present[:] = (laws.appears <= 1e-9) & (laws.disappears >= -1e-9) & (laws.waits == 0)
    state.law_placed[state.present == 1] = 0.0
    for law in range(laws.row.size):
        set_segment(table, state, law, state.segment[law])
    state.friction[:] = SLIP_FORWARD
    if not _rests(run, slippery, thread):
        segments = resting_segments(mechanism, inputs=state.inputs, present=state.present)
        for law, segment in enumerate(segments):
            set_segment(table, state, law, segment)
        if not _rests(run, slippery, thread):
            return Code.NO_EQUILIBRIUM
    state.friction[:] = STICK
    state.anchor[:] = state.g[laws.friction_row]
    law_arguments(system, table, state, work.argument)
    friction_trials(table, state, work.trial, work.limit)
    account_laws(system, table, state, work, state.inputs, 0.0)
    account_friction(table, state, work)
    state.ledger[:] = 0.0
    damp_coordinates(system, state)
    return Code.COMPLETE


def _rests(run: _Run, laws: LawTable, thread: Executor) -> bool:
    """Iterate the contact set of the static equilibrium from the present one."""
    patient = run.tolerances._replace(iterations=max(run.tolerances.iterations, 400))
    static = run.state.made.size - 1
    make_level(run.system, run.state, static, 0.0, 0.0)
    rebuild(run.system, laws, run.state, static, run.work.row)
    given = (run.system, laws, run.state, run.work, patient)
    code = heard(thread, run.work.stop, equilibrium, *given)
    if code == Code.INTERRUPTED:
        raise KeyboardInterrupt
    return code == Code.COMPLETE


def _march(run: _Run, first: int, last: int) -> tuple[int, int]:
    return march(
        run.system,
        run.table,
        run.state,
        run.work,
        run.tolerances,
        run.stepping,
        run.positions,
        first,
        last,
        run.record,
    )


def _march_in_chunks(
    run: _Run, report: Callable[[int, int], None] | None, thread: Executor
) -> tuple[Code, int]:
    """March, and tell of the progress now and then."""
    n_steps = run.positions.shape[0] - 1
    done, chunk = 0, FIRST_CHUNK
    try:
        while done < n_steps:
            began = time.perf_counter()
            last = min(done + chunk, n_steps)
            number, done = heard(thread, run.work.stop, _march, run, done, last)
            if number != Code.COMPLETE:
                return Code(number), done
            took = max(time.perf_counter() - began, 1e-3)
            chunk = max(1, round(chunk * min(BREATH / took, 4.0)))
            if report is not None:
                report(done, n_steps)
    except KeyboardInterrupt:  # between two kernels
        return Code.INTERRUPTED, done
    return Code.COMPLETE, done


def _books_close(run: _Run) -> bool:
    record = run.record
    error = closing_error(record.stored, record.ledger, folded=float(record.folded[0]))
    return error < CLOSES


def _unsettled(mechanism: Mechanism, work: Work) -> tuple[str, ...]:
    """Name the laws on rows that still changed when the last attempt ended."""
    rows = work.unsettled.astype(bool)
    names = [
        name for name, row in zip(mechanism.law_names, mechanism.laws.row, strict=True) if rows[row]
    ]
    names += [
        f"friction {name}"
        for name, row in zip(mechanism.friction_names, mechanism.laws.friction_row, strict=True)
        if rows[row]
    ]
    return tuple(dict.fromkeys(names))
