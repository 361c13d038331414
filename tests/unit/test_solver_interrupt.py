"""Ctrl-C ends a run between two kernels, and nothing half done is kept."""

import _thread
import os
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from turnout.core.scheme import Scheme
from turnout.panel.load import load_panel
from turnout.solver import integration
from turnout.solver.outcome import Code
from turnout.solver.state import Run, State
from turnout.throw.simulate import solve


@pytest.mark.usefixtures("python_ctrl_c")
def test_ctrl_c_in_a_kernel_ends_a_run_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integration, "FIRST_WITHOUT_REPORT", 100)
    monkeypatch.setattr(integration, "REPORT_INTERVAL", 1e-9)
    panel = load_panel("sb1")
    marched = integration._march

    def interrupted(run: Run, state: State, rods: None, first: int, last: int) -> tuple[int, int]:
        if last > 100:
            _thread.interrupt_main()
        return marched(run, state, rods, first, last)

    monkeypatch.setattr(integration, "_march", interrupted)
    history = solve(panel, scheme=Scheme.of("quick")).history
    assert history.outcome.code is Code.INTERRUPTED
    assert history.outcome.step == 101
    np.testing.assert_array_equal(np.isfinite(history.g), True)


@pytest.mark.usefixtures("python_ctrl_c")
@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is sent as a signal")
def test_a_long_run_ends_within_a_moment_of_ctrl_c() -> None:
    """In 0.3 s of the processor, at any place in a chunk."""
    scheme = replace(Scheme.of("waveform"), step=5e-6, output_interval=0.1)
    pressed = list[float]()

    def press() -> None:
        pressed.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.05, press)

    def report(done: int, _steps: int) -> None:
        if done > 1000 and timer.ident is None:
            timer.start()

    outcome = solve(load_panel("uic60-760-1-15"), scheme=scheme, report=report).history.outcome
    ended = time.process_time()
    assert outcome.code is Code.INTERRUPTED
    assert ended - pressed[0] < 0.3
