"""Memory of runs: scratch arrays of the kernels, and buffers of histories.

Memory of histories that nobody looks at any more, which serves the next run.

Memory that is fresh from the operating system is filled with zeros when it is first touched, which
took a tenth of the time of a run in waveform mode.

Scratch arrays of the kernels.
"""

import weakref
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.integrate.system import Ints, System
from turnout.kernels.records import shared_record
from turnout.law.table import LawTable

Floats = NDArray[np.float64]

MOST_KEPT = 16 * 2**20
"""Pieces of more numbers than this go back to the operating system; two pieces are kept at most."""

_free_buffers: deque[Floats] = deque(maxlen=2)


def acquire_buffer(count: int) -> Floats:
    """Return room for so many numbers or a few more; what they are means nothing.

    It comes back by itself once the last array that shares it is gone.

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
    memory = _fitting(count)
    if memory is None:
        memory = np.empty(count)
    found = np.frombuffer(memory.data, dtype=np.float64)
    if memory.size <= MOST_KEPT:
        weakref.finalize(found, _free_buffers.append, memory).atexit = False
    return found


def release_buffers() -> None:
    """Give spare memory back to the operating system."""
    _free_buffers.clear()


def _fitting(count: int) -> Floats | None:
    """Take a spare piece of memory that is large enough and not twice as large."""
    for _ in range(len(_free_buffers)):
        try:
            memory = _free_buffers.pop()  # the last one may still be in the processor's caches
        except IndexError:  # another thread was quicker
            return None
        if count <= memory.size <= 2 * count:
            return memory
        _free_buffers.appendleft(memory)
    return None


class Work(NamedTuple):
    """Scratch arrays of the kernels; their content means nothing between calls.

    Except `push`, which is zero on rows without an input, `unsettled`, which flags the rows that
    still changed when a step was given up, `changed`, whether a law has changed since the contact
    set was saved, and `stop`, which another thread sets to end the work between two solutions.
    At the last solution `given` holds a zero and the inputs, and
    `law_input` that of every law.
    `q`, `g_start` and the two of the contact set are the state at the start of a step; `argument`,
    `force`, `trial` and `limit` are of the last solution, `turnout.integrate.solve`.
    """

    row: Floats
    predicted: Floats
    velocity: Floats
    right_side: Floats
    push: Floats
    end_force: Floats
    slot_force: Floats
    joining: Floats
    pushed: Floats
    joined_end: Ints
    dirty: Ints
    dirty_list: Ints
    unsettled: Ints
    old_segment: Ints
    old_friction: Floats
    q: Floats
    g: Floats
    g_start: Floats
    argument: Floats
    force: Floats
    trial: Floats
    limit: Floats
    aim: Floats
    origin: Floats
    end_error: Floats
    modal_error: Floats
    found: Floats
    of_modes: Floats
    given: Floats
    law_input: Floats
    inputs: Floats
    inputs_end: Floats
    changed: Ints
    stop: Ints


def new_work(system: System, table: LawTable) -> Work:
    """Return scratch arrays that fit a system."""
    n_places = system.row_ends.shape[0]
    n_inputs = int(table.input_index.max(initial=-1)) + 1

    def modal() -> Floats:
        return np.zeros(system.load.size)

    def placed() -> Floats:
        return np.zeros(n_places)

    def flags() -> Ints:
        return np.zeros(n_places, dtype=np.int64)

    return shared_record(
        Work(
            row=np.zeros(2 * n_places + int(np.max(np.diff(system.pattern_start), initial=1))),
            predicted=modal(),
            velocity=modal(),
            right_side=modal(),
            push=placed(),
            end_force=placed(),
            slot_force=np.zeros(system.slot_start[-1]),
            joining=placed(),
            pushed=np.zeros(system.pushed_end.size),
            joined_end=flags(),
            dirty=flags(),
            dirty_list=flags(),
            unsettled=flags(),
            old_segment=np.zeros(table.row.size, dtype=np.int64),
            old_friction=np.zeros(table.friction_row.size),
            q=modal(),
            g=placed(),
            g_start=placed(),
            argument=np.zeros(table.row.size),
            force=np.zeros(table.row.size),
            trial=np.zeros(table.friction_row.size),
            limit=np.zeros(table.friction_row.size),
            aim=modal(),
            origin=modal(),
            end_error=placed(),
            modal_error=modal(),
            found=placed(),
            of_modes=modal(),
            given=np.zeros(n_inputs + 1),
            law_input=np.zeros(table.row.size),
            inputs=np.zeros(n_inputs),
            inputs_end=np.zeros(n_inputs),
            changed=np.ones(1, dtype=np.int64),
            stop=np.zeros(1, dtype=np.int64),
        )
    )
