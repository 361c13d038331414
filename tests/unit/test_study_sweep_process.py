"""Workers load what they need once they watch the run, not before."""

import gc
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor

import pytest

from turnout.sweep import worker as sweep_work
from turnout.sweep.process import worker_processes

LOADED = "import sys, turnout.sweep.process; print(*sorted(sys.modules))"


def test_what_a_process_loads_first_is_light() -> None:
    reported = subprocess.run(
        [sys.executable, "-c", LOADED], check=True, capture_output=True, text=True
    )
    ours = {name for name in reported.stdout.split() if name.split(".")[0] in ("turnout", "numpy")}
    assert ours == {"turnout", "turnout.lazy", "turnout.sweep", "turnout.sweep.process"}


@pytest.mark.usefixtures("worker_processes")
def test_the_collector_rests_until_all_is_loaded() -> None:
    with worker_processes(1) as pool:
        assert isinstance(pool, ProcessPoolExecutor)
        assert not pool.submit(gc.isenabled).result()
        pool.submit(sweep_work.initialize_worker).result()
        assert pool.submit(gc.isenabled).result()
        assert pool.submit(gc.get_threshold).result()[0] == sweep_work.GC_THRESHOLD
        assert pool.submit(gc.get_freeze_count).result() > 10_000
