"""Requests that no page sends, drawn from a seeded generator."""

import io
import json
import random
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, unquote

import h5py
import numpy as np
from tests.unit.served import Client

from turnout.panel.load import library_text

HANG = "*9^9^9^9"
NUMBERS = (
    *("0", "-0", "-1", "1e308", "-1e308", "1e-308", "1e400", "nan", "inf", "1_0", "0x10", "1,5"),
    *("9" * 400, "9" * 30_000, "1e999999999", "", " ", "--1", "1.2.3", "١٢"),  # noqa: RUF001
)
UNITS = ("mm", "m", "kN/m", "N/m", "s", "kg", "mm^2", "furlong", "m**2", "%", "mm mm", "/", "µm")
ODD = (
    *("", "\0", "\x1b[31m", "💥" * 30, "a" * 5000, "<script>alert(1)</script>", "../" * 20),
    *("/etc/passwd", "/dev/zero", "/proc/self/mem", "file:///etc/passwd", "$(id)", "${jndi:x}"),
    *(
        "__class__",
        "'; drop table",
        "%s%n",
        "\r\nX: y",
        "{0.__class__}",
        "\ud800",
        "con",
        "nul.toml",
    ),
)
KEYS = (
    *("chair.friction_coefficient", "drive.1.stiffness", "drive.1.stroke", "rail.straight.end"),
    *("movement.table_file", "rail.matrices", "schedule.end", "schedule.step", "gravity"),
    *("object_defaults.appears", "drive.1.rod_height", "lock.rule", "a" * 200, "", ".", "drive..x"),
    *("drive.1", "__proto__.x", "chair.1.x", "movement.return.duration", "object.a.size"),
)


@dataclass(frozen=True)
class Request:
    """A request; `raw` is sent as it is, whatever else there is."""

    path: str
    body: bytes | None = None
    headers: dict[str, str] = field(default_factory=dict)
    raw: bytes = b""
    number: int = 0

    def described(self) -> str:
        """Return address and content, short enough for a line."""
        return f"{self.path[:150]} {(self.raw or self.body or b'')[:200]!r}"

    def sent(self) -> str:
        """Return all that was sent, as the studio reads it."""
        return unquote(self.path) + (self.raw or self.body or b"").decode("latin-1")

    def send(self, client: Client, *, timeout: float) -> tuple[int, str]:
        """Send it; return the status and the text of the reply."""
        if self.raw:
            with socket.create_connection(("127.0.0.1", client.port), timeout=timeout) as raw:
                raw.sendall(self.raw.replace(b"COOKIE", client.cookie.encode()))
                raw.shutdown(socket.SHUT_WR)
                parts = iter(lambda: raw.recv(65536), b"")
                found = b"".join(parts).decode("latin-1")
            return int((found.split() + ["", "400"])[1] or 400), found
        reply = client.ask(self.path, self.body, self.headers)
        return reply.status, reply.body.decode("utf-8", "replace")


def hostile_request(kind: str, source: random.Random, *, mark: str, secret: Path) -> Request:
    """Draw a request of a kind.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    source : random.Random
        Where chance comes from.
    mark : str
        Of a panel that the studio knows.
    secret : Path
        A file that no reply may show.
    """
    drawn = _DRAWN[kind](source, mark, str(secret))
    number = source.randrange(1000)
    return Request(drawn.path, drawn.body, drawn.headers, drawn.raw, number)


def _quantity(source: random.Random) -> str:
    kind = source.randrange(7)
    number, unit = source.choice(NUMBERS), source.choice(UNITS)
    if kind == 0:
        return source.choice(ODD)
    if kind == 1 and source.random() < 0.15:
        return f"1 {unit}{HANG}"
    if kind == 2:
        return "(" * source.choice((1, 50, 3000)) + number
    if kind == 3:
        return f"1{' ' * source.choice((1, 1000, 40_000))}{unit}"
    if kind == 4:
        return "*".join([unit] * source.choice((2, 30, 2000)))
    return f"{number} {unit}"


def _value(source: random.Random, secret: str, depth: int = 0) -> object:
    kind = source.randrange(9 if depth < 4 else 6)
    if kind == 6:
        return [_value(source, secret, depth + 1) for _ in range(source.randrange(4))]
    if kind >= 7:
        return {source.choice(KEYS): _value(source, secret, depth + 1) for _ in range(2)}
    choices = (_quantity(source), secret, source.choice(ODD), 1e300, -1, None)
    return choices[kind]


def _json(source: random.Random, mark: str, secret: str) -> Request:
    path = source.choice(
        ("run", "panel/open", "panel/again", "panel/concerns", "file/csv", "file/png")
    )
    kind = source.randrange(7)
    if kind == 0:
        body = source.randbytes(source.randrange(2000))
    elif kind == 1:
        body = b'{"a":' * source.choice((10, 1000, 30_000)) + b"1"
    elif kind == 2:
        body = b"[" * source.choice((100, 100_000, 3_000_000))
    elif kind == 3:
        body = json.dumps({"panel": mark, "preview": _value(source, secret)}).encode()
    elif kind == 4:
        body = json.dumps(_value(source, secret)).encode()
    elif kind == 5:
        body = b'{"panel": ' + b"9" * source.choice((10, 5000, 100_000)) + b"}"
    else:
        whole = json.dumps({"run": {"panel": mark}, "behind": {"panel": mark}}).encode()
        body = bytes(b ^ (1 << source.randrange(8)) if source.random() < 0.02 else b for b in whole)
    return Request(f"/api/{path}", body)


def _trapped(source: random.Random, mark: str, _secret: str) -> Request:
    trapped = {"size": _quantity(source), "at": source.choice((*ODD, "sleeper 6", "x = 1e9 m"))}
    if source.random() < 0.5:
        trapped["stiffness"] = _quantity(source)
    if source.random() < 0.3:
        trapped = {"size": "13 mm", "at": f"x = {source.choice(NUMBERS)} {source.choice(UNITS)}"}
    record = {"panel": mark, "object": trapped, "preview": source.random() < 0.5}
    return Request("/api/run", json.dumps(record).encode())


def _settings(source: random.Random, mark: str, secret: str) -> Request:
    settings = {
        source.choice(KEYS): source.choice((_quantity(source), secret, 1e308, -1.0, 0.0, 1e-300))
        for _ in range(source.choice((1, 2, 5)))
    }
    run = {"panel": mark, "settings": settings, "preview": True}
    if source.random() < 0.3:
        kind = source.choice(("csv", "nc", "svg", "pdf"))
        return Request(f"/api/file/{kind}", json.dumps({"run": run, "behind": run}).encode())
    return Request("/api/run", json.dumps(run).encode())


def _panel(source: random.Random, _mark: str, secret: str) -> Request:
    text = library_text(source.choice(("sb1", "sb2", "uic60-760-1-15")))
    kind = source.randrange(8)
    lines = text.splitlines()
    if kind == 0:
        at = source.randrange(len(lines))
        del lines[at : at + source.choice((1, 5, 50))]
    elif kind == 1:
        for _ in range(source.choice((1, 10))):
            at = source.randrange(len(lines))
            key, equals, _ = lines[at].partition("=")
            if equals:
                value = json.dumps(_quantity(source).encode("utf-8", "replace").decode())
                lines[at] = f"{key}= {value}"
    elif kind == 2:
        lines.append("x = " + "[" * 3000 + "]" * 3000)
    elif kind == 3:
        lines += [f"[chair.n{n}]\nx = '{n} mm'" for n in range(source.choice((10, 3000)))]
    elif kind == 4:
        lines.append(f"[movement.more]\ntable_file = '{secret}'\n[rail.b]\nmatrices = '{secret}'")
    elif kind == 5:
        lines.append("a = 1 #" + " " * source.choice((100, 40_000)) + "paper: x")
        lines.append(".".join(["k"] * source.choice((10, 5000))) + " = 1")
    content = "\n".join(lines).encode()
    if kind >= 6:
        flipped = bytearray(content)
        for _ in range(source.choice((1, 20))):
            flipped[source.randrange(len(flipped))] ^= 1 << source.randrange(8)
        content = bytes(flipped)
    name = quote(source.choice(("x.toml", *ODD)).encode("utf-8", "replace").decode(), safe="")
    return Request(f"/api/panel/send?name={name}", content)


def _recording(source: random.Random, _mark: str, secret: str) -> Request:
    kind, name = source.randrange(7), "x.csv"
    if kind == 0:
        rows = [f"{source.choice(NUMBERS)},{source.choice(ODD)}" for _ in range(50)]
        content = ("Time (s),a\n" + "\n".join(rows)).encode("utf-8", "replace")
    elif kind == 1:
        name = f"x.{source.choice(('mat', 'h5', 'mf4', 'tdms', 'parquet', 'dxd', 'd7d', 'nc'))}"
        magic = (b"\x89HDF\r\n\x1a\n", b"MATLAB 5.0 MAT-file", b"MDF     4.10", b"TDSm", b"PAR1")
        content = source.choice(magic) + source.randbytes(source.choice((0, 600, 5000)))
    elif kind in (2, 3):
        name, content = "x.h5", _hdf5(source, secret)
    elif kind == 4:
        width = source.choice((1, 3000))
        content = (",".join(["a"] * width) + "\n" + ",".join(["1"] * width) + "\n").encode() * 20
    elif kind == 5:
        content = source.randbytes(source.choice((0, 1, 100_000)))
    else:
        rows = [f"{0.01 * row:.2f},{row % 5}" for row in range(500)]
        content = ("Time (s),a (V)\n" + "\n".join(rows)).encode()
    shown = source.choice((name, name, *ODD)).encode("utf-8", "replace").decode()
    chosen = source.choice(
        ("", "", "campaign", "two-rods", secret, "../channels.toml", "a = ]", "[" * 2000)
    )
    return Request(
        f"/api/recording?name={quote(shown, safe='')}&map={quote(chosen, safe='')}", content
    )


def _hdf5(source: random.Random, secret: str) -> bytes:
    file = io.BytesIO()
    with h5py.File(file, "w") as made:
        made["time"] = np.arange(50.0)
        kind = source.randrange(5)
        if kind == 0:
            made.create_dataset("a", (10**9,), "f8", chunks=(10**6,), compression="gzip")
        elif kind == 1:
            made.create_dataset("a", (4,), "f8", external=[(secret, 0, 32)])
        elif kind == 2:
            made["a"] = h5py.ExternalLink(secret, "/a")
        elif kind == 3:
            made["a"] = h5py.SoftLink("/a")
        else:
            made["group/" * 200 + "a"] = np.arange(50.0)
    content = bytearray(file.getvalue())
    if source.random() < 0.4:
        for _ in range(5):
            content[source.randrange(len(content))] ^= 1 << source.randrange(8)
    return bytes(content)


def _path(source: random.Random, _mark: str, secret: str) -> Request:
    before = source.choice(
        ("/page/", "/api/campaign/", "/api/file/", "/api/measured/", "/", "/api/")
    )
    up = source.choice(("../" * 8, "..%2f" * 8, "%2e%2e/" * 8, "....//" * 4, "", "/", "~/"))
    named = source.choice((secret, "etc/passwd", "secret.csv", "", "%00", "a" * 3000, "studio.py"))
    body = None if source.random() < 0.7 else source.randbytes(50)
    path = (
        (before + up + named).replace("//", "/") if source.random() < 0.5 else before + up + named
    )
    return Request(path, body)


def _head(source: random.Random, mark: str, _secret: str) -> Request:
    kind = source.randrange(8)
    good = b"Host: 127.0.0.1\r\nCookie: COOKIE\r\n"
    body = json.dumps({"panel": mark}).encode()
    heads = (
        source.randbytes(500),
        b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n" + good + b"\r\n",
        b"POST /api/run HTTP/1.1\r\n" + good + b"Content-Length: 99999999999\r\n\r\n" + body,
        b"POST /api/run HTTP/1.1\r\n" + good + b"Transfer-Encoding: chunked\r\n\r\nZZ\r\n" + body,
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 2000 + good + b"\r\n",
        b"GET /api/start HTTP/1.1\r\nHost: evil.example\r\nCookie: COOKIE\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n" * 50,
        b'GET / HTTP/1.1\r\nHost: x\r\nCookie: a="' + b"\\\\" * 28_000 + b'"\r\n\r\n',
    )
    return Request("(raw)", raw=heads[kind])


def _entry(source: random.Random, _mark: str, _secret: str) -> Request:
    path = source.choice(("/?token=" + "a" * 40, "/api/start", "/?token=", "/?" + "a&" * 3000))
    headers = {"Cookie": source.choice(("", "a=b", "turnout_studio_1=x", ";" * 5000, "é"))}
    if source.random() < 0.5:
        headers["Origin"] = source.choice(("http://evil.example", "null", "http://127.0.0.1", ""))
    return Request(path, headers=headers)


_DRAWN: dict[str, Callable[[random.Random, str, str], Request]] = {
    "JSON": _json,
    "object": _trapped,
    "settings": _settings,
    "panel": _panel,
    "recording": _recording,
    "path": _path,
    "HTTP": _head,
    "entry": _entry,
}
KINDS = tuple(_DRAWN)
