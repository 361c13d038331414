"""Measure the return before a loaded start: its cost, and the force that it leaves, by its steps.

    python -m benchmarks.prior_motion

Printed for each panel of the library in quick mode, the largest over frictions from 0.1 to 0.5 and
drives: by how much the force of a drive starts off that with which its cycle ends, how far it is
off until the return and where the switch is held open, and what cycles before the start leave, and
their number (the table of `docs/theory/time-stepping.md`).

Then for several lengths of the steps of the return, with and without inertia: its processor time,
and by how much Drive 2 of the default panel starts off the end of the cycle that follows (see
decision 30).
"""

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.machine import load, machine
from turnout.core.scheme import Scheme
from turnout.panel.load import load_panel
from turnout.solver import start
from turnout.solver.state import Run, State
from turnout.throw.simulate import simulate

PANELS = (
    *("uic60-760-1-15", "uic60-760-1-15-symmetric", "60e1-300-1-9", "60e1-300-1-9-clamp-lock"),
    *("60e1-500-1-12", "60e1-441-1-12", "60e1-1200-1-18.5", "sb2"),
)
FRICTIONS = np.linspace(0.1, 0.5, 17)
OPEN = 4.3
"""The switch is held open, just before its return [s]."""
END = 8.0
"""Of the cycle, some tenths of a second after its return [s]."""
CHOICES = (
    *((3e-3, True), (6e-3, True), (12e-3, True), (20e-3, True), (80e-3, True)),
    *((20e-3, False), (100e-3, False)),
)
"""Step [s], and True for inertia."""


def compared(name: str, friction: float) -> list[float]:
    """Return how far a start by a return, and by cycles, is from the end of a cycle.

    Largest over drives: force at the start [N] and as a share of that at the end [-], force until
    the return as a share of the peak [-], force held open [N]; of cycles force at the
    start [N], and their number [-].
    """
    runs, cycles, usual = [], [], start.march

    def counted(run: Run, state: State, *given: Any) -> tuple[int, int]:
        cycles.append(given[1])
        return usual(run, state, *given)

    for by in ("return", "cycles"):
        given = {"schedule.loaded": True, "schedule.loaded_by": by}
        panel = load_panel(name).with_overrides(given | {"chair.friction_coefficient": friction})
        start.clear_starts()
        cycles.clear()
        setattr(start, "march", counted)  # noqa: B010
        try:
            run = simulate(panel, mode="quick")
        finally:
            setattr(start, "march", usual)  # noqa: B010
        runs.append(run["drive_force"].values)
    time_of, (by_return, by_cycles) = run["time"].values, runs
    apart, ends = np.abs(by_return - by_cycles), by_cycles[:, -1]
    apart, peak = apart[:, time_of <= OPEN], np.abs(by_cycles).max(axis=1)
    opening, held = apart.max(axis=1) / peak, apart[:, -1].max()
    found = np.abs(by_return[:, 0] - by_return[:, -1])
    left = np.abs(by_cycles[:, 0] - ends).max()
    shares = [(found / np.abs(ends)).max(), opening.max()]
    return [found.max(), *shares, held, left, float(len(cycles))]


def use(scheme_of: Callable[..., Scheme], step: float, *, inertia: bool) -> None:
    """Let returns from now on have a step [s], with or without inertia."""

    def changed(scheme: Scheme, duration: float, *, cyclic: bool) -> Scheme:
        chosen = replace(scheme, step=step, output_interval=step, inertia=inertia)
        return scheme_of(chosen, duration, cyclic=cyclic)

    setattr(start, "_prior_scheme", changed)  # noqa: B010


def measured() -> tuple[float, list[float]]:
    """Return the median processor time of a return [s], and its deviation by friction."""
    panel, off, costs = load_panel("uic60-760-1-15"), [], []
    for friction in FRICTIONS:
        given = {"chair.friction_coefficient": float(friction), "schedule.end": END}
        changed = panel.with_overrides(given)
        simulate(changed, mode="quick")
        start.clear_starts()
        times = [time.process_time()]
        for _ in range(2):  # the second one finds what the return of the first one left
            run = simulate(changed, mode="quick")
            times.append(time.process_time())
        costs.append((times[1] - times[0]) - (times[2] - times[1]))
        first, last = (run["drive_force"].isel(drive=1, time=at).item() for at in (0, -1))
        off.append(first / last - 1.0)
    return statistics.median(costs), off


def main() -> None:
    """Measure and print."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name in PANELS:
        found = [compared(name, friction) for friction in FRICTIONS[::4]]
        start_off, share, opening, held, left, cycles = np.max(found, axis=0)
        print(
            f"| `{name}` | {start_off:.0f} | {100 * share:.1f} | {100 * opening:.1f} "
            f"| {held:.0f} | {left:.2f} | {cycles:.0f} |",
            flush=True,
        )
    usual, least = start._prior_scheme, start.PRIOR_STEP
    simulate(load_panel("uic60-760-1-15"), mode="quick")
    setattr(start, "PRIOR_STEP", 0.0)  # noqa: B010
    try:
        for step, inertia in CHOICES:
            use(usual, step, inertia=inertia)
            cost, off = measured()
            print(
                f"{1e3 * step:.0f} ms {'with' if inertia else 'without'} inertia: "
                f"{1e3 * cost:.1f} ms, rms {100 * np.sqrt(np.mean(np.square(off))):.2f} %, "
                f"at worst {100 * np.max(np.abs(off)):.2f} %",
                flush=True,
            )
    finally:
        setattr(start, "_prior_scheme", usual)  # noqa: B010
        setattr(start, "PRIOR_STEP", least)  # noqa: B010
    print(f"{machine()}, load {load():.1f}")


if __name__ == "__main__":
    main()
