"""What passes between the server and the processes that compute for it."""

import json
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from turnout.errors import FileError

# The one place that says how long an answer may take and how much memory it may use.
TIME_LIMIT = 10.0
"""Of an answer [s]; counted from when a process begins with it."""
CHECK_TIME_LIMIT = 60.0
"""Of the check of a panel [s], which for the default panel takes 7 s."""
MEMORY_LIMIT = 2_000_000_000
"""Of an answer, beyond what a process takes at rest [bytes]."""

# A throw that has been computed for longer than this gives way to a newer question [s].
PATIENCE = 0.5


class Superseded(Exception):  # noqa: N818 - it is no error
    """Something newer was asked before this was answered."""


class UnknownMarkError(FileError):
    """A process does not know what a mark stands for; the server may."""

    def __init__(self, mark: str, message: str) -> None:
        super().__init__(message)
        self.mark = mark


@dataclass(eq=False)
class Question:
    """Whether something newer was asked, and since when this one is being computed."""

    overtaken: threading.Event = field(default_factory=threading.Event)
    began: float = float("inf")

    def hear(self, _done: int = 0, _total: int = 0) -> None:
        """Stop a run that gives way; to be handed to `simulate` as its report."""
        if self.overtaken.is_set() and time.monotonic() - self.began > PATIENCE:
            raise KeyboardInterrupt


@dataclass(frozen=True, slots=True)
class Task:
    """One request, as it goes to a process.

    Attributes
    ----------
    name : str
        What is asked for.
    content : bytes
        What the page sent.
    options : mapping of str to str
        From the address of the request.
    seconds : float
        So long it may take [s].
    restored : tuple of (str, bytes)
        Marks with what processes said before about them.
    """

    name: str
    content: bytes = b""
    options: Mapping[str, str] = field(default_factory=dict)
    seconds: float = TIME_LIMIT
    restored: tuple[tuple[str, bytes], ...] = ()

    def with_restored(self, mark: str, kept: bytes) -> Self:
        """Return the task with what a mark stands for."""
        return replace(self, restored=(*self.restored, (mark, kept)))


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a task.

    Attributes
    ----------
    content : bytes
        What the page gets.
    media_type : str
        Of the content.
    status : int
        Of HTTP.
    kept : tuple of (str, bytes)
        Marks and what another process needs to know what they stand for.
    needs : str
        A mark that the process does not know; empty for none.
    superseded : bool
        Whether the process gave way to a newer question.
    ahead : bool
        Whether the process could now do a piece of work that nobody asked for yet.
    exhausted : bool
        Whether the process has filled so much memory that it is better replaced.
    """

    content: bytes = b""
    media_type: str = "application/json"
    status: int = 200
    kept: tuple[tuple[str, bytes], ...] = ()
    needs: str = ""
    superseded: bool = False
    ahead: bool = False
    exhausted: bool = False

    @classmethod
    def of(cls, record: object) -> Self:
        """Return a reply that holds a record as JSON."""
        return cls(json.dumps(record, allow_nan=False).encode())

    @classmethod
    def refused(cls, message: str, *, status: int = 422, exhausted: bool = False) -> Self:
        """Return a reply that says why there is none."""
        content = json.dumps({"message": message}).encode()
        return cls(content, status=status, exhausted=exhausted)

    def packed(self) -> bytes:
        """Return the reply as bytes: a line that describes it, what is kept, the content.

        Examples
        --------
        >>> reply = Reply(b"{}", kept=(("a", b"one"),))
        >>> Reply.unpacked(reply.packed()) == reply
        True
        """
        line = {
            "media_type": self.media_type,
            "status": self.status,
            "kept": [[mark, len(given)] for mark, given in self.kept],
            "needs": self.needs,
            "superseded": self.superseded,
            "ahead": self.ahead,
            "exhausted": self.exhausted,
        }
        parts = (given for _, given in self.kept)
        return b"".join((json.dumps(line).encode(), b"\n", *parts, self.content))

    @classmethod
    def unpacked(cls, message: bytes) -> Self:
        """Return the reply that `packed` made bytes of."""
        end = message.index(b"\n")
        line = json.loads(message[:end])
        kept, at = [], end + 1
        for mark, length in line.pop("kept"):
            kept.append((mark, message[at : at + length]))
            at += length
        return cls(content=message[at:], kept=tuple(kept), **line)
