"""Workers load what they need once they watch the run, not before, and never meet Ctrl-C."""

import gc
import os
import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest
from tests.faults.terminal import run_code

from turnout.core.errors import FileError
from turnout.core.interrupt import held_interrupt
from turnout.core.processes import (
    FreshProcesses,
    Tasks,
    end_pool,
    worker_processes,
)
from turnout.core.workers import Workers
from turnout.study.sweep import worker as sweep_work
from turnout.study.sweep.run import sweep_workers


def test_what_a_process_loads_first_is_light() -> None:
    names = run_code("import sys, turnout.core.processes; print(*sorted(sys.modules))").split()
    ours = {name for name in names if name.split(".")[0] in ("turnout", "numpy")}
    light = ("lazy", "processes", "interrupt")
    assert ours == {"turnout", "turnout.core", *(f"turnout.core.{name}" for name in light)}


@pytest.mark.usefixtures("worker_processes")
def test_the_collector_rests_until_all_is_loaded() -> None:
    with sweep_workers(1) as workers:
        jobs = [
            *(gc.isenabled, sweep_work.initialize_worker, gc.isenabled),
            *(gc.get_threshold, gc.get_freeze_count),
        ]
        found: dict[int, Any] = dict(workers.run(jobs))
    assert (found[0], found[2]) == (False, True)
    assert found[3][0] == sweep_work.GC_THRESHOLD
    assert found[4] > 10_000


@pytest.mark.usefixtures("worker_processes")
@pytest.mark.skipif(os.name != "posix", reason="SIGINT is sent as on a terminal")
def test_ctrl_c_while_python_starts_does_not_reach_it() -> None:
    process = FreshProcesses().Process(target=gc.collect)
    process.start()
    assert process.pid is not None
    os.kill(process.pid, signal.SIGINT)
    process.join(60.0)
    assert process.exitcode == 0
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.usefixtures("worker_processes")
def test_an_ended_process_is_an_error_that_says_what_to_do() -> None:
    with (
        pytest.raises(FileError, match="run the same command to continue"),
        Workers(1) as workers,
    ):
        list(workers.run([partial(os._exit, 1)]))


@pytest.mark.usefixtures("worker_processes")
def test_a_result_cut_off_half_way_holds_up_no_end() -> None:
    pool = worker_processes(1)
    pool.submit(gc.isenabled).result()
    manager, results = pool._executor_manager_thread, pool._result_queue
    assert manager is not None
    # The length of a message, as a process ended right then leaves it.
    results._writer._send(b"\0\0\0\x10")
    end_pool(pool)
    assert not manager.is_alive()


@pytest.mark.usefixtures("python_ctrl_c")
def test_ctrl_c_waits_until_a_task_has_been_handed_over() -> None:
    handed: list[int] = []

    class Pool(ThreadPoolExecutor):
        def submit(self, *given, **named):
            signal.raise_signal(signal.SIGINT)
            handed.append(1)
            return super().submit(*given, **named)

    with Pool(1) as pool:
        tasks = Tasks[int](pool)
        with pytest.raises(KeyboardInterrupt):
            tasks.submit(abs, -1)
        assert handed == [1]
        assert [done.result() for done in tasks.all_done()] == [1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("python_ctrl_c")
def test_ctrl_c_ends_a_wait_for_tasks() -> None:
    with ThreadPoolExecutor(1) as pool:
        tasks, go_on = Tasks[bool](pool), threading.Event()
        tasks.submit(go_on.wait, 60.0)
        press = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
        press.start()
        with pytest.raises(KeyboardInterrupt):
            next(tasks.all_done())
        press.join()
        go_on.set()
        assert next(tasks.all_done()).result()


def test_a_program_that_ignores_ctrl_c_goes_on_ignoring_it() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with held_interrupt():
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_threads_hold_nothing() -> None:
    def held() -> object:
        with held_interrupt():
            return signal.getsignal(signal.SIGINT)

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(held).result() is signal.getsignal(signal.SIGINT)
