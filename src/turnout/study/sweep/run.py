"""Throw all scenarios of a study in processes of this machine or of a cluster, and lose none.

Workers write their batches themselves; only counts and times come back. What is written stays, and
the same call on the same folder does what is missing, however the last one ended.
"""

import gc
import json
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from turnout.core.errors import FileError
from turnout.core.files import make_durable, write_fault
from turnout.core.processes import Tasks, closing_pool, worker_processes
from turnout.core.sources import THROWS, digest_of_sources
from turnout.metric.features import compile_features
from turnout.study.study import Study
from turnout.study.sweep.batch import plan_batches
from turnout.study.sweep.export import write_sweep_card
from turnout.study.sweep.extract import output_stride
from turnout.study.sweep.folder import (
    BATCHES,
    JOURNAL,
    check_folder,
    claim_folder,
    clear_leftovers,
    lock_folder,
    move_damaged,
    study_identity,
)
from turnout.study.sweep.row import COMPLETE, SKIPPED
from turnout.study.sweep.stored_study import serialize_study
from turnout.study.sweep.verify import verified_batches
from turnout.study.sweep.worker import BatchDone, make_batch
from turnout.throw.compilation import must_compile
from turnout.throw.simulate import compile_kernels

# Batches handed out beyond one a worker, so that none waits for the next.
PREFETCH = 2
# Breaks of the pool in a row without a batch in between after which a run gives up.
MAX_POOL_FAILURES = 3
# Longest time between two reports of progress [s].
REPORT_INTERVAL = 0.5

MakePool = Callable[[], Executor]


@dataclass(frozen=True, slots=True)
class SweepProgress:
    """Progress of a run.

    Attributes
    ----------
    done, failed, total : int
        Scenarios that are stored, those of them that failed, and all.
    rate : float
        Scenarios a second in this run, 0 before the first batch.
    """

    done: int
    failed: int
    total: int
    rate: float

    @property
    def left(self) -> float:
        """Time left at this rate [s]; infinite before the first batch."""
        return (self.total - self.done) / self.rate if self.rate else float("inf")


@dataclass(frozen=True, slots=True)
class SweepResult:
    """Result of a run.

    Attributes
    ----------
    thrown : int
        Scenarios of the batches made in this run.
    batches : tuple of BatchDone
        Made in this run.
    damaged : tuple of Path
        Files that were damaged, where they are now; what they should hold was thrown again.
    """

    thrown: int
    batches: tuple[BatchDone, ...]
    damaged: tuple[Path, ...]


def throw_study(
    study: Study,
    folder: Path | str,
    *,
    workers: int = 1,
    pool: MakePool | None = None,
    report: Callable[[SweepProgress], None] | None = None,
) -> SweepResult:
    """Throw the missing scenarios of a study into a folder.

    Parameters
    ----------
    study : Study
        From `load_study`.
    folder : path-like
        Made if it is not there; must be empty, or hold the beginning of this sweep.
    workers : int
        Processes, or batches at a time for a pool that was given.
    pool : callable, optional
        Makes the executor that batches are handed to; default processes of this machine.
    report : callable, optional
        Called twice a second or so.

    Returns
    -------
    SweepResult
        Scenarios and batches of this run, and files that were damaged.

    Raises
    ------
    FileError
        When the folder is that of another study or version, is in use, or is full.
    KeyboardInterrupt
        On Ctrl-C; the batches written by then stay.

    Examples
    --------
    >>> from turnout.calibration.load_study import load_study  # doctest: +SKIP
    >>> throw_study(load_study("study.toml"), "results", workers=2).thrown  # doctest: +SKIP
    143
    """
    folder = Path(folder).absolute()
    output_stride(study)
    text = serialize_study(study)
    check_folder(folder, study)
    with lock_folder(folder):
        claim_folder(folder, study, text=text)
        clear_leftovers(folder)
        chains = plan_batches(study)
        sizes = [sum(len(chain) for chain in batch) for batch in chains]
        there, torn = verified_batches(folder / BATCHES, study_identity(study).origin)
        if strangers := [path.name for number, path in there.items() if number >= len(chains)]:
            message = (
                f"{folder / BATCHES}: {', '.join(strangers)} cannot come from this study of "
                f"{len(chains)} batches; move away what is not of it"
            )
            raise FileError(message)
        damaged = tuple(move_damaged(path, folder) for path in torn)
        make_durable(there.values())  # a run that was ended may not have waited for all of them
        todo = [number for number in range(len(chains)) if number not in there]
        make = pool if pool is not None else partial(local_pool, min(workers, max(1, len(todo))))
        if todo and pool is None:
            if must_compile():
                compile_kernels()
            compile_features()
        log = ProgressLog(
            total=study.count,
            before=sum(sizes[number] for number in there),
            journal=folder / JOURNAL,
            report=report,
        )
        log.emit()
        # What processes of this machine write is waited for here, while they go on.
        batches = Batches(folder, study.digest, workers + PREFETCH, durable=pool is not None)
        made = _run_batches(batches, todo, make=make, log=log)
        with closing(made):
            for done in made:
                if not batches.durable:
                    make_durable([folder / BATCHES / done.name])
                log.record(done)
        clear_leftovers(folder)
        write_sweep_card(folder, study)
    thrown = sum(sum(done.outcomes.values()) for done in log.batches)
    return SweepResult(thrown, tuple(log.batches), damaged)


class ProgressLog:
    """Count finished batches, write the journal, and report progress."""

    def __init__(
        self,
        *,
        total: int,
        before: int,
        journal: Path,
        report: Callable[[SweepProgress], None] | None,
    ) -> None:
        self.batches: list[BatchDone] = []
        self._total, self._done, self._failed, self._before = total, before, 0, before
        self._journal, self._report = journal, report
        self._began = time.monotonic()

    def record(self, done: BatchDone) -> None:
        """Count a batch."""
        self.batches.append(done)
        self._done += sum(done.outcomes.values())
        self._failed += sum(
            n for name, n in done.outcomes.items() if name not in (COMPLETE, SKIPPED)
        )
        try:
            with self._journal.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(done)) + "\n")
        except OSError as error:
            raise FileError(write_fault(self._journal, error)) from None
        self.emit()

    def emit(self) -> None:
        """Report the progress."""
        if self._report is None:
            return
        passed = max(time.monotonic() - self._began, 1e-9)
        rate = (self._done - self._before) / passed
        self._report(SweepProgress(self._done, self._failed, self._total, rate))


@dataclass(frozen=True, slots=True)
class Batches:
    """Settings for handing out batches.

    Attributes
    ----------
    folder : Path
        Of the sweep.
    digest : str
        Of the study.
    ahead : int
        So many are handed out before one is done.
    durable : bool
        Whether a worker waits until its batch is on the disk.
    """

    folder: Path
    digest: str
    ahead: int
    durable: bool


def _run_batches(
    batches: Batches, todo: Sequence[int], *, make: MakePool, log: ProgressLog
) -> Generator[BatchDone, None, None]:
    """Yield batches as they are written; a pool that breaks is replaced."""
    left, breaks = list(todo), 0
    while left:
        with closing_pool(make()) as pool:
            try:
                for done in submit_batches(pool, batches, left, log=log):
                    left.remove(done.number)
                    breaks = 0
                    yield done
            except BrokenExecutor as error:
                breaks += 1
                if breaks >= MAX_POOL_FAILURES:
                    message = (
                        f"worker processes were ended {breaks} times in a row ({error}); what is "
                        "written stays; look for memory running out, then run the same again"
                    )
                    raise FileError(message) from None
            except cluster_errors() as error:
                message = (
                    f"the cluster lost its workers or its scheduler ({error}); what is written "
                    "stays; run the same again once they are back"
                )
                raise FileError(message) from None


def cluster_errors() -> tuple[type[BaseException], ...]:
    """Return the exceptions that a cluster raises for a task that cannot be done any more."""
    cluster = sys.modules.get("distributed")
    return (CancelledError, cluster.KilledWorker) if cluster else (CancelledError,)


def submit_batches(
    pool: Executor, batches: Batches, todo: Sequence[int], *, log: ProgressLog
) -> Iterator[BatchDone]:
    """Hand out batches, a few more than there are workers, and yield the finished ones."""
    tasks: Tasks[BatchDone] = Tasks(pool)
    folder, digest, durable = str(batches.folder), batches.digest, batches.durable
    rest = iter(list(todo))
    while True:
        while tasks.waiting < batches.ahead and (number := next(rest, None)) is not None:
            code = digest_of_sources(THROWS)
            tasks.submit(make_batch, folder, digest, code, number, durable=durable)
        if not tasks.waiting:
            return
        done = tasks.next_done(timeout=REPORT_INTERVAL)
        if done is None:
            log.emit()
        else:
            yield done.result()


def local_pool(workers: int) -> Executor:
    """Return processes of this machine; `initialize_worker` starts their garbage collector."""
    return worker_processes(workers, gc.disable)
