"""The last question wins; nobody waits for what no one wants any more."""

import asyncio
import threading
import time
from collections.abc import Callable
from functools import partial

import pytest

from turnout.errors import FileError
from turnout.web import worker
from turnout.web.worker import Question, Superseded, Worker


def run(coroutine_of: Callable[[Worker], object]) -> object:
    async def inner() -> object:
        desk = Worker()
        try:
            return await coroutine_of(desk)  # type: ignore[misc]
        finally:
            desk.close()

    return asyncio.run(inner())


def test_what_waits_is_dropped_for_the_newest() -> None:
    worked: list[int] = []
    hold = threading.Event()

    def work(number: int) -> Callable[[Question], int]:
        def inner(_question: Question) -> int:
            worked.append(number)
            hold.wait(5)
            return number

        return inner

    async def ask(desk: Worker) -> object:
        tasks = []
        for number in range(5):
            tasks.append(asyncio.create_task(desk.answer(work(number), kind="live")))
            await asyncio.sleep(0.02)
        hold.set()
        return await asyncio.gather(*tasks, return_exceptions=True)

    found = run(ask)
    assert worked == [0, 4]
    assert [type(item) for item in found] == [int, Superseded, Superseded, Superseded, int]  # type: ignore[attr-defined]


def test_a_file_is_made_whatever_is_asked_after_it() -> None:
    async def ask(desk: Worker) -> object:
        kept = asyncio.create_task(desk.answer(lambda _: "file"))
        live = asyncio.create_task(desk.answer(lambda _: "throw", kind="live"))
        return await asyncio.gather(kept, live)

    assert run(ask) == ["file", "throw"]


def test_a_long_run_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "PATIENCE", 0.05)

    def endless(question: Question) -> None:
        try:
            for _ in range(1000):
                time.sleep(0.01)
                question.hear()
        except KeyboardInterrupt:
            raise Superseded from None

    async def ask(desk: Worker) -> object:
        slow = asyncio.create_task(desk.answer(endless, kind="live"))
        await asyncio.sleep(0.02)
        quick = asyncio.create_task(desk.answer(lambda _: "new", kind="live"))
        return await asyncio.gather(slow, quick, return_exceptions=True)

    began = time.monotonic()
    slow, quick = run(ask)  # type: ignore[misc]
    assert isinstance(slow, Superseded)
    assert quick == "new"
    assert time.monotonic() - began < 5


def test_a_short_run_is_finished_although_something_newer_waits() -> None:
    question = Question()
    question.began = time.monotonic()
    question.overtaken.set()
    question.hear(1, 2)


def test_leaving_stops_what_is_computed_and_drops_what_waits() -> None:
    def endless(question: Question) -> None:
        try:
            for _ in range(1000):
                time.sleep(0.01)
                question.hear()
        except KeyboardInterrupt:
            raise Superseded from None

    async def ask(desk: Worker) -> object:
        tasks = [asyncio.create_task(desk.answer(endless)) for _ in range(3)]
        await asyncio.sleep(0.05)
        desk.close()
        return await asyncio.gather(*tasks, return_exceptions=True)

    began = time.monotonic()
    assert [type(item) for item in run(ask)] == [Superseded] * 3  # type: ignore[attr-defined]
    assert time.monotonic() - began < 5


def test_work_ahead_gives_way_to_a_question() -> None:
    done: list[int] = []

    def piece(number: int) -> None:
        if number == 1:
            message = "does not fit"
            raise FileError(message)
        time.sleep(0.02)
        done.append(number)

    async def until(number: int) -> None:
        while number not in done:
            await asyncio.sleep(0.005)

    async def ask(desk: Worker) -> None:
        desk.ahead([partial(piece, number) for number in range(3)])
        await until(2)
        assert done == [0, 2]
        desk.ahead([partial(piece, number) for number in range(10, 200)])
        await until(10)
        await desk.answer(lambda _: done.append(-1))
        await asyncio.sleep(0.1)
        assert done[-1] == -1, "a question ends the work ahead"
        assert 199 not in done

    run(ask)
