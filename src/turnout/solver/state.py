"""A run as the kernels take it: what is constant in it, its memory, and the state they change.

The operating system fills fresh memory with zeros when it is first touched, which took a tenth of
the time of a run in waveform mode. A buffer that no array refers to any more therefore serves the
next run.
"""

import math
import weakref
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.scheme import AlphaCoefficients, Scheme
from turnout.kernels.compiled import compiled
from turnout.kernels.lanes import LANES, whole_lines, zeros_in_lines
from turnout.kernels.shared_record import address_of, shared_record
from turnout.law.friction import FrictionCourses
from turnout.law.kernel import segment_for
from turnout.law.obstruction import Obstructions
from turnout.law.table import LawTable
from turnout.solver.system import Floats, Ints, System, as_unsigned

MOST_KEPT = 16 * 2**20
"""Buffers of more numbers than this go back to the operating system; at most two are kept."""

LARGE = 2**20
"""Buffers of fewer numbers than this are kept apart, at most `MOST_SMALL` of them."""
MOST_SMALL = 8

_free = (deque[Floats](maxlen=MOST_SMALL), deque[Floats](maxlen=2))
"""Free buffers, small ones and large ones."""


def acquire_buffer(count: int) -> Floats:
    """Return an uninitialised array of at least `count` numbers, at most twice as many.

    Its memory becomes free for the next call once the last array that shares it is gone, in any
    thread and at any time, so that this must not wait for a lock.

    Examples
    --------
    >>> first = acquire_buffer(1000)
    >>> address = first.ctypes.data
    >>> part = first[10:20]
    >>> del first
    >>> acquire_buffer(1000).ctypes.data == address  # a part of it is in use
    False
    >>> del part
    >>> acquire_buffer(900).ctypes.data == address
    True
    """
    memory = _take_fitting(count)
    if memory is None:
        memory = np.empty(count)
    found = np.frombuffer(memory.data, dtype=np.float64)
    if memory.size <= MOST_KEPT:
        back = weakref.finalize(found, _free[memory.size >= LARGE].append, memory)
        back.atexit = False
    return found


def lines_from_buffer(*shape: int) -> Floats:
    """Return an uninitialised array from `acquire_buffer` that begins at a cache line."""
    count = int(math.prod(shape))
    memory = acquire_buffer(int(whole_lines(count)) + LANES)
    first = -(address_of(memory) // 8) % LANES
    return memory[first : first + count].reshape(shape)


def release_buffers() -> None:
    """Return the memory of free buffers to the operating system."""
    for kept in _free:
        kept.clear()


def _take_fitting(count: int) -> Floats | None:
    """Take a free buffer of `count` to twice as many numbers; None where there is none."""
    kept = _free[count >= LARGE]
    for _ in range(len(kept)):
        try:
            memory = kept.pop()  # the last one may still be in the processor's caches
        except IndexError:  # another thread was quicker
            return None
        if count <= memory.size <= 2 * count:
            return memory
        kept.appendleft(memory)
    return None


LAWS, FRICTIONS = range(2)
"""Places in `Work.changed`."""


class Work(NamedTuple):
    """Scratch arrays of the kernels; their content means nothing between calls.

    The exceptions are

    - ``q_start``, ``g_start``, ``saved_segment``, ``saved_friction``: modal coordinates,
      displacements [m] and contact set at the start of a step; ``q_pred``, ``v_pred`` and
      ``right_side`` are predicted from them, `turnout.solver.march`;
    - ``free``: displacements of the last solution without forces of inputs and joining rows [m];
    - ``law_input``: input of every law in the last solution, zero for one without [m];
    - ``argument``, ``force``, ``trial``, ``limit``: laws and frictions at the last solution;
    - ``input_force``: force of the inputs on their rows [N], zero on rows without an input;
    - ``foot_shift``: zeros, in which changes of forces on feet are summed up [N];
    - ``unconverged``: flags the rows that still changed when a step was given up;
    - ``changed``: whether `LAWS` and `FRICTIONS` may have changed since the contact set was saved.
    """

    row: Floats
    q_pred: Floats
    v_pred: Floats
    right_side: Floats
    free: Floats
    input_force: Floats
    end_force: Floats
    slot_force: Floats
    joining: Floats
    input_end_force: Floats
    coupled_end: Ints
    dirty: Ints
    dirty_list: Ints
    unconverged: Ints
    saved_segment: Ints
    saved_friction: Floats
    q_start: Floats
    g_end: Floats
    g_start: Floats
    argument: Floats
    force: Floats
    trial: Floats
    limit: Floats
    friction_shift: Floats
    foot_shift: Floats
    right_side_end: Floats
    right_side_start: Floats
    end_error: Floats
    modal_error: Floats
    end_scratch: Floats
    law_input: Floats
    inputs_start: Floats
    inputs_end: Floats
    changed: Ints


def new_work(system: System, table: LawTable) -> Work:
    """Return scratch arrays of the sizes of a system and its laws."""
    n_places, n_laws = system.row_ends.shape[0], table.row.size
    longest = int(np.max(np.diff(system.pattern_start), initial=1))
    n_inputs = int(table.input_index.max(initial=-1)) + 1
    return shared_record(
        Work(
            row=np.zeros(2 * n_places + longest),
            **_alike(
                np.zeros(system.load.size),
                "q_start q_pred v_pred modal_error right_side right_side_start right_side_end",
            ),
            **_alike(
                np.zeros(n_places),
                "free input_force end_force joining g_start g_end foot_shift end_error end_scratch",
            ),
            **_alike(
                np.zeros(n_places, dtype=np.int64), "coupled_end dirty dirty_list unconverged"
            ),
            **_alike(np.zeros(n_laws), "argument force law_input"),
            **_alike(
                np.zeros(table.friction_row.size), "saved_friction trial limit friction_shift"
            ),
            **_alike(np.zeros(n_inputs), "inputs_start inputs_end"),
            slot_force=np.zeros(system.slot_start[-1]),
            input_end_force=np.zeros(system.input_end.size),
            saved_segment=np.zeros(n_laws, dtype=np.int64),
            changed=np.ones(2, dtype=np.int64),
        )
    )


def _alike(array: NDArray[Any], names: str) -> dict[str, NDArray[Any]]:
    """Return an array under some names; `shared_record` makes a copy for each."""
    return dict.fromkeys(names.split(), array)


class Options(NamedTuple):
    """Numerical choices of a run.

    `gap` [m] and `force` [N] are the largest violations of a law that are overlooked; a step takes
    at most so many `iterations`. `step` is the nominal one [s]; the next four are coefficients of
    `turnout.solver.march` [-]. A step may be halved `halvings` times, and at last `follow_path`;
    every `stride`-th instant is stored. Without `inertia` a run is a sequence of equilibria.
    """

    gap: float
    force: float
    iterations: int
    step: float
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    halvings: int
    follow_path: bool
    stride: int
    inertia: bool

    @classmethod
    def of(cls, scheme: Scheme) -> "Options":
        """Return the options of a scheme."""
        alpha = AlphaCoefficients.from_spectral_radius(scheme.spectral_radius)
        return cls(
            gap=float(scheme.gap_tolerance),
            force=float(scheme.force_tolerance),
            iterations=scheme.iterations,
            step=float(scheme.step),
            alpha_m=alpha.alpha_m,
            alpha_f=alpha.alpha_f,
            beta=alpha.beta,
            gamma=alpha.gamma,
            halvings=scheme.halvings,
            follow_path=scheme.follow_path,
            stride=max(scheme.stride, 1),
            inertia=scheme.inertia,
        )


# Unsigned as those of watched runs: other kinds of arrays are other kernels.
_NO_PLACES = as_unsigned(np.zeros(0, dtype=np.int64))


class StepRecord(NamedTuple):
    """Stored instants, one row each, and the largest equilibrium residual so far [m].

    `q` and `v` are modal coordinates and velocities, `g` the displacements of the rows [m],
    `friction` and `law` forces [N], `stored` and `ledger` energies and work [J]
    (`turnout.solver.energy`). Rows of `q`, `g`, `friction`, `law` and `v` fill whole cache
    lines; those of the first four begin at one.

    Of a watched run `places` are, of each stored instant, the row of `q`, `g`, `friction` and `law`
    in which it is stored whole, that of `seen`, and that of `stored` and `ledger`, -1 for none;
    without entries every instant has its own. So many rows of each are `given` (`give_place`).
    `effort` are the forces of the laws `watched` at all instants [N]; `seen` displacements [m] are
    `seen_load` under the constant load and the sum over the places, modes, laws and frictions of
    ``..._list`` with a row of weights in ``..._rows`` for each. The lists fill whole cache lines;
    `picked` is scratch for the longest.
    """

    q: Floats
    g: Floats
    friction: Floats
    law: Floats
    stored: Floats
    ledger: Floats
    residual: Floats
    v: Floats
    places: Ints = np.zeros((0, 3), dtype=np.int64)
    given: Ints = np.zeros(3, dtype=np.int64)
    watched: Ints = np.zeros(0, dtype=np.int64)
    effort: Floats = np.zeros((0, 0))
    seen: Floats = np.zeros((0, 0))
    seen_load: Floats = np.zeros(0)
    stored_list: Ints = _NO_PLACES
    stored_rows: Floats = np.zeros((0, 0))
    mode_list: Ints = _NO_PLACES
    mode_rows: Floats = np.zeros((0, 0))
    law_list: Ints = _NO_PLACES
    law_places: Ints = _NO_PLACES
    law_rows: Floats = np.zeros((0, 0))
    friction_list: Ints = _NO_PLACES
    friction_rows: Floats = np.zeros((0, 0))
    picked: Floats = np.zeros(0)


class Run(NamedTuple):
    """All of a run but its `State`, by reference.

    Attributes
    ----------
    system : System
        The condensed linear system.
    table : LawTable
        Laws by places; what they remember changes.
    work : Work
        Scratch arrays.
    options : Options
        Numerical choices.
    positions : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m]; machines write those of their rods.
    record : StepRecord
        Memory of what is saved.
    obstructions : Obstructions
        Laws with memory.
    courses : FrictionCourses
        Friction along the stroke.
    """

    system: System
    table: LawTable
    work: Work
    options: Options
    positions: Floats
    record: StepRecord
    obstructions: Obstructions
    courses: FrictionCourses


class State(NamedTuple):
    """All that changes during a run; kernels change it in place.

    Laws: on its present `segment` a law resists with ``slope * (g - input) + constant`` [N] for
    ``g - input`` between ``lower`` and ``upper`` [m]; at its argument e [m] it stores
    ``(slope * e / 2 + intercept) * e + potential`` [J]; `set_segment` keeps these together.
    ``present`` is 0 for an absent law. ``input_law_force`` are the forces of the driven laws at the
    last instant [N], ``jump`` the force that a law lost when it was switched [N]; ``law_placed``
    and ``law_first`` are the times at which a law that does not always act appeared, and first had
    a force [s].

    Frictions: ``friction`` is the branch, see `turnout.law.kernel`, ``anchor`` the displacement at
    which the stick spring is free [m], ``friction_force`` what it resists with [N], and
    ``friction_beyond`` how far its limit lies above that of a constant coefficient [N].

    Motion: modal coordinates ``q`` with their velocities ``v``, algorithmic accelerations ``a`` and
    accelerations ``acceleration``, `turnout.solver.march`; ``g`` holds the displacements of all
    places [m], `turnout.solver.system`. ``q_rest``, ``modal_force_rest``, ``law_rest_offset``
    and ``friction_rest_offset`` are the reference of the energies, and ``ledger`` sums up work [J],
    `turnout.solver.energy`.

    Solution: ``entries`` and ``shift`` are the deviations of the rows; the columns with their
    slots, and the coupling of the blocks, factorised with its ``pivots``, are those of
    `turnout.solver.columns` for the step of the present level. ``compliance`` depends
    on the length of the step alone and is kept level by level, ``level_ready`` says which levels
    have been assembled (`turnout.solver.arrange`). ``drift`` is the growth of rounding since it
    was last measured [-].
    ``counters``: active rows that join blocks, flips since the last rebuild, all flips, all
    iterations, halved steps, rebuilds, the level; 1 where the coupling is up to date, else 0;
    and a bit for each block whose columns or right side have changed since the last solution, -1
    for all.
    """

    segment: Ints
    present: Ints
    slope: Floats
    constant: Floats
    lower: Floats
    upper: Floats
    intercept: Floats
    potential: Floats
    friction: Floats
    anchor: Floats
    friction_force: Floats
    friction_beyond: Floats
    input_law_force: Floats
    jump: Floats
    q_rest: Floats
    modal_force_rest: Floats
    law_rest_offset: Floats
    friction_rest_offset: Floats
    entries: Floats
    shift: Floats
    slot_of_end: Ints
    end_of_slot: Ints
    row_of_slot: Ints
    slots: Ints
    columns: Floats
    joining: Ints
    coupling: Floats
    pivots: Ints
    level_ready: Ints
    mode_columns: Floats
    constant_column: Floats
    compliance: Floats
    q: Floats
    v: Floats
    a: Floats
    acceleration: Floats
    g: Floats
    inputs: Floats
    ledger: Floats
    counters: Ints
    drift: Floats
    law_placed: Floats
    law_first: Floats


@compiled
def set_segment(table: LawTable, state: State, law: int, segment: int) -> None:
    """Move a law to a segment; an absent law keeps it but has neither force nor bounds."""
    state.segment[law] = segment
    if state.present[law] == 0:
        state.slope[law] = 0.0
        state.constant[law] = 0.0
        state.intercept[law] = 0.0
        state.potential[law] = 0.0
        state.lower[law] = -np.inf
        state.upper[law] = np.inf
        return
    at = table.segment_start[law] + segment
    state.slope[law] = table.slope[at]
    state.constant[law] = table.intercept[at] - table.slope[at] * table.offset[law]
    state.intercept[law] = table.intercept[at]
    state.potential[law] = table.potential[at]
    state.lower[law] = table.segment_lower[at] + table.offset[law]
    state.upper[law] = table.segment_upper[at] + table.offset[law]


(
    COUNT_JOINING,
    COUNT_RECENT,
    COUNT_FLIPS,
    COUNT_ITERATIONS,
    COUNT_HALVED,
    COUNT_REBUILDS,
    LEVEL,
    COUPLED,
    UNSOLVED,
) = range(9)


@compiled
def set_home_segments(table: LawTable, state: State) -> None:
    """Put every law on its base segment, or on the one that holds the argument zero."""
    for law in range(table.row.size):
        segment = table.base_segment[law]
        if segment < 0:
            segment = segment_for(table, law, 0.0, 0, 0.0)
        set_segment(table, state, law, segment)


@compiled
def set_segments(table: LawTable, state: State, segments: Ints) -> None:
    """Put every law on a segment."""
    for law in range(table.row.size):
        set_segment(table, state, law, segments[law])


def fresh_state(system: System, table: LawTable, *, n_inputs: int, levels: int) -> State:
    """Return a state at rest with every law on its base segment (or where its argument is 0).

    Parameters
    ----------
    levels : int
        How many lengths of a step there are.
    """
    n_modes, n_places = system.load.size, system.row_ends.shape[0]
    n_ends, n_slots = int(system.follower_start[-1]), int(system.slot_start[-1])
    widest = int(np.max(np.diff(system.end_start), initial=0))
    n_laws, n_joining = table.row.size, int(np.sum(system.row_ends[:, 1] >= 0))
    state = shared_record(
        State(
            **_alike(np.zeros(n_modes), "q v a acceleration q_rest modal_force_rest"),
            **_alike(
                np.zeros(n_laws),
                "slope constant lower upper intercept potential jump law_rest_offset",
            ),
            segment=np.zeros(n_laws, dtype=np.int64),
            present=np.ones(n_laws, dtype=np.int64),
            law_placed=np.full(n_laws, np.nan),
            law_first=np.full(n_laws, np.inf),
            **_alike(
                np.zeros(table.friction_row.size),
                "friction anchor friction_force friction_beyond friction_rest_offset",
            ),
            input_law_force=np.zeros(system.input_law.size),
            entries=np.zeros(system.pattern_list.size),
            **_alike(np.zeros(n_places), "g shift"),
            slot_of_end=np.full(n_ends, -1, dtype=np.int64),
            **_alike(np.full(n_slots, -1, dtype=np.int64), "end_of_slot row_of_slot"),
            slots=np.zeros(system.end_stop.size, dtype=np.int64),
            columns=zeros_in_lines(n_slots, widest),
            joining=np.full(n_joining, -1, dtype=np.int64),
            coupling=np.zeros((n_joining, n_joining)),
            pivots=np.zeros(n_joining, dtype=np.int64),
            level_ready=np.zeros(levels, dtype=np.int64),
            mode_columns=zeros_in_lines(n_modes, widest),
            constant_column=np.zeros(int(system.end_start[-1])),
            compliance=lines_from_buffer(levels, n_ends, widest),
            inputs=np.zeros(n_inputs),
            ledger=np.zeros(7),
            counters=np.zeros(9, dtype=np.int64),
            drift=np.ones(1),
        ),
        lower=-np.inf,
        upper=np.inf,
    )
    set_home_segments(table, state)
    return state
