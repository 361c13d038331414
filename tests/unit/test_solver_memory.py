"""Memory of histories that are gone serves again; that of others is left alone."""

import numpy as np
from tests.unit.test_solver_scheme import oscillator

from turnout.solver.state import MOST_KEPT, acquire_buffer, release_buffers


def test_a_second_run_leaves_the_history_of_the_first_alone() -> None:
    first = oscillator(step=1e-3)
    kept = first.q[3:-1], first.ledger[-1]
    copies = [part.copy() for part in kept]
    del first
    second = oscillator(step=1e-3)
    for part, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(part, copy)
        assert not np.shares_memory(part, second.q)


def test_memory_serves_again_once_the_last_part_of_it_is_gone() -> None:
    release_buffers()
    part = acquire_buffer(5000)[7:9]
    address = part.base.ctypes.data
    others = [acquire_buffer(5000) for _ in range(3)]
    assert address not in [other.ctypes.data for other in others]
    del part
    assert acquire_buffer(4000).ctypes.data == address


def test_what_does_not_fit_is_not_used() -> None:
    release_buffers()
    small = acquire_buffer(100).ctypes.data
    found = acquire_buffer(101)
    assert found.size >= 101
    assert acquire_buffer(49).ctypes.data != small


def test_large_memory_goes_back() -> None:
    release_buffers()
    huge = acquire_buffer(MOST_KEPT + 1)
    del huge
    again = acquire_buffer(MOST_KEPT // 2 + 8)
    assert again.size == MOST_KEPT // 2 + 8
