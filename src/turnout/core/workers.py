"""The one runner of many jobs: here, in processes of this machine, or on a cluster.

Jobs write their results themselves, or are written as they come back, so that a run that is ended
loses those under way alone. Processes start with the first job, serve any number of runs one after
another, and end with the block. A pool whose processes are ended from outside is replaced.
"""

import gc
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from types import TracebackType
from typing import Self, TypeVar

from turnout.core.errors import FileError
from turnout.core.processes import Tasks, end_pool, worker_processes

T = TypeVar("T")
MakePool = Callable[[], Executor]
Job = Callable[[], T]

PREFETCH = 2
"""Jobs handed out beyond one a worker, so that none waits for the next."""
MAX_POOL_FAILURES = 3
"""Breaks of the pool in a row without a result in between after which a run gives up."""
REPORT_INTERVAL = 0.5
"""Longest time between two calls of what waits for results [s]."""


class Workers:
    """Pool that does jobs; use as a context manager.

    Parameters
    ----------
    count : int
        Processes, or jobs at a time of a pool that was given; 0 does all jobs in this process.
    pool : callable, optional
        Makes the executor that jobs are handed to; default processes of this machine.
    prepare : callable
        Called in each process of this machine before its first job.
    *given
        Arguments of `prepare`, sent once to each process.

    Examples
    --------
    >>> from functools import partial
    >>> with Workers(0) as workers:
    ...     list(workers.run([partial(abs, -1), partial(abs, -2)]))
    [(0, 1), (1, 2)]
    """

    def __init__(
        self,
        count: int = 1,
        *given: object,
        pool: MakePool | None = None,
        prepare: Callable[..., object] = gc.enable,
    ) -> None:
        self.count = count
        self._make: MakePool = pool or (lambda: worker_processes(count, prepare, *given))
        self._pool: Executor | None = None
        self.local = pool is None

    def __enter__(self) -> Self:
        """Start nothing yet."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the processes; on an error or Ctrl-C do not wait for the jobs under way."""
        if error is not None:
            self._end()
        elif self._pool is not None:
            self._pool.shutdown(wait=True)
            self._pool = None

    @property
    def idle(self) -> bool:
        """True if there are no processes, or none yet."""
        return self._pool is None

    def start(self, job: Job[object]) -> None:
        """Start all processes now, each with a job, so that they load while this one goes on."""
        if self.count > 0:
            tasks = Tasks[object](self._started())
            for _ in range(self.count):
                tasks.submit(job)

    def run(
        self, jobs: Sequence[Job[T]], *, wait: Callable[[], None] = lambda: None
    ) -> Generator[tuple[int, T], None, None]:
        """Yield the number and the result of each job as it is done.

        Parameters
        ----------
        jobs : sequence of callable
            Without arguments; those for processes can be pickled. In this process they are done in
            their order.
        wait : callable
            Called at least every `REPORT_INTERVAL` while nothing comes.

        Raises
        ------
        FileError
            When processes or a cluster are lost again and again.
        """
        if self.count < 1:
            for number, job in enumerate(jobs):
                yield number, job()
            return
        left, breaks = dict(enumerate(jobs)), 0
        while left:
            try:
                for number, result in self._handed_out(dict(left), wait):
                    del left[number]
                    breaks = 0
                    yield number, result
            except BrokenExecutor as error:
                self._end()
                breaks += 1
                if breaks >= MAX_POOL_FAILURES:
                    message = (
                        f"worker processes were ended {breaks} times in a row ({error}), often "
                        "because memory ran out; what is done is kept: run the same command to "
                        "continue, with fewer --workers"
                    )
                    raise FileError(message) from None
            except _cluster_errors() as error:
                message = (
                    f"the cluster lost its workers or its scheduler ({error}); what is done is "
                    "kept; run the same again once they are back"
                )
                raise FileError(message) from None

    def _handed_out(
        self, jobs: dict[int, Job[T]], wait: Callable[[], None]
    ) -> Iterator[tuple[int, T]]:
        """Hand out jobs, a few more than there are workers, and yield what is done."""
        tasks, numbers = Tasks[T](self._started()), dict[Future[T], int]()
        rest = iter(jobs.items())
        while True:
            while tasks.waiting < self.count + PREFETCH and (item := next(rest, None)) is not None:
                numbers[tasks.submit(item[1])] = item[0]
            if not tasks.waiting:
                return
            done = tasks.next_done(timeout=REPORT_INTERVAL)
            if done is None:
                wait()
            else:
                yield numbers.pop(done), done.result()

    def _started(self) -> Executor:
        if self._pool is None:
            self._pool = self._make()
        return self._pool

    def _end(self) -> None:
        pool, self._pool = self._pool, None
        if pool is not None:
            end_pool(pool)


def _cluster_errors() -> tuple[type[BaseException], ...]:
    """Return the exceptions that a cluster raises for a task that cannot be done any more."""
    cluster = sys.modules.get("distributed")
    return (CancelledError, cluster.KilledWorker) if cluster else (CancelledError,)
