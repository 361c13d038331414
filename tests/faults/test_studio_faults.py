"""What the studio must refuse with a message, and survive; it reads no files for the page."""

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import h5py
import numpy as np
import pytest
from benchmarks.studies.attack.studio import mark_of, threw
from tests.unit.campaigns import copied
from tests.unit.served import Client, served
from tests.unit.simulated import sb2_panel
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import FileError, PanelError, TurnoutError
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.panel.load import library_text, load_panel
from turnout.web import app as web_app
from turnout.web.process import without_folders
from turnout.web.serve import prepared
from turnout.web.studio import Opened, Studio

HANGING = {"schedule.end": "300 s"}
"""Settings of a throw that takes much longer than `SHORT`."""
POWERS = "1 N/m*9^9^9^9"
SECRET = "root:first-line-of-a-protected-file"
SHORT = 3.0
"""Instead of the limit that a user has [s]."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Opened:
    folder = copied(tmp_path_factory.mktemp("studio"))
    return Opened(folder, build_campaign_dataset(folder))


@pytest.fixture(scope="module")
def entered(campaign: Opened) -> Iterator[Client]:
    """Serve to one client that has entered, whatever it is sent."""
    with served(sb2_panel(), campaign) as client:
        client.enter()
        yield client


@pytest.fixture
def inside(entered: Client) -> Iterator[Client]:
    """Give this client, and see that the server is still up afterwards."""
    yield entered
    assert entered.ask("/api/start").status == 200, "the server is up"


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    file = tmp_path / "secret.csv"
    file.write_text(f"{SECRET}\n1,2\n", encoding="utf-8")
    return file


def test_without_a_token_nothing_is_reported(inside: Client) -> None:
    for path in ("/", "/api/start", "/page/main.js", "/api/campaign/runs.csv"):
        reply = Client(inside.address).ask(path)
        assert reply.status == 403
        assert "open the studio with the address" in reply.text


def test_a_wrong_token_leaves_the_right_one_good_once_and_nothing_is_read_without_end() -> None:
    """The cookie is kept from scripts and other sites; more than was announced is refused."""
    with served(sb2_panel(), largest=1000) as client:
        reply = client.ask("/?token=guessed")
        assert reply.status == 403
        assert "wrong token" in reply.text
        entered = client.enter()
        assert entered.status == 303
        cookie = entered.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        with socket.create_connection(("127.0.0.1", client.port), timeout=20) as raw:
            head = (
                f"POST /api/panel/send?name=a.toml HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\n"
                f"Cookie: {client.cookie}\r\nTransfer-Encoding: chunked\r\n\r\n"
            )
            raw.sendall(head.encode() + b"7d0\r\n" + b"a" * 2000 + b"\r\n0\r\n\r\n")
            assert b" 413 " in raw.recv(200)
        assert client.ask("/api/start").status == 200
        again = Client(client.address).enter()
        assert again.status == 403
        assert "used before" in again.text
        assert "set-cookie" not in again.headers


@pytest.mark.parametrize("host", ["example.org", "127.0.0.1", "example.org:80", ""])
def test_foreign_hosts_and_pages_are_refused(inside: Client, host: str) -> None:
    reply = inside.ask("/api/start", headers={"Host": host})
    assert reply.status == 421
    assert "accepts only 127.0.0.1" in reply.text
    for origin, status in ((f"http://{host}", 403), (f"http://127.0.0.1:{inside.port}", 200)):
        assert inside.ask("/api/start", headers={"Origin": origin}).status == status


@pytest.mark.parametrize(
    ("path", "body", "status", "words"),
    [
        ("/api/panel/send?name=x.toml", b"", 422, "empty"),
        ("/api/panel/send?name=x.toml", b"a = ", 422, "not valid TOML"),
        ("/api/panel/send?name=x.toml", b"\xff\xfe\x00", 422, "UTF-16"),
        ("/api/panel/send?name=x.toml", b"\0\1", 422, "binary"),
        ("/api/panel/open", b'{"name": "/etc/passwd"}', 422, "no library panel is called"),
        *(
            ("/api/run", body, 422, "request: ")
            for body in (b"", b"{", b"[]", b'{"panel": 3}', b'{"panel": "x", "run": NaN}')
        ),
        *(
            (path, b'{"panel": "' + b"a" * 5_000_000 + b'"}', 413, "too large")
            for path in ("/api/run", "/api/panel/open", "/api/file/csv", "/api/panel/send?name=x")
        ),
    ],
    ids=lambda item: item[:20].decode("latin1") if isinstance(item, bytes) else None,
)
def test_a_broken_request_is_reported(
    inside: Client, path: str, body: bytes, status: int, words: str
) -> None:
    reply = inside.ask(path, body)
    assert reply.status == status
    assert words in reply.json["message"]


def test_200_megabytes_are_refused_without_being_kept(inside: Client) -> None:
    before = resident()
    reply = inside.ask("/api/recording?name=large.csv", bytes(200_000_000))
    assert reply.status == 413
    assert "at most 100 MB" in reply.text
    # The 200 MB of the sender are in this process too; they are gone by now.
    assert resident() - before < 150


def test_a_malformed_panel_is_reported_as_by_panel_check(inside: Client, tmp_path: Path) -> None:
    text = library_text("sb1").replace('"750 kN/m"', '"750 kg"').replace("[lock]", "[lok]")
    file = tmp_path / "bad.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(PanelError) as reported:
        load_panel(file)
    reply = inside.ask("/api/panel/send?name=bad.toml", text.encode())
    assert reply.status == 422
    assert reply.json["message"] == str(reported.value).replace(str(file), "bad.toml")
    assert "750 kg" in reply.json["message"]
    assert "lok" in reply.json["message"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../secret.csv", "outside the folder"), ("../../etc/passwd", "outside the folder"),
        ("/etc/passwd", "outside the folder"), ("a/../../secret.csv", "outside the folder"),
        ("..%2fx", "no such file"), ("link.csv", "outside the folder"),
    ],
)  # fmt: skip
def test_a_path_outside_the_campaign_is_refused(
    inside: Client, campaign: Opened, name: str, words: str
) -> None:
    secret, link = campaign.folder.parent / "secret.csv", campaign.folder / "link.csv"
    secret.write_text("not for all", encoding="utf-8")
    link.symlink_to(secret)
    try:
        reply = inside.ask(f"/api/campaign/{quote(name)}")
    finally:
        link.unlink()
    assert reply.status == 422
    assert words in reply.json["message"]
    assert "not for all" not in reply.text
    assert "root:" not in reply.text
    assert inside.ask("/api/campaign/runs.csv").status == 200


def test_files_of_the_page_stay_in_its_folder(inside: Client) -> None:
    for path in ("/page/../guard.py", "/page/..%2fguard.py", "/page/none.js"):
        assert inside.ask(path).status == 404


def test_a_recording_that_is_none_is_reported_as_by_import(inside: Client, tmp_path: Path) -> None:
    file = tmp_path / "throw.mat"
    file.write_bytes(b"MATLAB 5.0 MAT-file, cut short")
    reported = CliRunner().invoke(app, ["import", str(file)])
    assert isinstance(reported.exception, FileError)
    reply = inside.ask("/api/recording?name=throw.mat", file.read_bytes())
    assert reply.status == 422
    assert reply.json["message"] == str(reported.exception).replace(str(file), "throw.mat")


def test_the_suggested_map_of_a_recording_can_be_used(inside: Client) -> None:
    rows = "".join(f"{n / 100:.2f},{0.1 * (n % 7):.3f}\n" for n in range(300))
    content = f"Time (s),Force 1 (kN)\n{rows}".encode()
    suggested = inside.ask("/api/recording?name=a.csv", content).json["suggested"]
    assert "[drive_force.1]" in suggested
    reply = inside.ask(f"/api/recording?name=a.csv&map={quote(suggested, safe='')}", content)
    assert reply.status == 200
    assert "suggested" not in reply.json
    assert not inside.ask("/api/recording?name=a.csv", b"t,x\n0,1\n0.1,2\n").json["suggested"]


def test_a_name_that_leads_elsewhere_stays_a_name(inside: Client) -> None:
    name = quote("../../etc/evil\n\0.csv", safe="")
    reply = inside.ask(f"/api/recording?name={name}", b"Time (s),a (V)\n0,1\n0.1,2\n0.2,3\n")
    assert reply.status == 200
    assert reply.json["lines"][0].startswith("evil.csv: text")


def test_a_taken_port_is_reported(inside: Client) -> None:
    with pytest.raises(FileError, match="leave it out"):
        prepared(Studio(sb2_panel()), port=inside.port)


def test_every_answer_carries_the_policy(inside: Client) -> None:
    for path in ("/", "/api/start", "/page/main.js", "/plotly.js", "/nothing"):
        headers = inside.ask(path).headers
        policy = headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; ")
        assert "unsafe-inline" not in policy
        assert "http" not in policy
        assert headers["x-content-type-options"] == "nosniff"


def resident() -> float:
    """Return the memory of this process [MB]."""
    with Path("/proc/self/status").open(encoding="utf-8") as file:
        line = next(line for line in file if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--panel", "nope"), "no library panel is called 'nope'"),
        (("--set", "drive.2.stifness=1 kN/m"), "nearest is 'drive.2.stiffness'"),
        (("--campaign", "nowhere"), "nowhere"),
    ],
)
def test_a_studio_that_cannot_open_says_why(arguments: tuple[str, str], words: str) -> None:
    reported = CliRunner().invoke(app, ["studio", "--no-browser", *arguments])
    assert isinstance(reported.exception, TurnoutError)
    assert words in str(reported.exception)


def test_a_throw_that_takes_too_long_is_stopped_and_others_are_answered(
    inside: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = mark_of(inside)
    assert threw(inside, mark, size=7).status == 200, "a process is ready"
    monkeypatch.setattr(web_app, "TIME_LIMIT", SHORT)
    replies = []

    def ask() -> None:
        # A throw for the page itself gives way to the next one; that of a file is finished.
        run = {"panel": mark, "settings": HANGING}
        replies.append(inside.post("/api/file/csv", {"run": run}))

    began = time.monotonic()
    thread = threading.Thread(target=ask)
    thread.start()
    time.sleep(0.3)
    # That they need not wait for it is a test of its own in test_web_worker.py.
    for size in (8, 9):
        assert threw(inside, mark, size=size).status == 200
    thread.join(timeout=SHORT + 20)
    assert replies, "the request ends"
    assert time.monotonic() - began > SHORT
    assert replies[0].status == 422
    assert f"took longer than {SHORT:g} s" in replies[0].json["message"]
    assert replies[0].json["message"].count("\n") <= 1
    assert threw(inside, mark, size=10).status == 200


def test_a_panel_with_powers_of_units_is_one_message(inside: Client) -> None:
    text = library_text("sb1").replace('"750 kN/m"', f'"{POWERS}"')
    reply = inside.ask("/api/panel/send?name=slow.toml", text.encode())
    assert reply.status == 422
    assert threw(inside, mark_of(inside), size=11).status == 200


@pytest.mark.parametrize(
    "key", ["movement.return.table_file", "rail.A.matrices", "movement.table_file", "rail.matrices"]
)
def test_no_setting_names_a_file(inside: Client, secret: Path, key: str) -> None:
    record = {"panel": mark_of(inside), "settings": {key: str(secret)}}
    for path, body in (
        ("/api/run", record),
        ("/api/file/csv", {"run": record}),
        ("/api/file/csv", {"run": {"panel": record["panel"]}, "behind": record}),
        ("/api/measured/campaign-0", record),
    ):
        reported_nothing(inside.post(path, body).text, secret)
    assert "names another file" in inside.post("/api/run", record).json["message"]


@pytest.mark.parametrize("form", ["{}", "{}.toml", "~/../{}", "./../../../../../..{}"])
def test_no_channel_map_names_a_file(inside: Client, secret: Path, form: str) -> None:
    named = form.format(secret)
    if named.endswith(".toml"):
        secret.with_name(secret.name + ".toml").write_text(SECRET, encoding="utf-8")
    content = b"Time (s),a (V)\n0,1\n0.1,2\n0.2,3\n"
    reply = inside.ask(f"/api/recording?name=a.csv&map={quote(named, safe='')}", content)
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
def test_no_panel_names_a_file(inside: Client, secret: Path, lines: str) -> None:
    text = library_text("sb1") + "\n" + lines.format(secret)
    reply = inside.ask("/api/panel/send?name=x.toml", text.encode())
    assert reply.status == 422
    assert "names another file" in reply.json["message"]
    reported_nothing(reply.text, secret)


@pytest.mark.parametrize("way", ["storage", "link", "virtual"])
def test_no_recording_names_a_file(inside: Client, secret: Path, tmp_path: Path, way: str) -> None:
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
    reply = inside.ask("/api/recording?name=sent.h5", path.read_bytes())
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


def test_it_listens_on_this_machine_only(inside: Client) -> None:
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", inside.port), timeout=5)


def test_a_cookie_of_60_kilobytes_holds_no_one_up(inside: Client) -> None:
    cookie = 'a="' + "\\\\" * 29_000 + '"'
    # http.cookies took 26 s over it, before it was known who asks.
    began = time.monotonic()
    reply = Client(inside.address).ask("/api/start", headers={"Cookie": cookie})
    assert reply.status == 403
    assert time.monotonic() - began < 3
