"""How long a calibration takes by the clock, on a campaign of the default panel.

    python -m benchmarks.studies.calibration_times make DIR
    python -m benchmarks.studies.calibration_times run DIR
    python -m benchmarks.studies.calibration_times report DIR

`make` writes and builds a virtual campaign of all places and sizes, its truth solved with another
mesh, shorter steps and more modes than a fit uses. `run` times the command, from the start with no
throw kept, with two processes: on 20 movements, and on all of them. Each takes its time from
DIR/results.jsonl where it was measured before; delete the file to measure again. `report` writes
into docs/evidence/calibration.md.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, read_records, run_missing
from turnout.calibration.result import load_calibration
from turnout.calibration.stages import default_plan
from turnout.panel.load import load_panel
from turnout.throw.store import open_response

PANEL = "uic60-760-1-15"
PAGE = EVIDENCE / "calibration.md"
DATASET = "campaign.nc"
SEED, WORKERS = 20261124, 2
# Throws without an object in each direction: 96 movements in all.
REPEATS = 10
# Over-travel and stress-free position are what a panel is known by to a part of a millimetre only.
TRUTH = {
    "chair.friction_coefficient": "0.33",
    "drive.1.stiffness": "860 kN/m",
    "drive.2.stiffness": "690 kN/m",
    "drive.2.over_travel_closed": "4.5 mm",
    "rail.straight.stress_free": "0.30",
}
# What is timed, its options, and what is wanted of it [s].
RUNS = (
    ("stages and joint fit on 20 movements", ("--most", "20"), 20.0),
    ("stages and joint fit on all movements", ("--most", "0"), 60.0),
)


def make(folder: Path) -> None:
    """Write and build the campaign."""
    changes = [word for key, value in TRUTH.items() for word in ("--set", f"{key}={value}")]
    options = ["--panel", PANEL, "--seed", str(SEED), "--format", "csv", "--finer"]
    options += ["--repeats", str(REPEATS), *changes]
    turnout("campaign", "virtual", "--out", str(folder / "campaign"), *options)
    turnout("campaign", "build", str(folder / "campaign"), "--out", str(folder / DATASET))


def turnout(*words: str) -> int:
    """Run the program in a process of its own and return its exit code, which may be 1."""
    code = subprocess.run([sys.executable, "-m", "turnout", *words], check=False).returncode
    assert code in (0, 1), words
    return code


def timed(folder: Path, number: int) -> Record:
    """Calibrate once, with nothing kept, and return how long that took."""
    name, options, wanted = RUNS[number]
    place = folder / f"run-{number}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    shutil.copy(folder / DATASET, place / DATASET)
    load = os.getloadavg()[0]
    used, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    words = ["-o", str(place / "calibration.toml"), "--workers", str(WORKERS)]
    code = turnout("calibrate", str(place / DATASET), "--panel", PANEL, *words, *options)
    seconds, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    found = load_calibration(place / "calibration.toml")
    true_panel = load_panel(PANEL).with_settings([f"{k}={v}" for k, v in TRUTH.items()])
    truth = {item.name: item.start for item in default_plan(true_panel).parameters}
    return {
        "index": number,
        "name": name,
        "wanted": wanted,
        "seconds": seconds,
        "processor": after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime,
        "movements": len(found.movements),
        "all": open_response(folder / DATASET).sizes["movement"],
        "throws": sum(stage.evaluations for stage in found.stages),
        "load": load,
        "code": code,
        "values": {
            item.name: [item.value, *item.interval, truth.get(item.name, item.value)]
            for item in found.parameters
        },
        "causes": list(found.fitted_causes),
        "distrust": list(found.distrust),
    }


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    lines = [
        f"Campaign of {records[0]['all']} movements of `{PANEL}`, seed {SEED}, `turnout calibrate` "
        f"with {WORKERS} processes, by the clock from the start of the program to its end. Written "
        "by `python -m benchmarks.studies.calibration_times report DIR`.",
        "",
        "| what | time | wanted | processor time | throws of the stages | load before |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['name']} | {r['seconds']:.0f} s | {r['wanted']:.0f} s | {r['processor']:.0f} s | "
        f"{r['throws']} | {r['load']:.1f} |"
        for r in records
    ]
    lines += [
        "",
        "Values of the first line, which has over-travel and stress-free position as unknowns:",
        "",
        "| parameter | truth | found | 95 % interval | holds the truth |",
        "|---|---|---|---|---|",
    ]
    for name, (value, low, high, truth) in records[0]["values"].items():
        held = "yes" if low <= truth <= high else "no"
        lines.append(
            f"| `{name}` | {truth:.5g} | {value:.5g} | {low:.5g} ... {high:.5g} | {held} |"
        )
    return lines


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", choices=("make", "run", "report"))
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    command, folder = given.command, given.folder
    if command == "make":
        make(folder)
    elif command == "run":
        run_missing(lambda missing: map(partial(timed, folder), missing), len(RUNS), folder=folder)
    else:
        lines = section(read_records(folder))
        put_section(PAGE, name="times", heading="How long it takes by the clock", lines=lines)


if __name__ == "__main__":
    main()
