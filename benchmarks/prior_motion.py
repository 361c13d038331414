"""Measure the return before a loaded start: its cost, and the force that it leaves, by its steps.

    python -m benchmarks.prior_motion

Printed for several lengths of its steps, with and without inertia: the processor time of the return
in quick mode, and by how much Drive 2 of the default panel starts off the force with which the
cycle that follows ends, for frictions from 0.1 to 0.5 (see decision 30).
"""

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.machine import load, machine
from turnout.core.scheme import Scheme
from turnout.panel.load import load_panel
from turnout.solver import start
from turnout.throw.simulate import simulate

FRICTIONS = np.linspace(0.1, 0.5, 17)
END = 8.0
"""Of the cycle, some tenths of a second after its return [s]."""
CHOICES = (
    *((3e-3, True), (6e-3, True), (12e-3, True), (20e-3, True), (80e-3, True)),
    *((20e-3, False), (100e-3, False)),
)
"""Step [s], and True for inertia."""


def use(scheme_of: Callable[[Scheme, float], Scheme], step: float, *, inertia: bool) -> None:
    """Let returns from now on have a step [s], with or without inertia."""

    def changed(scheme: Scheme, duration: float) -> Scheme:
        chosen = replace(scheme, step=step, output_interval=step, inertia=inertia)
        return scheme_of(chosen, duration)

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
