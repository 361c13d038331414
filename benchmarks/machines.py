"""Compare the cost of throws with machines to that of a throw of markers, in one run.

    python -m benchmarks.machines

Processor seconds of the whole of `turnout.simulate` and of its solution alone on the default panel.
The kinds take turns, so that what else the machine does meets all of them; reported is the median
over the rounds of each kind's ratio to the markers of its own round.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Mapping

from benchmarks.machine import load, machine
from turnout.core.scheme import Scheme
from turnout.panel.load import LoadedPanel, load_panel
from turnout.throw.simulate import simulate, solve

PANEL = "uic60-760-1-15"
KINDS: dict[str, dict[str, object]] = {
    "markers": {},
    "two `jea73`": {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"},
    "two `s700k`": {
        "drive.1.machine": "s700k",
        "drive.2.machine": "s700k",
        "machine.s700k.clutch.torque": 2.6,
    },
    "two `zdj9`": {
        "drive.1.machine": "zdj9",
        "drive.2.machine": "zdj9",
        "machine.zdj9.clutch.torque": 2.6,
    },
    "two `m70`": {"drive.1.machine": "m70", "drive.2.machine": "m70"},
}


def panels() -> dict[str, LoadedPanel]:
    """Return the panel with each kind of drive."""
    plain = load_panel(PANEL)
    found = {}
    for kind, overrides in KINDS.items():
        panel = plain
        for key, value in overrides.items():
            panel = panel.with_overrides({key: value})
        found[kind] = panel
    return found


def in_turn(works: Mapping[str, Callable[[], object]], count: int) -> dict[str, list[float]]:
    """Return processor seconds of each work in each of so many rounds."""
    for work in works.values():
        work()
    seconds: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(count):
        for name, work in works.items():
            began = time.process_time()
            work()
            seconds[name].append(time.process_time() - began)
    return seconds


def table(count: int) -> list[str]:
    """Return the rows of the table: mode, kind, processor time, ratio."""
    rows = []
    given = panels()
    for mode in ("quick", "waveform"):
        scheme = Scheme.of(mode)
        parts: dict[str, dict[str, Callable[[], object]]] = {
            "solution": {
                kind: lambda panel=panel, scheme=scheme: solve(panel, scheme=scheme)
                for kind, panel in given.items()
            },
            "dataset": {
                kind: lambda panel=panel, scheme=scheme: simulate(panel, scheme=scheme)
                for kind, panel in given.items()
            },
        }
        for part, works in parts.items():
            seconds = in_turn(works, count)
            for kind, own in seconds.items():
                ratios = [a / b for a, b in zip(own, seconds["markers"], strict=True)]
                rows.append(
                    f"| {mode} | {part} | {kind} | {1e3 * statistics.median(own):.1f} ms "
                    f"| {statistics.median(ratios):.2f} |"
                )
    return rows


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=15, help="rounds (default 15)")
    count = parser.parse_args().count
    print(f"{machine()}; load {load():.1f}; median of {count} rounds, processor time")
    print("| mode | what | drives | time | ratio to markers |")
    print("|---|---|---|--:|--:|")
    for row in table(count):
        print(row)


if __name__ == "__main__":
    main()
