"""Show the stages of a quick sweep's throw by time, in docs/evidence/performance-methods.md.

    python -m benchmarks.sweep_stages [STUDY] [--count 192] [--repeats 3]

STUDY defaults to benchmarks/million.toml, in which all that history matching varies is varied. The
functions of each stage are replaced by ones that add up the processor time of a process of one
thread; what a stage calls of another one counts there alone. Asking for the time takes about a
microsecond each, which is in the numbers. Of the repeats the one with the least sum is written.
"""

import argparse
import functools
import importlib
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.machine import load, machine
from benchmarks.page import METHODS, write_section
from turnout.calibration.load_study import load_study
from turnout.solver.start import clear_starts
from turnout.study.study import Study
from turnout.study.sweep import batch
from turnout.study.sweep import batch_bytes as batch_file
from turnout.study.sweep.worker import initialize_worker

STUDY = Path(__file__).with_name("million.toml")
WARM, BATCH = 160, 64
STAGES = {
    "turnout.study.sweep.batch": {
        "throw_batch": "scenario drawn",
        "batch_variables": "rows stacked",
    },
    "turnout.study.sweep.batch_bytes": {"file_bytes": "file made and compressed"},
    "turnout.study.sweep.row": {
        "prepare_scenario": "panel of the scenario",
        "resolve_objects": "objects placed and checked",
        "plan_throw": "markers",
        "solve_planned": "outcome, history",
        "extract_signals": "signals, gaps, flangeway",
        "lay_together": "signals, gaps, flangeway",
        "kept_histories": "signals, gaps, flangeway",
        "compute_labels": "labels and features",
        "make_rows": "rows",
    },
    "turnout.throw.simulate": {
        "build_mechanism": "mechanism built",
        "plan_run": "what is watched, grid",
    },
    "turnout.solver.integration": {
        "arrange": "condensed rails with their object",
        "prepare": "memory of the run",
        "plan_start": "start: laws frozen, looked up",
        "find_start": "start: found",
        "_march_in_chunks": "steps of the throw",
    },
    "turnout.solver.start": {
        "prepare": "start: memory of the return",
        "_move": "start: the return before the throw",
        "_start_from": "start: brought to rest",
    },
}
"""Functions and the stages they stand for, by the module that calls them."""


class Clock:
    """Processor time by stage, each without the stages that it calls."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self._inner: list[float] = []

    def timed(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """Return a function that does the same and counts for a stage."""

        @functools.wraps(function)
        def call(*given: Any, **named: Any) -> Any:
            began = time.process_time()
            self._inner.append(0.0)
            try:
                return function(*given, **named)
            finally:
                took = time.process_time() - began
                self.spent[stage] = self.spent.get(stage, 0.0) + took - self._inner.pop()
                if self._inner:
                    self._inner[-1] += took

        return call


def throw(study: Study, first: int) -> None:
    """Throw a batch of scenarios and make its file."""
    rows = batch.throw_batch(study, [range(first, first + BATCH)])
    batch_file.file_bytes(batch.batch_variables(study, rows))


def measured(study: Study, *, count: int, repeats: int) -> dict[str, float]:
    """Return processor time by stage [s a throw], of the repeat with the least."""
    for first in range(0, WARM, BATCH):
        throw(study, first)
    clock = Clock()
    for name, functions in STAGES.items():
        module = importlib.import_module(name)
        for function, stage in functions.items():
            setattr(module, function, clock.timed(getattr(module, function), stage))
    found: list[dict[str, float]] = []
    for _ in range(repeats):
        clock.spent = {}
        clear_starts()  # a throw of a sweep is made once, so its return is too
        for first in range(WARM, WARM + count, BATCH):
            throw(study, first)
        found.append({stage: spent / count for stage, spent in clock.spent.items()})
    return min(found, key=lambda item: sum(item.values()))


def main() -> None:
    """Measure and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", nargs="?", default=str(STUDY))
    parser.add_argument("--count", type=int, default=192)
    parser.add_argument("--repeats", type=int, default=3)
    chosen = parser.parse_args()
    before = load()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in a worker
    initialize_worker()
    study = load_study(chosen.study)
    count = -(-chosen.count // BATCH) * BATCH
    spent = measured(study, count=count, repeats=chosen.repeats)
    total = sum(spent.values())
    lines = [
        f"Written by `python -m benchmarks.sweep_stages` on {machine()}, at a load of",
        f"{before:.1f} before and {load():.1f} at the end: {count} throws of `{study.name}`,",
        f"the least of {chosen.repeats} repeats. Processor time of one thread; a stage is without",
        "those that it calls.",
        "",
        "| stage of a throw | ms | share |",
        "|---|---:|---:|",
    ]
    for stage, seconds in sorted(spent.items(), key=lambda item: -item[1]):
        lines.append(f"| {stage} | {1e3 * seconds:.2f} | {100 * seconds / total:.0f} % |")
    lines.append(f"| **all** | **{1e3 * total:.2f}** | |")
    print("\n".join(lines))
    write_section("A throw of a sweep", "\n".join(lines), page=METHODS)


if __name__ == "__main__":
    main()
