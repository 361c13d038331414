"""Time a virtual campaign of the published size and its build, for docs/evidence.

    python -m benchmarks.campaign [FOLDER]

The campaign is made in FOLDER (default: a temporary one), or gone on with there, by the program
itself in two processes. Its build is then timed from files to the dataset written, by the program
too, as a user starts it: with nothing read before, and with everything read before. The figures of
docs/use/campaign.md are drawn from what was built.
"""

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.machine import load, machine
from benchmarks.page import write_section
from turnout.measurement.campaign.recorded_throw import STORE
from turnout.measurement.campaign.run_sheet import find_sheet, read_sheet

DOCS = Path(__file__).parents[1] / "docs"
PANEL, SEED, REPEATS = "sb2", "1", 3
# Repeats without an object in each direction, so that there are about 120 movements.
OBJECT_FREE = "20"
LIMIT = 15.0


def turnout(*arguments: str) -> float:
    """Run the program and return the seconds it took."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-m", "turnout", *arguments], check=True)
    return time.perf_counter() - began


def timed_builds(folder: Path, *, fresh: bool) -> list[float]:
    """Return the seconds of repeated builds."""
    seconds = []
    for _ in range(REPEATS):
        if fresh:
            shutil.rmtree(folder / STORE, ignore_errors=True)
        seconds.append(turnout("campaign", "build", str(folder), "--quiet"))
    return seconds


def reported(seconds: list[float]) -> str:
    """Return median and spread."""
    median = statistics.median(seconds)
    return f"{median:.1f} s ({min(seconds):.1f} ... {max(seconds):.1f})"


def section(count: int, *, made: float, fresh: list[float], again: list[float]) -> str:
    """Return the section."""
    what = f"build {count} movements of 12 s, in part CSV, in part MATLAB, nothing read before"
    return f"""Written by `python -m benchmarks.campaign` on {machine()}, load {load():.1f}
at the end. Medians (least ... largest)
of {REPEATS} runs of the program, from its start to the dataset on disk.

| what | seconds |
|---|---|
| {what} | {reported(fresh)} |
| the same with everything read before | {reported(again)} |
| make the virtual campaign on panel `{PANEL}` in two processes, once | {made:.0f} s |

The aim is a build below {LIMIT:g} s on two cores; it uses one. Most of a CSV recording's time is
the search for its layout.
"""


def draw(folder: Path) -> None:
    """Draw the figures of the how-to."""
    dataset = str(folder / "campaign.nc")
    figures = DOCS / "figures"
    overview, stacked = figures / "campaign_overview.png", figures / "campaign_stacked.png"
    turnout("campaign", "plot", dataset, "--out", str(overview), "--quiet")
    place = ("--place", "sleeper 6")
    turnout("campaign", "plot", dataset, *place, "--out", str(stacked), "--quiet")


def main() -> None:
    """Make, build, draw and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, help="where the campaign is made")
    chosen = parser.parse_args().folder
    with tempfile.TemporaryDirectory() as temporary:
        folder = (chosen or Path(temporary)) / "virtual"
        options = ("--panel", PANEL, "--seed", SEED, "--repeats", OBJECT_FREE)
        made = turnout("campaign", "virtual", *options, "--out", str(folder))
        fresh = timed_builds(folder, fresh=True)
        again = timed_builds(folder, fresh=False)
        count = len(read_sheet(find_sheet(folder)).runs)
        write_section("Campaigns", section(count, made=made, fresh=fresh, again=again))
        draw(folder)


if __name__ == "__main__":
    main()
