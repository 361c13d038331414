"""Compare a throw with its dataset, with a friction curve, and with another checkout.

    python -m benchmarks.dataset_ratio [--older FOLDER] [--count 9]

Printed are medians and least values of runs in turn, in milliseconds of the process, and ratios of
the least to those of a plain solution, with a 13 mm object on the default panel; a dataset is a
throw as `simulate` returns it, its solution included. The curve is that of sound chairs
(`chair.friction_state`); its dataset is compared with a plain one. With `--older` the sources of
another checkout run in turns with these, each in processes of its own, and the ratio to it is of
the same without a curve.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from turnout.core.errors import PanelError
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate, solve

HERE = Path(__file__).parents[1]
MODES = ("quick", "waveform")
Times = dict[str, list[float]]


def measured(count: int) -> Times:
    """Return the milliseconds of solutions and of datasets, each after one that does not count."""
    panel, foreign = load_panel("uic60-760-1-15"), ForeignObject(0.013, "sleeper 6")
    found, curved = defaultdict[str, list[float]](list), None
    with suppress(PanelError):  # an older checkout knows no curves
        curved = panel.with_overrides({"chair.friction_state": "sound"})
    for mode in MODES:
        scheme = Scheme.of(mode)
        parts: dict[str, Callable[[], object]] = {
            "solution": partial(solve, panel, foreign_object=foreign, scheme=scheme),
            "dataset": partial(simulate, panel, foreign_object=foreign, scheme=scheme),
        }
        if curved is not None:
            parts["curve solution"] = partial(solve, curved, foreign_object=foreign, scheme=scheme)
            parts["curve dataset"] = partial(
                simulate, curved, foreign_object=foreign, scheme=scheme
            )
        for number in range(count + 1):
            for name, part in parts.items():
                begun = time.process_time()
                part()
                if number > 0:
                    found[f"{mode} {name}"].append(1e3 * (time.process_time() - begun))
    return found


def measured_in(checkout: Path, count: int) -> Times:
    """Return what another process measures with the sources of a checkout."""
    environment = {**os.environ, "PYTHONPATH": f"{checkout / 'src'}{os.pathsep}{HERE}"}
    command = [sys.executable, __file__, "--print-times", "--count", str(count)]
    done = subprocess.run(command, check=True, env=environment, stdout=subprocess.PIPE, text=True)
    found: Times = json.loads(done.stdout)
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--older", type=Path, help="another checkout")
    parser.add_argument("--count", type=int, default=9, help="runs of each in a process")
    parser.add_argument("--print-times", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.print_times:
        print(json.dumps(measured(given.count)))
        return
    checkouts = {"this": HERE} | ({} if given.older is None else {"older": given.older.resolve()})
    found: dict[str, Times] = {name: defaultdict(list) for name in checkouts}
    for _ in range(3):
        for name, checkout in checkouts.items():
            for what, times in measured_in(checkout, given.count).items():
                found[name][what] += times
    for name, by_part in found.items():
        for what, times in by_part.items():
            mode, kind = what.split()[0], what.split()[-1]
            plain = f"{mode} {kind if 'curve' in what else 'solution'}"
            line = f"{name:<6}{what:<24}{statistics.median(times):7.2f} ms, least {min(times):6.2f}"
            line += f", {min(times) / min(by_part[plain]):.3f} of the plain {plain.split()[-1]}"
            if "older" in found and name == "this":
                own = f"{mode} {kind}"
                line += f", {min(times) / min(found['older'][own]):.3f} of the older plain {kind}"
            print(line)


if __name__ == "__main__":
    main()
