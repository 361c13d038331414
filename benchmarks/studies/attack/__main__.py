"""Hostile input in numbers: ``python -m benchmarks.studies.attack``, or some of its parts.

Each attempt has a number and follows from it and the seed alone. What is done stands in a journal
in the folder, a line an attempt: a job that was killed, or whose time was up, continues
from the last line.
At its end the table of all parts is written to docs/evidence/robustness.md.
"""

import argparse
import importlib
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from benchmarks.machine import machine
from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, read_records, run_missing

PAGE = EVIDENCE / "robustness.md"
OUTCOMES = ("refused", "stopped", "answered", "fault")
Attacking = Callable[[int], AbstractContextManager[Callable[[int], Record]]]


@dataclass(frozen=True, slots=True)
class Part:
    """A module with `attacking(seed)`, and how many attempts it makes.

    The context that `attacking` returns gives what turns a number into a record with index, kind,
    outcome (one of `OUTCOMES`), seconds, memory [MB], and a text for a fault.
    """

    module: str
    count: int


PARTS = {
    "panels": Part("benchmarks.studies.attack.panels", 1000),
    "recordings": Part("benchmarks.studies.attack.recordings", 500),
    "sweeps": Part("benchmarks.studies.attack.sweeps", 2200),
    "studio": Part("benchmarks.studies.attack.studio", 2000),
}


def run(part: str, *, seed: int, count: int, out: Path, minutes: float) -> list[Record]:
    """Make the attempts that the journal lacks, until the time is up; return all there are."""
    attacking: Attacking = importlib.import_module(PARTS[part].module).attacking
    until = time.monotonic() + 60 * minutes

    def attempts(missing: list[int]) -> Iterator[Record]:
        if not missing:
            return
        with attacking(seed) as attempt:
            for done, index in enumerate(missing):
                if time.monotonic() > until:
                    left = len(missing) - done
                    print(f"time is up with {left} left; run the same command to continue")
                    break
                yield attempt(index)

    return run_missing(attempts, count, folder=out / f"{part}-{seed}")


def table(records: list[Record]) -> list[str]:
    """Return a table: attempts and outcomes of each kind, longest time and largest memory."""
    lines = [
        "| kind | tried | refused | stopped | answered | faults | longest | largest memory |",
        "|---|---|---|---|---|---|---|---|",
    ]
    kinds = sorted({record["kind"] for record in records})
    for kind in [*kinds, "all"]:
        those = [record for record in records if kind in ("all", record["kind"])]
        found = Counter(record["outcome"] for record in those)
        longest = max((record["seconds"] for record in those), default=0.0)
        memory = max((record.get("memory", 0.0) for record in those), default=0.0)
        counts = " | ".join(str(found[outcome]) for outcome in OUTCOMES)
        lines.append(f"| {kind} | {len(those)} | {counts} | {longest:.1f} s | {memory:.0f} MB |")
    return lines


def section(found: dict[str, list[Record]], seed: int) -> list[str]:
    """Return the lines of the page."""
    lines = [f"Seed {seed}; {machine()}, which did other things too."]
    for part, records in found.items():
        lines += ["", f"### {part.capitalize()}", "", *table(records)]
    return lines


def main() -> int:
    """Run the requested parts, or all; return 1 for any fault."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="attempts of each part instead of its own number")
    parser.add_argument("--minutes", type=float, default=30.0, help="in all")
    parser.add_argument("--out", type=Path, default=Path("build/attack"), help="of the journals")
    parser.add_argument("--page", type=Path, help=f"to write the table to; all parts: {PAGE.name}")
    given = parser.parse_args()
    if unknown := set(given.parts) - set(PARTS):
        parser.error(f"there is no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    if len(given.parts) != 1:
        return _each_apart(given.parts or list(PARTS), given)
    (part,) = given.parts
    count = given.count or PARTS[part].count
    records = run(part, seed=given.seed, count=count, out=given.out, minutes=given.minutes)
    print(f"\n{part}, seed {given.seed}\n")
    print("\n".join(table(records)))
    found = [record for record in records if record["outcome"] == "fault"]
    for record in found:
        print(f"\nfault {record['index']} ({record['kind']}): {record['text']}")
    return int(bool(found))


def _each_apart(parts: list[str], given: argparse.Namespace) -> int:
    """Run each part in a process of its own, as some fork and some count their memory."""
    codes, until = [], time.monotonic() + 60 * given.minutes
    for left, part in zip(range(len(parts), 0, -1), parts, strict=True):
        minutes = max(until - time.monotonic(), 0.0) / 60 / left
        words = [part, "--seed", given.seed, "--minutes", minutes, "--out", given.out]
        words += ["--count", given.count] if given.count else []
        command = [sys.executable, "-m", "benchmarks.studies.attack", *map(str, words)]
        codes.append(subprocess.run(command, check=False).returncode)
    page = given.page or (PAGE if set(parts) == set(PARTS) and not given.count else None)
    if page is not None:
        found = {part: read_records(given.out / f"{part}-{given.seed}") for part in parts}
        put_section(page, name="attack", heading="Attacks", lines=section(found, given.seed))
        print(f"{page}: written")
    return max(codes)


if __name__ == "__main__":
    sys.exit(main())
