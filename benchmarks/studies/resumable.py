"""Numbered pieces of a long job, each a line of a file: a killed job continues."""

import argparse
import json
import multiprocessing
import signal
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

Record = dict[str, Any]
RESULTS = "results.jsonl"
SAID = 100
"""Lines of progress, at most."""


def read_records(folder: Path) -> list[Record]:
    """Return the results by index; a line that a kill left unfinished is left out."""
    path = folder / RESULTS
    if not path.exists():
        return []
    lines = path.read_bytes().split(b"\n")[:-1]
    found = {record["index"]: record for record in map(json.loads, lines)}
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
    path, began = folder / RESULTS, time.monotonic()
    if path.exists():
        whole = path.read_bytes()
        path.write_bytes(whole[: whole.rfind(b"\n") + 1])
    every = max(1, len(missing) // SAID)
    with path.open("ab", buffering=0) as file:
        for done, record in enumerate(make(missing), 1):
            file.write(json.dumps(record).encode() + b"\n")
            left = (time.monotonic() - began) / done * (len(missing) - done)
            if done % every == 0 or done == len(missing):
                text = f"{done} of {len(missing)}, {left / 60:.0f} min left"
                print(text, file=sys.stderr, flush=True)
    return [record for record in read_records(folder) if record["index"] < count]


def run_numbered(
    job: Callable[[int], Record], count: int, *, folder: Path, workers: int
) -> list[Record]:
    """Do the missing ones of `count` pieces in processes, and return all results.

    `job` is a function of a module, as worker processes load it.
    """
    context = multiprocessing.get_context("spawn")
    with context.Pool(workers, _deaf) as pool:
        return run_missing(lambda missing: pool.imap_unordered(job, missing), count, folder=folder)


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
    try:
        run_numbered(job, chosen.count, folder=chosen.out, workers=chosen.workers)
    except KeyboardInterrupt:
        print("interrupted; run the same command to continue", file=sys.stderr)
        sys.exit(130)


def _deaf() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
