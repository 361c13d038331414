"""Worker processes: fresh, quick to start, deaf to Ctrl-C, and ended with the run.

A new process loads this module before anything else, so it imports little else of turnout.
"""

import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from pathlib import Path
from queue import Empty, SimpleQueue
from types import ModuleType
from typing import Any, Generic, ParamSpec, TypeVar

from turnout.core.interrupt import held_interrupt

P = ParamSpec("P")
T = TypeVar("T")

# On some platforms a wait without a timeout does not react to Ctrl-C [s].
POLL_INTERVAL = 0.5


class _Process(SpawnProcess):
    """A fresh process that does not import the program which started it, nor meets Ctrl-C.

    The program would take time to load, or start another sweep if it is a script without a guard.
    Its linear algebra has one thread: there is a process for each core already.
    """

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:  # noqa: N802 - named by the library
        from turnout.core.lean_imports import without_blas_threads

        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            with _ctrl_c_held_back(), without_blas_threads():
                return SpawnProcess._Popen(process_obj)
        finally:
            sys.modules["__main__"] = main


@contextmanager
def _ctrl_c_held_back() -> Iterator[None]:
    """Keep Ctrl-C from this thread until the end, and for good from processes started meanwhile.

    They inherit the mask. To ignore the signal once they run would be too late: it may come while
    Python starts, which then prints a traceback.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its own start would lift the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class FreshProcesses(SpawnContext):
    """Starts such processes: the context for `multiprocessing` and `concurrent.futures`."""

    Process = _Process


def worker_processes(
    workers: int, prepare: Callable[..., object] = gc.enable, *given: object
) -> ProcessPoolExecutor:
    """Return an executor of fresh processes on this machine, which end when this one does.

    Parameters
    ----------
    workers : int
        Processes.
    prepare : callable
        Called in each process before its first task. The garbage collector is off until then; by
        default it is started.
    *given
        Arguments of `prepare`, sent once to each process.
    """
    start = partial(_start_worker, prepare, *given)
    return ProcessPoolExecutor(workers, mp_context=FreshProcesses(), initializer=start)


class Tasks(Generic[T]):
    """Tasks handed to a pool, given back as they are done.

    `concurrent.futures` locks each task in Python. Ctrl-C in the midst of that leaves it locked,
    and the pool then waits for it without end. So Ctrl-C waits until a task has been handed over,
    and what is done comes through a queue that it may interrupt.

    Parameters
    ----------
    pool : Executor
        Processes that do them.

    Attributes
    ----------
    waiting : int
        Tasks that have not been given back.
    """

    def __init__(self, pool: Executor) -> None:
        self._pool, self._done = pool, SimpleQueue[Future[T]]()
        self.waiting = 0

    def submit(self, task: Callable[P, T], /, *given: P.args, **named: P.kwargs) -> Future[T]:
        """Hand a task over."""
        with held_interrupt():
            future = self._pool.submit(task, *given, **named)
            future.add_done_callback(self._done.put)
            self.waiting += 1
        return future

    def next_done(self, *, timeout: float) -> Future[T] | None:
        """Return a task that is done, or None if there is none within a time [s]."""
        try:
            future = self._done.get(timeout=timeout)
        except Empty:
            return None
        self.waiting -= 1
        return future

    def all_done(self) -> Iterator[Future[T]]:
        """Yield all tasks as they are done."""
        while self.waiting:
            if (future := self.next_done(timeout=POLL_INTERVAL)) is not None:
                yield future


def end_pool(pool: Executor) -> None:
    """End a pool now; processes of this machine are ended with the tasks under way."""
    if not isinstance(pool, ProcessPoolExecutor):
        pool.shutdown(wait=False)
        return
    processes = list((pool._processes or {}).values())
    manager = getattr(pool, "_executor_manager_thread", None)
    results = getattr(pool, "_result_queue", None)
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(5.0)
    if results is not None:
        # A process that ended while it sent a result leaves half of it. The rest is waited for as
        # long as the pipe can be written to, and this process can write to it.
        results._writer.close()
    if manager is not None:  # which Python would wake up at its end, closed or not
        manager.join(5.0)


def limit_memory(more: int) -> None:
    """Let this process take so much more memory than it has now, if the system reports it [byte].

    Its children may each have as much in all. Linux counts what a process can write to; others do
    not report what it has.
    """
    status = Path("/proc/self/status")
    if sys.platform == "win32" or not status.exists():
        return
    import resource

    (line,) = (text for text in status.read_text().splitlines() if text.startswith("VmData:"))
    taken = 1024 * int(line.split()[1])
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = taken + more
    limit = wanted if most == resource.RLIM_INFINITY else min(wanted, most)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, most))


def _start_worker(prepare: Callable[..., object], *given: object) -> None:
    """Ignore Ctrl-C, which is for the run, and end together with the run in any case.

    To look for garbage in what is being loaded takes a tenth of the start, as does what SciPy loads
    along and no worker uses.
    """
    from turnout.core.lean_imports import import_scipy

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_with_parent, args=(parent.sentinel,), daemon=True).start()
    import_scipy()
    prepare(*given)


def _exit_with_parent(sentinel: int) -> None:
    from multiprocessing.connection import wait as wait_for

    wait_for([sentinel])
    os._exit(1)
