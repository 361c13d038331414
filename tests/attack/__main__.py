"""Hostile input in numbers: ``python -m tests.attack PART --seed S --count N --out DIR``.

Each attempt has a number and follows from it and the seed alone. What is done stands in a journal
in the folder, a line an attempt: a job that was killed, or whose time was up, goes on from there.
"""

import argparse
import importlib
import json
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from tests.verification.resumable import RESULTS, read_records

# Each module has `attacking(seed)`: a context that gives what turns a number into a record with
# index, kind, outcome ("refused", "answered" or "fault"), seconds, and a text for a fault.
PARTS = {"studio": "tests.attack.studio"}
OUTCOMES = ("refused", "answered", "fault")
Record = dict[str, Any]
Attacking = Callable[[int], AbstractContextManager[Callable[[int], Record]]]


def run(part: str, *, seed: int, count: int, out: Path, minutes: float) -> list[Record]:
    """Make the attempts that the journal lacks, until the time is up; return all there are."""
    attacking: Attacking = importlib.import_module(PARTS[part]).attacking
    folder = out / f"{part}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    journal = folder / RESULTS
    if journal.exists():
        whole = journal.read_bytes()
        journal.write_bytes(whole[: whole.rfind(b"\n") + 1])
    known = {record["index"] for record in read_records(folder)}
    missing = [index for index in range(count) if index not in known]
    until = time.monotonic() + 60 * minutes
    if missing:
        with attacking(seed) as attempt, journal.open("ab", buffering=0) as file:
            for done, index in enumerate(missing):
                if time.monotonic() > until:
                    print(f"time is up with {len(missing) - done} left; the same command goes on")
                    break
                file.write(json.dumps(attempt(index)).encode() + b"\n")
                if done % 100 == 99:
                    print(f"{done + 1} of {len(missing)}", file=sys.stderr, flush=True)
    return [record for record in read_records(folder) if record["index"] < count]


def table(records: list[Record]) -> str:
    """Return how many attempts of each kind were refused, answered, or found a fault."""
    lines = [
        "| kind | tried | refused | answered | faults | longest |",
        "|---|---|---|---|---|---|",
    ]
    kinds = sorted({record["kind"] for record in records})
    for kind in [*kinds, "all"]:
        those = [record for record in records if kind in ("all", record["kind"])]
        found = Counter(record["outcome"] for record in those)
        longest = max((record["seconds"] for record in those), default=0.0)
        counts = " | ".join(str(found[outcome]) for outcome in OUTCOMES)
        lines.append(f"| {kind} | {len(those)} | {counts} | {longest:.1f} s |")
    return "\n".join(lines)


def main() -> int:
    """Run a part, or all; 1 where there is a fault."""
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description=__doc__)
    parser.add_argument("part", choices=[*PARTS, "all"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=2000, help="attempts of each part")
    parser.add_argument("--minutes", type=float, default=30.0, help="for each part")
    parser.add_argument("--out", type=Path, default=Path("build/attack"), help="of the journals")
    given = parser.parse_args()
    faults = 0
    for part in PARTS if given.part == "all" else [given.part]:
        records = run(
            part, seed=given.seed, count=given.count, out=given.out, minutes=given.minutes
        )
        found = [record for record in records if record["outcome"] == "fault"]
        print(f"\n{part}, seed {given.seed}\n\n{table(records)}")
        for record in found:
            print(f"\nfault {record['index']} ({record['kind']}): {record['text']}")
        faults += len(found)
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
