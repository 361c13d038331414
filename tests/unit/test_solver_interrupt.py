"""A kernel at work is stopped by Ctrl-C, between two solutions, and nothing half done is kept."""

import _thread
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import FrameType

import numpy as np
import pytest
from tests.unit.test_solver_columns import setup

from turnout.core.scheme import Scheme
from turnout.kernels import flag_setter, interrupt
from turnout.kernels.interrupt import call_interruptible, one_thread
from turnout.kernels.lanes import zeros_in_lines
from turnout.kernels.shared_record import shared_record
from turnout.law.friction import no_courses
from turnout.law.obstruction import no_obstructions
from turnout.panel.load import load_panel
from turnout.solver import integration
from turnout.solver.follow import follow_path
from turnout.solver.march import march
from turnout.solver.outcome import Code
from turnout.solver.prepared_run import PreparedRun
from turnout.solver.seen import StepRecord
from turnout.solver.solve import Tolerances, iterate_contact_set
from turnout.solver.step import Stepping
from turnout.throw.simulate import solve

TOLERANCES = Tolerances(1e-11, 1e-6, 40)


def test_what_a_kernel_returns_or_raises_comes_back() -> None:
    stop = np.zeros(1, dtype=np.int64)
    with one_thread() as thread:
        assert call_interruptible(thread, stop, divmod, 7, 2) == (3, 1)
        with pytest.raises(ZeroDivisionError):
            call_interruptible(thread, stop, divmod, 7, 0)
    assert stop[0] == 0


def of_the_program(number: int, frame: FrameType | None) -> None:
    signal.default_int_handler(number, frame)


@pytest.mark.usefixtures("python_ctrl_c")
@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is sent as a signal")
@pytest.mark.parametrize("handler", [signal.default_int_handler, of_the_program])
@pytest.mark.parametrize("stays", [True, False])
def test_ctrl_c_reaches_a_kernel_at_work(
    handler: Callable[[int, FrameType | None], None], stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Past Python's handler, which is held back, and by one of the program, which is not."""
    monkeypatch.setattr(interrupt, "HANDLERS_STAY", stays)
    stop = np.zeros(1, dtype=np.int64)

    def endless() -> str:
        while not stop[0]:
            time.sleep(1e-3)
        return "stopped"

    signal.signal(signal.SIGINT, handler)
    began = time.perf_counter()
    press = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
    press.start()
    try:
        with one_thread() as thread:
            assert (thread is None) == (stays and handler is signal.default_int_handler)
            assert call_interruptible(thread, stop, endless) == "stopped"
    finally:
        press.join()
    assert signal.getsignal(signal.SIGINT) is handler
    assert time.perf_counter() - began < 5.0
    with pytest.raises(KeyboardInterrupt):  # what comes later is for Python again
        signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("python_ctrl_c")
def test_a_signal_that_python_handles_ends_a_run_between_chunks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One that is no Ctrl-C, or a program's own call in place of it, waits for the kernel."""
    monkeypatch.setattr(integration, "FIRST_WITHOUT_REPORT", 100)
    monkeypatch.setattr(integration, "REPORT_INTERVAL", 1e-9)
    panel = load_panel("sb1")
    marched = integration._march

    def interrupted(run: PreparedRun, first: int, last: int) -> tuple[int, int]:
        found = marched(run, first, last)
        if last > 100:
            _thread.interrupt_main()
        return found

    monkeypatch.setattr(integration, "_march", interrupted)
    outcome = solve(panel, scheme=Scheme.of("quick")).history.outcome
    assert outcome.code is Code.INTERRUPTED
    assert outcome.step in (100, 101)


@pytest.mark.usefixtures("python_ctrl_c")
def test_ctrl_c_at_any_instant_leaves_no_lock_and_is_heard() -> None:
    """Where the thread is handed its kernel and gives its result, it raises nothing."""
    stop = np.zeros(1, dtype=np.int64)

    def pressed(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)

    class Thread(ThreadPoolExecutor):
        def submit(self, *given, **named):
            pressed()
            future = super().submit(*given, **named)
            pressed()
            return future

    with Thread(1) as thread:
        assert call_interruptible(thread, stop, abs, -1) == 1
    assert stop[0] == 1


def test_a_step_ends_where_it_is_and_the_state_is_that_of_the_last_instant() -> None:
    made = setup(7, seed=5)
    system, table, state, work = made.system, made.table, made.state, made.work
    stepping = Stepping(1e-3, 0.0, 1 / 3, 4 / 9, 5 / 6, 6, True, 1, True)
    markers = np.array([[0.0, 0.0], [5e-3, 1e-3], [9e-3, 2e-3]])
    shapes = [(3, 40)] * 6 + [(1,), (1, 40)]
    record = shared_record(StepRecord(*(zeros_in_lines(*shape) for shape in shapes)))
    q, inputs = state.q.copy(), state.inputs.copy()
    work.stop[0] = 1
    given = (system, table, state, work, TOLERANCES, stepping, markers, 0, 2, record)
    memory = (shared_record(no_obstructions()), shared_record(no_courses()))
    assert march(*given, *memory) == (Code.INTERRUPTED, 0)
    np.testing.assert_array_equal(state.q, q)
    np.testing.assert_array_equal(state.inputs, inputs)


def test_the_walk_along_the_path_listens_too() -> None:
    made = setup(7, seed=5)
    system, table, state, work = made.system, made.table, made.state, made.work
    work.stop[0] = 1
    inputs = (np.zeros(2), np.ones(2))
    given = (system, table, state, work, TOLERANCES, inputs, 3e4, 900.0)
    assert follow_path(*given) == Code.INTERRUPTED
    assert iterate_contact_set(system, table, state, work, TOLERANCES) == Code.INTERRUPTED


@pytest.mark.usefixtures("python_ctrl_c")
@pytest.mark.skipif(os.name != "posix", reason="handlers stay in place there")
def test_ctrl_c_as_a_kernel_is_called_leaves_the_handler_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Python raises what it has noted once the call that sets the handler returns."""
    before = flag_setter.present_handler(signal.SIGINT)

    def interrupted(number: int, handler: int) -> int:
        found = set_handler(number, handler)
        if handler != before:
            raise KeyboardInterrupt
        return found

    set_handler = flag_setter.set_handler
    monkeypatch.setattr(flag_setter, "set_handler", interrupted)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            call_interruptible(None, np.zeros(1, dtype=np.int64), max, 1, 2)
        assert flag_setter.present_handler(signal.SIGINT) == before
