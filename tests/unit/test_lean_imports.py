"""Libraries imported without what they load along."""

import json
import os
import sys

import pytest
from tests.faults.terminal import run_code

from turnout.core.lean_imports import (
    import_scipy,
    without_blas_threads,
    without_packages,
    without_plugins,
)
from turnout.core.processes import worker_processes

LEAN = """
import json, os, sys
from turnout.core.lean_imports import *
found = {}
with without_plugins():
    import pydantic
    pydantic.create_model("Record", size=(float, 1.0))
    from pydantic.plugin._loader import get_plugins
    found["plugins"] = len(get_plugins()), os.environ.get("PYDANTIC_DISABLE_PLUGINS")
found["plugins after"] = os.environ.get("PYDANTIC_DISABLE_PLUGINS")
with without_blas_threads():
    import numpy
    before = numpy.__all__, numpy.__dir__
    import_scipy()
found["threads after"] = os.environ.get("OPENBLAS_NUM_THREADS")
parts = ("numpy.f2py", "scipy.linalg", "numpy.ma")
found["loaded"] = [name for name in parts if name in sys.modules]
found["numpy as before"] = (numpy.__all__, numpy.__dir__) == before
from threadpoolctl import threadpool_info
blas = {item["num_threads"] for item in threadpool_info() if item["user_api"] == "blas"}
found["threads"] = sorted(blas)
from numpy import ma, unique
found["unique"] = unique([3, 1, 3]).tolist() == [1, 3], "numpy.ma" in sys.modules
masked = ma.masked_array([3, 1, 3], [False, True, False])
import numpy.ma
found["masked"] = numpy.ma is not ma, ma.is_masked(masked), numpy.ma.is_masked(masked)
found["unique masked"] = numpy.unique(masked).tolist() == [3, None]
with without_packages("pyarrow", "pint"):
    import pandas, xarray
    rails = xarray.Dataset(coords={"rail": ["curved", "straight"]})
found["left out"] = [name for name in ("pyarrow", "pint") if name in sys.modules]
found["rail"] = rails.sel(rail="curved").rail.item()
found["late"] = numpy.f2py.__name__
print(json.dumps(found))
"""


def test_unused_parts_are_left_out_and_there_when_they_are_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Linear algebra starts no threads, pydantic looks for no plugins, masked arrays come late."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PYDANTIC_DISABLE_PLUGINS"):
        monkeypatch.delenv(name, raising=False)
    found = json.loads(run_code(LEAN))
    assert found.pop("threads") in ([1], []), "without OpenBLAS there are none to see"
    assert found == {
        "plugins": [0, "__all__"],
        "plugins after": None,
        "threads after": None,
        "loaded": ["scipy.linalg"],
        "numpy as before": True,
        "unique": [True, False],
        "masked": [True, True, True],
        "unique masked": True,
        "left out": [],
        "rail": "curved",
        "late": "numpy.f2py",
    }


def test_what_a_user_chose_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with without_blas_threads():
        assert "OPENBLAS_NUM_THREADS" not in os.environ
    chosen = {"OPENBLAS_NUM_THREADS": "2", "PYDANTIC_DISABLE_PLUGINS": "logfire-plugin"}
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    for context in (without_blas_threads, without_plugins):
        with context():
            assert chosen.items() <= os.environ.items()
        assert chosen.items() <= os.environ.items()


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


STARTS = """
import sys
import turnout.throw.simulate
print("turnout.throw.dataset" in sys.modules)
import turnout.study.sweep.run, turnout.study.sweep.worker, turnout.calibration.result
print("xarray" in sys.modules, "pandas" in sys.modules)
import turnout.calibration.calibrate, turnout.calibration.sensors
import turnout.detection.detector.throw_verdict, turnout.detection.detector.trends
print("scipy.stats" in sys.modules)
"""


def test_steps_sweeps_calibration_and_detector_start_without_what_opens_results() -> None:
    # Which takes 0.3 s before the first worker of a sweep begins, and distributions of SciPy 0.4 s.
    assert run_code(STARTS).split() == ["False"] * 4
