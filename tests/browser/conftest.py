"""A studio with a panel and a campaign, and Chromium to open it."""

import contextlib
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from tests.unit.campaigns import copied
from tests.unit.served import served
from tests.unit.simulated import sb2_panel
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.web.studio import Opened

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
# WebGL in software, as machines for tests have no graphics.
ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # The page itself is put together without it, which takes a third less of the processors.
    "--disable-gpu-compositing",
]
PATIENCE = 120_000
SIZE = {"width": 1280, "height": 720}
# What a user would undo by hand: loading the page again takes two seconds of a processor.
AS_OPENED = """async () => {
  const { state } = await import("/page/state.js");
  const { showPanel } = await import("/page/files.js");
  const set = (id, value) => {
    const choice = document.getElementById(id);
    if (choice.value !== value) { choice.value = value; choice.dispatchEvent(new Event("change")); }
  };
  document.getElementById("message-close").click();
  document.getElementById("tab-curves").click();
  document.getElementById("state").textContent = "";
  document.getElementById("trapped").checked = true;
  document.getElementById("map").value = "";
  document.activeElement.blur();
  set("theme", "auto");
  set("text-size", "normal");
  Object.assign(state, { trapped: true, kind: "spring" });
  for (const box of document.querySelectorAll("#channel-list input:not(:checked)")) box.click();
  await showPanel(state.start.panel);
}"""


@dataclass
class Screen:
    """A page of the studio, with all its requests and complaints."""

    page: "Page"
    host: str
    asked: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def figure(self, key: str) -> str:
        """Return a number of the present throw from the table of comparisons."""
        return self.page.locator(f"#table tr[data-key='{key}'] td").first.inner_text()

    def wait(self, condition: str) -> None:
        """Wait for an expression to hold; the page forbids what Playwright has for this."""
        until = time.monotonic() + PATIENCE / 1000
        while not self.page.evaluate(condition):
            assert time.monotonic() < until, f"never came: {condition}"
            self.page.wait_for_timeout(50)

    def start(self) -> None:
        """Bring the page back to how it was opened."""
        self.page.emulate_media(media="screen")
        self.page.set_viewport_size(SIZE)
        self.page.evaluate(AS_OPENED)
        self.finished()
        self.complaints.clear()

    def clear(self) -> None:
        """Forget that a throw was computed; `finished` then waits for the next one."""
        self.page.evaluate("document.getElementById('state').textContent = ''")

    def finished(self) -> None:
        """Wait until the throw is computed as by the command."""
        self.wait("document.getElementById('state').textContent.startsWith('final result')")

    def set(self, key: str, value: float) -> None:
        """Type a number beside a slider."""
        box = self.page.locator(f"#control-{key.replace('.', '-')}-number")
        self.clear()
        box.fill(str(value))
        box.press("Enter")
        self.finished()


def chromium() -> str | None:
    """Return the program, None where there is none."""
    return next((found for name in CHROMIUM if (found := shutil.which(name))), None)


# While it is there an event loop runs, which tests elsewhere cannot have beside their own.
@pytest.fixture(scope="package")
def browser() -> Iterator["Browser"]:
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: extra dev")
    program = chromium()
    if program is None:
        pytest.skip("no Chromium: apt-get install chromium (as root)")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=program, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture(scope="package")
def studio_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    """Return the address and the cookie of a studio; the token is spent already."""
    folder = copied(tmp_path_factory.mktemp("browser"))
    with served(sb2_panel(), Opened(folder, build_campaign_dataset(folder))) as client:
        client.enter()
        yield f"http://127.0.0.1:{client.port}", client.cookie


@contextlib.contextmanager
def opened(browser: "Browser", address: str, cookie: str) -> Iterator[Screen]:
    """Open the page and wait for its first throw; nothing may be asked of another host."""
    name, _, value = cookie.partition("=")
    context = browser.new_context(viewport=SIZE)
    context.set_default_timeout(PATIENCE)
    context.add_cookies([{"name": name, "value": value, "url": address}])
    page = context.new_page()
    screen = Screen(page, urlsplit(address).netloc)
    page.on("request", lambda request: screen.asked.append(request.url))
    page.on("pageerror", lambda error: screen.complaints.append(str(error)))
    page.on(
        "console",
        lambda said: screen.complaints.append(said.text) if said.type == "error" else None,
    )
    page.goto(address)
    page.wait_for_selector(".lamp")
    screen.finished()
    try:
        yield screen
    finally:
        context.close()
    foreign = [url for url in screen.asked if urlsplit(url).netloc not in (screen.host, "")]
    assert not foreign, f"asked of other hosts: {foreign}"


@pytest.fixture(scope="package")
def only_screen(browser: "Browser", studio_address: tuple[str, str]) -> Iterator[Screen]:
    with opened(browser, *studio_address) as found:
        yield found


@pytest.fixture
def screen(only_screen: Screen) -> Iterator[Screen]:
    """Return the page as it was opened; it must end without a complaint on its console."""
    only_screen.start()
    yield only_screen
    assert not only_screen.complaints, only_screen.complaints


@pytest.fixture(scope="session")
def shots(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that screenshots go to: where pytest keeps things, if it may."""
    cache: pytest.Cache | None = getattr(pytestconfig, "cache", None)
    return cache.mkdir("studio") if cache else tmp_path_factory.mktemp("studio")
