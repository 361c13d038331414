"""Arrange a mechanism for the kernels, and find where it rests."""

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.integrate.arrange import Arranged
from turnout.integrate.columns import rebuild
from turnout.integrate.compliance import make_level
from turnout.integrate.energy import account_friction, account_laws
from turnout.integrate.equilibrium import equilibrium, resting_segments
from turnout.integrate.interrupt import heard
from turnout.integrate.march import Record
from turnout.integrate.memory import borrowed
from turnout.integrate.outcome import Code
from turnout.integrate.places import placed, whole_lines
from turnout.integrate.scheme import AlphaCoefficients, Scheme
from turnout.integrate.solve import Tolerances, evaluate
from turnout.integrate.state import LEVEL, State, fresh_state, set_segments
from turnout.integrate.step import Stepping
from turnout.integrate.stored import rest_at
from turnout.integrate.system import System
from turnout.integrate.work import Work, new_work
from turnout.law.kernel import SLIP_FORWARD, STICK
from turnout.law.shared import shared
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism

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


def prepare(
    made: Arranged,
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
    # one level a halving, and one without inertia
    state = fresh_state(system, table, n_inputs=positions.shape[1], levels=scheme.halvings + 2)
    state.inputs[:] = positions[0]
    n_modes = system.load.size
    alpha = AlphaCoefficients.from_spectral_radius(scheme.spectral_radius)
    return Run(
        system=system,
        laws=laws,
        table=table,
        state=state,
        work=new_work(system, table),
        tolerances=Tolerances(scheme.gap_tolerance, scheme.force_tolerance, scheme.iterations),
        stepping=Stepping(
            scheme.step,
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
    memory = borrowed(count * sum(widths.values()) + page)
    at, arrays = (-(memory.ctypes.data // 8)) % page, {}
    for name, width in widths.items():
        arrays[name] = memory[at : at + count * width].reshape(count, width)
        at += count * width
    velocity = np.zeros((count if with_velocity else 1, arrays["q"].shape[1]))
    return shared(Record(**arrays, residual=np.zeros(1), folded=np.zeros(1), v=velocity))


def instants_of(run: Run, count: int) -> Record:
    """Return the first stored instants, without what fills the lines of memory."""
    record, laws, modes = run.record, run.laws, run.system.load.size
    widths = {
        "q": modes,
        "g": run.system.row_place.size,
        "friction": laws.friction_row.size,
        "law": laws.row.size,
        "v": modes,
    }
    return Record(
        *(getattr(record, name)[:count, : widths.get(name)]
          if getattr(record, name).ndim == 2 else getattr(record, name)
          for name in Record._fields)
    )  # fmt: skip


def start(run: Run, mechanism: Mechanism, thread: Executor) -> Code:
    """Find the static equilibrium without friction, then anchor the feet where they stand."""
    system, laws, table, state, work = run.system, run.laws, run.table, run.state, run.work
    none = np.zeros_like(laws.friction_coefficient)
    slippery = shared(placed(laws, system.row_place)._replace(friction_coefficient=none))
    state.present[:] = (laws.appears <= 1e-9) & (laws.disappears >= -1e-9) & (laws.waits == 0)
    state.law_placed[state.present == 1] = 0.0
    set_segments(table, state, state.segment)
    state.friction[:] = SLIP_FORWARD
    if not _rests(run, slippery, thread):
        segments = resting_segments(mechanism, inputs=state.inputs, present=state.present)
        set_segments(table, state, segments)
        if not _rests(run, slippery, thread):
            return Code.NO_EQUILIBRIUM
    state.friction[:] = STICK
    state.anchor[:] = state.g[table.friction_row]
    evaluate(table, state, work)
    account_laws(system, table, state, work, state.inputs, 0.0)
    account_friction(system, state, work)
    state.ledger[:] = 0.0
    rest_at(system, table, state)
    if not run.stepping.inertia:
        rebuild(system, table, state, state.counters[LEVEL], work.row)
    return Code.COMPLETE


def _rests(run: Run, laws: LawTable, thread: Executor) -> bool:
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
