"""A report in a real browser that no network is open to."""

from pathlib import Path
from typing import TYPE_CHECKING

from tests.unit.simulated import sb2_dataset
from turnout.figures.report.page import Picture, page_html
from turnout.figures.report.run import run_page, run_sheets

if TYPE_CHECKING:
    from playwright.sync_api import Browser


def test_charts_are_drawn_with_the_network_off(browser: "Browser", tmp_path: Path) -> None:
    pictures = [Picture(sheet, {}) for sheet in run_sheets(sb2_dataset())]
    report = run_page(sb2_dataset(), pictures=pictures)
    file = tmp_path / "report.html"
    file.write_text(page_html(report), encoding="utf-8")
    asked: list[str] = []
    page = browser.new_page(offline=True)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.as_uri())
    made = page.content()
    page.close()
    assert made.count('class="main-svg"') >= 2 * len(pictures)
    for word in ("Drive force", "TKK1", "x from the toe [m]", "return (closing)"):
        assert f">{word}" in made, word
    assert {url.partition(":")[0] for url in asked} <= {"file", "data", "blob"}
