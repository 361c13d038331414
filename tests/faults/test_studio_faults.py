"""What the studio must refuse with a message, and survive."""

import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from tests.unit.campaigns import copied
from tests.unit.served import Client, served
from tests.unit.simulated import sb2_panel
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import FileError, PanelError, TurnoutError
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.panel.load import library_text, load_panel
from turnout.web.serve import prepared
from turnout.web.studio import Opened, Studio


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Opened:
    folder = copied(tmp_path_factory.mktemp("studio"))
    return Opened(folder, build_campaign_dataset(folder))


@pytest.fixture
def outside(campaign: Opened) -> Iterator[Client]:
    """Serve again; this client has not entered."""
    with served(sb2_panel(), campaign) as client:
        yield client


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


def test_without_a_token_nothing_is_reported(outside: Client) -> None:
    for path in ("/", "/api/start", "/page/main.js", "/api/campaign/runs.csv"):
        reply = outside.ask(path)
        assert reply.status == 403
        assert "open the studio with the address" in reply.text


def test_a_wrong_token_is_refused_and_leaves_the_right_one_good(outside: Client) -> None:
    reply = outside.ask("/?token=guessed")
    assert reply.status == 403
    assert "wrong token" in reply.text
    assert outside.enter().status == 303


def test_the_token_is_good_once(inside: Client) -> None:
    second = Client(inside.address).enter()
    assert second.status == 403
    assert "used before" in second.text
    assert "set-cookie" not in second.headers


def test_the_cookie_is_kept_from_scripts_and_other_sites(outside: Client) -> None:
    cookie = outside.enter().headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


@pytest.mark.parametrize("host", ["example.org", "127.0.0.1", "example.org:80", ""])
def test_a_foreign_host_is_refused(inside: Client, host: str) -> None:
    reply = inside.ask("/api/start", headers={"Host": host})
    assert reply.status == 421
    assert "accepts only 127.0.0.1" in reply.text


def test_a_foreign_page_is_refused(inside: Client) -> None:
    reply = inside.ask("/api/start", headers={"Origin": "http://example.org"})
    assert reply.status == 403
    assert "may not use this studio" in reply.text
    own = {"Origin": f"http://127.0.0.1:{inside.port}"}
    assert inside.ask("/api/start", headers=own).status == 200


def test_200_megabytes_are_refused_without_being_kept(inside: Client) -> None:
    before = resident()
    reply = inside.ask("/api/recording?name=large.csv", bytes(200_000_000))
    assert reply.status == 413
    assert "at most 100 MB" in reply.text
    # The 200 MB of the sender are in this process too; they are gone by now.
    assert resident() - before < 150


def test_more_than_was_announced_is_refused() -> None:
    with served(sb2_panel(), largest=1000) as client:
        client.enter()
        with socket.create_connection(("127.0.0.1", client.port), timeout=20) as raw:
            head = (
                f"POST /api/panel/send?name=a.toml HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\n"
                f"Cookie: {client.cookie}\r\nTransfer-Encoding: chunked\r\n\r\n"
            )
            raw.sendall(head.encode() + b"7d0\r\n" + b"a" * 2000 + b"\r\n0\r\n\r\n")
            assert b" 413 " in raw.recv(200)
        assert client.ask("/api/start").status == 200


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
    ("content", "words"),
    [(b"", "empty"), (b"a = ", "not valid TOML"), (b"\xff\xfe\x00", "UTF-16"), (b"\0\1", "binary")],
)
def test_what_is_no_panel_is_reported(inside: Client, content: bytes, words: str) -> None:
    reply = inside.ask("/api/panel/send?name=x.toml", content)
    assert reply.status == 422
    assert words in reply.json["message"]


def test_a_sent_panel_cannot_name_files_of_this_machine(inside: Client) -> None:
    text = library_text("sb1") + '\n[rail.other]\nmatrices = "/etc/passwd"\n'
    reply = inside.ask("/api/panel/send?name=x.toml", text.encode())
    assert reply.status == 422
    assert "rail.other.matrices: names another file" in reply.json["message"]
    library = inside.post("/api/panel/open", {"name": "/etc/passwd"})
    assert library.status == 422
    assert "no library panel is called" in library.json["message"]


@pytest.mark.parametrize(
    "name", ["../secret.csv", "../../etc/passwd", "/etc/passwd", "a/../../secret.csv", "..%2fx"]
)
def test_a_path_outside_the_campaign_is_refused(
    inside: Client, campaign: Opened, name: str
) -> None:
    (campaign.folder.parent / "secret.csv").write_text("not for all", encoding="utf-8")
    reply = inside.ask(f"/api/campaign/{quote(name)}")
    assert reply.status in (404, 422)
    assert "not for all" not in reply.text
    assert "root:" not in reply.text
    if reply.status == 422:
        message = reply.json["message"]
        assert "outside the folder" in message or "no such file" in message


def test_a_link_that_leads_out_of_the_campaign_is_refused(inside: Client, campaign: Opened) -> None:
    secret = campaign.folder.parent / "secret.csv"
    secret.write_text("not for all", encoding="utf-8")
    link = campaign.folder / "link.csv"
    link.symlink_to(secret)
    try:
        reply = inside.ask("/api/campaign/link.csv")
    finally:
        link.unlink()
    assert reply.status == 422
    assert "outside the folder" in reply.json["message"]
    assert inside.ask("/api/campaign/runs.csv").status == 200


def test_files_of_the_page_stay_in_its_folder(inside: Client) -> None:
    for path in ("/page/../guard.py", "/page/..%2fguard.py", "/page/none.js"):
        assert inside.ask(path).status == 404


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b'{"panel": 3}', b'{"panel": "x", "run": NaN}'])
def test_a_broken_question_is_reported(inside: Client, body: bytes) -> None:
    reply = inside.ask("/api/run", body)
    assert reply.status == 422
    assert reply.json["message"].startswith("request: ")


def test_a_recording_that_is_none_is_reported_as_by_import(inside: Client, tmp_path: Path) -> None:
    file = tmp_path / "throw.mat"
    file.write_bytes(b"MATLAB 5.0 MAT-file, cut short")
    reported = CliRunner().invoke(app, ["import", str(file)])
    assert isinstance(reported.exception, FileError)
    reply = inside.ask("/api/recording?name=throw.mat", file.read_bytes())
    assert reply.status == 422
    assert reply.json["message"] == str(reported.exception).replace(str(file), "throw.mat")


def test_a_name_that_leads_elsewhere_stays_a_name(inside: Client) -> None:
    name = quote("../../etc/evil\n\0.csv", safe="")
    reply = inside.ask(f"/api/recording?name={name}", b"Time (s),a (V)\n0,1\n0.1,2\n0.2,3\n")
    assert reply.status == 200
    assert reply.json["lines"][0].startswith("evil.csv: text")


def test_a_taken_port_is_reported() -> None:
    with served(sb2_panel()) as client, pytest.raises(FileError, match="leave it out"):
        prepared(Studio(sb2_panel()), port=client.port)


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
