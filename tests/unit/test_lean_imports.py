"""Libraries imported without what they load along."""

import os
import subprocess
import sys

import pytest

from turnout.core.lean_imports import import_scipy, without_blas_threads, without_packages
from turnout.core.processes import worker_processes

LEAN = """
import sys
from turnout.core.lean_imports import import_scipy, without_blas_threads, without_packages
import numpy
before = numpy.__all__, numpy.__dir__
import_scipy()
print("numpy.f2py" in sys.modules, "scipy.linalg" in sys.modules)
print((numpy.__all__, numpy.__dir__) == before)
with without_packages("pyarrow", "pint"):
    import pandas, xarray
    rails = xarray.Dataset(coords={"rail": ["curved", "straight"]})
print("pyarrow" in sys.modules, "pint" in sys.modules)
print(rails.sel(rail="curved").rail.item())
print(numpy.f2py.__name__)
"""


def test_unused_parts_are_left_out_and_there_when_they_are_used() -> None:
    done = subprocess.run([sys.executable, "-c", LEAN], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [
        "False",
        "True",
        "True",
        "False",
        "False",
        "curved",
        "numpy.f2py",
    ]


MASKED = """
import sys
from turnout.core.lean_imports import import_scipy
import_scipy()
from numpy import ma, unique
print(unique([3, 1, 3]).tolist() == [1, 3], "numpy.ma" in sys.modules)
masked = ma.masked_array([3, 1, 3], [False, True, False])
import numpy.ma
print(numpy.ma is not ma, ma.is_masked(masked), numpy.ma.is_masked(masked))
print(numpy.unique(masked).tolist() == [3, None])
"""


def test_masked_arrays_are_loaded_when_they_are_wanted() -> None:
    command = [sys.executable, "-c", MASKED]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True", "False", "True", "True", "True", "True"]


THREADS = """
import os
from threadpoolctl import threadpool_info
from turnout.core.lean_imports import without_blas_threads
with without_blas_threads():
    import numpy, scipy.linalg
print(*{item["num_threads"] for item in threadpool_info() if item["user_api"] == "blas"})
print(os.environ.get("OPENBLAS_NUM_THREADS"))
"""


@pytest.mark.parametrize(("chosen", "expected"), [(None, ["1", "None"]), ("2", ["2", "2"])])
def test_linear_algebra_starts_no_threads_unless_they_are_wanted(
    chosen: str | None, expected: list[str]
) -> None:
    environment = {key: value for key, value in os.environ.items() if "NUM_THREADS" not in key}
    if chosen is not None:
        environment["OPENBLAS_NUM_THREADS"] = chosen
    done = subprocess.run(
        [sys.executable, "-c", THREADS], capture_output=True, text=True, env=environment, check=True
    )
    if done.stdout.split()[0] == "None":
        pytest.skip("NumPy and SciPy come without OpenBLAS here")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    threads, variable = done.stdout.split()
    # OpenBLAS starts no more threads than there are cores.
    assert threads == str(min(int(expected[0]), cores or 1))
    assert variable == expected[1]


def test_threads_that_a_user_wants_of_all_libraries_are_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with without_blas_threads():
        assert "OPENBLAS_NUM_THREADS" not in os.environ


def threads_of_blas() -> set[int]:
    import scipy.linalg  # noqa: F401 - brings a copy of its own
    from threadpoolctl import threadpool_info

    return {item["num_threads"] for item in threadpool_info() if item["user_api"] == "blas"}


def test_workers_have_one_thread_of_linear_algebra_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with worker_processes(1) as pool:
        assert pool.submit(threads_of_blas).result() <= {1}
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def test_what_is_loaded_stays_loaded() -> None:
    import_scipy()
    with without_packages("numpy"):
        import numpy as np
    assert np is sys.modules["numpy"]


def test_a_package_is_missing_meanwhile_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)
    with without_packages("colorsys"), pytest.raises(ImportError):
        import colorsys
    import colorsys

    assert colorsys.rgb_to_hsv(0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)


CALIBRATION = """
import sys
import turnout.calibration.calibrate, turnout.calibration.left_priors
import turnout.detection.detector.throw_verdict, turnout.detection.detector.trends
print("scipy.stats" in sys.modules)
"""


def test_calibration_and_detector_start_without_the_distributions_of_scipy() -> None:
    # They take 0.4 s, and both need but three of their functions.
    done = subprocess.run(
        [sys.executable, "-c", CALIBRATION], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["False"]


SWEEP = """
import sys
import turnout.study.sweep.run, turnout.study.sweep.worker
print("xarray" in sys.modules, "pandas" in sys.modules)
"""


def test_a_run_of_a_sweep_starts_without_what_opens_its_results() -> None:
    # Which takes 0.3 s before the first worker begins.
    done = subprocess.run(
        [sys.executable, "-c", SWEEP], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["False", "False"]


PLUGINS = """
import os, sys
from turnout.core.lean_imports import without_plugins
with without_plugins():
    import pydantic
    pydantic.create_model("Record", size=(float, 1.0))
    from pydantic.plugin._loader import get_plugins
    print(len(get_plugins()), os.environ.get("PYDANTIC_DISABLE_PLUGINS"))
print(os.environ.get("PYDANTIC_DISABLE_PLUGINS"))
"""


@pytest.mark.parametrize("chosen", [None, "logfire-plugin"])
def test_pydantic_looks_for_no_plugins_unless_they_are_wanted(chosen: str | None) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYDANTIC_DISABLE_PLUGINS"}
    if chosen is not None:
        environment["PYDANTIC_DISABLE_PLUGINS"] = chosen
    done = subprocess.run(
        [sys.executable, "-c", PLUGINS], capture_output=True, text=True, env=environment, check=True
    )
    count, meanwhile, after = done.stdout.split()
    assert (meanwhile, after) == ((chosen, chosen) if chosen else ("__all__", "None"))
    assert int(count) == 0 or chosen


def test_no_step_waits_for_what_makes_datasets() -> None:
    code = "import sys, turnout.throw.simulate; print('turnout.throw.dataset' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
