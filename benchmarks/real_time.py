"""Whole panels against the clock: SB2 and the default panel, quick and waveform."""

import json
import statistics
from pathlib import Path

from tests.verification.agreement import sb2_checks
from tests.verification.reference import thinned

from benchmarks.kept import keep
from benchmarks.machine import figure, load, machine, processor_seconds, seconds_text
from benchmarks.schemes import MODES
from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel
from turnout.panel.markers import marker_offsets, marker_positions
from turnout.solver.integration import integrate
from turnout.throw.simulate import simulate

FILE = "real-time.json"
PANELS = ("sb2", "uic60-760-1-15")
OBJECTS = {"none": None, "13 mm": ForeignObject(0.013, "sleeper 6")}
ANSWERS = {"none": "sb2_none", "13 mm": "sb2_sleeper6_13mm"}
KEPT = {"quick, kept at 125 Hz": Scheme.of("quick", output_interval=8e-3)}
"""A quick throw as sweeps keep it, the least output that shows drives and gaps."""
FEWER = {"waveform to 210 Hz": Scheme.of("waveform", cutoff_frequency=210.0)}
"""On SB2, whose sections are symmetric and without dashpots, less than 300 Hz shows as much."""
REPEATS = 9


def measure(name: str, trapped: str, scheme: Scheme) -> dict[str, object]:
    """Measure one cycle: the solution, its part before the steps, and up to the dataset."""
    panel, thing = load_panel(name), OBJECTS[trapped]
    objects = resolve_objects(panel, [thing] if thing else [])
    mechanism = build_mechanism(panel, objects)
    offsets = marker_offsets(panel)[:, None]

    def solve(end: float = panel.schedule.end) -> None:
        integrate(mechanism, scheme, inputs=lambda t: marker_positions(panel, t) + offsets, end=end)

    dataset = simulate(panel, foreign_object=thing, scheme=scheme)
    found: dict[str, object] = {
        "panel": name,
        "object": trapped,
        "scheme": scheme.describe(),
        "seconds": processor_seconds(solve, count=REPEATS),
        "start": statistics.median(
            processor_seconds(lambda: solve(scheme.output_interval), count=REPEATS)
        ),
        "dataset": processor_seconds(
            lambda: simulate(panel, foreign_object=thing, scheme=scheme), count=5
        ),
        "end": panel.schedule.end,
        "load": load(),
    }
    if name == "sb2":
        checks = sb2_checks(dataset, thinned(ANSWERS[trapped]))
        failed = [check.what for check in checks if not check.passed]
        found["checks"] = f"{len(checks) - len(failed)} of {len(checks)}"
        found["failed"] = failed
    return found


def section(folder: Path) -> str:
    """Return the section, from the folder or measured now."""
    path = folder / FILE
    if path.exists():
        rows = json.loads(path.read_text(encoding="utf-8"))
    else:
        rows = [
            {"mode": mode, **measure(panel, trapped, scheme)}
            for panel in PANELS
            for mode, scheme in (KEPT | MODES | (FEWER if panel == "sb2" else {})).items()
            for trapped in OBJECTS
        ]
        keep(path, rows)
    lines = [
        f"Written by `python -m benchmarks.race` on {machine()}, at a load of up to "
        f"{max(row['load'] for row in rows):.1f}. Processor seconds: median (least to largest).",
        "",
        "One full cycle, both switch rails, every step kept but where said. *Solution* is from",
        "mechanism to history, *before steps* its part for arrangement and equilibrium; condensed",
        "rails are in memory from a run before (else some 10 ms more); *dataset* is from the panel",
        "to labelled channels and energies. *Real time* is how many times faster than the",
        "railway the solution is, and its steps alone. SB2 is judged by the checks of the",
        "[verification](verification.md); those that quick mode is not meant for are named.",
        "",
        *(f"- {mode}: {scheme.describe()}" for mode, scheme in (KEPT | MODES | FEWER).items()),
        "",
        "| panel | object | mode | solution | before steps [ms] | steps [ms] | real time "
        "| its steps | dataset | checks passed |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|---|",
    ]
    return "\n".join([*lines, *map(_row, rows)]) + "\n"


def _row(row: dict[str, object]) -> str:
    """Return one line of the table."""
    seconds, start, end = row["seconds"], float(f"{row['start']}"), float(f"{row['end']}")
    whole = statistics.median(seconds)  # type: ignore[type-var, arg-type]
    checks = f"{row.get('checks', '')}"
    if row.get("failed"):
        checks += f"; not {', '.join(row['failed'])}"  # type: ignore[arg-type]
    cells = (
        row["panel"], row["object"], row["mode"], seconds_text(seconds),  # type: ignore[arg-type]
        figure(1e3 * start), figure(1e3 * (whole - start)),  # type: ignore[operator]
        figure(end / whole), figure(end / (whole - start)),  # type: ignore[operator]
        seconds_text(row["dataset"]), checks,  # type: ignore[arg-type]
    )  # fmt: skip
    return "| " + " | ".join(f"{cell}" for cell in cells) + " |"
