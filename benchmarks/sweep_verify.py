"""Measure the time that verifying the batches of a sweep adds to reading it the first time.

    python -m benchmarks.sweep_verify FOLDER [--repeat 15]

FOLDER is that of a sweep. Shown is processor time, the least of some repeats: to verify all
batches, and to read the sweep once they are verified, which adds nothing from then on.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import h5py

from turnout.study.sweep.batch import list_batches
from turnout.study.sweep.folder import BATCHES
from turnout.study.sweep.read import open_batches, read_labels
from turnout.study.sweep.verify import content_fault, read_origin


def least(work: Callable[[], object], *, repeat: int) -> float:
    """Return the least processor time of some work, after a first time that is not counted [s]."""
    work()
    spent = []
    for _ in range(repeat):
        began = time.process_time()
        work()
        spent.append(time.process_time() - began)
    return min(spent)


def main() -> None:
    """Measure, and print a line for each way to read."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--repeat", type=int, default=15)
    given = parser.parse_args()
    paths = [path for _, path in list_batches(given.folder / BATCHES)]

    def verify() -> None:
        for path in paths:
            content_fault(path)

    files = [h5py.File(path, "r") for path in paths]
    checking = least(verify, repeat=given.repeat)
    checking += least(lambda: [read_origin(file) for file in files], repeat=given.repeat)
    for file in files:
        file.close()
    size = sum(path.stat().st_size for path in paths)
    print(f"{len(paths)} batches, {size / 1e6:.1f} MB: verified in {1e3 * checking:.1f} ms")
    ways: dict[str, Callable[[], object]] = {
        "open and read all": lambda: open_batches(given.folder).load(),
        "read labels": lambda: read_labels(given.folder),
        "open alone": lambda: open_batches(given.folder),
    }
    for name, read in ways.items():
        spent = least(read, repeat=given.repeat)
        print(f"{name:<18}{1e3 * spent:7.1f} ms; verifying is {checking / spent:.1%} of it")


if __name__ == "__main__":
    main()
