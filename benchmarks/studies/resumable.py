"""Numbered pieces of a long job, each a line of a file: a killed job continues."""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from turnout.core.kept_results import append_line, read_lines
from turnout.core.progress import Pace
from turnout.core.workers import Workers

Record = dict[str, Any]
RESULTS = "results.jsonl"
SAID = 100
"""Lines of progress, at most."""


def read_records(folder: Path) -> list[Record]:
    """Return the results by index; a line that a kill left unfinished is dropped."""
    found = {record["index"]: record for record in read_lines(folder / RESULTS)}
    return [found[index] for index in sorted(found)]


def run_missing(
    make: Callable[[list[int]], Iterable[Record]], count: int, *, folder: Path
) -> list[Record]:
    """Do the missing ones of `count` pieces, and return all results.

    Parameters
    ----------
    make : callable
        From the missing indices to their records, in any order; it may end before the last.
    count : int
        Pieces.
    folder : Path
        Made if it is not there. A record is a line in it as soon as it is there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known = {record["index"] for record in read_records(folder)}
    missing = [index for index in range(count) if index not in known]
    pace, every = Pace(), max(1, len(missing) // SAID)
    pace.begin("", len(missing))
    for done, record in enumerate(make(missing), 1):
        append_line(folder / RESULTS, record)
        pace.count("")
        if done % every == 0 or done == len(missing):
            left = pace.progress().left / 60
            print(f"{done} of {len(missing)}, {left:.0f} min left", file=sys.stderr, flush=True)
    return [record for record in read_records(folder) if record["index"] < count]


def run_numbered(
    job: Callable[[int], Record], count: int, *, folder: Path, workers: int
) -> list[Record]:
    """Do the missing ones of `count` pieces in processes, and return all results.

    `job` is a function of a module, as worker processes load it.
    """
    with Workers(workers) as processes:

        def made(missing: list[int]) -> Iterator[Record]:
            for _, record in processes.run([partial(job, index) for index in missing]):
                yield record

        return run_missing(made, count, folder=folder)


def command_line(
    job: Callable[[int], Record], report: Callable[[list[Record]], None], *, count: int
) -> None:
    """Understand `run --count N --out DIR --workers N` and `report DIR`."""
    parser = argparse.ArgumentParser(description=sys.modules[job.__module__].__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("--count", type=int, default=count)
    run.add_argument("--out", type=Path, required=True)
    run.add_argument("--workers", type=int, default=2)
    commands.add_parser("report").add_argument("folder", type=Path)
    chosen = parser.parse_args()
    if chosen.command == "report":
        report(read_records(chosen.folder))
        return
    spec = sys.modules[job.__module__].__spec__
    if spec is not None and spec.name != job.__module__:  # run by -m: workers load it by its name
        job = getattr(import_module(spec.name), job.__name__)
    try:
        run_numbered(job, chosen.count, folder=chosen.out, workers=chosen.workers)
    except KeyboardInterrupt:
        print("interrupted; run the same command to continue", file=sys.stderr)
        sys.exit(130)
