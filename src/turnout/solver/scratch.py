"""Memory of runs: buffers of histories that serve run after run, and scratch arrays of kernels.

The operating system fills fresh memory with zeros when it is first touched, which took a tenth of
the time of a run in waveform mode. A buffer that no array refers to any more therefore serves the
next run.
"""

import math
import weakref
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.lanes import LANES, whole_lines
from turnout.kernels.shared_record import address_of, shared_record
from turnout.law.table import LawTable
from turnout.solver.system import Ints, System

Floats = NDArray[np.float64]

MOST_KEPT = 16 * 2**20
"""Buffers of more numbers than this go back to the operating system; at most two are kept."""

LARGE = 2**20
"""Buffers of fewer numbers than this are kept apart, at most `MOST_SMALL` of them."""
MOST_SMALL = 8

_free_buffers: deque[Floats] = deque(maxlen=2)
_free_small: deque[Floats] = deque(maxlen=MOST_SMALL)


def acquire_buffer(count: int) -> Floats:
    """Return an uninitialised array of at least `count` numbers, at most twice as many.

    Its memory becomes free for the next call once the last array that shares it is gone.

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
        loan = _Loan(found, _release_buffer)
        loan.memory = memory
        _loans[id(loan)] = loan
    return found


class _Loan(weakref.ref[Floats]):
    """A reference to an array in use, and the buffer that is free once the array is gone.

    Its callback may run in any thread, at any time, and so must not wait for a lock.
    """

    __slots__ = ("memory",)
    memory: Floats


_loans: dict[int, _Loan] = {}


def _release_buffer(loan: _Loan) -> None:
    del _loans[id(loan)]
    kept = _free_small if loan.memory.size < LARGE else _free_buffers
    kept.append(loan.memory)


def lines_from_buffer(*shape: int) -> Floats:
    """Return an uninitialised array from `acquire_buffer` that begins at a cache line."""
    count = int(math.prod(shape))
    memory = acquire_buffer(int(whole_lines(count)) + LANES)
    first = -(address_of(memory) // 8) % LANES
    return memory[first : first + count].reshape(shape)


def release_buffers() -> None:
    """Return the memory of free buffers to the operating system."""
    _free_buffers.clear()
    _free_small.clear()


def _take_fitting(count: int) -> Floats | None:
    """Take a free buffer of `count` to twice as many numbers; None where there is none."""
    kept = _free_small if count < LARGE else _free_buffers
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
      ``right_side`` are predicted from them, `turnout.solver.step`;
    - ``free``: displacements of the last solution without forces of inputs and joining rows [m];
    - ``padded_inputs``: a zero, then the inputs of the last solution [m]; ``law_input`` that of
      every law;
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
    padded_inputs: Floats
    law_input: Floats
    inputs_start: Floats
    inputs_end: Floats
    changed: Ints


def new_work(system: System, table: LawTable) -> Work:
    """Return scratch arrays of the sizes of a system and its laws."""
    n_places = system.row_ends.shape[0]
    n_inputs = int(table.input_index.max(initial=-1)) + 1

    def modal() -> Floats:
        return np.zeros(system.load.size)

    def by_place() -> Floats:
        return np.zeros(n_places)

    def flags() -> Ints:
        return np.zeros(n_places, dtype=np.int64)

    return shared_record(
        Work(
            row=np.zeros(2 * n_places + int(np.max(np.diff(system.pattern_start), initial=1))),
            q_pred=modal(),
            v_pred=modal(),
            right_side=modal(),
            free=by_place(),
            input_force=by_place(),
            end_force=by_place(),
            slot_force=np.zeros(system.slot_start[-1]),
            joining=by_place(),
            input_end_force=np.zeros(system.input_end.size),
            coupled_end=flags(),
            dirty=flags(),
            dirty_list=flags(),
            unconverged=flags(),
            saved_segment=np.zeros(table.row.size, dtype=np.int64),
            saved_friction=np.zeros(table.friction_row.size),
            q_start=modal(),
            g_end=by_place(),
            g_start=by_place(),
            argument=np.zeros(table.row.size),
            force=np.zeros(table.row.size),
            trial=np.zeros(table.friction_row.size),
            limit=np.zeros(table.friction_row.size),
            friction_shift=np.zeros(table.friction_row.size),
            foot_shift=by_place(),
            right_side_end=modal(),
            right_side_start=modal(),
            end_error=by_place(),
            modal_error=modal(),
            end_scratch=by_place(),
            padded_inputs=np.zeros(n_inputs + 1),
            law_input=np.zeros(table.row.size),
            inputs_start=np.zeros(n_inputs),
            inputs_end=np.zeros(n_inputs),
            changed=np.ones(2, dtype=np.int64),
        )
    )
