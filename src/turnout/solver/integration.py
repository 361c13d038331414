"""Integrate a mechanism from where it starts through a motion of its markers."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import SolverError
from turnout.core.interrupt import held_interrupt
from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.kernels.compiled import prepare_kernels
from turnout.law.obstruction import Obstructions
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism, Wait
from turnout.solver.arrange import (
    Grid,
    RunSetup,
    arrange,
    choose_grid,
    give_back,
    prepare,
    set_up_run,
)
from turnout.solver.condense import CondensedRails
from turnout.solver.driven import MachineHistory, machine_history, most_places, new_rods
from turnout.solver.energy import energy_balance, folded_energy
from turnout.solver.march import march, march_with_machines, store_instant
from turnout.solver.modal import ModalModel
from turnout.solver.outcome import Code, Outcome, is_closed
from turnout.solver.record import (
    SaveAt,
    SavePlan,
    Watched,
    interpolate_record,
    kept_obstructions,
    plan_saving,
    seen_weights,
    trim_record,
    trim_watched,
)
from turnout.solver.rods import Rods, find_slips, start_rods
from turnout.solver.schedule import DUE, Pause, end_pause, pauses_until, schedule_time
from turnout.solver.solve import equilibrium_residual
from turnout.solver.start import (
    PriorMotion,
    StartPlan,
    anchor_at_rest,
    equilibrium,
    find_start,
    plan_start,
    settle,
)
from turnout.solver.state import COUNT_FLIPS, COUNT_HALVED, COUNT_ITERATIONS, Run, State

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Progress is reported, and Ctrl-C ends a run, after so many seconds [s]; the first time after so
# many steps.
REPORT_INTERVAL, FIRST_REPORT, FIRST_WITHOUT_REPORT = 0.1, 100, 4000
# Outcomes without a single instant.
WITHOUT_START = (Code.NO_EQUILIBRIUM, Code.NO_LOADED_START)


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Stored instants and outcome of a run; n is the number of stored instants.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Stored instants [s].
    inputs : ndarray, shape (n, n_inputs)
        Marker positions [m].
    q : ndarray, shape (n, n_modes)
        Coordinates of the kept modes, in the shapes of `model`.
    g : ndarray, shape (n, n_rows)
        Row displacements [m].
    law_force, friction_force : ndarray, shape (n, n_laws), (n, n_frictions)
        Forces with which laws and frictions resist [N].
    stored, ledger : ndarray, shape (n, 4), (n, 7)
        Stored energies, and work since the start; columns as in `turnout.solver.energy` [J].
    law_placed, law_first : ndarray, shape (n_laws,)
        Times at which a law that does not always act (an object) appeared, and first had a force
        [s]; NaN where it did not, as an object that never fits, and for all other laws.
    condensed : CondensedRails
        The condensed system, from which shapes are recovered; `model` is the whole of it.
    laws : LawTable
        The laws as integrated: those that join rails are not part of the linear system.
    outcome : Outcome
        How the run ended.
    obstructions : Obstructions
        What the obstructions with memory have become.
    iterations, flips, halved : int
        Contact-set iterations, rank-one updates, halved steps.
    machines : MachineHistory, optional
        Of the drives that are machines.
    watched : Watched, optional
        What a complete watched run leaves of all its instants; the history then holds few of them.
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
    condensed: CondensedRails
    laws: LawTable
    outcome: Outcome
    iterations: int
    flips: int
    halved: int
    obstructions: Obstructions
    machines: MachineHistory | None = None
    watched: Watched | None = None

    def forces(self, laws: Sequence[int]) -> Floats:
        """Return the forces of some laws, shape (n, n_laws) [N]."""
        return self.law_force[:, list(laws)]

    @property
    def model(self) -> ModalModel:
        """The condensed system in the coordinates of the mechanism."""
        return self.condensed.model


def integrate(
    mechanism: Mechanism,
    scheme: Scheme,
    *,
    inputs: Callable[[Floats], Floats],
    end: float,
    prior: PriorMotion | None = None,
    report: Callable[[int, int], None] | None = None,
    save_at: SaveAt | None = None,
) -> History:
    """Find where the run starts, then step to `end`.

    Parameters
    ----------
    mechanism : Mechanism
        Reduced rails and their laws.
    scheme : Scheme
        Step, cut-off frequency, tolerances and output.
    inputs : callable
        Marker positions, shape (n_inputs, n), for times of shape (n,) [m].
    end : float
        Duration, rounded to whole output intervals [s].
    prior : PriorMotion, optional
        The motion before the start, whose friction the rails take over. Default static equilibrium
        without friction.
    report : callable, optional
        Called with steps done and steps in all.
    save_at : SaveAt, optional
        What alone is wanted of the run. It is not heeded where instants lie between the steps.

    Returns
    -------
    History
        Complete, or up to where `outcome` says that it ended.
    """
    with one_blas_thread():  # nested limits are free
        plan = plan_run(mechanism, scheme, inputs=inputs, end=end, prior=prior, save_at=save_at)
        return carry_out(plan, report=report)


@dataclass(frozen=True, slots=True, eq=False)
class RunPlan:
    """A run that can be carried out, with all that it needs but the memory of its state.

    Attributes
    ----------
    scheme : Scheme
        Numerical choices.
    inputs : callable
        Marker positions by time, as `integrate` takes them.
    grid : Grid
        Its steps and stored instants.
    setup : RunSetup
        The condensed mechanism, its laws, numbers of the run, and what alone is saved of it.
    start : StartPlan, optional
        The motion before the start.
    rods : Rods, optional
        Drives that are machines, of a watched run; others keep too much to be planned together.
    """

    scheme: Scheme
    inputs: Callable[[Floats], Floats]
    grid: Grid
    setup: RunSetup
    start: StartPlan | None
    rods: Rods | None


def plan_run(
    mechanism: Mechanism,
    scheme: Scheme,
    *,
    inputs: Callable[[Floats], Floats],
    end: float,
    prior: PriorMotion | None = None,
    save_at: SaveAt | None = None,
    waits: Sequence[Wait] = (),
) -> RunPlan:
    """Do all of `integrate` that comes before its kernels; parameters are the same.

    `waits` are where the schedule waits for machines, at its end in any case.

    Some throws planned one after another take half of the time that they take between throws, whose
    histories drive all else out of the processor's caches.
    """
    if not scheme.inertia and mechanism.courses.has_curves:
        message = (
            'mode "quasi-static" has no speed for friction that follows it; take "quick" or '
            '"waveform", or leave out chair.N.friction_state, static_ratio and friction_rise'
        )
        raise SolverError(message)
    with one_blas_thread():
        grid = choose_grid(mechanism, scheme, end, waits)
        arrangement = arrange(mechanism, scheme)
        plan = SavePlan(grid.n_stored, velocity=grid.filled_in and scheme.inertia)
        if save_at is not None and not grid.filled_in:
            interval, further = scheme.step * grid.stride, 0
            if (machines := mechanism.machines) is not None:
                further = most_places(machines, grid, save_at.whole)
            places, laws = arrangement.system.row_place, arrangement.laws
            seen = save_at.seen(arrangement.condensed)
            weights = seen_weights(seen, laws, places, save_at.laws)
            plan = plan_saving(save_at, weights, interval, grid.n_stored, further=further)
        positions = np.ascontiguousarray(inputs(_times(scheme.step, grid.room + 1)).T)
        if mechanism.machines is not None:
            positions = positions.copy()  # machines write to them, and throws may share them
        # before the table gets the dents that objects have already
        start = None if prior is None else plan_start(arrangement, scheme, prior)
        setup = set_up_run(arrangement, scheme, positions, plan)
        rods = new_rods(setup, scheme, grid) if plan.watches else None
        return RunPlan(scheme, inputs, grid, setup, start, rods)


@lru_cache(maxsize=16)
def _times(interval: float, count: int) -> Floats:
    """Return instants from 0 on, read-only, as throws share them [s]."""
    times = interval * np.arange(count, dtype=np.float64)
    times.flags.writeable = False
    return times


def _march_from_start(
    given: RunPlan,
    run: Run,
    state: State,
    rods: Rods | None,
    report: Callable[[int, int], None] | None,
) -> tuple[Code, int, tuple[Pause, ...]]:
    """Find the start and march to the end of the schedule; return outcome, steps done, pauses."""
    _compile_march(run, state, rods, after_motion=given.start is not None)
    code = find_start(run, state, given.setup.arrangement, given.start)
    if code != Code.COMPLETE:
        return code, 0, ()
    if rods is not None:
        start_rods(run, state, rods)
    store_instant(run, state, 0)

    code, done = _march_in_chunks(run, state, rods, given.grid, report)
    return code, done, () if rods is None else pauses_until(run, rods, done)


def _judge(
    run: Run,
    state: State,
    mechanism: Mechanism,
    balance: tuple[float, float],
    reached: tuple[Code, int],
) -> Outcome:
    """Return the outcome of a run by its residuals, and by the code and the step it reached."""
    code, done = reached
    if code == Code.COMPLETE and not is_closed(*balance):
        folded = folded_energy(run, state)
        code = Code.COMPLETE if is_closed(*balance, folded) else Code.INACCURATE
    residual = equilibrium_residual(run, state)
    return Outcome(
        code=code,
        time=done * run.options.step,
        step=done,
        residual=max(float(run.record.residual[0]), float(residual)),
        contacts=_name_unconverged(mechanism, run),
        energy_residual=balance[0],
        energy_scale=balance[1],
    )


@one_blas_thread()
def carry_out(given: RunPlan, *, report: Callable[[int, int], None] | None = None) -> History:
    """Carry out a planned run, once; `report` is called with steps done and steps in all."""
    scheme, inputs, grid, setup = given.scheme, given.inputs, given.grid, given.setup
    arrangement, plan, stride = setup.arrangement, setup.save, grid.stride
    mechanism = arrangement.mechanism
    run, state = prepare(setup)
    rods = given.rods if plan.watches else new_rods(setup, scheme, grid)
    code, done, pauses = _march_from_start(given, run, state, rods, report)
    kept = 0 if code in WITHOUT_START else done // stride + 1
    booked = plan.rows(2, kept)
    balance = energy_balance(run.record.stored[booked], run.record.ledger[booked])
    instants = _times(scheme.step * stride, grid.n_stored)[:kept]
    machines = machine_history(rods, mechanism, instants, booked, pauses)
    if machines is not None:
        balance = machines.with_balance(*balance)
    outcome = _judge(run, state, mechanism, balance, (code, done))
    record = trim_record(run, kept, plan)
    positions = setup.positions[::stride][:kept].view()
    if grid.filled_in and kept > 1:
        last = min(grid.last + sum(item.length for item in pauses), instants[-1])
        count = int((last + 1e-9) / scheme.output_interval) + 1
        instants = scheme.output_interval * np.arange(count, dtype=np.float64)
        positions = np.ascontiguousarray(inputs(schedule_time(instants, pauses)).T).view()
        if machines is not None:
            positions = positions.copy()
            machines = machines.at(instants, positions)
        between = {"instants": instants, "inputs": positions, "modes": arrangement.model.row_modes}
        record = interpolate_record(record, step=scheme.step, laws=arrangement.laws, **between)
    positions.flags.writeable = False  # throws may share them
    first = np.where(np.isinf(state.law_first), np.nan, state.law_first)
    placed, watched = state.law_placed.copy(), None
    if plan.watches and outcome.complete:
        onsets = None if machines is None else machines.onsets
        every = {"time": instants, "inputs": positions, "law_first": first}
        watched = trim_watched(run.record, plan, onsets, **every, law_placed=placed)
    if not grid.filled_in:
        whole = plan.whole(kept)
        instants, positions = instants[whole], positions[whole]
    history = History(
        time=instants,
        inputs=positions,
        q=record.q,
        g=record.g,
        law_force=record.law,
        friction_force=record.friction,
        stored=record.stored,
        ledger=record.ledger,
        law_placed=placed,
        law_first=first,
        condensed=arrangement.condensed,
        laws=arrangement.laws,
        machines=machines,
        outcome=outcome,
        iterations=int(state.counters[COUNT_ITERATIONS]),
        flips=int(state.counters[COUNT_FLIPS]),
        halved=int(state.counters[COUNT_HALVED]),
        obstructions=kept_obstructions(run.obstructions),
        watched=watched,
    )
    give_back(arrangement, run, state)  # and no other run takes it over before
    return history


def _march(run: Run, state: State, rods: Rods | None, first: int, last: int) -> tuple[int, int]:
    if rods is None:
        return march(run, state, first, last, None)
    return march_with_machines(run, state, first, last, rods)


# Whether the kernels for drives that are machines, and for others, are at hand.
_at_hand: set[bool] = set()


def _compile_march(run: Run, state: State, rods: Rods | None, *, after_motion: bool) -> None:
    """Compile or load the time loop on its first use, while Ctrl-C still ends the program at once.

    A motion before the start knows no machines.
    """
    needed = {rods is not None, False} if after_motion else {rods is not None}
    if needed <= _at_hand:
        return
    loops: list[tuple[Callable[..., object], tuple[object, ...]]] = []
    if True in needed:
        row, table = np.zeros(1), np.zeros((1, 1))
        loops = [
            (march_with_machines, (run, state, 0, 0, rods)),
            (start_rods, (run, state, rods)),
            (end_pause, (run, rods, 0)),
            (find_slips, (row, table, table, row, (0.0, 0.0), np.zeros((1, 1), dtype=np.int64))),
        ]
    loops += [(march, (run, state, 0, 0, None))] if False in needed else []
    kernels = (equilibrium, settle, anchor_at_rest, equilibrium_residual)
    of_start = [(kernel, (run, state)) for kernel in kernels]
    prepare_kernels(*loops, *of_start, (store_instant, (run, state, 0)))
    _at_hand.update(needed)


def _march_in_chunks(
    run: Run,
    state: State,
    rods: Rods | None,
    grid: Grid,
    report: Callable[[int, int], None] | None,
) -> tuple[Code, int]:
    """March to the end in chunks of about `REPORT_INTERVAL`, and report after each."""
    done, until = 0, grid.n_steps if rods is None else grid.room
    chunk = FIRST_WITHOUT_REPORT if report is None else FIRST_REPORT
    try:
        while done < until:
            began = time.perf_counter()
            last = min(done + chunk, until)
            with held_interrupt():
                number, done = _march(run, state, rods, done, last)
            if number != Code.COMPLETE:
                return Code(number), done
            took = max(time.perf_counter() - began, 1e-3)
            chunk = max(1, round(chunk * min(REPORT_INTERVAL / took, 4.0)))
            if report is not None:
                report(done, max(grid.n_steps, 0 if rods is None else int(rods.schedule[DUE])))
            if done < last:  # the schedule of machines has ended
                break
    except KeyboardInterrupt:  # between two kernels
        return Code.INTERRUPTED, done
    return Code.COMPLETE, done


def _name_unconverged(mechanism: Mechanism, run: Run) -> tuple[str, ...]:
    """Return the names of the laws on rows that still changed when the last attempt ended."""
    rows, table = run.work.unconverged, run.table
    if not np.count_nonzero(rows):
        return ()
    names = [name for name, row in zip(mechanism.law_names, table.row, strict=True) if rows[row]]
    names += [
        f"friction {name}"
        for name, row in zip(mechanism.friction_names, table.friction_row, strict=True)
        if rows[row]
    ]
    return tuple(dict.fromkeys(names))
