"""Measure sweeps; write a section of docs/evidence/performance.md.

    python -m benchmarks.sweep FOLDER [--full 2000] [--small 20000] [--store 64] [--workers 2]

Sweeps are made in FOLDER, or gone on with there, so that a run that was ended goes on. What was
measured is kept in FOLDER/measured.json and written on the page. The ideal rate is that of solvers
that do nothing else: workers over the mean time in which these very throws were solved, while the
same number of workers ran. Solving is what `simulate` reports as `solver_time`: the mechanism, its
equilibrium, the integration. The share of the solver in processor time says the same whatever
else the machine does. The published campaign is run by its command.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.page import write_section
from benchmarks.sweep_page import section
from turnout.calibration.load_study import load_study
from turnout.core.progress import Progress
from turnout.study.read_study import scheme_for
from turnout.study.study import Study
from turnout.study.sweep.batch import batch_variables, throw_batch
from turnout.study.sweep.batch_bytes import file_bytes
from turnout.study.sweep.folder import JOURNAL
from turnout.study.sweep.read import open_batches, read_labels
from turnout.study.sweep.run import throw_study
from turnout.throw.simulate import compile_kernels

FULL = """
schema_version = 1
name = "full panel"
description = "Benchmark: the default panel, friction and an object of any size at any place."
panel = "uic60-760-1-15"
seed = 1

[scheme]
mode = "{mode}"

[[variable]]
key = "chair.friction_coefficient"
distribution = "uniform"
minimum = 0.1
maximum = 0.4

[[variable]]
key = "drive.2.stiffness"
distribution = "uniform"
minimum = "400 kN/m"
maximum = "900 kN/m"

[[variable]]
key = "object.at"
distribution = "choice"
values = ["every sleeper"]

[[variable]]
key = "object.size"
distribution = "uniform"
minimum = "0 mm"
maximum = "30 mm"

[sampling]
count = {count}
"""
SMALL = """
schema_version = 1
name = "small"
description = "Benchmark: one rail, cut short."
panel = "sb1"
seed = 1

[scheme]
mode = "quick"

[set]
"schedule.end" = "0.6 s"
"movement.throw.start" = "0.05 s"
"movement.throw.duration" = "0.2 s"
"movement.return.start" = "0.3 s"
"movement.return.duration" = "0.2 s"
"movement.return.extra_time" = {{ "2" = "0 s" }}

[[variable]]
key = "chair.friction_coefficient"
distribution = "uniform"
minimum = 0.1
maximum = 0.4

[sampling]
count = {count}
"""


def study_in(folder: Path, text: str, *, name: str, count: int, mode: str = "quick") -> Study:
    """Write a study file and load it."""
    path = folder / f"{name}-{count}.toml"
    path.write_text(text.format(count=count, mode=mode), encoding="utf-8")
    return load_study(path)


def timed_run(study: Study, folder: Path, *, workers: int) -> dict[str, Any]:
    """Make the missing throws; return rates of this call, and sizes of the whole."""
    load, own = os.getloadavg()[0], time.process_time()
    began, used = time.perf_counter(), used_by_workers()
    finished = throw_study(study, folder, workers=workers, report=Reported())
    wall, used = time.perf_counter() - began, used_by_workers() - used
    used += time.process_time() - own
    batches = finished.batches
    count = read_labels(folder).sizes["scenario"]
    size = sum(path.stat().st_size for path in (folder / "batches").iterdir())
    return {
        "thrown": finished.thrown,
        "wall": wall,
        "processor": used,
        "solver": sum(batch.solver_time for batch in batches),
        "build": sum(batch.build_time for batch in batches),
        "busy": sum(batch.wall_time for batch in batches),
        "solver_processor": sum(batch.solver_processor for batch in batches),
        "busy_processor": sum(batch.processor for batch in batches),
        "workers": workers,
        "stored": count,
        "bytes": size / count,
        "log": (folder / JOURNAL).stat().st_size,
        "load_before": load,
        "load": os.getloadavg()[0],
    }


def used_by_workers() -> float:
    """Return the processor time of all workers that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


class Reported:
    """Shows the progress of a sweep, every ten seconds."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, state: Progress) -> None:
        """Print one line."""
        if time.monotonic() < self._next and state.done < state.total:
            return
        self._next = time.monotonic() + 10.0
        print(f"{state.done} of {state.total}, {state.rate:.2f} a second", flush=True)


def memory_of(pid: int) -> float:
    """Return the memory that a process holds [MB]."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1e3
    return float("nan")


def memory_curve(study: Study, folder: Path, *, workers: int) -> list[tuple[int, float, float]]:
    """Return batches written, memory of the run and of its largest worker [MB], as it runs."""
    command = [sys.executable, "-m", "benchmarks.sweep", str(folder.parent), "--only", study.name]
    process = subprocess.Popen([*command, str(study.count), "--workers", str(workers)])
    curve: list[tuple[int, float, float]] = []
    while process.poll() is None:
        time.sleep(5.0)
        done = sum(1 for _ in (folder / "batches").glob("[0-9]*.nc")) if folder.exists() else 0
        try:
            task = Path(f"/proc/{process.pid}/task/{process.pid}/children")
            children = [int(pid) for pid in task.read_text(encoding="utf-8").split()]
            largest = max((memory_of(pid) for pid in children), default=0.0)
            curve.append((done, memory_of(process.pid), largest))
        except OSError:  # a process ended between two looks
            continue
    if process.returncode:
        message = f"the sweep for the memory curve ended with {process.returncode}"
        raise RuntimeError(message)
    return curve


def sizes(study: Study, *, count: int) -> dict[str, float]:
    """Return bytes a scenario at its rate, at 1 kHz, and without histories."""
    found = {}
    for name, output in (
        (f"{study.output.rate:g} Hz", study.output),
        ("1 kHz", replace(study.output, rate=1000.0)),
        ("labels and features alone", replace(study.output, channels=())),
    ):
        chosen = replace(study, output=output, scheme=scheme_for(study.scheme, output))
        rows = throw_batch(chosen, [[index] for index in range(count)])
        found[name] = len(file_bytes(batch_variables(chosen, rows))) / count
    return found


def reading(folder: Path) -> dict[str, float]:
    """Return the seconds that looking at a sweep takes."""
    began = time.perf_counter()
    sweep = open_batches(folder)
    opened = time.perf_counter()
    sweep["drive_force"].isel(scenario=-1).load()
    one = time.perf_counter()
    sweep["peak_force"].load()
    feature = time.perf_counter()
    read_labels(folder)
    labels = time.perf_counter()
    return {
        "open": opened - began,
        "one scenario": one - opened,
        "one feature of all": feature - one,
        "all labels and features": labels - feature,
    }


def campaign(folder: Path, *, workers: int) -> dict[str, Any]:
    """Run the published campaign by its command; return its times and counts."""
    shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, "-m", "turnout", "sweep", "run", "paper-campaign"]
    began, used = time.perf_counter(), used_by_workers()
    subprocess.run([*command, "-o", str(folder), "--workers", str(workers), "--quiet"], check=True)
    wall, used = time.perf_counter() - began, used_by_workers() - used
    outcome = read_labels(folder)["outcome"].values.astype(str)
    return {
        "wall": wall,
        "processor": used,
        "thrown": int((outcome == "complete").sum()),
        "skipped": int((outcome == "skipped").sum()),
        "workers": workers,
        "load": os.getloadavg()[0],
    }


def main() -> None:
    """Measure the requested parts, keep them, and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--full", type=int, default=2000)
    parser.add_argument("--small", type=int, default=20000)
    parser.add_argument("--store", type=int, default=64)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs=2, metavar=("NAME", "COUNT"))
    chosen = parser.parse_args()
    folder: Path = chosen.folder
    folder.mkdir(parents=True, exist_ok=True)
    if chosen.only:
        small = study_in(folder, SMALL, name="small", count=int(chosen.only[1]))
        result = timed_run(small, folder / "small", workers=chosen.workers)
        (folder / "small.json").write_text(json.dumps(result), encoding="utf-8")
        return
    compile_kernels()
    kept_file = folder / "measured.json"
    kept = json.loads(kept_file.read_text(encoding="utf-8")) if kept_file.exists() else {}

    def keep(name: str, value: Any) -> None:
        kept[name] = value
        kept_file.write_text(json.dumps(kept, indent=1), encoding="utf-8")

    for name, mode in (("full", "quick"), ("waveform", "waveform")):
        study = study_in(folder, FULL, name=name, count=chosen.full, mode=mode)
        result = timed_run(study, folder / name, workers=chosen.workers)
        if result["thrown"]:
            keep(name, result)
    full = study_in(folder, FULL, name="full", count=chosen.full)
    if "campaign" not in kept:
        keep("campaign", campaign(folder / "campaign", workers=chosen.workers))
    if "sizes" not in kept:
        keep("sizes", sizes(full, count=chosen.store))
    small = study_in(folder, SMALL, name="small", count=chosen.small)
    if kept.get("small", {}).get("stored") != chosen.small:
        curve = memory_curve(small, folder / "small", workers=chosen.workers)
        result = json.loads((folder / "small.json").read_text(encoding="utf-8"))
        keep("small", result | {"curve": curve})
    keep("reading", reading(folder / "small"))
    write_section("Sweeps", section(kept))
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    print(f"written; the largest process took {peak:.0f} MB")


if __name__ == "__main__":
    main()
