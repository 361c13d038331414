"""What is assumed of a switch and was not varied: the effect of each on the default panel.

    python -m benchmarks.studies.assumptions FOLDER

writes docs/evidence/assumptions.md: friction, locking, ends of the motion, fit, vertical forces;
end forces, what objects at sleeper 6 change, the size a90 there, and the least gauge. Throws are
kept in FOLDER; a run that was stopped goes on. `a90` rests on few throws of the population of
sound switches (`SOUND`, `STATES`), the same draws for all rows, so that differences say more than
levels.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from benchmarks.page import EVIDENCE
from turnout.calibration.matching.measures import LAST, end_forces
from turnout.detection.floor import touch_floor
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.reference import Conditions, reference_study
from turnout.detection.throws import (
    closing_time,
    floor_study,
    gaps_at,
    objects_study,
    signals_of,
    sizes_beyond,
    throws_from,
)
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.study import Study
from turnout.study.sweep.read import open_batches
from turnout.study.sweep.run import throw_study
from turnout.throw.simulate import simulate

PAGE = EVIDENCE / "assumptions.md"
PANEL, PLACE = "uic60-760-1-15", "sleeper 6"
SIZES = (0.010, 0.013)
SOUND, STATES = 150, 20
"""Throws of the population for an a90, and how many of them are thrown with objects."""
BEYOND = (2.0e-3, 4.5e-3, 10.0e-3)
"""Sizes beyond that which is touched in nine of ten states [m]."""
MATTERS = 0.01
"""Share of the peak force from which a change is named."""
KEPT = "rows.json"
MACHINES = {
    **{"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"},
    **{"movement.return.extra_time": {}, "schedule.end": 9.5},  # the gear takes the 0.2 s; at rest
}
BAR = {"stroke": 0.014, "force": 1000.0}
LOCKS = {"machine.jea73.lock": BAR, "machine.jea73-drive2.lock": BAR}


@dataclass(frozen=True)
class Case:
    """An assumption in place of the panel's, beside `base`, and the item that it belongs to."""

    name: str
    values: dict[str, Any] = field(default_factory=dict)
    base: str = ""
    population: bool = True


def fit(gap: float) -> dict[str, Any]:
    """Return a fit of the panel's shape with another height [m]."""
    own = load_panel(PANEL).rail["straight"].fit_gap
    height = 4.6e-3  # as the panel's file says
    return {"rail.fit_gap.value": [gap / height * value for value in own.value]}  # type: ignore[union-attr]


BARE, DRIVEN = "the panel as it is", "machines in place of markers"


def cases() -> list[Case]:
    """Return all rows of the table."""
    states = ("sound", "dry", "rain", "rust", "greased")
    every_third = {f"chair.{number}.roller_lift": 2e-3 for number in range(2, 26, 3)}
    return [
        Case(BARE),
        *(Case(f"chairs: {name}", {"chair.friction_state": name}, BARE) for name in states),
        Case("level at rest 1.2 times", {"chair.static_ratio": 1.2}, BARE),
        Case(DRIVEN, MACHINES, BARE),
        Case("machines with lock bars, 14 mm and 1 kN", MACHINES | LOCKS, DRIVEN),
        Case("clamp locks, 60 mm of lost motion", {"drive.lost_motion": 0.06}, BARE),
        Case("ends of the motion 0.1 s", {"movement.ramp": 0.1}, BARE),
        Case("ends of the motion 0.6 s", {"movement.ramp": 0.6}, BARE),
        Case("fit gap 0", fit(0.0), BARE),
        Case("fit gap 2.5 mm", fit(2.5e-3), BARE, population=False),
        Case("fit gap 5 mm", fit(5e-3), BARE),
        Case("rods that rise by 0.086", {"drive.rod_slope": 0.086}, BARE),
        Case("rods that fall by 0.086", {"drive.rod_slope": -0.086}, BARE),
        Case("face of 14 degrees, lifts", {"object_defaults.face_slope": 0.25}, BARE),
        Case("face of 14 degrees, presses down", {"object_defaults.face_slope": -0.25}, BARE),
        Case("5 mm below the foot at sleeper 6", {"chair.7.clearance": -5e-3}, BARE),
        Case("rollers at every third chair, 2 mm", every_third, BARE),
    ]


def thrown(panel: LoadedPanel, size: float = 0.0) -> xr.Dataset:
    """Throw with an object at the place, or none."""
    trapped = ForeignObject(size, PLACE) if size else None
    return simulate(panel, foreign_object=trapped, mode="quick")


def figures(panel: LoadedPanel, folder: Path, *, population: bool) -> dict[str, Any]:
    """Return the numbers of a row [N], [m]."""
    began = time.process_time()
    nominal = panel.gauge.nominal if panel.gauge else np.nan
    without = thrown(panel)
    forces = end_forces(without)
    found: dict[str, Any] = {
        "forces": forces.tolist(),
        "peak": float(np.abs(without["drive_force"]).max()),
        "gauge": float(without["least_gauge"]) - nominal,
        "residual": _residual(without),
    }
    for size in SIZES:
        with_object = thrown(panel, size)
        found[f"{1e3 * size:.0f}"] = {
            "change": (end_forces(with_object) - forces).tolist(),
            "gap": float(with_object["sensor_gap"].sel(sensor="TKK1")[-1]),
            "gauge": float(with_object["least_gauge"]) - nominal,
            "residual": _residual(with_object),
        }
    if population:
        found["a90"] = smallest_seen(panel, folder)
    return found | {"seconds": time.process_time() - began}


def smallest_seen(panel: LoadedPanel, folder: Path) -> float:
    """Return the linear bound of a90 at the place, from few throws of the population [m]."""
    whole, first = (reference_study(panel, count=count) for count in (SOUND, STATES))
    at = {PLACE: panel.sleeper[PLACE.split()[1]].x}

    def thrown_study(study: Study, name: str) -> xr.Dataset:
        throw_study(study, folder / name)
        return open_batches(folder / name)

    rail = panel.object_defaults.rail
    gaps = gaps_at(
        thrown_study(floor_study(first), "floor"), np.array(list(at.values())), rail=rail
    )
    sizes = sizes_beyond(touch_floor(gaps), BEYOND)
    rows = {PLACE: tuple(map(float, sizes[0]))}
    throws = throws_from(
        whole,
        thrown_study(whole, "sound"),
        thrown_study(objects_study(first, rows), "objects"),
        gap=gaps,
        where=at,
        sizes=sizes,
        signals=signals_of(whole.panel, "force"),
    )
    limit = limit_map(throws, Conditions(), closing=closing_time(panel))
    return float(limit["a90"].sel(channel="both drives").item())


def _residual(dataset: xr.Dataset) -> float:
    """Return the energy residual over the work of the markers [-]."""
    work = float(np.abs(dataset["work_markers"]).max())
    return float(np.abs(dataset["energy_residual"]).max()) / work


def all_figures(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the rows by name; those of the folder are not made again."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / KEPT
    known: dict[str, dict[str, Any]] = json.loads(path.read_text()) if path.exists() else {}
    panel = load_panel(PANEL)
    for number, case in enumerate(cases()):
        if case.name not in known:
            made = panel.with_overrides(case.values) if case.values else panel
            own = folder / f"case-{number}"
            known[case.name] = figures(made, own, population=case.population)
            path.write_text(json.dumps(known, indent=1))
            print(f"{case.name}: {known[case.name]['seconds']:.0f} s", file=sys.stderr, flush=True)
    return known


def shown(change: float, peak: float) -> str:
    """Return a change of a force in N, in bold where it matters."""
    text = f"{change:+.0f}"
    return f"**{text}**" if abs(change) > MATTERS * peak else text


def table(known: dict[str, dict[str, Any]]) -> str:
    """Return the rows; end forces and what objects change are changes from the row's base."""
    lines = [
        "| in place of the panel's | Drive 1 [N] | Drive 2 [N] | 10 mm: Drive 2 by [N], gap [mm] "
        "| 13 mm: Drive 2 by [N], gap [mm] | a90 [mm] | least gauge, none / 13 mm [mm] |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for case in cases():
        own, base = known[case.name], known.get(case.base)
        first = [f"{value:.0f}" for value in own["forces"]]
        if base is not None:
            pairs = zip(own["forces"], base["forces"], strict=True)
            first = [shown(mine - its, base["peak"]) for mine, its in pairs]
        cells = [case.name, *first]
        for size in SIZES:
            of_size, of_base = own[f"{1e3 * size:.0f}"], (base or own)[f"{1e3 * size:.0f}"]
            change = of_size["change"][1]
            text = f"{change:.0f}"
            if abs(change - of_base["change"][1]) > MATTERS * (base or own)["peak"]:
                text = f"**{text}**"
            cells.append(f"{text}, {1e3 * of_size['gap']:.2f}")
        seen = own.get("a90")
        told = f"{1e3 * seen:.1f}" if seen is not None and np.isfinite(seen) else "-"
        cells.append("not thrown" if seen is None else told)
        cells.append(f"{1e3 * own['gauge']:.1f} / {1e3 * own['13']['gauge']:.1f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def page(known: dict[str, dict[str, Any]]) -> str:
    """Return the page."""
    residual = max(
        max(row["residual"], *(row[f"{1e3 * size:.0f}"]["residual"] for size in SIZES))
        for row in known.values()
    )
    return f"""\
# What is assumed and was not varied

Written by `python -m benchmarks.studies.assumptions`: the default panel, mode quick, with one
assumption changed in a row. The first row is the panel. Below it, end forces (mean of the last
{LAST:g} s) are changes from it, those of lock bars from machines without them. What objects of 10
and 13 mm at sleeper 6 change at Drive 2, and the gap that they leave at TKK1, are of the row.
**Bold**: differs from the first row, or the row that it builds on, by more than {100 * MATTERS:g} %
of the peak force. Gauge is less the nominal one.

a90 is the linear bound of `turnout limit` by force at sleeper 6 alone, from {SOUND} sound throws
and {STATES} states with objects, drawn alike for all rows: an estimate whose differences say more
than its level. "-": larger than what was thrown, {1e3 * BEYOND[-1]:g} mm beyond the size that is
touched in nine of ten states; "not thrown" where none was. Largest energy residual over the work
of the drives: {residual:.0e}. A row takes some 12 s of processor time.

{table(known)}

Laws and sources: [friction](../theory/friction.md#friction-states),
[lock bars](../theory/machines.md#lock-bar),
[clamp locks and ends of the motion](../theory/mechanism.md#motion-of-the-markers),
[vertical forces](../theory/mechanism.md#vertical-forces), [gauge](../theory/gauge.md).
"""


def main() -> None:
    """Throw what is missing and write the page."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path)
    known = all_figures(options.parse_args().folder)
    PAGE.write_text(page(known), encoding="utf-8")


if __name__ == "__main__":
    main()
