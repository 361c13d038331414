"""One thread that computes, in which the last question of a kind is the one that is answered.

Sliders ask faster than a throw takes. What waits is dropped as soon as something newer of its kind
is asked; what is being computed goes on for a moment, so that a moving slider sees answers at all,
and is then stopped through the flag that the integration looks at.
"""

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TypeVar

from turnout.errors import TurnoutError

T = TypeVar("T")

# A throw that has been computed for longer than this gives way to a newer question [s].
PATIENCE = 0.5


class Superseded(Exception):  # noqa: N818 - it is no error
    """Something newer was asked before this was answered."""


@dataclass(eq=False)
class Question:
    """Whether something newer was asked, and since when this one is being computed."""

    overtaken: threading.Event = field(default_factory=threading.Event)
    began: float = float("inf")

    def hear(self, _done: int = 0, _total: int = 0) -> None:
        """Stop a run that gives way; to be handed to `simulate` as its report."""
        if self.overtaken.is_set() and time.monotonic() - self.began > PATIENCE:
            raise KeyboardInterrupt

    def stop(self) -> None:
        """Give way at once."""
        self.began = -float("inf")
        self.overtaken.set()


class Worker:
    """The thread, and the newest question of each kind."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="turnout-studio")
        self._newest: dict[str, Question] = {}
        self._open: set[Question] = set()
        self._ahead: deque[Callable[[], None]] = deque()

    async def answer(self, work: Callable[[Question], T], *, kind: str | None = None) -> T:
        """Compute an answer in the thread.

        Parameters
        ----------
        work : callable
            Takes the question and returns its answer.
        kind : str, optional
            What it replaces; None for what is to be answered whatever comes after.

        Raises
        ------
        Superseded
            When something newer of this kind came first.
        """
        question = Question()
        self._open.add(question)
        if kind is not None:
            before = self._newest.get(kind)
            if before is not None:
                before.overtaken.set()
            self._newest[kind] = question
        try:
            return await asyncio.get_running_loop().run_in_executor(
                self._thread, _worked, work, question
            )
        finally:
            self._open.discard(question)
            if kind is not None and self._newest.get(kind) is question:
                del self._newest[kind]

    def ahead(self, works: Iterable[Callable[[], None]]) -> None:
        """Do work that nobody asked for yet, a piece at a time, until the next question comes."""
        self._ahead = deque(works)
        self._next_ahead()

    def _next_ahead(self) -> None:
        with suppress(RuntimeError):  # the thread was closed
            self._thread.submit(self._one_ahead)

    def _one_ahead(self) -> None:
        if self._open:
            self._ahead.clear()
        if not self._ahead:
            return
        with suppress(IndexError, TurnoutError):  # cleared meanwhile, or it cannot be made
            self._ahead.popleft()()
        self._next_ahead()

    def close(self) -> None:
        """Stop what is computed and drop what waits, so that nobody is kept from leaving."""
        for question in list(self._open):
            question.stop()
        self._ahead.clear()
        self._thread.shutdown(wait=False)


def _worked(work: Callable[[Question], T], question: Question) -> T:
    if question.overtaken.is_set():
        raise Superseded
    question.began = time.monotonic()
    return work(question)
