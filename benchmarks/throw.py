"""Time one throw of the default panel and write a section of docs/evidence/performance.md.

    python -m benchmarks.throw

Reported are the median and the spread (least to largest) of repeated runs on one core, in processor
time: the solution of a full cycle (panel record to history), and the same up to the finished
dataset. Kernels are compiled before. What whole commands take is measured by
`python -m benchmarks.first_start`.
"""

import argparse
import statistics
import time
from collections.abc import Callable

from benchmarks.machine import load, machine
from benchmarks.page import write_section
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate, solve

PANEL = "uic60-760-1-15"
REPEATS = 15


def repeated(work: Callable[[], object], *, count: int = REPEATS) -> list[float]:
    """Return the processor seconds of repeated calls, after one that does not count."""
    work()
    seconds = []
    for _ in range(count):
        began = time.process_time()
        work()
        seconds.append(time.process_time() - began)
    return seconds


def solution() -> None:
    """Build and integrate one cycle."""
    foreign = ForeignObject(0.013, "sleeper 6")
    solve(load_panel(PANEL), foreign_object=foreign, scheme=Scheme())


def dataset() -> None:
    """Simulate one cycle to the finished dataset."""
    simulate(load_panel(PANEL), foreign_object=ForeignObject(0.013, "sleeper 6"))


def row(what: str, seconds: list[float]) -> str:
    """Return one line of the table."""
    least, largest = min(seconds), max(seconds)
    return f"| {what} | {statistics.median(seconds):.3f} | {least:.3f} to {largest:.3f} |"


def main() -> None:
    """Measure and write the page."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    lines = [
        f"Written by `python -m benchmarks.throw` on {machine()}, at a load of {load():.1f}.",
        "One full cycle of the default panel (8.5 s, two switch rails, two stock rails, 50 chairs",
        f"with two feet each) with a 13 mm object at sleeper 6. Scheme: {Scheme().describe()}.",
        f"Processor time, median and spread of {REPEATS} runs, kernels compiled before. The whole",
        "command: [before the first throw](#before-the-first-throw).",
        "",
        "| what | median [s] | spread [s] |",
        "|---|---:|---:|",
        row("solution: panel to history, one core", repeated(solution)),
        row("dataset: panel to labelled channels", repeated(dataset)),
    ]
    write_section("One throw", "\n".join(lines))


if __name__ == "__main__":
    main()
