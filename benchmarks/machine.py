"""Machine and method of a measured figure: processor seconds of one thread."""

import os
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""Environment in which every program of a race is started."""


def machine() -> str:
    """Describe the machine in one line."""
    model = platform.processor() or platform.machine()
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.split(":", 1)[1].strip()
            break
    system = f"{platform.system()}, Python {platform.python_version()}"
    return f"{model}, {os.cpu_count()} cores (shared), {system}"


def load() -> float:
    """Return the number of programs that want to run, on average over the last minute."""
    return os.getloadavg()[0]


def processor_seconds(
    work: Callable[[], object], *, count: int, warm: bool = True, most: float = 60.0
) -> list[float]:
    """Return the processor seconds of repeated calls, after one that does not count.

    A call that a busy machine interrupts takes no more of them. Repeating ends, with what there
    is, once `most` seconds have passed.
    """
    if warm:
        work()
    seconds: list[float] = []
    begun = time.perf_counter()
    while len(seconds) < count and (not seconds or time.perf_counter() - begun < most):
        began = time.process_time()
        work()
        seconds.append(time.process_time() - began)
    return seconds


def seconds_text(seconds: Sequence[float]) -> str:
    """Return median and spread in a unit that suits.

    Examples
    --------
    >>> seconds_text([0.001, 0.002, 0.004])
    '2 ms (1 to 4)'
    >>> seconds_text([14.5])
    '14.5 s (once)'
    """
    median = statistics.median(seconds)
    unit, scale = ("s", 1.0) if median >= 1.0 else ("ms", 1e3)
    if len(seconds) == 1:
        return f"{figure(scale * median)} {unit} (once)"
    least, most = figure(scale * min(seconds)), figure(scale * max(seconds))
    return f"{figure(scale * median)} {unit} ({least} to {most})"


def figure(value: float) -> str:
    """Return three figures without an exponent.

    Examples
    --------
    >>> figure(1234.5), figure(0.01234)
    ('1230', '0.0123')
    """
    if value == 0.0:
        return "0"
    rounded = float(f"{value:.3g}")
    return f"{rounded:.0f}" if abs(rounded) >= 100 else f"{rounded:g}"
