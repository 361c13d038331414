"""Two processes that compute, of which the last question of a kind is the one that is answered.

Sliders ask faster than a throw takes. What waits is dropped as soon as something newer of its kind
is asked; what is being computed goes on for a moment, so that a moving slider sees answers at all,
and is then stopped through the flag that the integration looks at.

What takes too long is stopped with its process, and another process is started in its place. The
second one is ready meanwhile: it answers where the first is busy for more than a moment.
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

from turnout.errors import FileError
from turnout.web.process import EndedError, Prepare, Process
from turnout.web.question import MEMORY_LIMIT, Reply, Superseded, Task

PROCESSES = 2
# A question goes to the process that answered last, unless it is busy for longer than this [s].
MOMENT = 0.5
MOST_WAITING = 200
# What processes say about marks is kept for their successors: so many, and so many bytes in all.
MOST_KEPT, MOST_KEPT_BYTES = 72, 100_000_000
MOST_FAILED_STARTS = 3
AHEAD = Task("ahead")
P = ParamSpec("P")
T = TypeVar("T")


class ClosedError(Exception):
    """The studio ends."""


@dataclass(eq=False)
class _Waiting:
    """A question that waits for a process, or has one."""

    task: Task
    turn: "asyncio.Future[Process]"
    since: float = field(default_factory=time.monotonic)
    process: Process | None = None
    number: int = 0


class Worker:
    """The processes, what waits for them, and the newest question of each kind.

    Parameters
    ----------
    prepare : callable
        Called in each process; returns what answers tasks there. It is pickled.
    memory : int
        That an answer may take [bytes].
    """

    def __init__(self, prepare: Prepare, *, memory: int = MEMORY_LIMIT) -> None:
        self._prepare, self._memory = prepare, memory
        self.folder = Path(tempfile.mkdtemp(prefix="turnout-studio-"))
        # Each process has one thread that asks it; the others overtake.
        self._threads = ThreadPoolExecutor(PROCESSES + 2, thread_name_prefix="turnout-studio")
        self._processes: list[Process] = []
        self._idle: list[Process] = []
        self._waiting: deque[_Waiting] = deque()
        self._newest: dict[str, _Waiting] = {}
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._background: set[asyncio.Task[None]] = set()
        self._last: Process | None = None
        self._failed, self._fault = 0, ""
        self._closed = False

    def start(self) -> None:
        """Start the processes, the second one when the first is ready; needs the event loop."""
        self._in_background(self._start_all())

    async def answer(self, task: Task, *, kind: str | None = None) -> Reply:
        """Compute an answer in a process.

        Parameters
        ----------
        task : Task
            What is asked.
        kind : str, optional
            What it replaces; None for what is to be answered whatever comes after.

        Raises
        ------
        Superseded
            When something newer of this kind came first.
        """
        if len(self._waiting) >= MOST_WAITING:
            text = f"{MOST_WAITING} requests wait already; wait until some of them are answered"
            return Reply.refused(text, status=503)
        asked = _Waiting(task, asyncio.get_running_loop().create_future())
        if kind is not None:
            if (before := self._newest.get(kind)) is not None:
                self._overtake(before)
            self._newest[kind] = asked
        try:
            return await self._answered(asked)
        finally:
            if kind is not None and self._newest.get(kind) is asked:
                del self._newest[kind]

    async def _answered(self, asked: _Waiting) -> Reply:
        """Wait for a turn and ask; once more where a process ended, perhaps before it was asked."""
        try:
            process, reply = await self._told(asked)
        except EndedError:
            again = _Waiting(asked.task, asyncio.get_running_loop().create_future())
            try:
                process, reply = await self._told(again)
            except EndedError as error:
                text = f"the process that computed this ended ({error}); the studio goes on"
                return Reply.refused(text, status=500)
        if reply.superseded:
            raise Superseded
        for mark, given in reply.kept:
            self._keep(mark, given)
        if reply.ahead:
            self._in_background(self._work_ahead(process))
        return reply

    async def _told(self, asked: _Waiting) -> tuple[Process, Reply]:
        """Ask a process, and tell it what only the server knows where it asks back."""
        process = await self._acquired(asked)
        task, reply = asked.task, Reply()
        try:
            while True:
                reply = await self._reply(process, asked, task)
                told = {mark for mark, _ in task.restored}
                if not reply.needs or reply.needs in told or reply.needs not in self._kept:
                    return process, reply
                task = task.with_restored(reply.needs, self._kept[reply.needs])
        finally:
            asked.process = None
            if process.alive and not reply.exhausted:
                self._release(process)
            else:
                self._replace(process)

    async def _reply(self, process: Process, asked: _Waiting, task: Task) -> Reply:
        """Ask a process, which is stopped when it takes too long."""
        loop = asyncio.get_running_loop()
        late: list[bool] = []

        def stop() -> None:
            late.append(True)
            process.kill()

        timer = loop.call_later(task.seconds, stop)
        asked.process, asked.number = process, process.number + 1
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

    async def _acquired(self, asked: _Waiting) -> Process:
        if self._closed:
            raise ClosedError
        if self._fault:
            message = f"the studio cannot compute: {self._fault}; start it again"
            raise FileError(message)
        self._waiting.append(asked)
        self._dispatch()
        asyncio.get_running_loop().call_later(MOMENT, self._dispatch)
        try:
            return await asked.turn
        except asyncio.CancelledError:
            if asked.turn.done() and not asked.turn.cancelled():
                self._release(asked.turn.result())
            raise
        finally:
            with suppress(ValueError):  # it was taken from there
                self._waiting.remove(asked)

    def _dispatch(self) -> None:
        """Give the processes that are free to those who wait, the first one first."""
        while self._waiting and self._idle:
            asked = self._waiting[0]
            if asked.turn.done():
                self._waiting.popleft()
                continue
            process = self._choice(time.monotonic() - asked.since)
            if process is None:
                return
            self._idle.remove(process)
            if not process.alive:
                self._replace(process)
                continue
            self._waiting.popleft()
            self._last = process
            asked.turn.set_result(process)

    def _choice(self, waited: float) -> Process | None:
        """Return the process that answered last, whose caches are warm; another one after all."""
        if self._last in self._idle:
            return self._last
        busy = self._last in self._processes and self._last is not None and self._last.alive
        # A timer may come a little early.
        return None if busy and waited < 0.9 * MOMENT else self._idle[0]

    def _release(self, process: Process) -> None:
        self._idle.append(process)
        self._dispatch()

    def _replace(self, process: Process) -> None:
        """Start another process in the place of one."""
        process.kill()
        if process in self._processes:
            self._processes.remove(process)
            self._in_background(self._start_one())

    def _overtake(self, asked: _Waiting) -> None:
        """Drop a question that waits, or tell its process that it is no longer wanted."""
        if not asked.turn.done():
            asked.turn.set_exception(Superseded())
        elif asked.process is not None and not self._closed:
            self._threads.submit(asked.process.overtake, asked.number)

    async def _start_all(self) -> None:
        for _ in range(PROCESSES):
            await self._start_one()

    async def _start_one(self) -> None:
        """Start a process, again where that fails, and let it answer."""
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
        for asked in self._waiting:
            if not asked.turn.done():
                asked.turn.set_exception(FileError(message))
        self._waiting.clear()

    async def _work_ahead(self, process: Process) -> None:
        """Do work that nobody asked for yet, a piece at a time, until the next question comes."""
        reply = Reply(ahead=True)
        while reply.ahead and not self._waiting and process in self._idle and process.alive:
            self._idle.remove(process)
            nobody = _Waiting(AHEAD, asyncio.get_running_loop().create_future())
            try:
                reply = await self._reply(process, nobody, AHEAD)
            except EndedError:
                reply = Reply()
            if process.alive:
                self._release(process)
            else:
                self._replace(process)

    def _keep(self, mark: str, given: bytes) -> None:
        """Keep what a mark stands for, the latest ones."""
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
        """End the processes whatever they do, so that nobody is kept from leaving."""
        self._closed = True
        for process in list(self._processes):
            process.kill()
        for asked in list(self._waiting):
            if not asked.turn.done():
                asked.turn.set_exception(ClosedError())
        self._waiting.clear()
        self._threads.shutdown(wait=False, cancel_futures=True)
        shutil.rmtree(self.folder, ignore_errors=True)


def late_message(seconds: float) -> str:
    """Return what is said of an answer that took too long."""
    return (
        f"this took longer than {seconds:g} s, so it was stopped; give less: a smaller panel, "
        "a shorter schedule, a shorter recording, plainer values"
    )
