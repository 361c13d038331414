"""Take the pictures of studio and report in the documentation: python -m tests.browser.make."""

import tempfile
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

import turnout
from tests.browser.conftest import ARGUMENTS, chromium, opened
from tests.unit.served import served
from turnout.figures.report.inputs import panel_of_result
from turnout.figures.report.page import page_html
from turnout.figures.report.run import run_page
from turnout.panel.load import load_panel

FIGURES = Path(__file__).parents[2] / "docs" / "figures"


def make_report(browser: Browser) -> None:
    """Write docs/figures/report.png: the head of the report of 13 mm at sleeper 6."""
    trapped = turnout.ForeignObject(size=0.013, at="sleeper 6")
    dataset = turnout.simulate(turnout.load_panel("uic60-760-1-15"), foreign_object=trapped)
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        report = run_page(dataset, panel=panel_of_result(dataset.attrs))
        file.write_text(page_html(report), encoding="utf-8")
        page.goto(file.as_uri())
        page.wait_for_timeout(2000)
        page.screenshot(path=FIGURES / "report.png")


def make() -> None:
    """Write docs/figures/studio.png, studio_space.png and report.png, of the default panel."""
    with served(load_panel("uic60-760-1-15")) as client, sync_playwright() as started:
        client.enter()
        browser = started.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        with opened(browser, f"http://127.0.0.1:{client.port}", client.cookie) as screen:
            page = screen.page
            page.get_by_role("button", name="Pin this throw").click()
            page.locator("#place").select_option("sleeper 9")
            screen.clear()
            screen.set("object.size", 18)
            page.wait_for_timeout(500)
            page.screenshot(path=FIGURES / "studio.png")
            page.get_by_role("slider", name="Time", exact=True).fill("86")
            page.get_by_role("tab", name="3-D").click()
            page.wait_for_timeout(3000)
            page.screenshot(path=FIGURES / "studio_space.png")
        make_report(browser)
        browser.close()


if __name__ == "__main__":
    make()
