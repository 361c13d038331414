"""Throw all scenarios of studies in processes of this machine or of a cluster, and lose none.

Workers write their batches themselves; only counts and times come back. What is written stays, and
the same call on the same folders does what is missing, however the last one ended.
"""

import gc
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from turnout.core.errors import FileError
from turnout.core.files import make_durable, write_fault
from turnout.core.progress import Pace, Report
from turnout.core.sources import THROWS, digest_of_sources
from turnout.core.workers import MakePool, Workers
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
from turnout.study.sweep.stored_study import serialize_study
from turnout.study.sweep.verify import verified_batches
from turnout.study.sweep.worker import BatchDone, make_batch
from turnout.throw.compilation import must_compile
from turnout.throw.simulate import compile_kernels


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


def sweep_workers(count: int, *, pool: MakePool | None = None) -> Workers:
    """Return workers for sweeps; `initialize_worker` starts the garbage collector of each."""
    return Workers(count, pool=pool, prepare=gc.disable)


@contextmanager
def running(workers: int | Workers, *, pool: MakePool | None = None) -> Iterator[Workers]:
    """Give the workers that run already, or so many for this block."""
    if isinstance(workers, Workers):
        yield workers
        return
    with sweep_workers(workers, pool=pool) as found:
        yield found


def throw_study(
    study: Study,
    folder: Path | str,
    *,
    workers: int | Workers = 1,
    pool: MakePool | None = None,
    report: Report | None = None,
) -> SweepResult:
    """Throw the missing scenarios of a study into a folder.

    Parameters
    ----------
    study : Study
        From `load_study`.
    folder : path-like
        Made if it is not there; must be empty, or hold the beginning of this sweep.
    workers : int or Workers
        Processes, or batches at a time for a pool that was given; or what is running already.
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
    place = Path(folder)
    return throw_studies({place: study}, workers=workers, pool=pool, report=report)[place]


def throw_studies(
    studies: Mapping[Path, Study],
    *,
    workers: int | Workers = 1,
    pool: MakePool | None = None,
    report: Report | None = None,
    pace: Pace | None = None,
) -> dict[Path, SweepResult]:
    """Throw the missing scenarios of several studies, each into a folder of its own.

    Parameters
    ----------
    studies : mapping of Path to Study
        By folder; a batch of each is made first, so that the time of all is known early.
    workers, pool, report
        As of `throw_study`; progress is that of all.
    pace : Pace, optional
        In place of `report`, of a run that these sweeps are a part of; folders of one name count
        as one kind of throws.

    Returns
    -------
    dict of Path to SweepResult
        By folder.
    """
    with ExitStack() as stack:
        sweeps = [
            stack.enter_context(closing(Sweep(study, folder.absolute())))
            for folder, study in studies.items()
        ]
        workers = stack.enter_context(running(workers, pool=pool))
        todo = [(sweep, number) for sweep in sweeps for number in sweep.todo[:1]]
        todo += [(sweep, number) for sweep in sweeps for number in sweep.todo[1:]]
        if todo and workers.local:
            if must_compile():
                compile_kernels()
            compile_features()
        pace = pace or Pace(report)
        for sweep in sweeps:
            expected, there = sweep.study.count, sweep.there
            pace.begin(sweep.folder.name, expected, there=there, at_once=workers.count)
        pace.emit()
        # What processes of this machine write is waited for here, while they go on.
        jobs = [sweep.job(number, durable=not workers.local) for sweep, number in todo]
        with closing(workers.run(jobs, wait=pace.emit)) as made:
            for place, done in made:
                sweep = todo[place][0]
                sweep.record(done, durable=workers.local)
                kind, cost, usual = sweep.folder.name, done.wall_time, done.usual_time
                pace.count(kind, done.count, failed=done.failed, cost=cost, usual=usual)
        for sweep in sweeps:
            clear_leftovers(sweep.folder)
        cards = [partial(write_sweep_card, sweep.folder, sweep.digest) for sweep in sweeps]
        for _ in (workers if todo else Workers(0)).run(cards, wait=pace.emit):
            pass
        results = [sweep.result for sweep in sweeps]
    return dict(zip(studies, results, strict=True))


class Sweep:
    """A sweep that is being made: its folder, locked, and the batches that are missing.

    Attributes
    ----------
    digest : str
        Of the study.
    todo : list of int
        Numbers of the batches that are missing.
    there : int
        Scenarios that are there already.
    made : list of BatchDone
        In this run.
    """

    def __init__(self, study: Study, folder: Path) -> None:
        self.study, self.folder, self.made = study, folder, list[BatchDone]()
        output_stride(study)
        text, identity = serialize_study(study), study_identity(study)
        check_folder(folder, identity)
        self._locked, self.digest = ExitStack(), identity.study
        with ExitStack() as stack:
            stack.enter_context(lock_folder(folder))
            claim_folder(folder, identity, text=text)
            clear_leftovers(folder)
            self._sizes = [sum(map(len, batch)) for batch in plan_batches(study)]
            there, torn = verified_batches(folder / BATCHES, identity.origin)
            self._refuse(there)
            self._damaged = tuple(move_damaged(path, folder) for path in torn)
            make_durable(there.values())  # a run that was ended may not have waited for all
            self._locked = stack.pop_all()
        self.todo = [number for number in range(len(self._sizes)) if number not in there]
        self.there = sum(self._sizes[number] for number in there)

    def _refuse(self, there: Mapping[int, Path]) -> None:
        """Refuse batches that the study does not have."""
        count = len(self._sizes)
        if strangers := [path.name for number, path in there.items() if number >= count]:
            message = (
                f"{self.folder / BATCHES}: {', '.join(strangers)} cannot come from this study of "
                f"{count} batches; move away what is not of it"
            )
            raise FileError(message)

    def job(self, number: int, *, durable: bool) -> Callable[[], BatchDone]:
        """Return the job of a batch, for any process."""
        code = digest_of_sources(THROWS)
        return partial(make_batch, str(self.folder), self.digest, code, number, durable=durable)

    def record(self, done: BatchDone, *, durable: bool) -> None:
        """Count a batch, and write it to the journal; `durable` waits until it is on the disk."""
        if durable:
            make_durable([self.folder / BATCHES / done.name])
        self.made.append(done)
        journal = self.folder / JOURNAL
        try:
            with journal.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(done)) + "\n")
        except OSError as error:
            raise FileError(write_fault(journal, error)) from None

    def close(self) -> None:
        """Unlock the folder."""
        self._locked.close()

    @property
    def result(self) -> SweepResult:
        """The result of this run."""
        thrown = sum(done.count for done in self.made)
        return SweepResult(thrown, tuple(self.made), self._damaged)
