"""The studio cannot be made to hang, to grow, to outlive its end, or to read files for the page."""

import json
import os
import random
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import h5py
import numpy as np
import pytest
from tests.attack.studio import Started, started, threw
from tests.unit.served import Client, served
from tests.unit.simulated import sb2_panel
from tests.unit.test_web_worker import gone

from turnout.panel.load import library_text
from turnout.web import app
from turnout.web.guard import LARGEST_UPLOAD
from turnout.web.process import without_folders
from turnout.web.serve import prepared
from turnout.web.studio import Studio

HANGING = {"schedule.end": "300 s"}
"""Settings of a throw that takes much longer than `SHORT`."""
POWERS = "1 N/m*9^9^9^9"
SECRET = "root:first-line-of-a-protected-file"
LEAVING = 2.0
"""Seconds from a signal to the end."""
SHORT = 3.0
"""Instead of the limit that a user has [s]."""


@pytest.fixture(scope="module")
def studio() -> Iterator[Client]:
    with served(sb2_panel()) as client:
        client.enter()
        yield client


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    file = tmp_path / "secret.csv"
    file.write_text(f"{SECRET}\n1,2\n", encoding="utf-8")
    return file


@pytest.fixture
def process() -> Iterator[Started]:
    with started() as found:
        yield found


@pytest.fixture(scope="module")
def lasting() -> Iterator[Started]:
    """One for tests that leave it as it was."""
    with started() as found:
        yield found


def mark_of(client: Client) -> str:
    return str(client.ask("/api/start").json["panel"]["mark"])


def test_a_throw_that_takes_too_long_is_stopped_and_others_are_answered(
    studio: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = mark_of(studio)
    assert threw(studio, mark, size=7).status == 200, "a process is ready"
    monkeypatch.setattr(app, "TIME_LIMIT", SHORT)
    replies = []

    def ask() -> None:
        # A throw for the page itself gives way to the next one; that of a file is finished.
        run = {"panel": mark, "settings": HANGING}
        replies.append(studio.post("/api/file/csv", {"run": run}))

    began = time.monotonic()
    thread = threading.Thread(target=ask)
    thread.start()
    time.sleep(0.3)
    # That they need not wait for it is a test of its own in test_web_worker.py.
    for size in (8, 9):
        assert threw(studio, mark, size=size).status == 200
    thread.join(timeout=SHORT + 20)
    assert replies, "the request ends"
    assert time.monotonic() - began > SHORT
    assert replies[0].status == 422
    assert f"took longer than {SHORT:g} s" in replies[0].json["message"]
    assert replies[0].json["message"].count("\n") <= 1
    assert threw(studio, mark, size=10).status == 200


def test_a_panel_with_powers_of_units_is_one_message(studio: Client) -> None:
    text = library_text("sb1").replace('"750 kN/m"', f'"{POWERS}"')
    reply = studio.ask("/api/panel/send?name=slow.toml", text.encode())
    assert reply.status == 422
    assert threw(studio, mark_of(studio), size=11).status == 200


@pytest.mark.parametrize(
    ("number", "hangs"),
    [
        (signal.SIGINT, True),
        (signal.SIGTERM, False),
        pytest.param(signal.SIGTERM, True, marks=pytest.mark.long),
        pytest.param(signal.SIGINT, False, marks=pytest.mark.long),
    ],
)
def test_signals_end_it_with_all_its_processes(
    process: Started, number: signal.Signals, hangs: bool
) -> None:
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


def test_a_server_that_is_killed_leaves_no_process(process: Started) -> None:
    client = process.client
    assert threw(client, mark_of(client), size=5).status == 200
    processes = process.processes()
    process.server.kill()
    process.server.wait(timeout=20)
    assert gone(processes)


def test_a_process_that_is_killed_is_replaced_and_nothing_is_forgotten(lasting: Started) -> None:
    client = lasting.client
    text = library_text("sb1").replace('name = "sb1"', 'name = "mine"')
    mark = client.ask("/api/panel/send?name=mine.toml", text.encode()).json["mark"]
    for pid in lasting.computing():
        os.kill(pid, signal.SIGKILL)
    assert threw(client, mark, size=6).status == 200
    assert lasting.server.poll() is None


@pytest.mark.parametrize(
    "key", ["movement.return.table_file", "rail.A.matrices", "movement.table_file", "rail.matrices"]
)
def test_no_setting_names_a_file(studio: Client, secret: Path, key: str) -> None:
    record = {"panel": mark_of(studio), "settings": {key: str(secret)}}
    for path, body in (
        ("/api/run", record),
        ("/api/file/csv", {"run": record}),
        ("/api/file/csv", {"run": {"panel": record["panel"]}, "behind": record}),
        ("/api/measured/campaign-0", record),
    ):
        reported_nothing(studio.post(path, body).text, secret)
    assert "names another file" in studio.post("/api/run", record).json["message"]


@pytest.mark.parametrize("form", ["{}", "{}.toml", "~/../{}", "./../../../../../..{}"])
def test_no_channel_map_names_a_file(studio: Client, secret: Path, form: str) -> None:
    named = form.format(secret)
    if named.endswith(".toml"):
        secret.with_name(secret.name + ".toml").write_text(SECRET, encoding="utf-8")
    content = b"Time (s),a (V)\n0,1\n0.1,2\n0.2,3\n"
    reply = studio.ask(f"/api/recording?name=a.csv&map={quote(named, safe='')}", content)
    assert reply.status == 422
    assert "takes no files of this machine" in reply.json["message"]
    reported_nothing(reply.text, secret)


@pytest.mark.parametrize(
    "lines",
    [
        '[movement.more]\ntable_file = "{}"\n',
        '[rail.other]\nmatrices = "{}"\n',
        '[movement.more]\ny = [{{ table_file = "{}" }}]\n',
    ],
)
def test_no_panel_names_a_file(studio: Client, secret: Path, lines: str) -> None:
    text = library_text("sb1") + "\n" + lines.format(secret)
    reply = studio.ask("/api/panel/send?name=x.toml", text.encode())
    assert reply.status == 422
    assert "names another file" in reply.json["message"]
    reported_nothing(reply.text, secret)


@pytest.mark.parametrize("way", ["storage", "link", "virtual"])
def test_no_recording_names_a_file(studio: Client, secret: Path, tmp_path: Path, way: str) -> None:
    path, other = tmp_path / "sent.h5", tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["a"] = np.arange(100.0)
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(100.0)
        if way == "storage":
            external = [(str(secret), 0, 32)]
            file.create_dataset("a", (4,), "f8", external=external)
        elif way == "link":
            file["a"] = h5py.ExternalLink(str(other), "/a")
        else:
            layout = h5py.VirtualLayout((100,), "f8")
            layout[:] = h5py.VirtualSource(str(other), "a", (100,))
            file.create_virtual_dataset("a", layout)
    reply = studio.ask("/api/recording?name=sent.h5", path.read_bytes())
    assert reply.status == 422
    assert "another file" in reply.json["message"]
    assert "allow" not in reply.json["message"], "an option that no page has"
    reported_nothing(reply.text, secret)


def reported_nothing(text: str, secret: Path) -> None:
    """Assert that neither the file nor where it is can be read from a reply."""
    assert SECRET not in text
    assert str(Path.home() / "x")[:-1] not in text
    assert "turnout-studio-" not in text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("/home/anna/a.toml: no such file", "a.toml: no such file"),
        ("the folder is C:\\Users\\anna\\a", "the folder is a"),
        ("750 kN/m is no length; N/mm", "750 kN/m is no length; N/mm"),
        ("4 / 2", "4 / 2"),
        ("open '/var/tmp/x/y.h5' (/etc)", "open 'y.h5' (etc)"),
    ],
)
def test_messages_hold_no_folders(text: str, shown: str) -> None:
    assert without_folders(text) == shown


def test_it_listens_on_this_machine_only(studio: Client) -> None:
    ready = prepared(Studio(sb2_panel()))
    try:
        assert ready.listener.getsockname()[0] == "127.0.0.1"
    finally:
        ready.listener.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", studio.port), timeout=5)


@pytest.mark.parametrize(
    "path", ["/api/run", "/api/panel/open", "/api/file/csv", "/api/panel/send?name=x.toml"]
)
def test_a_question_larger_than_any_is_refused(studio: Client, path: str) -> None:
    reply = studio.ask(path, b'{"panel": "' + b"a" * 5_000_000 + b'"}')
    assert reply.status == 413
    assert "too large" in reply.json["message"]
    assert LARGEST_UPLOAD > 5_000_000


def test_a_cookie_of_60_kilobytes_holds_no_one_up(studio: Client) -> None:
    cookie = 'a="' + "\\\\" * 29_000 + '"'
    # http.cookies took 26 s over it, before it was known who asks.
    began = time.monotonic()
    reply = Client(studio.address).ask("/api/start", headers={"Cookie": cookie})
    assert reply.status == 403
    assert time.monotonic() - began < 3


def test_the_memory_does_not_grow_with_throws(lasting: Started) -> None:
    """Previews only, which take a tenth of a second; the whole use is in the long test."""
    client, before = lasting.client, 0.0
    mark = mark_of(client)
    for number in range(90):
        assert threw(client, mark, size=3 + 0.1 * number).status == 200
        if number == 30:
            before = lasting.memory()
    assert lasting.memory() < 1.2 * before


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
