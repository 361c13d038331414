"""Messages between the server and its worker processes."""

import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from turnout.core.errors import FileError

# Limits of a reply: time and memory.
TIME_LIMIT = 10.0
"""Of a reply [s], from when a process starts on it."""
CHECK_TIME_LIMIT = 60.0
"""Of the check of a panel [s], which for the default panel takes 10 s."""
MAP_TIME_LIMIT = 600.0
"""Of a map of objects [s], which for the default panel takes 10 s."""
MEMORY_LIMIT = 2_000_000_000
"""Of a reply, above the memory of an idle process [bytes]."""

# A throw that has run longer than this is stopped by a newer request [s].
STOPPABLE_AFTER = 0.5
# Between two reports of progress [s].
REPORT_INTERVAL = 0.2


class Superseded(Exception):  # noqa: N818 - it is no error
    """A newer request arrived before the reply."""


class UnknownMarkError(FileError):
    """The mark is unknown to the process; the server may have its content."""

    def __init__(self, mark: str, message: str) -> None:
        super().__init__(message)
        self.mark = mark


@dataclass(eq=False)
class Question:
    """State of a running request: start time, and an event by which a newer one supersedes it.

    `send` takes the share that is done to the server.
    """

    overtaken: threading.Event = field(default_factory=threading.Event)
    began: float = float("inf")
    send: Callable[[float], None] | None = None
    reported: float = 0.0

    def check(self, _done: int = 0, _total: int = 0) -> None:
        """Stop a superseded run; pass this to `simulate` as its report."""
        if self.overtaken.is_set() and time.monotonic() - self.began > STOPPABLE_AFTER:
            raise KeyboardInterrupt

    def progress(self, done: int, total: int) -> None:
        """Stop a superseded run, and report now and then the share of it that is done."""
        self.check()
        now = time.monotonic()
        if self.send is not None and total and now - self.reported > REPORT_INTERVAL:
            self.reported = now
            self.send(done / total)


@dataclass(frozen=True, slots=True)
class Task:
    """A request as it is sent to a process.

    Attributes
    ----------
    name : str
        Kind of task.
    content : bytes
        Body of the request.
    options : mapping of str to str
        From the address of the request.
    seconds : float
        Time limit [s].
    restored : tuple of (str, bytes)
        Marks with their content from earlier replies.
    job : str
        Name under which its progress can be read, and by which it can be stopped; it then runs in
        the process that the sliders do not use.
    """

    name: str
    content: bytes = b""
    options: Mapping[str, str] = field(default_factory=dict)
    seconds: float = TIME_LIMIT
    restored: tuple[tuple[str, bytes], ...] = ()
    job: str = ""

    def with_restored(self, mark: str, kept: bytes) -> Self:
        """Return the task with the content of a mark."""
        return replace(self, restored=(*self.restored, (mark, kept)))


@dataclass(frozen=True, slots=True)
class Reply:
    """The reply to a task.

    Attributes
    ----------
    content : bytes
        Body of the reply.
    media_type : str
        Media type of the content.
    status : int
        Status code of HTTP: 200, or 4xx and 5xx for refusals.
    kept : tuple of (str, bytes)
        Marks with their content, for other processes.
    needs : str
        A mark unknown to the process; empty for none.
    superseded : bool
        Whether a newer request stopped it.
    ahead : bool
        Whether the process has work to prefetch.
    exhausted : bool
        Whether the process should be replaced because of its memory.
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
        """Return a reply with an error message."""
        content = json.dumps({"message": message}).encode()
        return cls(content, status=status, exhausted=exhausted)

    def packed(self) -> bytes:
        """Return the reply as bytes: a header line, the content of marks, the content.

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
