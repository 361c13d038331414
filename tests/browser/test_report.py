"""A report in a real browser that no network is open to."""

import shutil
import subprocess
from pathlib import Path

import pytest
from tests.unit.simulated import sb2_dataset

from turnout.figures.report.page import page_html
from turnout.figures.report.run import run_page

NAMES = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="module")
def chromium() -> str:
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    if found is None:
        pytest.skip("no Chromium here (Debian: apt-get install chromium)")
    return found


def opened(chromium: str, page: Path, profile: Path) -> str:
    """Return what a browser has made of a page; whatever it would ask for meets a closed door."""
    line = [
        *(chromium, "--headless", "--no-sandbox", "--disable-gpu", "--window-size=1280,720"),
        *("--proxy-server=127.0.0.1:9", f"--user-data-dir={profile}"),
        *("--virtual-time-budget=10000", "--dump-dom", page.as_uri()),
    ]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout


def test_charts_are_drawn_with_the_network_off(chromium: str, tmp_path: Path) -> None:
    page = run_page(sb2_dataset())
    pictures = [picture for section in page.sections for picture in section.pictures]
    file = tmp_path / "report.html"
    file.write_text(page_html(page), encoding="utf-8")
    made = opened(chromium, file, tmp_path / "profile")
    assert made.count('class="main-svg"') >= 2 * len(pictures)
    for word in ("Drive force", "TKK1", "x from the toe [m]", "return (closing)"):
        assert f">{word}" in made, word
