"""Time the work before the first step: sections, beams, reduction.

    python -m benchmarks.build

writes a section of docs/evidence/performance.md. One core. "Cold" starts with an empty cache in a
new process, "from files" in a new process with what that one left, "in memory" repeats it.
Importing Python packages is separate, it is no build.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile

from benchmarks.machine import load, machine
from benchmarks.page import write_section

REPEATS = 5

PROBE = """
import json, time
began = time.process_time()
import skfem
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.rail_sections import section_values
from turnout.panel.load import load_panel
from turnout.beam import section_analysis, section_taper, shear_torsion
imported = time.process_time()
panel = load_panel("uic60-760-1-15")
loaded = time.process_time()
section_values(panel, "straight", [0.0])
sections = time.process_time()
mechanism = build_mechanism(panel)
built = time.process_time()
build_mechanism(panel.with_overrides({"chair.friction_coefficient": 0.3}))
again = time.process_time()
share = max(body.count / body.n_full for body in mechanism.rails)
print(json.dumps({
    "import": imported - began, "panel": loaded - imported, "sections": sections - loaded,
    "rails": built - sections, "again": again - built, "share": share,
}))
"""


def probe(folder: str) -> dict[str, float]:
    """Build in a new process with a cache folder; return the seconds of each part."""
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", PROBE],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | threads | {"TURNOUT_CACHE_DIR": folder},
    )
    found: dict[str, float] = json.loads(run.stdout)
    return found


def row(what: str, runs: list[dict[str, float]], *keys: str) -> str:
    """Return one line of the table: the median and the spread of a sum of parts."""
    seconds = [sum(run[key] for key in keys) for run in runs]
    spread = f"{min(seconds):.3f} to {max(seconds):.3f}"
    return f"| {what} | {statistics.median(seconds):.3f} | {spread} |"


def main() -> None:
    """Measure and write the section."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    cold, warm = [], []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            cold.append(probe(folder))
            warm.append(probe(folder))
    lines = [
        "Written by `python -m benchmarks.build`: the default panel, 14 planed sections and the",
        "stock rail's, two switch rails and two stock rails reduced. Processor seconds on",
        f"{machine()}, at a load of {load():.0f}; median and",
        f"spread of {REPEATS} runs, each in a new process.",
        "",
        "| what | median [s] | spread [s] |",
        "|---|---:|---:|",
        row("cold: sections from outlines, 14 cuts", cold, "sections"),
        row("cold: stock rail's section, beams, reduction of four rails", cold, "rails"),
        row("cold: both", cold, "sections", "rails"),
        row("from files: both", warm, "sections", "rails"),
        row("in memory, with another friction", cold, "again"),
        row("reading and checking the panel file", cold, "panel"),
        row("importing what builds", cold, "import"),
        "",
        f"Kept of a rail's degrees of freedom: at most {100 * cold[0]['share']:.1f} %.",
    ]
    write_section("Building a mechanism", "\n".join(lines))


if __name__ == "__main__":
    main()
