"""The last question wins, no request waits for what no one wants, and no task stops the others."""

import asyncio
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.unit import answering

from turnout.core.errors import FileError
from turnout.web import process
from turnout.web.question import STOPPABLE_AFTER, Question, Reply, Superseded, Task
from turnout.web.worker import ClosedError, Worker

Asking = Callable[[Worker], Coroutine[Any, Any, Any]]
Shared = Callable[[Asking], Any]
BYTES = 500_000_000


def run(asking: Asking, *, prepare: Any = answering.prepared) -> Any:
    """Let processes start, ask them, and end them."""

    async def inner() -> Any:
        worker = Worker(prepare, memory=BYTES)
        worker.start()
        try:
            return await asking(worker)
        finally:
            worker.close()

    return asyncio.run(inner())


@pytest.fixture(scope="module")
def shared() -> Iterator[Shared]:
    """Ask one worker whatever needs none of its own; it is served by a thread."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    def ask(asking: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
        return asyncio.run_coroutine_threadsafe(asking(), loop).result(60)

    async def begun() -> Worker:
        worker = Worker(answering.prepared, memory=BYTES)
        worker.start()
        return worker

    worker = ask(begun)
    yield lambda asking: ask(lambda: asking(worker))
    loop.call_soon_threadsafe(worker.close)
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def record(reply: Reply) -> Any:
    return json.loads(reply.content)


async def both(worker: Worker) -> list[int]:
    """Wait until both processes answer; return their numbers."""
    while True:
        waits = [worker.answer(Task("wait", b"1.2")) for _ in range(2)]
        found = {record(reply)["process"] for reply in await asyncio.gather(*waits)}
        if len(found) == 2:
            return sorted(found)


def there(pid: int) -> bool:
    """Return whether a process runs; one that ended and whose code is not read yet does not."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii")
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


def gone(pids: list[int]) -> bool:
    until = time.monotonic() + 5
    while any(map(there, pids)) and time.monotonic() < until:
        time.sleep(0.02)
    return not any(map(there, pids))


@pytest.fixture(autouse=True)
def _needs_proc() -> None:
    if not Path("/proc/self/stat").exists():
        pytest.skip("no /proc to see processes in")


def test_what_waits_is_dropped_for_the_newest(shared: Shared) -> None:
    async def ask(worker: Worker) -> Any:
        await worker.answer(Task("echo"))
        tasks = []
        for number in range(5):
            asked = Task("wait", b"0.3" + b"0" * number)
            tasks.append(asyncio.create_task(worker.answer(asked, kind="live")))
            await asyncio.sleep(0 if number else 0.02)  # the others come at once
        return await asyncio.gather(*tasks, return_exceptions=True)

    first, *dropped, last = shared(ask)
    assert record(first)["content"] == "0.3", "what is computed is soon done, and is answered"
    assert [type(item) for item in dropped] == [Superseded] * 3
    assert record(last)["content"] == "0.30000"


def test_a_file_is_made_whatever_is_asked_after_it(shared: Shared) -> None:
    async def ask(worker: Worker) -> Any:
        kept = asyncio.create_task(worker.answer(Task("wait", b"0.2")))
        live = asyncio.create_task(worker.answer(Task("echo", b"throw"), kind="live"))
        return await asyncio.gather(kept, live)

    assert [record(item)["content"] for item in shared(ask)] == ["0.2", "throw"]


def test_a_long_run_gives_way(shared: Shared) -> None:
    async def ask(worker: Worker) -> Any:
        await worker.answer(Task("echo"))
        slow = asyncio.create_task(worker.answer(Task("wait", b"9"), kind="live"))
        await asyncio.sleep(0.05)
        began = time.monotonic()
        quick = asyncio.create_task(worker.answer(Task("echo", b"new"), kind="live"))
        return *await asyncio.gather(slow, quick, return_exceptions=True), time.monotonic() - began

    slow, quick, took = shared(ask)
    assert isinstance(slow, Superseded)
    assert record(quick)["content"] == "new"
    assert took < 5


def test_a_short_run_is_finished_although_something_newer_waits() -> None:
    question = Question(began=time.monotonic())
    question.overtaken.set()
    question.check(1, 2)
    question.began -= 2 * STOPPABLE_AFTER
    with pytest.raises(KeyboardInterrupt):
        question.check(1, 2)


def test_a_hanging_task_is_stopped_and_others_are_answered_meanwhile() -> None:
    async def ask(worker: Worker) -> Any:
        before = await both(worker)
        stopped = asyncio.create_task(worker.answer(Task("hang", seconds=2.0)))
        await asyncio.sleep(0.1)
        meanwhile = [await worker.answer(Task("echo", b"still here")) for _ in range(3)]
        assert not stopped.done()
        return before, await stopped, meanwhile, await both(worker)

    before, stopped, meanwhile, after = run(ask)
    assert stopped.status == 422
    assert "longer than 2 s" in record(stopped)["message"]
    assert [record(reply)["content"] for reply in meanwhile] == ["still here"] * 3
    assert len({*before, *after}) == 3, "one process was replaced"
    assert gone([*before, *after])


@pytest.mark.parametrize(
    ("name", "status", "words"),
    [
        ("crash", 500, "ended (SIGABRT)"),
        ("much", 422, "of memory, so it was stopped"),
        ("refuse", 422, "panel.toml: is a folder"),
        ("fail", 500, "ValueError); see its terminal"),
    ],
)
def test_whatever_goes_wrong_is_one_message(
    shared: Shared, name: str, status: int, words: str
) -> None:
    async def ask(worker: Worker) -> Any:
        reply = await worker.answer(Task(name))
        return reply, await worker.answer(Task("echo", b"next"))

    reply, following = shared(ask)
    assert reply.status == status
    assert words in record(reply)["message"]
    assert "anna" not in record(reply)["message"]
    assert record(following)["content"] == "next"


def test_what_a_process_knew_is_known_to_its_successor(shared: Shared) -> None:
    async def ask(worker: Worker) -> Any:
        options = {"mark": "m"}
        first = record(await worker.answer(Task("keep", b"panel", options)))["process"]
        os.kill(first, 9)
        await asyncio.sleep(0.1)
        found = record(await worker.answer(Task("know", b"", options)))
        other = await worker.answer(Task("know", b"", {"mark": "other"}))
        return first, found, other

    first, found, other = shared(ask)
    assert found["content"] == "panel"
    assert found["process"] != first
    assert (other.status, record(other)["message"]) == (422, "never heard of it")


def test_leaving_ends_what_hangs_with_all_that_it_started(tmp_path: Path) -> None:
    number = tmp_path / "pid"

    async def ask(worker: Worker) -> Any:
        pids = await both(worker)
        asked = Task("child", str(number).encode())
        waits = [asyncio.create_task(worker.answer(asked)) for _ in range(4)]
        while not number.exists() or not number.read_text():
            await asyncio.sleep(0.02)
        began = time.monotonic()
        worker.close()
        ended = await asyncio.gather(*waits, return_exceptions=True)
        return [*pids, int(number.read_text())], ended, time.monotonic() - began, worker.folder

    pids, ended, took, folder = run(ask)
    assert [type(item) for item in ended] == [ClosedError] * 4
    assert took < 2
    assert gone(pids)
    assert not folder.exists()


def test_processes_that_do_not_start_are_reported() -> None:
    async def ask(worker: Worker) -> Any:
        return await asyncio.gather(
            *(worker.answer(Task("echo")) for _ in range(2)), return_exceptions=True
        )

    for error in run(ask, prepare=answering.unprepared):
        assert isinstance(error, FileError)
        assert "does not start (OSError: nothing to compute with)" in str(error)


def test_work_ahead_is_done_and_gives_way(shared: Shared, tmp_path: Path) -> None:
    done = tmp_path / "done"

    async def ask(worker: Worker) -> None:
        await worker.answer(Task("begin", str(done).encode()))
        while not done.exists() or len(done.read_text()) < 5:
            await asyncio.sleep(0.02)

    shared(ask)
    assert done.read_text() == "xxxxx"


def test_a_process_that_has_grown_since_its_first_answers_is_replaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    megabytes = 0.0
    monkeypatch.setattr(process, "_pages", lambda: [0, round(megabytes * 1e6)])
    monkeypatch.setattr(process, "_page_size", lambda: 1)
    for first, most in ((400.0, 800.0), (1000.0, 1300.0)):
        use, megabytes = process._MemoryUse(), first
        assert not any(use.has_grown() for _ in range(process.FIRST_ANSWERS))
        megabytes = most - 1
        assert not use.has_grown()
        megabytes = most + 1
        assert use.has_grown() is (sys.platform == "linux")
