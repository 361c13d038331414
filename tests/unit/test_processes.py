"""Workers load what they need once they watch the run, not before, and never meet Ctrl-C."""

import gc
import os
import signal
import subprocess
import sys

import pytest

from turnout.core.processes import FreshProcesses, closing_pool, end_pool, worker_processes
from turnout.errors import FileError
from turnout.sweep import worker as sweep_work
from turnout.sweep.run import local_pool

LOADED = "import sys, turnout.core.processes; print(*sorted(sys.modules))"


def test_what_a_process_loads_first_is_light() -> None:
    reported = subprocess.run(
        [sys.executable, "-c", LOADED], check=True, capture_output=True, text=True
    )
    ours = {name for name in reported.stdout.split() if name.split(".")[0] in ("turnout", "numpy")}
    assert ours == {"turnout", "turnout.lazy", "turnout.core", "turnout.core.processes"}


@pytest.mark.usefixtures("worker_processes")
def test_the_collector_rests_until_all_is_loaded() -> None:
    with local_pool(1) as pool:
        assert not pool.submit(gc.isenabled).result()
        pool.submit(sweep_work.initialize_worker).result()
        assert pool.submit(gc.isenabled).result()
        assert pool.submit(gc.get_threshold).result()[0] == sweep_work.GC_THRESHOLD
        assert pool.submit(gc.get_freeze_count).result() > 10_000


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
        closing_pool(worker_processes(1)) as pool,
    ):
        pool.submit(os._exit, 1).result()


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
