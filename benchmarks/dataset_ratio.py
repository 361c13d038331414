"""Compare a throw as a dataset with its solution alone, in processor time.

    python -m benchmarks.dataset_ratio [--older FOLDER] [--count 9]

Printed are medians and spreads (least to largest) of runs in turn, in milliseconds of the process,
and the ratio of the medians, with a 13 mm object on the default panel. With `--older` the sources
of another checkout run before and after these, each in a process of its own.
"""

import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

from turnout.core.scheme import Mode, Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate, solve

HERE = Path(__file__).parents[1]
MODES: tuple[Mode, ...] = ("quick", "waveform")


def measured(mode: Mode, count: int) -> tuple[list[float], list[float]]:
    """Return the milliseconds of solutions and of datasets, each after one that does not count."""
    panel, foreign = load_panel("uic60-760-1-15"), ForeignObject(0.013, "sleeper 6")
    solution, dataset = [], []
    for _ in range(count + 1):
        begun = time.process_time()
        solve(panel, foreign_object=foreign, scheme=Scheme.of(mode))
        between = time.process_time()
        simulate(panel, foreign_object=foreign, mode=mode)
        solution.append(1e3 * (between - begun))
        dataset.append(1e3 * (time.process_time() - between))
    return solution[1:], dataset[1:]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--older", type=Path, help="another checkout")
    parser.add_argument("--count", type=int, default=9, help="runs of each")
    parser.add_argument("--name", default="this", help=argparse.SUPPRESS)
    given = parser.parse_args()

    def older() -> None:
        if given.older is not None:
            sources = given.older.resolve() / "src"
            environment = {**os.environ, "PYTHONPATH": f"{sources}{os.pathsep}{HERE}"}
            script = [sys.executable, __file__, "--name", "older", "--count", str(given.count)]
            subprocess.run(script, check=True, env=environment)

    older()
    for mode in MODES:
        solution, dataset = measured(mode, given.count)
        middle = [statistics.median(times) for times in (solution, dataset)]
        spread = [f"{min(times):.1f} to {max(times):.1f}" for times in (solution, dataset)]
        print(
            f"{given.name:<6}{mode:<9} solution {middle[0]:6.1f} ms ({spread[0]}), dataset "
            f"{middle[1]:6.1f} ms ({spread[1]}), ratio {middle[1] / middle[0]:.2f}"
        )
    older()


if __name__ == "__main__":
    main()
