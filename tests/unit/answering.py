"""What processes answer in tests of them: each takes a task and returns its reply."""

import os
import subprocess
import sys
import time
from collections.abc import Callable

from turnout.core.errors import FileError
from turnout.web.question import Question, Reply, Superseded, Task, UnknownMarkError


def prepared() -> Callable[[Task, Question], Reply]:
    """Return what answers a task by its name."""
    return lambda task, question: ANSWERS[task.name](task, question)


def unprepared() -> Callable[[Task, Question], Reply]:
    message = "nothing to compute with"
    raise OSError(message)


def echo(task: Task, _question: Question) -> Reply:
    return Reply.of({"content": task.content.decode(), "process": os.getpid()})


def wait(task: Task, question: Question) -> Reply:
    """Compute for so long, but give way to what is newer."""
    until = time.monotonic() + float(task.content)
    try:
        while time.monotonic() < until:
            time.sleep(0.01)
            question.check()
    except KeyboardInterrupt:
        raise Superseded from None
    return echo(task, question)


def hang(_task: Task, _question: Question) -> Reply:
    """Never come back, and let no other thread of the process run."""
    return Reply.of(len(str(9 ** (9**9) ** 9)))


def crash(_task: Task, _question: Question) -> Reply:
    os.abort()


def much(_task: Task, _question: Question) -> Reply:
    return Reply.of(len(b"\1" * 1_000_000_000))


def refuse(_task: Task, _question: Question) -> Reply:
    message = "/home/anna/secret/panel.toml: is a folder"
    raise FileError(message)


def fail(_task: Task, _question: Question) -> Reply:
    raise ValueError("/home/anna/secret")  # noqa: EM101


def child(task: Task, question: Question) -> Reply:
    """Start a process that ends late, write its number to a file, and hang."""
    late = [sys.executable, "-c", "import time; time.sleep(60)"]
    with subprocess.Popen(late) as started:
        with open(task.content.decode(), "w", encoding="ascii") as file:
            file.write(str(started.pid))
        return hang(task, question)


def keep(task: Task, question: Question) -> Reply:
    """Let a mark be known from now on."""
    known[task.options["mark"]] = task.content
    kept = ((task.options["mark"], task.content),)
    return Reply(echo(task, question).content, kept=kept)


def know(task: Task, question: Question) -> Reply:
    """Return what a mark stands for."""
    mark = task.options["mark"]
    found = known.get(mark) or dict(task.restored).get(mark)
    if found is None:
        raise UnknownMarkError(mark, "never heard of it")
    return echo(Task("echo", found), question)


def ahead(task: Task, _question: Question) -> Reply:
    """Do five pieces of work, each noted in a file."""
    with open(known["file"].decode(), "a", encoding="ascii") as file:
        file.write("x")
    known["left"] = known.get("left", b"12345")[1:]
    return Reply(ahead=bool(known["left"]))


def begin(task: Task, _question: Question) -> Reply:
    """Ask for work ahead."""
    known["file"] = task.content
    return Reply(ahead=True)


known: dict[str, bytes] = {}
ANSWERS: dict[str, Callable[[Task, Question], Reply]] = {
    item.__name__: item
    for item in (echo, wait, hang, crash, much, refuse, fail, child, keep, know, ahead, begin)
}
