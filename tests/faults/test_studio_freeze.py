"""The studio as a process: it does not grow, and leaves no process at its end."""

import json
import os
import random
import signal
import socket
import time
from collections.abc import Iterator

import pytest
from benchmarks.studies.attack.studio import Started, mark_of, started, threw
from tests.unit.served import Client
from tests.unit.test_web_worker import gone

from turnout.panel.load import library_text

HANGING = {"schedule.end": "300 s"}
"""Settings of a throw that takes much longer than any test."""
LEAVING = 2.0
"""Seconds from a signal to the end."""


@pytest.fixture
def process() -> Iterator[Started]:
    with started() as found:
        yield found


@pytest.fixture(scope="module")
def lasting() -> Iterator[Started]:
    """Return one for tests that leave it as it was, and for the last of them, which does not."""
    with started() as found:
        yield found


@pytest.mark.parametrize(
    ("number", "hangs"),
    [
        (signal.SIGTERM, True),
        pytest.param(signal.SIGTERM, False, marks=pytest.mark.long),
        pytest.param(signal.SIGINT, True, marks=pytest.mark.long),
    ],
)
def test_signals_end_it_with_all_its_processes(
    process: Started, number: signal.Signals, hangs: bool
) -> None:
    """That Ctrl-C ends one without work is a test of the commands that README shows."""
    client, mark = process.client, mark_of(process.client)
    assert threw(client, mark, size=5).status == 200
    record = {"panel": mark, "settings": HANGING}
    path = "/api/run" if hangs else "/api/panel/concerns"
    body = record if hangs else {"panel": mark}
    with socket.create_connection(("127.0.0.1", client.port), timeout=20) as raw:
        content = json.dumps(body).encode()
        head = (
            f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\nCookie: {client.cookie}\r\n"
            f"Content-Length: {len(content)}\r\n\r\n"
        )
        raw.sendall(head.encode() + content)
        time.sleep(0.7)
        processes = process.processes()
        assert len(processes) >= 2, "the server and a process that computes"
        began = time.monotonic()
        process.server.send_signal(number)
        process.server.wait(timeout=20)
    assert time.monotonic() - began < LEAVING
    assert gone(processes)


def test_a_process_that_is_killed_is_replaced_and_nothing_is_forgotten(lasting: Started) -> None:
    client = lasting.client
    text = library_text("sb1").replace('name = "sb1"', 'name = "mine"')
    mark = client.ask("/api/panel/send?name=mine.toml", text.encode()).json["mark"]
    for pid in lasting.computing():
        os.kill(pid, signal.SIGKILL)
    assert threw(client, mark, size=6).status == 200
    assert lasting.server.poll() is None


def test_the_memory_does_not_grow_with_throws(lasting: Started) -> None:
    """Previews only, which take a tenth of a second; the whole use is in the long test."""
    client, before = lasting.client, 0.0
    mark = mark_of(client)
    for number in range(60):
        assert threw(client, mark, size=3 + 0.1 * number).status == 200
        if number == 20:
            before = lasting.memory()
    assert lasting.memory() < 1.2 * before


def test_a_server_that_is_killed_leaves_no_process(lasting: Started) -> None:
    client = lasting.client
    assert threw(client, mark_of(client), size=5).status == 200
    processes = lasting.processes()
    lasting.server.kill()
    lasting.server.wait(timeout=20)
    assert gone(processes)


@pytest.mark.long
@pytest.mark.parametrize(("early", "late"), [(50, 150), (50, 1000)])
def test_the_memory_does_not_grow_with_use(process: Started, early: int, late: int) -> None:
    """The server and its processes; figures of 1,000 requests: docs/evidence/robustness.md."""
    client, random_numbers = process.client, random.Random(17)
    mark, before = mark_of(client), 0.0
    for number in range(1, late + 1):
        used(client, mark, random_numbers, number)
        if number == early:
            before = process.memory()
    assert process.memory() < 1.2 * before


def used(client: Client, mark: str, random_numbers: random.Random, number: int) -> None:
    """Ask as a user does: mostly throws, now and then a file, a panel or a recording."""
    size, x = random_numbers.uniform(3, 12), random_numbers.uniform(2, 9)
    kind = random_numbers.random()
    run = {
        "panel": mark,
        "object": {"size": f"{size:.3f} mm", "at": f"x = {x:.3f} m"},
        "settings": {"chair.friction_coefficient": round(random_numbers.uniform(0.1, 0.4), 3)},
        "preview": kind < 0.6,
    }
    if kind < 0.8:
        reply = client.post("/api/run", run)
    elif kind < 0.86:
        reply = client.post(
            f"/api/file/{random_numbers.choice(['nc', 'csv', 'svg'])}", {"run": run}
        )
    elif kind < 0.93:
        text = library_text("sb1").replace('"sb1"', f'"p{number}"')
        reply = client.ask(f"/api/panel/send?name=p{number}.toml", text.encode())
    else:
        rows = "".join(f"{0.01 * row:.2f},{row % 7}\n" for row in range(5000))
        reply = client.ask("/api/recording?name=a.csv", f"Time (s),a (V)\n{rows}".encode())
    assert reply.status == 200, reply.text
