"""Numbered pieces of a long job, each a line of a file: what was killed goes on where it was."""

import argparse
import json
import multiprocessing
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

Record = dict[str, Any]
RESULTS = "results.jsonl"


def read_records(folder: Path) -> list[Record]:
    """Return the results by index; a line that a kill left unfinished is left out."""
    path = folder / RESULTS
    if not path.exists():
        return []
    lines = path.read_bytes().split(b"\n")[:-1]
    found = {record["index"]: record for record in map(json.loads, lines)}
    return [found[index] for index in sorted(found)]


def run_numbered(
    job: Callable[[int], Record], count: int, *, folder: Path, workers: int
) -> list[Record]:
    """Do what is missing of `count` pieces, and return all results.

    Parameters
    ----------
    job : callable
        From an index to its record; a function of a module, as worker processes load it.
    count : int
        Pieces.
    folder : Path
        Made if it is not there.
    workers : int
        Processes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known = {record["index"] for record in read_records(folder)}
    missing = [index for index in range(count) if index not in known]
    path, began = folder / RESULTS, time.monotonic()
    if path.exists():
        whole = path.read_bytes()
        path.write_bytes(whole[: whole.rfind(b"\n") + 1])
    context = multiprocessing.get_context("spawn")
    with path.open("ab", buffering=0) as file, context.Pool(workers, _deaf) as pool:
        for done, record in enumerate(pool.imap_unordered(job, missing), 1):
            file.write(json.dumps(record).encode() + b"\n")
            passed = time.monotonic() - began
            left = passed / done * (len(missing) - done)
            print(
                f"{done} of {len(missing)}, {left / 60:.0f} min left", file=sys.stderr, flush=True
            )
    return [record for record in read_records(folder) if record["index"] < count]


def put_section(page: Path, *, name: str, heading: str, lines: list[str]) -> None:
    """Replace the part of a page between its marks, or add it at the end."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    body = "\n".join([begin, *lines, end])
    text = page.read_text(encoding="utf-8") if page.exists() else "# Calibration\n"
    if begin in text:
        before, _, rest = text.partition(begin)
        text = before + body + rest.partition(end)[2]
    else:
        text = f"{text.rstrip()}\n\n## {heading}\n\n{body}\n"
    page.write_text(text, encoding="utf-8")


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
