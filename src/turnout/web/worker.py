"""Two worker processes; a newer request of a kind supersedes the older one.

Sliders send requests faster than a throw takes. A queued request is dropped as soon as a newer one
of its kind arrives; a running one continues for a moment, so that a moving slider shows results,
and is then stopped through the flag that the integration checks.

A request beyond its time limit is stopped with its process, which is replaced. Meanwhile the second
process takes requests if the first is busy for more than a moment.
"""

import asyncio
import shutil
import tempfile
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from turnout.core.errors import FileError
from turnout.web.process import EndedError, Prepare, Process
from turnout.web.question import MEMORY_LIMIT, Reply, Superseded, Task

PROCESSES = 2
# A request goes to the process used last, unless that is busy for longer than this [s].
BUSY_LIMIT = 0.5
MOST_WAITING = 200
# Content of marks stored for replacement processes: number, and bytes in total.
MOST_KEPT, MOST_KEPT_BYTES = 72, 100_000_000
MOST_FAILED_STARTS = 3
PREFETCH = Task("ahead")
P = ParamSpec("P")
T = TypeVar("T")


class ClosedError(Exception):
    """The studio is shutting down."""


@dataclass(eq=False)
class _Waiting:
    """A request that is queued or running."""

    task: Task
    turn: "asyncio.Future[Process]"
    since: float = field(default_factory=time.monotonic)
    process: Process | None = None
    number: int = 0


class Worker:
    """The processes, the queue, and the newest request of each kind.

    Parameters
    ----------
    prepare : callable
        Called in each process, returns its task handler; pickled.
    memory : int
        Limit of a reply [bytes].
    """

    def __init__(self, prepare: Prepare, *, memory: int = MEMORY_LIMIT) -> None:
        self._prepare, self._memory = prepare, memory
        self.folder = Path(tempfile.mkdtemp(prefix="turnout-studio-"))
        # One thread per process sends tasks; the others send stop signals.
        self._threads = ThreadPoolExecutor(PROCESSES + 2, thread_name_prefix="turnout-studio")
        self._processes: list[Process] = []
        self._idle: list[Process] = []
        self._waiting: deque[_Waiting] = deque()
        self._newest: dict[str, _Waiting] = {}
        self._jobs: dict[str, _Waiting] = {}
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._background: set[asyncio.Task[None]] = set()
        self._last: Process | None = None
        self._failed, self._fault = 0, ""
        self._closed = False

    def start(self) -> None:
        """Start the processes, the second one when the first is ready; needs the event loop."""
        self._in_background(self._start_all())

    async def answer(self, task: Task, *, kind: str | None = None) -> Reply:
        """Compute a reply in a process.

        Parameters
        ----------
        task : Task
            The request.
        kind : str, optional
            Kind that it supersedes; None if nothing supersedes it.

        Raises
        ------
        Superseded
            When a newer request of this kind arrived first.
        """
        if len(self._waiting) >= MOST_WAITING:
            text = f"{MOST_WAITING} requests are queued already; try again later"
            return Reply.refused(text, status=503)
        request = _Waiting(task, asyncio.get_running_loop().create_future())
        if task.job:
            self._jobs[task.job] = request
        if kind is not None:
            if (before := self._newest.get(kind)) is not None:
                self._overtake(before)
            self._newest[kind] = request
        try:
            return await self._answered(request)
        finally:
            if kind is not None and self._newest.get(kind) is request:
                del self._newest[kind]
            if self._jobs.get(task.job) is request:
                del self._jobs[task.job]

    def share(self, job: str) -> float | None:
        """Return the share of a job that is done; None if none of that name is at work."""
        request = self._jobs.get(job)
        if request is None:
            return None
        return 0.0 if request.process is None else request.process.share

    def stop(self, job: str) -> None:
        """Stop a job, which then ends as superseded."""
        if (request := self._jobs.get(job)) is not None:
            self._overtake(request)

    async def _answered(self, request: _Waiting) -> Reply:
        """Wait for a process and send; retry once if the process ended."""
        try:
            process, reply = await self._exchange(request)
        except EndedError:
            again = _Waiting(request.task, asyncio.get_running_loop().create_future())
            try:
                process, reply = await self._exchange(again)
            except EndedError as error:
                text = f"the worker process ended ({error}); the studio continues"
                return Reply.refused(text, status=500)
        if reply.superseded:
            raise Superseded
        for mark, given in reply.kept:
            self._keep(mark, given)
        if reply.ahead:
            self._in_background(self._work_ahead(process))
        return reply

    async def _exchange(self, request: _Waiting) -> tuple[Process, Reply]:
        """Send a task; resend it with the content of marks that the process lacks."""
        process = await self._acquired(request)
        task, reply = request.task, Reply()
        try:
            while True:
                reply = await self._reply(process, request, task)
                sent = {mark for mark, _ in task.restored}
                if not reply.needs or reply.needs in sent or reply.needs not in self._kept:
                    return process, reply
                task = task.with_restored(reply.needs, self._kept[reply.needs])
        finally:
            request.process = None
            if process.alive and not reply.exhausted:
                self._release(process)
            else:
                self._replace(process)

    async def _reply(self, process: Process, request: _Waiting, task: Task) -> Reply:
        """Send a task and stop the process at the time limit."""
        loop = asyncio.get_running_loop()
        late: list[bool] = []

        def stop() -> None:
            late.append(True)
            process.kill()

        timer = loop.call_later(task.seconds, stop)
        request.process, request.number = process, process.number + 1
        try:
            return await self._in_thread(process.ask, task)
        except EndedError:
            if self._closed:
                raise ClosedError from None
            if late:
                return Reply.refused(late_message(task.seconds))
            raise
        except asyncio.CancelledError:
            process.kill()
            raise
        finally:
            timer.cancel()

    async def _acquired(self, request: _Waiting) -> Process:
        if self._closed:
            raise ClosedError
        if self._fault:
            message = f"the studio cannot compute: {self._fault}; start it again"
            raise FileError(message)
        self._waiting.append(request)
        self._dispatch()
        asyncio.get_running_loop().call_later(BUSY_LIMIT, self._dispatch)
        try:
            return await request.turn
        except asyncio.CancelledError:
            if request.turn.done() and not request.turn.cancelled():
                self._release(request.turn.result())
            raise
        finally:
            with suppress(ValueError):  # it was taken from there
                self._waiting.remove(request)

    def _dispatch(self) -> None:
        """Assign free processes to queued requests, oldest first."""
        while self._waiting and self._idle:
            request = self._waiting[0]
            if request.turn.done():
                self._waiting.popleft()
                continue
            process = self._choice(time.monotonic() - request.since, request.task)
            if process is None:
                return
            self._idle.remove(process)
            if not process.alive:
                self._replace(process)
                continue
            self._waiting.popleft()
            if not request.task.job or self._last is None:
                self._last = process
            request.turn.set_result(process)

    def _choice(self, waited: float, task: Task) -> Process | None:
        """Return the process that answered last, whose caches are warm; another one after all.

        A job takes another one first, so that sliders keep theirs.
        """
        if task.job:
            others = [process for process in self._idle if process is not self._last]
            return others[0] if others else None if waited < 0.9 * BUSY_LIMIT else self._idle[0]
        if self._last in self._idle:
            return self._last
        busy = self._last in self._processes and self._last is not None and self._last.alive
        # A timer may come a little early.
        return None if busy and waited < 0.9 * BUSY_LIMIT else self._idle[0]

    def _release(self, process: Process) -> None:
        self._idle.append(process)
        self._dispatch()

    def _replace(self, process: Process) -> None:
        """Start another process in the place of one."""
        process.kill()
        if process in self._processes:
            self._processes.remove(process)
            self._in_background(self._start_one())

    def _overtake(self, request: _Waiting) -> None:
        """Drop a queued request, or signal its process to stop."""
        if not request.turn.done():
            request.turn.set_exception(Superseded())
        elif request.process is not None and not self._closed:
            self._threads.submit(request.process.overtake, request.number)

    async def _start_all(self) -> None:
        for _ in range(PROCESSES):
            await self._start_one()

    async def _start_one(self) -> None:
        """Start a process, again if that fails, and let it answer."""
        while not self._closed and not self._fault:
            process = Process(self._prepare, str(self.folder), self._memory)
            self._processes.append(process)
            try:
                await self._in_thread(process.start)
            except (EndedError, OSError) as error:
                self._processes.remove(process)
                self._failed += 1
                if self._failed >= MOST_FAILED_STARTS:
                    self._fail(f"its process does not start ({error})")
                continue
            self._failed = 0
            self._release(process)
            return

    def _fail(self, fault: str) -> None:
        self._fault = fault
        message = f"the studio cannot compute: {fault}; start it again"
        for request in self._waiting:
            if not request.turn.done():
                request.turn.set_exception(FileError(message))
        self._waiting.clear()

    async def _work_ahead(self, process: Process) -> None:
        """Prefetch piece by piece until the next request arrives."""
        reply = Reply(ahead=True)
        while reply.ahead and not self._waiting and process in self._idle and process.alive:
            self._idle.remove(process)
            prefetch = _Waiting(PREFETCH, asyncio.get_running_loop().create_future())
            try:
                reply = await self._reply(process, prefetch, PREFETCH)
            except EndedError:
                reply = Reply()
            if process.alive:
                self._release(process)
            else:
                self._replace(process)

    def _keep(self, mark: str, given: bytes) -> None:
        """Store the content of a mark; the oldest ones are dropped."""
        self._kept.pop(mark, None)
        self._kept[mark] = given
        while len(self._kept) > MOST_KEPT or sum(map(len, self._kept.values())) > MOST_KEPT_BYTES:
            if len(self._kept) == 1:
                return
            self._kept.popitem(last=False)

    async def _in_thread(self, work: Callable[P, T], *arguments: P.args, **_: P.kwargs) -> T:
        try:
            running = asyncio.get_running_loop().run_in_executor(self._threads, work, *arguments)
        except RuntimeError:  # the threads were shut down
            raise ClosedError from None
        return await running

    def _in_background(self, work: "Coroutine[Any, Any, None]") -> None:
        async def until_closed() -> None:
            with suppress(ClosedError):
                await work

        if self._closed:
            work.close()
            return
        task = asyncio.get_running_loop().create_task(until_closed())
        self._background.add(task)
        task.add_done_callback(self._background.discard)

    def close(self) -> None:
        """Kill the processes, so that the studio ends at once."""
        self._closed = True
        for process in list(self._processes):
            process.kill()
        for request in list(self._waiting):
            if not request.turn.done():
                request.turn.set_exception(ClosedError())
        self._waiting.clear()
        self._threads.shutdown(wait=False, cancel_futures=True)
        shutil.rmtree(self.folder, ignore_errors=True)


def late_message(seconds: float) -> str:
    """Return the message about a request beyond its time limit."""
    return (
        f"this took longer than {seconds:g} s, so it was stopped; send less: a smaller panel, "
        "a shorter schedule, a shorter recording, simpler values"
    )
