"""Delay of a number on the screen after a slider has moved: python -m benchmarks.studio_page.

The page measures itself, from the event of the slider to the frame that shows the number. Needs
Playwright (extra dev) and Chromium.
"""

import argparse
import json
import os
import statistics

from playwright.sync_api import sync_playwright
from tests.browser.conftest import ARGUMENTS, chromium, opened
from tests.unit.served import served

from turnout.panel.load import load_panel

PANEL, AIM = "uic60-760-1-15", 150.0
MEASURES = "performance.getEntriesByName('slider to painted number').map((one) => one.duration)"
SLIDERS = ("object-size", "chair-friction_coefficient", "drive-1-stiffness", "object-x")
# Between two moves, so that nothing of the one is still at work in the other [ms].
PAUSE = 900


def measured(count: int) -> dict[str, list[float]]:
    """Return the times of each slider in milliseconds."""
    program = chromium()
    if program is None:
        message = "no Chromium: apt-get install chromium (as root)"
        raise SystemExit(message)
    found = {}
    with served(load_panel(PANEL)) as client, sync_playwright() as started:
        client.enter()
        browser = started.chromium.launch(executable_path=program, args=ARGUMENTS)
        with opened(browser, f"http://127.0.0.1:{client.port}", client.cookie) as screen:
            for slider in SLIDERS:
                screen.page.locator(f"#control-{slider}").focus()
                screen.page.keyboard.press("ArrowRight")
                screen.page.wait_for_timeout(2 * PAUSE)
                screen.page.evaluate("performance.clearMeasures()")
                for _ in range(count):
                    screen.page.keyboard.press("ArrowRight")
                    screen.page.wait_for_timeout(PAUSE)
                found[slider] = [float(value) for value in screen.page.evaluate(MEASURES)]
        browser.close()
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.studio_page", description=__doc__)
    parser.add_argument("--count", type=int, default=15, help="moves of each slider")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    before = os.getloadavg()[0]
    found = measured(given.count)
    every = [value for values in found.values() for value in values]
    record = {
        "median": statistics.median(every),
        "aim": AIM,
        "load": [before, os.getloadavg()[0]],
        "sliders": {
            name: {"median": statistics.median(values), "least": min(values), "count": len(values)}
            for name, values in found.items()
        },
    }
    if given.json:
        print(json.dumps(record, indent=2))
        return
    for name, row in record["sliders"].items():
        print(f"{name:32} median {row['median']:6.0f} ms, least {row['least']:6.0f} ms")
    load = " to ".join(f"{value:.1f}" for value in record["load"])
    print(f"all: median {record['median']:.0f} ms, aim {AIM:.0f} ms, load {load}")


if __name__ == "__main__":
    main()
