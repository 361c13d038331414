"""The limit of threads is asked of the libraries once, and taken back at the end."""

import os
import subprocess
import sys
import threading
from contextlib import contextmanager

import numpy as np
import pytest

from turnout.core import threads


class Library:
    """Stands for BLAS."""

    user_api = "blas"

    def __init__(self, num_threads: int) -> None:
        self.num_threads = num_threads


class Libraries:
    """Stands for the controller of the libraries; records what was asked of it."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.lib_controllers = [Library(1), Library(2)]

    @contextmanager
    def limit(self, *, limits: int, user_api: str):
        self.asked.append(f"{limits} {user_api}")
        try:
            yield
        finally:
            self.asked.append("back")


@pytest.fixture
def libraries(monkeypatch):
    found = Libraries()
    monkeypatch.setattr(threads, "_controller", lambda: found)
    return found


def test_within_a_limit_nothing_is_asked(libraries):
    with threads.one_blas_thread():
        with threads.one_blas_thread():
            pass
        assert libraries.asked == ["1 blas"]
    assert libraries.asked == ["1 blas", "back"]


def test_one_thread_is_left_as_it_is(libraries):
    libraries.lib_controllers = [Library(1), Library(1)]
    with threads.one_blas_thread():
        pass
    assert libraries.asked == []


def test_an_error_takes_the_limit_back(libraries):
    with pytest.raises(ZeroDivisionError), threads.one_blas_thread():
        raise ZeroDivisionError
    with threads.one_blas_thread():
        pass
    assert libraries.asked == ["1 blas", "back"] * 2


def test_every_thread_asks_for_itself(libraries):
    def work():
        with threads.one_blas_thread():
            pass

    with threads.one_blas_thread():
        other = threading.Thread(target=work)
        other.start()
        other.join()
    assert libraries.asked == ["1 blas", "1 blas", "back", "back"]


SPENT = """
import time
from turnout.core.scheme import Scheme
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

panel = load_panel("uic60-760-1-15")
simulate(panel, mode="waveform")
for number in range(6):
    own = panel.with_overrides({"rail.section_scale": 1.0 + 1e-3 * (1 + number)})
    cpu, thread = time.process_time(), time.thread_time()
    simulate(own, mode="waveform")
    print(time.process_time() - cpu, time.thread_time() - thread)
"""


def test_a_throw_is_not_waited_for_by_other_threads():
    """Threads of linear algebra that spin would take the processors from other throws."""
    two = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", SPENT], env=two, capture_output=True, text=True, check=True
    )
    spent = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    assert (spent[:, 0] < 1.15 * spent[:, 1]).all(), spent
