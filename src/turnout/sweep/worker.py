"""Workers of a sweep: their processes, and what they do.

Processes for the workers of a sweep: fresh, and quick to start.

A new process loads this module before anything else, so it loads nothing of the rest by itself.

What a worker of a sweep does: throw a batch, write it, and tell how it went.
"""

import ctypes
import gc
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType
from typing import Any

from turnout.core.provenance import version
from turnout.core.sources import THROWS, digest_of_sources
from turnout.errors import FileError
from turnout.response.simulate import compile_kernels
from turnout.sweep.batch import (
    BatchOrigin,
    batch_variables,
    batches_of,
    file_bytes,
    throw_batch,
    write_batch,
)
from turnout.sweep.folder import BATCHES
from turnout.sweep.row import OUTCOMES
from turnout.sweep.stored_study import kept_study


class _Process(SpawnProcess):
    """A fresh process that does not import the program which started it.

    The program would take time to load, or start another sweep if it is a script without a guard.
    """

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:  # noqa: N802 - named by the library
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process_obj)
        finally:
            sys.modules["__main__"] = main


class _Context(SpawnContext):
    """Starts such processes."""

    Process = _Process


def worker_processes(workers: int) -> ProcessPoolExecutor:
    """Return an executor of fresh processes on this machine, which end when this one does."""
    return ProcessPoolExecutor(workers, mp_context=_Context(), initializer=_begin_worker)


def _begin_worker() -> None:
    """Be deaf to Ctrl-C, which is for the run, and end when the run does, however it ends.

    The collector begins its work once all is loaded, `turnout.sweep.worker.get_ready`: to look
    through what is being loaded takes a tenth of the start.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    from multiprocessing.connection import wait as wait_for

    wait_for([sentinel])
    os._exit(1)


# Of malloc.h in the GNU C library: the size from which on an array gets memory of its own from the
# system (32 MiB is the most that it allows), and how much may lie unused before it is given back.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
LARGEST_KEPT, MOST_KEPT = 32 << 20, 1 << 30

# So many more objects made than let go before the collector looks at them.
GC_THRESHOLD = 50_000

# A worker of a cluster may have several threads; the caches and HDF5 want one.
_one_at_a_time = threading.Lock()


@dataclass(frozen=True, slots=True)
class BatchDone:
    """What comes back of a batch.

    Attributes
    ----------
    number : int
        Of the batch.
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
    size : int
        Of the file [bytes].
    """

    number: int
    outcomes: dict[str, int]
    retried: int
    solver_time: float
    wall_time: float
    solver_processor: float
    processor: float
    build_time: float
    size: int


def make_batch(folder: str, digest: str, code: str, number: int) -> BatchDone:
    """Throw one batch and write it, in whatever process this is called.

    Parameters
    ----------
    folder : str
        Of the sweep, as seen from this process too.
    digest, code : str
        Of the study and of the sources, which must be those of this process.
    number : int
        Of the batch.

    Raises
    ------
    FileError
        When the batch cannot be written, or this process is not what the run expects.
    """
    if code != digest_of_sources(THROWS):
        message = "a worker has other sources of turnout than the run; install the same on both"
        raise FileError(message)
    with _one_at_a_time:
        get_ready()
        began, used = time.perf_counter(), time.process_time()
        place = Path(folder)
        study = kept_study(place, digest)
        rows = throw_batch(study, kept_batches(place, digest)[number])
        origin = BatchOrigin(study=digest, version=version(), code=code, batch=str(number))
        content = file_bytes(batch_variables(study, rows), origin=origin)
        write_batch(place / BATCHES, number, content)
        wall_time, processor = time.perf_counter() - began, time.process_time() - used
    counts = {name: sum(row.outcome == name for row in rows) for name in OUTCOMES}
    return BatchDone(
        number=number,
        outcomes={name: n for name, n in counts.items() if n},
        retried=sum(row.attempts > 1 for row in rows),
        solver_time=sum(row.solver.wall for row in rows),
        wall_time=wall_time,
        solver_processor=sum(row.solver.processor for row in rows),
        processor=processor,
        build_time=sum(row.solver.build for row in rows),
        size=len(content),
    )


@cache
def get_ready() -> None:
    """Load the kernels, so that no throw waits for them, and keep memory from now on.

    What is there by then stays. The collector need not look through it again, which takes as long
    as ten throws, nor soon at anything else: a throw leaves no cycles behind.
    """
    keep_memory()
    compile_kernels()
    gc.freeze()
    gc.set_threshold(GC_THRESHOLD, *gc.get_threshold()[1:])
    gc.enable()


def keep_memory() -> None:
    """Let this process keep the memory of a throw for the next one, where the C library can.

    Otherwise arrays of megabytes go back to the system with each throw, and their pages come again
    one by one, which takes a fifth of the time of a quick throw. What is kept is no more than what
    the largest throw took.
    """
    with suppress(OSError, AttributeError):
        adjust = ctypes.CDLL(None).mallopt
        adjust(M_MMAP_THRESHOLD, LARGEST_KEPT)
        adjust(M_TRIM_THRESHOLD, MOST_KEPT)


@lru_cache(maxsize=2)
def kept_batches(folder: Path, digest: str) -> list[tuple[Sequence[int], ...]]:
    """Return the chains of each batch of the study of a folder."""
    return batches_of(kept_study(folder, digest))
