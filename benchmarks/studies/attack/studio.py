"""Hostile requests to a studio in a process of its own, which must refuse or answer each of them.

A fault is a request without a reply, one that takes longer than the limits say, a reply that the
studio failed, one that shows a file or a folder of this machine, and a studio that does not answer
an ordinary request afterwards.
"""

import http.client
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.unit.campaigns import copied
from tests.unit.served import Client, Reply

from benchmarks.studies.attack.requests import KINDS, Request, hostile_request
from turnout.web.question import CHECK_TIME_LIMIT, TIME_LIMIT

# For a machine that does other things too [s].
SLACK = 15.0
MEMORY_EVERY = 10
SECRET = "root:first-line-of-a-protected-file"


@dataclass
class Started:
    """A studio in a process, and a client that has entered."""

    server: "subprocess.Popen[str]"
    client: Client

    def processes(self) -> list[int]:
        """Return the numbers of the server and of all that it has started."""
        return list(_family(self.server.pid))

    def computing(self) -> list[int]:
        """Return the numbers of the processes that compute."""
        return [pid for pid in self.processes()[1:] if b"spawn_main" in _command(pid)]

    def memory(self) -> float:
        """Return the memory of all processes, shared pages counted once [MB]."""
        return sum(map(_memory, self.processes()))


@contextmanager
def started(*arguments: str) -> Iterator[Started]:
    """Start `turnout studio` and enter it; it ends with the block."""
    command = [sys.executable, "-m", "turnout", "studio", "--no-browser", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            client = Client(server.stdout.readline().split()[-1])
            until = time.monotonic() + 30
            while client.enter().status != 303:
                assert time.monotonic() < until
            yield Started(server, client)
        finally:
            if server.poll() is None:
                server.send_signal(signal.SIGTERM)
            try:
                server.wait(timeout=10)
            except subprocess.TimeoutExpired:
                server.kill()


def mark_of(client: Client) -> str:
    """Return the mark of the panel that the studio was started with."""
    return str(client.ask("/api/start").json["panel"]["mark"])


def threw(client: Client, mark: str, *, size: float) -> Reply:
    """Ask for a throw with an object of a size [mm]."""
    trapped = {"size": f"{size:g} mm", "at": "sleeper 6"}
    return client.post("/api/run", {"panel": mark, "object": trapped, "preview": True})


@contextmanager
def attacking(seed: int) -> Iterator[Callable[[int], dict[str, Any]]]:
    """Start a studio with a campaign, again if it ends; provide a function that attacks it."""
    with tempfile.TemporaryDirectory() as folder:
        secret = Path(folder) / "secret.csv"
        secret.write_text(SECRET + "\n", encoding="utf-8")
        campaign = copied(Path(folder))
        running: list[Started] = []
        contexts: list[Any] = []

        def begin() -> Started:
            contexts.append(started("--panel", "sb1", "--campaign", str(campaign)))
            running.append(contexts[-1].__enter__())
            return running[-1]

        memory = 0.0
        begin()
        mark = mark_of(running[-1].client)

        def attempt(index: int) -> dict[str, Any]:
            nonlocal memory
            if running[-1].server.poll() is not None:
                begin()
            source = random.Random(f"{seed}-{index}")
            kind = KINDS[index % len(KINDS)]
            request = hostile_request(kind, source, mark=mark, secret=secret)
            record = _judged(running[-1], request, mark, folder)
            if index % MEMORY_EVERY == 0:
                memory = running[-1].memory()
            return {"index": index, "kind": kind, "memory": round(memory), **record}

        try:
            yield attempt
        finally:
            for context in contexts:
                context.__exit__(None, None, None)


def _judged(studio: Started, request: Request, mark: str, folder: str) -> dict[str, Any]:
    began = time.monotonic()
    limit = SLACK + (CHECK_TIME_LIMIT if request.path.endswith("concerns") else TIME_LIMIT)
    text, status = "", 0
    try:
        status, body = request.send(studio.client, timeout=limit)
        seconds = time.monotonic() - began
        private = (folder, str(Path.home()) + "/", "Traceback")
        # What was sent is no secret.
        shown = [word for word in private if word in body and word not in request.sent()]
        if status >= 500 and status != 503:
            text = f"status {status}: {body[:300]}"
        elif shown and status >= 400:
            text = f"shows {shown}: {body[:300]}"
        elif SECRET in body:
            text = "shows the protected file"
    except (OSError, http.client.HTTPException) as error:
        seconds = time.monotonic() - began
        # A connection that the server ends is a refusal of what is not HTTP.
        text = "" if request.raw and seconds < limit - 1 else f"{type(error).__name__}: {error}"
        status = 400
    if not text and (fault := _not_alive(studio, mark, request)):
        text = fault
    outcome = "fault" if text else "answered" if status < 400 else "refused"
    found = {"outcome": outcome, "status": status, "seconds": round(seconds, 3)}
    return found | ({"text": f"{request.described()}: {text}"} if text else {})


def _not_alive(studio: Started, mark: str, request: Request) -> str:
    """Return the fault of the studio after a request; a throw is asked after every tenth."""
    try:
        if studio.client.ask("/api/start").status != 200:
            return "the studio does not answer any more"
        if request.number % 10 == 0:
            reply = threw(studio.client, mark, size=5 + request.number % 7)
            if reply.status != 200:
                return f"a throw is not answered any more: {reply.text[:200]}"
    except (OSError, http.client.HTTPException) as error:
        return f"the studio is gone: {type(error).__name__}: {error}"
    return ""


def _family(pid: int) -> Iterator[int]:
    yield pid
    try:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            for child in (thread / "children").read_text(encoding="ascii").split():
                yield from _family(int(child))
    except OSError:
        return


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def _memory(pid: int) -> float:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024
