"""Global error of every channel against its cost; writes a section and a figure.

    python -m benchmarks.accuracy [FOLDER] [--again] [--cases CASE ...]

The reference is turnout's own with steps of 0.05 ms and all modes, cached in FOLDER (default
build/accuracy), as is every run, so that an interrupted one goes on; `--again` repeats the runs
(after a change of the solver) and keeps the references; remove FOLDER where what a throw starts
from has changed. `--cases` leaves out what is not named.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import xarray as xr

from benchmarks.accuracy_page import draw, section
from benchmarks.errors import Error, Run, contact_late, errors
from benchmarks.kept import keep
from benchmarks.machine import load, processor_seconds
from benchmarks.page import ACCURACY, write_section
from benchmarks.schemes import MODES
from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel
from turnout.panel.markers import marker_offsets, marker_positions
from turnout.solver.integration import integrate
from turnout.throw.simulate import simulate
from turnout.throw.store import open_response, save_response

ROOT = Path(__file__).parents[1]
CASES = {
    "sb1": ("sb1", None),
    "sb1, object": ("sb1", "x = 3.9 m"),
    "sb2": ("sb2", None),
    "sb2, object": ("sb2", "sleeper 6"),
    "default": ("uic60-760-1-15", None),
    "default, object": ("uic60-760-1-15", "sleeper 6"),
}
STEPS = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
CUTOFFS = (100.0, 300.0)
ALL_MODES = 1e6
REFERENCE = Scheme(step=5e-5, cutoff_frequency=ALL_MODES, output_interval=1e-3)
COARSER = Scheme(step=1e-4, cutoff_frequency=ALL_MODES, output_interval=1e-3)
"""The reference once more with twice its step: its own error is a third of the difference."""


def reference(case: str, folder: Path) -> xr.Dataset:
    """Return the reference of a case, simulated once."""
    name, place = CASES[case]
    panel = load_panel(name)
    path = folder / f"reference_{panel.hash[:12]}_{'object' if place else 'none'}.nc"
    if not path.exists():
        print(f"{case}: reference ...", file=sys.stderr)
        trapped = ForeignObject(0.013, place) if place else None
        dataset = simulate(panel, foreign_object=trapped, scheme=REFERENCE)
        path.parent.mkdir(parents=True, exist_ok=True)
        save_response(dataset, path)
    return open_response(path)


def measure(case: str, name: str, scheme: Scheme, folder: Path) -> Run:
    """Run a scheme and compare it with the reference of its case."""
    panel_name, place = CASES[case]
    panel = load_panel(panel_name)
    trapped = ForeignObject(0.013, place) if place else None
    dataset = simulate(panel, foreign_object=trapped, scheme=scheme, throw=False)
    mechanism = build_mechanism(panel, resolve_objects(panel, [trapped] if trapped else []))
    offsets = marker_offsets(panel)[:, None]
    seconds = processor_seconds(
        lambda: integrate(
            mechanism,
            scheme,
            inputs=lambda t: marker_positions(panel, t) + offsets,
            end=panel.schedule.end,
        ),
        count=3,
        warm=False,
        most=2.0,
    )
    truth = reference(case, folder)
    complete = bool(dataset.attrs["complete"])
    return Run(
        case=case,
        name=name,
        step=scheme.step,
        cutoff_frequency=scheme.cutoff_frequency,
        scheme=scheme.describe(),
        modes=int(dataset.attrs["modes"]),
        halved=int(dataset.attrs["halved_steps"]),
        seconds=min(seconds),
        load=load(),
        contact_late=contact_late(dataset, truth) if complete else float("nan"),
        channels=errors(dataset, truth) if complete else {},
    )


def schemes() -> Iterator[tuple[str, Scheme]]:
    """Yield every scheme with its name."""
    yield "reference at twice the step", COARSER
    yield from MODES.items()
    for step in STEPS:
        for cutoff in CUTOFFS:
            yield (
                f"{1e3 * step:g} ms, {cutoff:g} Hz",
                Scheme(step=step, cutoff_frequency=cutoff, output_interval=max(step, 1e-3)),
            )


def kept_run(case: str, name: str, scheme: Scheme, folder: Path) -> Run:
    """Return a run from the folder, or measured now."""
    plain = "".join(c if c.isalnum() else "_" for c in f"{case}_{name}")
    path = folder / "runs" / f"{plain}.json"
    if path.exists():
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["scheme"] == scheme.describe():
            found["channels"] = {k: Error(**v) for k, v in found["channels"].items()}
            return Run(**found)
    print(f"{case}: {name} ...", file=sys.stderr)
    run = measure(case, name, scheme, folder)
    keep(path, asdict(run))
    return run


def main() -> None:
    """Measure, draw and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "build" / "accuracy")
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    given = parser.parse_args()
    if given.again:
        shutil.rmtree(given.folder / "runs", ignore_errors=True)
    try:
        runs = [
            kept_run(case, name, scheme, given.folder)
            for case in given.cases
            for name, scheme in schemes()
        ]
    except KeyboardInterrupt:
        print(f"interrupted; {given.folder} holds what is done", file=sys.stderr)
        raise SystemExit(130) from None
    draw(runs).savefig(ROOT / "docs" / "figures" / "accuracy.png", dpi=130)
    missing = [case for case in CASES if case not in given.cases]
    text = f"\nLeft out of this run: {'; '.join(missing)}.\n" if missing else ""
    write_section("Accuracy against cost", section(runs) + text, page=ACCURACY)


if __name__ == "__main__":
    main()
