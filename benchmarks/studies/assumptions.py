"""What is assumed of a switch and was not varied: the effect of each on the default panel.

    python -m benchmarks.studies.assumptions FOLDER

writes docs/evidence/assumptions.md: friction, locking, ends of the motion, fit, vertical forces;
end forces, what objects at sleeper 6 change, the size a90 there, the least gauge, and the numbers
behind the other facts of the paper. Throws are kept in FOLDER; a run that was stopped goes on.
`a90` rests on few throws of the population of sound switches (`SOUND`, `STATES`), the same draws
for all rows, so that differences say more than levels.
"""

import argparse
import json
import sys
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from benchmarks.page import EVIDENCE
from turnout.calibration.matching.facts import Facts, load_facts
from turnout.calibration.matching.match import Thrower, holds, with_machines
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
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, as_written, load_panel
from turnout.study.design import Drawn
from turnout.study.distribution import Distribution
from turnout.study.study import Study
from turnout.study.sweep.read import open_batches
from turnout.study.sweep.run import throw_study
from turnout.study.variable import Variable, value_kind
from turnout.throw.simulate import simulate

PAGE = EVIDENCE / "assumptions.md"
PANEL, PLACE = "uic60-760-1-15", "sleeper 6"
SIZES = (0.010, 0.013)
SOUND, STATES = 150, 20
"""Throws of the population for an a90, and how many of them are thrown with objects."""
BEYOND = (2.0e-3, 4.5e-3, 10.0e-3)
"""Sizes beyond that which is touched in nine of ten states [m]."""
MATTERS = 0.01
"""Share from which a change is named: of the peak force, or of what is no force."""
KEPT = "rows.json"
KEYS = {"forces", "peak", "gauge", "residual", "10", "13", "a90", "facts", "missed"}
"""Of a row; one that an older version kept may lack some."""
MACHINES = {
    **{"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"},
    **{"movement.return.extra_time": {}, "schedule.end": 9.5},  # the gear takes the 0.2 s; at rest
}
BAR = {"stroke": 0.014, "force": 1000.0}
LOCKS = {
    **{"machine.jea73.lock": BAR, "machine.jea73-drive2.lock": BAR},
    **{"movement.return.start": 6.5, "schedule.end": 12.0},  # once the opening is locked
}


@dataclass(frozen=True)
class Case:
    """An assumption in place of the panel's, beside `base`, and the item that it belongs to."""

    name: str
    values: dict[str, Any] = field(default_factory=dict)
    base: str = ""
    drawn: tuple[tuple[str, float, float], ...] = ()
    """Keys that differ from switch to switch in the population too, least and most in SI."""


@dataclass(frozen=True)
class Column:
    """Facts of `paper-facts` by name, or answers, in one column: values times `factor`."""

    heading: str
    names: tuple[str, ...]
    factor: float
    digits: int = 0
    force: bool = False


BUILD_UP = "d: build-up of Drive 1,"
LINE = ("friction 0.1 and 0.3 on a line", "friction 0.3 and 0.5 on a line")
GROWTH = tuple(
    f"c: Drive {drive}, {own} mm after {old} mm"
    for drive in "12"
    for old, own in pairwise((5, 10, 13, 16, 18, 21, 23, 26, 29, 31))
)
OBJECTS = (
    Column("a: left at Drive 2 [mm]", ("a: left at Drive 2 with 81 kN/m",), 1e3, 1),
    Column("b: sound gap at TKK1 [mm]", ("b: 5 mm at sleeper 6 is not touched",), 1e3, 2),
    Column("c: least growth [N]", GROWTH, 1.0, force=True),
    Column(
        "c: 29 mm, travel until slip [mm]", ("c: 29 mm at sleeper 6, travel left until slip",),
        1e3, 2,
    ),
    Column(
        "d: the other drive less a quarter, 13 mm at Drive 1 / 2 [N]",
        tuple(
            f"d: 13 mm at Drive {own}, Drive {other} less a quarter of Drive {own}"
            for own, other in ("12", "21")
        ),
        1.0, force=True,
    ),
    Column(
        "d: build-up, 75 / 750 / 7500 kN/m [kN/s]",
        tuple(f"{BUILD_UP} {stiffness} kN/m" for stiffness in (75, 750, 7500)), 1e-3, 1,
    ),
)  # fmt: skip
SWITCH = (
    *(
        Column(
            f"e: Drive {drive} off a line, 0.1 to 0.3 / 0.3 to 0.5 [N]",
            tuple(f"e: Drive {drive}, {pair}" for pair in LINE), 1.0, force=True,
        )
        for drive in "12"
    ),
    Column("g: flangeway [mm]", ("g: least flangeway",), 1e3, 1),
    Column("g: margin [%]", ("g: least margin",), 1e2, 1),
    *(
        Column(
            f"g: misses lock by, 3 / 5 mm at Drive {drive} [mm]",
            (f"g: 3 mm at Drive {drive}, locks", f"g: 5 mm at Drive {drive}, refused"), 1e3, 2,
        )
        for drive in "12"
    ),
    Column(
        "h: Drive 2's current, 10 / 13 mm [mA]",
        tuple(f"h: {size} mm there, current of Drive 2 by" for size in (10, 13)), 1e3,
    ),
)  # fmt: skip


def fit(gap: float) -> dict[str, Any]:
    """Return a fit of the panel's shape with another height [m]."""
    own = load_panel(PANEL).rail["straight"].fit_gap
    height = 4.6e-3  # as the panel's file says
    return {"rail.fit_gap.value": [gap / height * value for value in own.value]}  # type: ignore[union-attr]


@cache
def dry_third() -> dict[str, Any]:
    """Return a film of grease that is dry over the last third of each chair's own way to closed."""
    panel = load_panel(PANEL)
    shape = build_mechanism(panel, ()).shapes[panel.instrumented_rail]
    given: dict[str, Any] = {}
    for name, chair in panel.chair.items():
        way = float(shape.travel_at(np.array([chair.x]))[0])
        given[f"chair.{name}.friction_opening"] = [0.0, round(way / 3.0, 4)]
        given[f"chair.{name}.friction_state"] = ["dry", "greased"]
    return given


AT_REST = (("chair.static_ratio", 1.0, 1.3), ("chair.stribeck_speed", 1e-3, 20e-3))
"""As the ranges of `paper-facts`."""
BARE, DRIVEN = "the panel as it is", "machines in place of markers"


def cases() -> list[Case]:
    """Return all rows of the table."""
    states = ("sound", "dry", "rain", "rust", "greased")
    every_third = {f"chair.{number}.roller_lift": 2e-3 for number in range(2, 26, 3)}
    return [
        Case(BARE),
        *(Case(f"chairs: {name}", {"chair.friction_state": name}, BARE) for name in states),
        Case("chairs: greased, dry in the third next to the closed rail", dry_third(), BARE),
        Case("level at rest 1.2 times", {"chair.static_ratio": 1.2}, BARE),
        Case("the same, 1 to 1.3 times from switch to switch", {}, BARE, AT_REST),
        Case(DRIVEN, MACHINES, BARE),
        Case("machines with lock bars, 14 mm and 1 kN", MACHINES | LOCKS, DRIVEN),
        Case("clamp locks, 60 mm of lost motion", {"drive.lost_motion": 0.06}, BARE),
        Case("ends of the motion 0.1 s", {"movement.ramp": 0.1}, BARE),
        Case("ends of the motion 0.6 s", {"movement.ramp": 0.6}, BARE),
        Case("fit gap 0", fit(0.0), BARE),
        Case("fit gap 2.5 mm", fit(2.5e-3), BARE),
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


def figures(panel: LoadedPanel, case: Case, folder: Path, facts: Facts) -> dict[str, Any]:
    """Return the numbers of a row [N], [m]."""
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
    found["a90"] = smallest_seen(panel, case, folder)
    return found | behind_facts(panel, facts)


def behind_facts(panel: LoadedPanel, facts: Facts) -> dict[str, Any]:
    """Return the numbers behind facts in SI, and the facts that a panel does not meet.

    Drives with lost motion have no machines, so no currents.
    """
    by_machines, lacking = None, any(drive.lost_motion for drive in panel.drive.values())
    if not lacking:
        by_machines = with_machines(facts, panel)
    thrower, wanted = Thrower(panel, by_machines), (*facts.facts, *facts.answers)
    shown = {name for column in (*OBJECTS, *SWITCH) for name in column.names}
    wanted = tuple(item for item in wanted if item in facts.facts or item.name in shown)
    if lacking:
        wanted = tuple(item for item in wanted if not item.name.startswith("h:"))
    values = {item.name: thrower.sum(item) for item in wanted}
    missed = [f.name for f in facts.facts if f in wanted and not holds(f, values[f.name])]
    return {"facts": values, "missed": missed}


def smallest_seen(panel: LoadedPanel, case: Case, folder: Path) -> float:
    """Return the linear bound of a90 at the place, from few throws of the population [m]."""
    whole, first = (
        with_drawn(reference_study(panel, count=count), case.drawn) for count in (SOUND, STATES)
    )
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


def with_drawn(study: Study, drawn: tuple[tuple[str, float, float], ...]) -> Study:
    """Return a study that draws further keys evenly, after its own: these stay as they are."""
    for key, least, most in drawn:
        law = Distribution(kind="uniform", parameters={"minimum": least, "maximum": most})
        design, copula = study.design, study.design.copula
        design = replace(
            design,
            drawn=(*design.drawn, Drawn(name=key, law=law)),
            copula=None if copula is None else block_diag(copula, np.ones((1, 1))),
        )
        variable = Variable(name=key, key=key, kind=value_kind(study.panel, key))
        study = replace(study, design=design, variables={**study.variables, key: variable})
    return study


def _residual(dataset: xr.Dataset) -> float:
    """Return the energy residual over the work of the markers [-]."""
    work = float(np.abs(dataset["work_markers"]).max())
    return float(np.abs(dataset["energy_residual"]).max()) / work


def all_figures(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the rows by name; those that the folder has whole are not made again."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / KEPT
    known: dict[str, dict[str, Any]] = json.loads(path.read_text()) if path.exists() else {}
    panel, facts = load_panel(PANEL), load_facts("paper-facts")
    for number, case in enumerate(cases()):
        if not known.get(case.name, {}).keys() >= KEYS:
            made = as_written(panel.with_overrides(case.values)) if case.values else panel
            known[case.name] = figures(made, case, folder / f"case-{number}", facts)
            path.write_text(json.dumps(known, indent=1))
            print(case.name, file=sys.stderr, flush=True)
    return known


def marked(text: str, change: float, whole: float) -> str:
    """Return a text, in bold where the change is more than a share of a whole, or not finite."""
    return text if abs(change) <= MATTERS * abs(whole) else f"**{text}**"


def table(known: dict[str, dict[str, Any]]) -> str:
    """Return the rows; end forces and what objects change are changes from the row's base."""
    lines = [
        "| in place of the panel's | Drive 1 [N] | Drive 2 [N] | 10 mm: Drive 2 by [N], gap [mm] "
        "| 13 mm: Drive 2 by [N], gap [mm] | a90 [mm] | least gauge, none / 13 mm [mm] |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for case in cases():
        own = known[case.name]
        base, peak = known[case.base or case.name], known[case.base or case.name]["peak"]
        first = [f"{value:.0f}" for value in own["forces"]]
        if case.base:
            changes = np.subtract(own["forces"], base["forces"])
            first = [marked(f"{change:+.0f}", change, peak) for change in changes]
        cells = [case.name, *first]
        for size in SIZES:
            of_size, of_base = own[f"{1e3 * size:.0f}"], base[f"{1e3 * size:.0f}"]
            change = of_size["change"][1]
            text = marked(f"{change:.0f}", change - of_base["change"][1], peak)
            cells.append(f"{text}, {1e3 * of_size['gap']:.2f}")
        seen = own["a90"]
        told = f"{1e3 * seen:.1f}" if np.isfinite(seen) else "-"
        cells.append(marked(told, seen - base["a90"], base["a90"]))
        gauges = [(row["gauge"], row["13"]["gauge"]) for row in (own, base)]
        pairs = zip(*gauges, strict=True)
        cells.append(" / ".join(marked(f"{1e3 * g:.1f}", g - old, old) for g, old in pairs))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def facts_table(known: dict[str, dict[str, Any]], columns: tuple[Column, ...]) -> str:
    """Return the numbers behind facts; of growth the least."""
    heads = [column.heading for column in columns]
    lines = ["| in place of the panel's | " + " | ".join(heads) + " |"]
    lines.append("|---|" + "--:|" * len(columns))
    for case in cases():
        if case.drawn:  # the panel itself is that of its base
            continue
        base = known[case.base or case.name]
        cells = [case.name]
        for column in columns:
            own, old = (
                [row["facts"].get(name, np.nan) for name in column.names]
                for row in (known[case.name], base)
            )
            if column.names is GROWTH:
                own, old = [min(own)], [min(old)]
            cells.append(
                " / ".join(
                    marked(
                        f"{column.factor * value:.{column.digits}f}".replace("nan", "-"),
                        value - before,
                        base["peak"] if column.force else before,
                    )
                    for value, before in zip(own, old, strict=True)
                )
            )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def missed(known: dict[str, dict[str, Any]]) -> str:
    """Return the facts that a row does not meet, row by row."""
    rows = [(case.name, known[case.name]["missed"]) for case in cases() if not case.drawn]
    return "\n".join(f"- {name}: {'; '.join(facts) or 'none'}" for name, facts in rows)


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
**Bold**: differs from the first row, or the row that it builds on, by more than
{100 * MATTERS:g} %: of the peak force where it is a force, else of the value in that row. Gauge is
less the nominal one.

a90 is the linear bound of `turnout limit` by force at sleeper 6 alone, from {SOUND} sound throws
and {STATES} states with objects, drawn alike for all rows: an estimate whose differences say more
than its level. "-": larger than what was thrown, {1e3 * BEYOND[-1]:g} mm beyond the size that is
touched in nine of ten states. Largest energy residual over the work of the drives:
{residual:.0e}.

{table(known)}

## On the other facts of the paper

The numbers behind facts a to e, g and h of the facts file
[`paper-facts`](plausible-panels.md), which says how each is taken and what its limits are.
a: 13 mm at Drive 2 with 81 kN/m. c: least change of an end force from a size to the next at
sleeper 6, of both drives. d: 13 mm at a drive; below 0 the other drive changes by less than a
quarter as much. g: below 0 the switch locks; where a drive slips, as on rust, what is missed is
the travel of its slip. h: with machines in place of markers, Drive 2 without
the extra time of its marker, which its gear takes; clamp locks have none.

{facts_table(known, OBJECTS)}

{facts_table(known, SWITCH)}

Facts that a row does not meet. The panel was matched without these assumptions;
[the plausible panels](plausible-panels.md) are matched with them.

{missed(known)}

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
