"""Time the shapes of a panel that follow from its strokes, and write a section of the page.

    python -m benchmarks.shapes

Cold: nothing is in memory; the reduction of the rails, which shapes are solved on, is separate
from the shapes. Kept: built again with another friction, as in a sweep. Processor time of one
thread.
"""

import argparse
import statistics
import time
from collections.abc import Callable

from benchmarks.machine import load, machine
from benchmarks.page import METHODS, write_section
from turnout.core import content_cache
from turnout.core.threads import one_blas_thread
from turnout.mechanism import build, reduce
from turnout.mechanism.build import build_mechanism
from turnout.panel.load import LoadedPanel, load_panel

PANEL = "uic60-760-1-15"
REPEATS = 9


def processor_time(work: Callable[[], object]) -> float:
    """Return the processor time of a call [s]."""
    began = time.process_time()
    work()
    return time.process_time() - began


def cold(*, rails_kept: bool) -> float:
    """Return the time to build a panel without its shapes in memory, with its rails or without."""
    panel = load_panel(PANEL)
    build_mechanism(panel)
    build.clear_mechanisms()
    if not rails_kept:
        reduce.clear_superelements()
        content_cache.clear_content_cache()
    return processor_time(lambda: build_mechanism(panel))


def kept(panel: LoadedPanel, number: int) -> float:
    """Return the time to build a panel again that differs in friction alone."""
    changed = panel.with_overrides({"chair.friction_coefficient": 0.3 + 1e-3 * number})
    return processor_time(lambda: build_mechanism(changed))


def shapes_alone() -> float:
    """Return the time that `rail_travel` itself takes, rails and rows at hand."""
    seconds = []
    solve = build.rail_travel

    def timed(*given: object) -> object:
        began = time.process_time()
        found = solve(*given)  # type: ignore[arg-type]
        seconds.append(time.process_time() - began)
        return found

    build.rail_travel = timed  # type: ignore[assignment]
    try:
        cold(rails_kept=True)
    finally:
        build.rail_travel = solve
    return sum(seconds)


def row(what: str, seconds: list[float]) -> str:
    """Return one line of the table."""
    return (
        f"| {what} | {1e3 * statistics.median(seconds):.2f} | "
        f"{1e3 * min(seconds):.2f} to {1e3 * max(seconds):.2f} |"
    )


def main() -> None:
    """Measure and write the section."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with one_blas_thread():
        panel = load_panel(PANEL)
        rows = [
            row("shapes alone", [shapes_alone() for _ in range(REPEATS)]),
            row(
                "mechanism, rails kept, shapes new", [cold(rails_kept=True) for _ in range(REPEATS)]
            ),
            row("mechanism, nothing kept", [cold(rails_kept=False) for _ in range(REPEATS)]),
        ]
        build_mechanism(panel)
        again = [kept(panel, number) for number in range(REPEATS)]
        rows.append(row("mechanism, all kept, other friction", again))
    lines = [
        f"Written by `python -m benchmarks.shapes` on {machine()},",
        f"load {load():.1f}, so an upper bound.",
        "What strokes, fit gap and stress-free fraction decide on the default panel: open shapes,",
        f"gaps, lengths of links. Median and spread of {REPEATS} runs, processor time.",
        "",
        "| what | median [ms] | spread [ms] |",
        "|---|---:|---:|",
        *rows,
    ]
    write_section("Shapes from strokes", "\n".join(lines), page=METHODS)


if __name__ == "__main__":
    main()
