"""Take the pictures of the studio that the documentation shows: python -m tests.browser.make."""

from pathlib import Path

from playwright.sync_api import sync_playwright
from tests.browser.conftest import ARGUMENTS, chromium, opened
from tests.unit.served import served

from turnout.panel.load import load_panel

FIGURES = Path(__file__).parents[2] / "docs" / "figures"


def make() -> None:
    """Write docs/figures/studio.png and studio_space.png, of the default panel."""
    with served(load_panel("uic60-760-1-15")) as client, sync_playwright() as started:
        client.enter()
        browser = started.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        with opened(browser, f"http://127.0.0.1:{client.port}", client.cookie) as screen:
            page = screen.page
            page.get_by_role("button", name="Pin this throw").click()
            page.locator("#place").select_option("sleeper 9")
            screen.forget()
            screen.set("object.size", 18)
            page.wait_for_timeout(500)
            page.screenshot(path=FIGURES / "studio.png")
            page.get_by_role("slider", name="Time", exact=True).fill("95")
            page.get_by_role("tab", name="3-D").click()
            page.wait_for_timeout(3000)
            page.screenshot(path=FIGURES / "studio_space.png")
        browser.close()


if __name__ == "__main__":
    make()
