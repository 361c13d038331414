"""The long job: thousands of random scenarios, each with an outcome and a list of faults.

    python -m benchmarks.studies.robustness run --count 2000 --out DIR [--workers 2]
    python -m benchmarks.studies.robustness report DIR

A scenario is fixed by its index, and its result is one line of `DIR/results.jsonl`, written at
once: a job that was killed goes on where it was, Ctrl-C keeps what there is. A run that does not
converge is repeated with steps of 0.1 ms; if it then does, that is a defect. `report` writes
docs/evidence/robustness.md. `show INDEX` prints a scenario with what is wrong with it.
"""

import argparse
import faulthandler
import gc
import json
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from statistics import median, quantiles
from types import FrameType

import numpy as np
from tests.verification.robustness_checks import Run, faults, run_scenario
from tests.verification.robustness_scenarios import SEED, Scenario, numbered_scenario

from benchmarks.machine import machine
from benchmarks.page import EVIDENCE
from benchmarks.studies.resumable import RESULTS, Record, read_records, run_missing
from turnout.core.errors import TurnoutError
from turnout.core.processes import Tasks, end_pool, worker_processes
from turnout.kernels.compiled import kernel_cache_folder
from turnout.metric.summary import numerical_share, residual_share
from turnout.throw.simulate import simulate

FINE_STEP = 1e-4
MOVES = 1.0
"""Shares of the energy scale are reported of runs with more than this [J]."""
INTERRUPT_EVERY, SLOW = 10, 3.0
"""One run in so many, and every run that takes longer [s], is repeated and ended by Ctrl-C."""
WEAK = ("weakref", "_weakrefset")
"""Modules whose functions the end of an object may call."""
ENDLESS = 300.0
"""A run that takes longer than this is ended and counts as endless [s]."""
JOB = "job.json"


def result_of(index: int) -> Record:
    """Run one scenario; return a record for the report."""
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


def run_job(count: int, *, folder: Path, workers: int) -> list[Record]:
    """Run the missing ones of the first `count` scenarios; return all their results.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C; the results until then are kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / JOB).write_text(json.dumps(_job(workers)))
    return run_missing(lambda missing: _results(missing, workers), count, folder=folder)


def _job(workers: int) -> Record:
    kernels = kernel_cache_folder().name.removeprefix("kernels-")
    return {
        "machine": machine(),
        "workers": workers,
        "kernels": kernels,
        "seed": SEED,
    }


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


def show(scenario: Scenario) -> str:
    """Return a scenario and its faults, to be repeated elsewhere."""
    run = run_scenario(scenario)
    parts = [f"panel: {scenario.source}", f"overrides: {scenario.overrides}"]
    parts += [f"object: {item}" for item in scenario.objects]
    parts += [run.scheme.describe(), run.history.outcome.message()]
    return "\n".join([*parts, *faults(run)])


def seconds_deaf(scenario: Scenario, *, after: float) -> float:
    """Press Ctrl-C so many seconds into a scenario; return how long it goes on after that [s].

    Zero if it ended before. An alarm sends what Ctrl-C sends, to the main thread, between any two
    instructions. Those of a finaliser are among them, and Python drops what a finaliser raises: the
    interrupt would be lost, and the warning about it fail whichever test runs. So what waits for
    the garbage collector, also of other tests, is finalised before, and nothing on the way; and
    where what is freed by counting is being finalised, the alarm comes again at once.
    """
    panel, scheme = scenario.panel(), scenario.scheme()
    gc.collect()
    gc.disable()
    before = signal.signal(signal.SIGALRM, interrupt_or_wait)
    ctrl_c = signal.signal(signal.SIGINT, signal.default_int_handler)  # which workers ignore
    began = time.perf_counter()
    signal.setitimer(signal.ITIMER_REAL, after)
    try:
        try:
            simulate(panel, foreign_object=scenario.foreign_objects(), scheme=scheme, throw=False)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            gc.enable()
    except KeyboardInterrupt:  # before the first step or after the last
        pass
    finally:
        signal.signal(signal.SIGALRM, before)
        signal.signal(signal.SIGINT, ctrl_c)
    return max(time.perf_counter() - began - after, 0.0)


def interrupt_or_wait(number: int, frame: FrameType | None) -> None:
    """Send the signal of Ctrl-C, a millisecond later while a finaliser may be running."""
    inner = frame
    while inner is not None:
        if inner.f_code.co_name == "__del__" or inner.f_globals.get("__name__") in WEAK:
            signal.setitimer(signal.ITIMER_REAL, 1e-3)
            return
        inner = inner.f_back
    signal.raise_signal(signal.SIGINT)


PAGE = EVIDENCE / "robustness.md"
LIMITS = (0.005, 0.02, 0.2)
"""Shares of the energy scale that the table of losses counts beyond."""

HEAD = """# Robustness

The job below draws random panels and throws them. The library panels are changed by overrides,
small panels are written from nothing: one or two rails, with and without stock rails, one to six
drives, feet, links and movements in any number. Stiffnesses are spread over six decades around
their defaults (drives from 1 kN/m to 1 GN/m), friction from 0 to 1, for all chairs or chair by
chair; movements follow each other at once, rests have no length, all chairs are lifted off or
stick; up to three objects from 1 mm to the opening stand at any station, some of them placed while
the rail is closed. Steps are 0.5 to 4 ms, cut-offs 100 Hz to none.

Each run must come to its end, or stop with a message that names time, step, residual, contacts and
a remedy and keeps the response until then. Every run, whole or partial, must be free of NaN, close
its energy balance to 1e-6 of its scale, and keep every law: no contact pulls by more than 1 mN
(or the scheme's gap tolerance times its stiffness, if that is more), no friction is above its
limit, no force is off its law, friction in sum takes energy. A run that comes to its end with an
open balance must say so itself (`inaccurate`). Where the balance is a small difference of large
terms, as under chairs lifted by metres, rounding is allowed for: 5e-13 of the energy in the linear
system with all closed chairs folded in, of a whole run 1e-14 and 1e-6 J at most. A run that stops
early is repeated with steps of 0.1 ms; if that one comes to its end, the first counts as a defect.
Every tenth run, and all that take more than 3 s, are repeated and ended by Ctrl-C at a random time.

    python -m benchmarks.studies.robustness run --count 2000 --out DIR
    python -m benchmarks.studies.robustness report DIR
    python -m benchmarks.studies.robustness show INDEX

The first command can be killed and started again; the second writes this page; the third repeats
one scenario. The same job is a test of `test_studies.py`, left out unless selected with
`-m long`.
"""


LOSSES = """The energy balance closes, whatever the step; the share of numerical dissipation shows
whether the step is small enough. Many of these scenarios are hard blows: a rail thrown in 0.3 s
against stops or an object of a thousand times the usual stiffness, without damping. Then a large
step loses or makes energy of the order of what there is, and the summary of a run says so; take a
smaller step.
"""


def write_page(results: Sequence[Record], job: Record) -> str:
    """Write the page, whose part on hostile input stays; return its text."""
    _, heading, hostile = PAGE.read_text(encoding="utf-8").partition("\n## Hostile input\n")
    text = page(results, job) + heading + hostile
    PAGE.write_text(text)
    return text


def page(results: Sequence[Record], job: Record) -> str:
    """Return the page for the results of a job."""
    parts = [HEAD, "## Result\n", _table(_figures(results, job), ("figure", "value"))]
    parts += ["## Outcomes by kind of panel\n", _by(results, "kind")]
    parts += ["## Outcomes by what is extreme\n", _by(results, "special")]
    parts += ["## Numerical dissipation\n", LOSSES, _losses(results)]
    parts.append("## Runs that stopped early\n")
    parts.append(_early(results))
    parts.append("## Defects\n")
    parts.append(_defects(results))
    return "\n".join(parts)


def _figures(results: Sequence[Record], job: Record) -> list[tuple[str, str]]:
    ran = [record for record in results if "steps" in record]
    stopped = [record for record in ran if record.get("deaf", 0.0) > 0.0]
    seconds = [record["seconds"] for record in results]
    low, high = (quantiles(seconds, n=20)[k] for k in (0, 18))
    early = sum(not record["complete"] for record in results)
    defects = sum(map(is_defect, results))
    return [
        ("runs", str(len(results))),
        ("complete", str(len(results) - early)),
        ("stopped early", f"{early} ({100 * early / len(results):.2f} %; allowed 1 %)"),
        ("defects", str(defects)),
        ("steps in all", f"{sum(record['steps'] for record in ran):,}"),
        ("halved steps", f"{sum(record['halved'] for record in ran):,}"),
        ("runs with halved steps", str(sum(record["halved"] > 0 for record in ran))),
        ("largest energy residual", _worst(ran, "residual", "of the scale")),
        ("largest numerical loss or gain", _worst(ran, "numerical", "of the scale")),
        ("median numerical loss or gain", f"{median(_numbers(ran, 'numerical')):.1e} of the scale"),
        ("runs ended by Ctrl-C on their way", str(len(stopped))),
        ("longest time from Ctrl-C to the end", _worst(stopped, "deaf", "s")),
        ("of them more than 1 s", str(sum(record["deaf"] > 1.0 for record in stopped))),
        ("time a run, median", f"{median(seconds):.2f} s"),
        ("time a run, 5 % to 95 %", f"{low:.2f} s to {high:.2f} s"),
        ("longest run", f"{max(seconds):.1f} s"),
        ("kernels", job["kernels"]),
        ("machine", f"{job['machine']}, {job['workers']} workers"),
        ("seed", f"{job['seed']} and the index of the scenario"),
    ]


def _numbers(results: Sequence[Record], key: str) -> list[float]:
    return [record[key] for record in results if record[key] == record[key]]


def _worst(results: Sequence[Record], key: str, unit: str) -> str:
    known = [record for record in results if record[key] == record[key]]
    if not known:
        return "none"
    worst = max(known, key=lambda record: float(record[key]))
    return f"{worst[key]:.1e} {unit} (scenario {worst['index']}, {worst['kind']})"


def _by(results: Sequence[Record], key: str) -> str:
    counts = Counter((record[key], record["outcome"]) for record in results)
    outcomes = sorted({record["outcome"] for record in results})
    rows = [
        (kind, *(str(counts[kind, outcome]) for outcome in outcomes))
        for kind in sorted({record[key] for record in results})
    ]
    return _table(rows, (key, *(name.lower().replace("_", " ") for name in outcomes)))


def _losses(results: Sequence[Record]) -> str:
    rows = []
    for step in sorted({record["step"] for record in results if "numerical" in record}):
        shares = _numbers([r for r in results if r["step"] == step and "steps" in r], "numerical")
        above = [f"{100 * sum(x > limit for x in shares) / len(shares):.1f} %" for limit in LIMITS]
        rows.append((f"{1e3 * step:g} ms", str(len(shares)), f"{median(shares):.1e}", *above))
    return _table(rows, ("step", "runs", "median share", "above 0.5 %", "above 2 %", "above 20 %"))


def _early(results: Sequence[Record]) -> str:
    rows = [
        (
            str(record["index"]),
            f"{record['kind']}, {record['special']}",
            str(record.get("message", record["faults"][:1])).split(";")[0].replace("|", "/"),
            record.get("fine", "-").lower().replace("_", " "),
        )
        for record in results
        if not record["complete"]
    ]
    return _table(rows, ("index", "scenario", "message", "at 0.1 ms")) if rows else "None.\n"


def _defects(results: Sequence[Record]) -> str:
    def reported(record: Record) -> str:
        converges = ["complete at 0.1 ms"] if record.get("fine") == "COMPLETE" else []
        return "; ".join([*converges, *record["faults"]][:3]).replace("|", "/")

    rows = [(str(r["index"]), r["kind"], reported(r)) for r in results if reported(r)]
    return _table(rows, ("index", "scenario", "what")) if rows else "None.\n"


def _table(rows: Sequence[tuple[str, ...]], head: tuple[str, ...]) -> str:
    def line(cells: Sequence[str]) -> str:
        return f"| {' | '.join(cells)} |"

    return "\n".join([line(head), line(["---"] * len(head)), *map(line, rows), ""])


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
        print(write_page(read_records(given.folder), job))
    else:
        try:
            run_job(given.count, folder=given.out, workers=given.workers)
        except KeyboardInterrupt:
            print(f"interrupted; results until now are in {given.out / RESULTS}", file=sys.stderr)
            return 130
    return 0


if __name__ == "__main__":
    from benchmarks.studies import robustness  # whose functions worker processes find by its name

    sys.exit(robustness.main())
