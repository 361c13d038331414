"""Work of a worker of a sweep: throw a batch, write it, report times and outcomes."""

import ctypes
import gc
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from turnout.core.errors import FileError
from turnout.core.provenance import version
from turnout.core.sources import THROWS, digest_of_sources
from turnout.metric.features import load_features
from turnout.study.sweep.batch import (
    BatchOrigin,
    batch_variables,
    plan_batches,
    throw_batch,
    write_batch,
)
from turnout.study.sweep.batch_bytes import file_bytes
from turnout.study.sweep.folder import BATCHES
from turnout.study.sweep.row import OUTCOMES, UNUSABLE
from turnout.study.sweep.stored_study import MOST_STUDIES, load_stored_study
from turnout.throw.simulate import compile_kernels

# Of malloc.h in the GNU C library: the size from which on an array gets memory of its own from the
# system (32 MiB is the most that it allows), and how much may lie unused before it is given back.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
MMAP_THRESHOLD, TRIM_THRESHOLD = 32 << 20, 1 << 30

# So many more objects made than let go before the collector looks at them.
GC_THRESHOLD = 50_000

UNUSUAL = 3.0
"""Times the median of a batch that a throw may take the solver before it counts as unusual."""
MOST_FAULTS = 3
"""Scenarios without results of which a batch says why."""

# A worker of a cluster may have several threads; the caches and HDF5 want one.
_batch_lock = threading.Lock()


@dataclass(frozen=True, slots=True)
class BatchDone:
    """Report on a finished batch.

    Attributes
    ----------
    number : int
        Of the batch.
    name : str
        Of its file.
    outcomes : dict of str to int
        Scenarios by how they ended.
    retried : int
        Scenarios that took a second attempt.
    solver_time, wall_time : float
        Spent in building and integrating, and on the whole batch [s].
    solver_processor, processor : float
        The same as processor time [s].
    build_time : float
        The part of the solver's time in which mechanisms were built [s].
    usual_time : float
        The time on the whole batch if no throw had taken the solver more than `UNUSUAL` times as
        long as the median, as the first ones of a process do, which reduce rails [s].
    size : int
        Of the file [bytes].
    faults : tuple of str
        Why the first of the scenarios without results have none.
    """

    number: int
    name: str
    outcomes: dict[str, int]
    retried: int
    solver_time: float
    wall_time: float
    solver_processor: float
    processor: float
    build_time: float
    usual_time: float
    size: int
    faults: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Scenarios in all."""
        return sum(self.outcomes.values())

    @property
    def failed(self) -> int:
        """Scenarios that were to be thrown and gave no numbers."""
        return sum(self.outcomes.get(name, 0) for name in UNUSABLE)


def make_batch(
    folder: str, digest: str, code: str, number: int, *, durable: bool = True
) -> BatchDone:
    """Throw one batch and write it, in whatever process this is called.

    Parameters
    ----------
    folder : str
        Of the sweep, as seen from this process too.
    digest, code : str
        Of the study and of the sources, which must be those of this process.
    number : int
        Of the batch.
    durable : bool
        Whether to wait until its file is on the disk; else the caller does.

    Raises
    ------
    FileError
        When the batch cannot be written, or this process is not what the run expects.
    """
    if code != digest_of_sources(THROWS):
        message = (
            "a worker has other sources of turnout than the run: they were changed while it ran; "
            "run the same command again, on other machines with the same sources"
        )
        raise FileError(message)
    with _batch_lock:
        initialize_worker()
        place = Path(folder)
        study, chains = load_stored_study(place, digest), cached_batches(place, digest)[number]
        began, used = time.perf_counter(), time.process_time()
        rows = throw_batch(study, chains)
        origin = BatchOrigin(study=digest, version=version(), code=code, batch=str(number))
        content = file_bytes(batch_variables(study, rows), origin=origin)
        path = write_batch(place / BATCHES, number, content, durable=durable)
        wall_time, processor = time.perf_counter() - began, time.process_time() - used
    counts = {name: sum(row.outcome == name for row in rows) for name in OUTCOMES}
    solver = [row.solver.wall for row in rows]
    return BatchDone(
        number=number,
        name=path.name,
        outcomes={name: n for name, n in counts.items() if n},
        retried=sum(row.attempts > 1 for row in rows),
        solver_time=sum(solver),
        wall_time=wall_time,
        solver_processor=sum(row.solver.processor for row in rows),
        processor=processor,
        build_time=sum(row.solver.build for row in rows),
        usual_time=wall_time - beyond_usual(solver),
        size=len(content),
        faults=tuple(
            f"scenario {row.scenario.index} ({row.scenario.name}): {row.reason}"
            for row in rows
            if row.outcome in UNUSABLE
        )[:MOST_FAULTS],
    )


def beyond_usual(times: Sequence[float]) -> float:
    """Return by how much some times that are unusual are beyond the median, together [s].

    Examples
    --------
    >>> beyond_usual([1.0, 2.0, 2.0, 5.0, 30.0])
    28.0
    """
    usual = float(np.median(times)) if times else 0.0
    return sum(one - usual for one in times if one > UNUSUAL * usual)


@cache
def initialize_worker() -> None:
    """Load the kernels, so that no throw waits for them, and keep memory from now on.

    What is there by then stays. The collector need not look through it again, which takes as long
    as ten throws, nor soon at anything else: a throw leaves no cycles behind.
    """
    retain_freed_memory()
    compile_kernels()
    load_features()
    gc.freeze()
    gc.set_threshold(GC_THRESHOLD, *gc.get_threshold()[1:])
    gc.enable()


def retain_freed_memory() -> None:
    """Let this process keep the memory of a throw for the next one, if the C library can.

    Otherwise arrays of megabytes go back to the system with each throw, and their pages come again
    one by one, which takes a fifth of the time of a quick throw. What is kept is no more than what
    the largest throw took.
    """
    with suppress(OSError, AttributeError):
        adjust = ctypes.CDLL(None).mallopt
        adjust(M_MMAP_THRESHOLD, MMAP_THRESHOLD)
        adjust(M_TRIM_THRESHOLD, TRIM_THRESHOLD)


@lru_cache(maxsize=MOST_STUDIES)
def cached_batches(folder: Path, digest: str) -> list[tuple[Sequence[int], ...]]:
    """Return the chains of each batch of the study of a folder."""
    return plan_batches(load_stored_study(folder, digest))
