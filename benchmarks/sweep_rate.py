"""Measure throws of quick sweeps against an older checkout; write docs/performance-rate.md.

    python -m benchmarks.sweep_rate OLDER [--count 512] [--repeats 3] [--note TEXT]

OLDER is the folder of another checkout, such as one made by `git worktree add --detach OLDER main`.
Both throw the same scenarios in turn, each in a fresh process of one thread, batches made and
compressed but not written. Processor time counts, the least of the repeats, so that other work on
the machine matters little; the ratio of a run is what to read. Bytes and the plan of a hundred
million throws follow from the newer one.
"""

import argparse
import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

from benchmarks.machine import ONE_THREAD, load, machine

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "performance-rate.md"
STUDIES = {
    "stiffness, slip, friction field, object size and place": ROOT / "benchmarks" / "million.toml",
    "population of sound switches": "detection-reference",
}
WARM, BATCH, FEATURES = 160, 64, 1024
"""Throws that are not counted, throws of a batch, and of a batch of features alone."""
PLANNED = 100_000_000
CORES = (2, 16, 128)

CHILD = f"""
import json, signal, sys, time
from dataclasses import replace
from turnout.sweep.batch import batch_variables, file_bytes, throw_batch
from turnout.sweep.worker import initialize_worker
try:
    from turnout.study.load_study import load_study
except ImportError:
    from turnout.study.load import load_study
signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in a worker
initialize_worker()
study, count, features = load_study(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
def size_of(study, first, number):
    rows = throw_batch(study, [range(first, first + number)])
    return rows, len(file_bytes(batch_variables(study, rows)))
size_of(study, 0, {WARM})
each, solver, size = [], 0.0, 0
for first in range({WARM}, {WARM} + count, {BATCH}):
    began = time.process_time()
    rows, written = size_of(study, first, {BATCH})
    each.append(time.process_time() - began)
    solver += sum(row.solver.processor for row in rows)
    size += written
thrown = {BATCH} * len(each)
found = {{"all": sum(each) / thrown, "solver": solver / thrown, "bytes": size / thrown}}
if features:
    alone = replace(study, output=replace(study.output, channels=()))
    found["features"] = size_of(alone, 0, features)[1] / features
print(json.dumps(found))
"""


def measured(source: Path, study: str, *, count: int, features: int) -> dict[str, float]:
    """Throw a study with the sources of a checkout; return seconds and bytes a throw."""
    environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(source / "src")}
    command = [sys.executable, "-c", CHILD, study, str(count), str(features)]
    run = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    found: dict[str, float] = json.loads(run.stdout)
    print(source.name, study, found, flush=True)
    return found


def page(
    found: dict[str, tuple[dict[str, float], dict[str, float]]], *, before: float, note: str
) -> str:
    """Return the page of what was measured."""
    rows = [
        f"| {what} | {1e3 * old['all']:.1f} | {1e3 * new['all']:.1f} | "
        f"{1e3 * new['solver']:.1f} | {old['all'] / new['all']:.2f} | "
        f"{2 * 3600 / new['all']:,.0f} |"
        for what, (old, new) in found.items()
    ]
    new = next(iter(found.values()))[1]
    plan = [
        f"| {cores} | {PLANNED * new['all'] / cores / 3600:,.0f} | "
        f"{PLANNED * new['features'] / 1e9:,.0f} | {PLANNED * new['bytes'] / 1e9:,.0f} |"
        for cores in CORES
    ]
    return "\n".join(
        [
            "# Rate of quick sweeps",
            "",
            f"Written by `python -m benchmarks.sweep_rate OLDER` on {machine()}, at a load of",
            f"{before:.1f} before and {load():.1f} at the end. Processor time of one thread a",
            "throw, the same scenarios thrown in turn by the code before and the present one;",
            "batches are made and compressed. What other work on the machine takes from the caches",
            "is in the times and hardly in the ratio.",
            *textwrap.wrap(note, 98),
            "",
            "| what varies | before [ms] | now [ms] | of that the solver [ms] | ratio "
            "| an hour on 2 cores |",
            "|---|---:|---:|---:|---:|---:|",
            *rows,
            "",
            "## A hundred million throws",
            "",
            f"From the first row: {1e3 * new['all']:.1f} ms, {new['features']:.0f} bytes a throw "
            'with `keep = "features"`,',
            f"{new['bytes'] / 1e3:.1f} kB with histories at 125 Hz. Times hold for this machine",
            "at that load and scale with cores; the start of a worker (about a second) is not in",
            "them.",
            "",
            "| cores | hours | disk for features [GB] | disk with histories [GB] |",
            "|---:|---:|---:|---:|",
            *plan,
            "",
            "Make it a hundred sweeps of a million, one a `seed`, since a sweep plans all of its",
            "batches at its start. [Workers of a cluster](how-to/sweep-run.md) write their batches",
            "themselves; one that is lost costs its batch, at most 1,024 throws, which another one",
            "throws again (`tests/unit/test_study_sweep_cluster.py`).",
            "",
        ]
    )


def main() -> None:
    """Measure both checkouts in turn and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("older", type=Path)
    parser.add_argument("--count", type=int, default=512)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--note", default="", help="what else differs between the two")
    chosen = parser.parse_args()
    before, found = load(), {}
    for what, study in STUDIES.items():
        pairs = []
        for repeat in range(chosen.repeats):
            features = FEATURES if repeat == 0 else 0
            old = measured(chosen.older.absolute(), str(study), count=chosen.count, features=0)
            new = measured(ROOT, str(study), count=chosen.count, features=features)
            pairs.append((old, new))
        older, newer = zip(*pairs, strict=True)
        least = min(older, key=lambda item: item["all"]), min(newer, key=lambda item: item["all"])
        found[what] = least[0], least[1] | {"features": newer[0]["features"]}
    PAGE.write_text(page(found, before=before, note=chosen.note), encoding="utf-8")


if __name__ == "__main__":
    main()
