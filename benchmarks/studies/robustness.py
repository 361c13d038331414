"""The long job: thousands of random scenarios, each with an outcome and a list of faults.

    python -m benchmarks.studies.robustness run --count 2000 --out DIR [--workers 2]
    python -m benchmarks.studies.robustness report DIR

A scenario is fixed by its index, and its result is one line of `DIR/runs.jsonl`, written at once:
a job that was killed goes on where it was, Ctrl-C keeps what there is. A run that does not converge
is repeated with steps of 0.1 ms; if it then does, that is a defect. `report` writes
docs/evidence/robustness.md. `show INDEX` prints a scenario with what is wrong with it.
"""

import argparse
import faulthandler
import gc
import json
import os
import platform
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
from tests.verification.robustness_checks import Run, faults, run_scenario, seconds_deaf
from tests.verification.robustness_scenarios import SEED, Scenario, numbered_scenario

from benchmarks.studies.robustness_report import write_page
from turnout.core.errors import TurnoutError
from turnout.core.processes import Tasks, end_pool, worker_processes
from turnout.kernels.compiled import kernel_cache_folder
from turnout.metric.summary import numerical_share, residual_share

Record = dict[str, Any]
FINE_STEP = 1e-4
MOVES = 1.0
"""Shares of the energy scale are reported of runs with more than this [J]."""
INTERRUPT_EVERY, SLOW = 10, 3.0
"""One run in so many, and every run that takes longer [s], is repeated and ended by Ctrl-C."""
ENDLESS = 300.0
"""A run that takes longer than this is ended and counts as endless [s]."""
RUNS, JOB = "runs.jsonl", "job.json"


def result_of(index: int) -> Record:
    """Run one scenario; return what the report needs."""
    faulthandler.dump_traceback_later(ENDLESS, exit=True)
    scenario = numbered_scenario(index)
    began = time.perf_counter()
    record: Record = {"index": index, "kind": scenario.kind, "special": scenario.special}
    record |= {"step": scenario.step, "objects": len(scenario.objects)}
    try:
        record |= _judged(run_scenario(scenario))
        record["seconds"] = time.perf_counter() - began
        if index % INTERRUPT_EVERY == 0 or record["seconds"] > SLOW:
            share = float(np.random.default_rng([SEED, index, 1]).uniform())
            record["deaf"] = seconds_deaf(scenario, after=share * record["seconds"])
        if not record["complete"]:
            again = run_scenario(scenario, step=FINE_STEP)
            record["fine"] = again.history.outcome.code.name
            record["faults"] += [f"at 0.1 ms: {text}" for text in faults(again)]
    except TurnoutError as error:
        record |= {"complete": False, "outcome": "REFUSED", "faults": [str(error)]}
    except Exception as error:  # noqa: BLE001 - any exception is what this job looks for
        text = f"{type(error).__name__}: {error}"
        record |= {"complete": False, "outcome": "EXCEPTION", "faults": [text]}
    faulthandler.cancel_dump_traceback_later()
    return record | {"seconds": record.get("seconds", time.perf_counter() - began)}


def _judged(run: Run) -> Record:
    outcome = run.history.outcome
    shares = (float("nan"), float("nan"))
    if run.dataset.attrs["energy_scale"] > MOVES:
        shares = (residual_share(run.dataset), numerical_share(run.dataset))
    return {
        "complete": outcome.complete,
        "outcome": outcome.code.name,
        "message": outcome.message(),
        "faults": faults(run),
        "steps": outcome.step,
        "halved": run.history.halved,
        "scale": run.dataset.attrs["energy_scale"],
        "residual": shares[0],
        "numerical": shares[1],
    }


def is_defect(record: Record) -> bool:
    """Return whether a result may not be: a fault, or an early end that a finer step avoids."""
    return bool(record["faults"]) or record.get("fine") == "COMPLETE"


def read_results(folder: Path) -> list[Record]:
    """Return the results of a job in the order of their indices; a torn last line is left out."""
    path = folder / RUNS
    if not path.exists():
        return []
    lines = path.read_bytes().split(b"\n")[:-1]
    found = {record["index"]: record for record in map(json.loads, lines)}
    return [found[index] for index in sorted(found)]


def run_job(count: int, *, folder: Path, workers: int) -> list[Record]:
    """Run what is missing of the first `count` scenarios; return all their results.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C; the results until then are kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / JOB).write_text(json.dumps(_job(workers)))
    known = {record["index"] for record in read_results(folder)}
    missing = [index for index in range(count) if index not in known]
    _mend(folder / RUNS)
    began = time.monotonic()
    with (folder / RUNS).open("ab", buffering=0) as file:
        for number, record in enumerate(_results(missing, workers), 1):
            file.write(json.dumps(record).encode() + b"\n")
            os.fsync(file.fileno())
            _tell(number, len(missing), time.monotonic() - began, record)
    return [record for record in read_results(folder) if record["index"] < count]


def _job(workers: int) -> Record:
    kernels = kernel_cache_folder().name.removeprefix("kernels-")
    cores = os.cpu_count() or 1
    return {
        "machine": f"{_processor()}, {cores} cores, {platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "workers": workers,
        "kernels": kernels,
        "seed": SEED,
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown processor"


def _mend(path: Path) -> None:
    """Cut off a line that a kill left unfinished."""
    if path.exists():
        data = path.read_bytes()
        path.write_bytes(data[: data.rfind(b"\n") + 1])


def _results(missing: Iterable[int], workers: int) -> Iterator[Record]:
    """Yield results as they come; a scenario that ends its process is named and left behind."""
    waiting = list(missing)
    while waiting:
        under_way: set[int] = set()
        try:
            for record in _pooled(waiting, workers, under_way):
                yield record
                waiting.remove(record["index"])
        except BrokenProcessPool:
            for index in sorted(under_way):
                waiting.remove(index)
                yield _alone(index)


def _alone(index: int) -> Record:
    try:
        return next(_pooled([index], 1, set()))
    except BrokenProcessPool:
        scenario = numbered_scenario(index)
        text = f"its process died, or it took more than {ENDLESS:g} s"
        return {
            "index": index,
            "kind": scenario.kind,
            "special": scenario.special,
            "complete": False,
            "outcome": "ENDLESS",
            "faults": [text],
            "seconds": ENDLESS,
        }


def _pooled(indices: list[int], workers: int, under_way: set[int]) -> Iterator[Record]:
    """Keep the workers busy without handing out more than they can start."""
    rest = iter(list(indices))
    pool = worker_processes(workers, _begin_worker)
    try:
        tasks: Tasks[Record] = Tasks(pool)
        while True:
            for index in _first(rest, workers - tasks.waiting):
                under_way.add(index)
                tasks.submit(result_of, index)
            if not tasks.waiting:
                return
            record = next(tasks.all_done()).result()
            under_way.discard(record["index"])
            yield record
    finally:
        end_pool(pool)


def _first(rest: Iterator[int], count: int) -> Iterator[int]:
    yield from (index for _, index in zip(range(count), rest, strict=False))


def _begin_worker() -> None:
    """Get compilation done before any run is timed."""
    gc.enable()
    run_scenario(numbered_scenario(0))


def _tell(number: int, total: int, seconds: float, record: Record) -> None:
    if is_defect(record):
        print(f"scenario {record['index']}: {record['outcome']} {record['faults']}", flush=True)
    if number % 25 == 0 or number == total:
        rate = number / seconds
        left = (total - number) / rate
        print(f"{number} of {total}, {rate:.1f} a second, {left:.0f} s left", flush=True)


def show(scenario: Scenario) -> str:
    """Return a scenario and what is wrong with it, to be repeated elsewhere."""
    run = run_scenario(scenario)
    parts = [f"panel: {scenario.source}", f"overrides: {scenario.overrides}"]
    parts += [f"object: {item}" for item in scenario.objects]
    parts += [run.scheme.describe(), run.history.outcome.message()]
    return "\n".join([*parts, *faults(run)])


def main(arguments: list[str] | None = None) -> int:
    """Run, report or show; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="run what is missing")
    run.add_argument("--count", type=int, default=2000)
    run.add_argument("--out", type=Path, required=True)
    run.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    report = commands.add_parser("report", help="write docs/evidence/robustness.md")
    report.add_argument("folder", type=Path)
    one = commands.add_parser("show", help="repeat one scenario")
    one.add_argument("index", type=int)
    given = parser.parse_args(arguments)
    if given.command == "show":
        print(show(numbered_scenario(given.index)))
    elif given.command == "report":
        job = json.loads((given.folder / JOB).read_text())
        print(write_page(read_results(given.folder), job))
    else:
        try:
            run_job(given.count, folder=given.out, workers=given.workers)
        except KeyboardInterrupt:
            print(f"interrupted; results until now are in {given.out / RUNS}", file=sys.stderr)
            return 130
    return 0


if __name__ == "__main__":
    from benchmarks.studies import robustness  # whose functions worker processes find by its name

    sys.exit(robustness.main())
