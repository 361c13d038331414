"""Time one throw of the default panel and write a section of docs/performance.md.

    python -m benchmarks.throw

Reported are the median and the spread (least to largest) of repeated runs on one core: the solution
of a full cycle (panel record to history), the same up to the finished dataset, and the command
`turnout simulate` from start to files written, with its peak memory. Kernels are compiled before.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

from benchmarks.machine import machine
from benchmarks.page import write_section
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.response.simulate import simulate, solve
from turnout.scheme import Scheme

PANEL = "uic60-760-1-15"
REPEATS = 15


def repeated(work: Callable[[], object], *, count: int = REPEATS) -> list[float]:
    """Return the seconds of repeated calls, after one that does not count."""
    work()
    seconds = []
    for _ in range(count):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return seconds


def solution() -> None:
    """Build and integrate one cycle."""
    foreign = ForeignObject(0.013, "sleeper 6")
    solve(load_panel(PANEL), foreign_object=foreign, scheme=Scheme())


def dataset() -> None:
    """Simulate one cycle to the finished dataset."""
    simulate(load_panel(PANEL), foreign_object=ForeignObject(0.013, "sleeper 6"))


COMMAND = """
import sys
from pathlib import Path
from turnout.cli.main import main
try:
    main()
finally:
    status = Path("/proc/self/status").read_text()
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    sys.stderr.write(peak.split()[1])
"""


def command() -> float:
    """Run the command line to its files; return its peak memory [MB]."""
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.run(
            [
                *(sys.executable, "-c", COMMAND, "simulate", PANEL, "--object", "13mm@sleeper6"),
                *("--out", f"{folder}/throw.nc", "--plot", f"{folder}/throw.png", "--quiet"),
            ],
            check=True,
            capture_output=True,
            text=True,
        )
    return float(run.stderr) / 1024


FIRST_STEP = """
import sys, time
from turnout.cli.main import main
from turnout.integrate import integration
march = integration._march_in_chunks
def first(*given):
    sys.stderr.write(f"{time.time()}")
    integration._march_in_chunks = march
    return march(*given)
integration._march_in_chunks = first
main()
"""


def first_step() -> float:
    """Return the seconds from the start of a command to its first step."""
    began = time.time()
    arguments = ("simulate", PANEL, "--object", "13mm@sleeper6", "--quiet")
    run = subprocess.run(
        [sys.executable, "-c", FIRST_STEP, *arguments], check=True, capture_output=True, text=True
    )
    return float(run.stderr) - began


def row(what: str, seconds: list[float]) -> str:
    """Return one line of the table."""
    least, largest = min(seconds), max(seconds)
    return f"| {what} | {statistics.median(seconds):.3f} | {least:.3f} to {largest:.3f} |"


def main() -> None:
    """Measure and write the page."""
    lines = [
        f"Written by `python -m benchmarks.throw` on {machine()}.",
        "One full cycle of the default panel (8.5 s, two switch rails, two stock rails, 50 chairs",
        f"with two feet each) with a 13 mm object at sleeper 6. Scheme: {Scheme().describe()}.",
        f"Median and spread of {REPEATS} runs (command: 5), kernels compiled before.",
        "",
        "| what | median [s] | spread [s] |",
        "|---|---:|---:|",
        row("solution: panel to history, one core", repeated(solution)),
        row("dataset: panel to labelled channels", repeated(dataset)),
        row(
            "command: `turnout simulate`, until the first step",
            [first_step() for _ in range(6)][1:],
        ),
        row("command: `turnout simulate` to result file and figure", repeated(command, count=5)),
        "",
    ]
    lines.append(f"Peak memory of the command: {command():.0f} MB.")
    write_section("One throw", "\n".join(lines))


if __name__ == "__main__":
    main()
