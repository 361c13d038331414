"""A studio on a free port of this machine, and a client that sends exactly what a test wants."""

import http.client
import json
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import anyio
import pytest

from turnout.panel.load import LoadedPanel
from turnout.web import app
from turnout.web.guard import LARGEST_UPLOAD
from turnout.web.serve import prepared
from turnout.web.studio import Opened, Studio

PATIENCE = 120.0
# Imported late by the server otherwise, from a thread, which Python 3.11 may trip over in pytest.
assert anyio.open_file


@dataclass(frozen=True)
class Reply:
    """What came back."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def text(self) -> str:
        return self.body.decode()

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Client:
    """Knows the address and, once it has entered, the cookie."""

    address: str
    cookie: str = ""

    @property
    def port(self) -> int:
        return urlsplit(self.address).port or 0

    def ask(
        self, path: str, body: bytes | None = None, headers: dict[str, str] | None = None
    ) -> Reply:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        try:
            sent = {"Cookie": self.cookie} if self.cookie else {}
            method = "GET" if body is None else "POST"
            connection.request(method, path, body, sent | (headers or {}))
            answer = connection.getresponse()
            found = {name.lower(): value for name, value in answer.getheaders()}
            return Reply(answer.status, found, answer.read())
        finally:
            connection.close()

    def post(self, path: str, record: dict[str, Any]) -> Reply:
        return self.ask(path, json.dumps(record).encode())

    def enter(self) -> Reply:
        """Exchange the token for the cookie, as a browser does."""
        parts = urlsplit(self.address)
        reply = self.ask(f"{parts.path}?{parts.query}")
        self.cookie = reply.headers.get("set-cookie", "").split(";")[0]
        return reply


@contextmanager
def served(
    panel: LoadedPanel, opened: Opened | None = None, *, largest: int = LARGEST_UPLOAD
) -> Iterator[Client]:
    """Serve until the block ends; the client has not entered yet.

    What is asked may take as long as the client waits: the machine may do other things too.
    """
    ready = prepared(Studio(panel, opened), largest=largest)
    thread = threading.Thread(target=ready.server.run, args=([ready.listener],), daemon=True)
    thread.start()
    try:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(app, "TIME_LIMIT", PATIENCE)
            yield Client(ready.address)
    finally:
        ready.server.should_exit = True
        thread.join(timeout=PATIENCE)
        ready.listener.close()
        frame = sys._current_frames().get(thread.ident or 0)
        at = "".join(traceback.format_stack(frame)) if frame else ""
        assert not thread.is_alive(), f"the server did not end; it is at\n{at}"
