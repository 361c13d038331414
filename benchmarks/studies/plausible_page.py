"""The tables of docs/evidence/plausible-panels.md, from the folder of a matching of `paper-facts`.

`python -m benchmarks.studies.plausible_page FOLDER` writes them. What a matching does not throw,
sizes seen at other frictions and the whole check of `turnout panel check`, is thrown here for the
panels of the study and kept in the folder; `--check N` bounds how many are checked, at 8 s each;
`--study` leaves measurements to the panels of the study. Checked is what is shipped: the cases of
the library study `plausible-panels`, whose values are rounded.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.page import EVIDENCE, put
from turnout.calibration.load_study import load_panel_or_case
from turnout.calibration.matching.facts import Facts, Sum, Term, load_facts
from turnout.calibration.matching.match import (
    Matching,
    farthest_points,
    match_panel,
    thrower_at,
)
from turnout.calibration.matching.survey import (
    answer_rows,
    combinations,
    fixed_direction,
    measurement_gains,
    ranges,
    survey,
)
from turnout.metric.panel_check import (
    blind_concerns,
    concerns,
    resting_concerns,
    supply_concerns,
    unusual_concerns,
)
from turnout.metric.stability import FACTORS, friction_stability
from turnout.throw.simulate import simulate

PAGE = EVIDENCE / "plausible-panels.md"
CHOSEN = 50
FRICTIONS = (0.3, 0.4, 0.5)
NEAR = 1.1
"""Gap at Drive 2 that parts the panels in which fact f holds from 0.3 on, as found [mm]."""
UNITS = {"m": ("mm", 1e3), "N": ("kN", 1e-3), "N/m": ("kN/m", 1e-3), "N/s": ("kN/s", 1e-3)}
UNITS |= {"N m/rad": ("kN m/rad", 1e-3), "m/s": ("mm/s", 1e3), "A": ("mA", 1e3)}


def shown(unit: str) -> tuple[str, float]:
    """Return the unit of a table, and the factor from SI to it."""
    return UNITS.get(unit, (unit or "-", 1.0))


def waves_table(found: Matching) -> str:
    """Return panels tried and accepted wave by wave."""
    rows = ["| wave | tried | accepted | share of the ranges left |", "|---:|---:|---:|---:|"]
    for wave in sorted({item.wave for item in found.tried}):
        own = [item for item in found.tried if item.wave == wave]
        good = sum(item.accepted for item in own)
        rows.append(f"| {wave + 1} | {len(own)} | {good} | {own[0].share:.2g} |")
    return "\n".join(rows)


def ranges_table(facts: Facts, points: Any) -> str:
    """Return the numbers before and after, those that the facts fix most first."""
    rows = [
        "| number | unit | stated | accepted, 5 to 95 % | least ... most | left |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for item in sorted(ranges(facts, points), key=lambda item: item.left):
        unit, factor = shown(item.unit)
        cells = [f"{factor * item.minimum:.4g} to {factor * item.maximum:.4g}"]
        cells += [f"{factor * item.low:.3g} to {factor * item.high:.3g}"]
        cells += [f"{factor * item.least:.3g} ... {factor * item.most:.3g}"]
        rows.append(f"| {item.name} | {unit} | {' | '.join(cells)} | {100 * item.left:.0f} % |")
    return "\n".join(rows)


def strongest(facts: Facts, points: Any) -> str:
    """Return the three pairs that are bound most, in words."""
    pairs = combinations(facts, points, strong=0.0)[:3]
    return ", ".join(f"{pair.first} with {pair.second} {pair.correlation:+.2f}" for pair in pairs)


def pairs_list(facts: Facts, points: Any) -> str:
    """Return the strongly correlated pairs, and the combination that is fixed most."""
    pairs = combinations(facts, points)
    lines = [f"- {pair.first} and {pair.second}: {pair.correlation:+.2f}" for pair in pairs]
    parts = [f"{share:+.2f} {name}" for share, name in fixed_direction(facts, points)]
    lines = lines or [f"- no pair; the strongest are {strongest(facts, points)}"]
    return "\n".join([*lines, f"- fixed most, in shares of the ranges: {', '.join(parts)}"])


def gains_table(facts: Facts, points: Any, shows: Any) -> str:
    """Return all further measurements, the most useful first."""
    rows = [
        "| further measurement | unit | precision | spread | panels left | parameters | answers |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for item in measurement_gains(facts, points, shows.measured, shows.answers):
        unit, factor = shown(item.unit)
        cells = [f"{factor * item.precision:.3g}", f"{factor * item.spread:.3g}"]
        cells += [f"{100 * part:.0f} %" for part in (item.left, item.parameters, item.answers)]
        rows.append(f"| {item.name} | {unit} | {' | '.join(cells)} |")
    return "\n".join(rows)


def answers_table(answers: Iterable[Sum], values: Any) -> str:
    """Return how answers spread over panels."""
    rows = [
        "| answer | unit | least | 5 % | 50 % | 95 % | most |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for row in answer_rows(tuple(answers), values):
        unit, factor = shown(str(row["unit"]))
        names = ("least", "low", "median", "high", "most")
        cells = " | ".join(f"{factor * float(row[name]):.3g}" for name in names)
        rows.append(f"| {row['name']} | {unit} | {cells} |")
    return "\n".join(rows)


def kept(path: Path) -> dict[str, Any]:
    """Return the results of a folder's panels by their number."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def visible(facts: Facts, point: Any, friction: float) -> float:
    """Return the smallest size seen at sleeper 6 at a friction [m]."""
    change = (("chair.friction_coefficient", friction),)
    term = Term("visible size", "sleeper 6", "", change, 1.0)
    return thrower_at(facts, point).sum(Sum(name="f", terms=(term,), unit="m"))


def further(folder: Path, facts: Facts, points: Any, *, checked: int) -> list[dict[str, Any]]:
    """Make throws that a matching does not: sizes at other frictions, and the whole check."""
    path = folder / "further.json"
    known = kept(path)
    for number, point in enumerate(points):
        row = known.setdefault(json.dumps(list(point)), {})
        for friction in (FRICTIONS[0], FRICTIONS[-1]):
            if str(friction) not in row:
                row[str(friction)] = visible(facts, point, friction)
        if number < checked and "warnings" not in row:
            row |= whole_check(number)
        path.write_text(json.dumps(known), encoding="utf-8")
        print(f"panel {number + 1} of {len(points)}", file=sys.stderr, flush=True)
    return [known[json.dumps(list(point))] for point in points]


def whole_check(number: int) -> dict[str, Any]:
    """Return warnings of `turnout panel check` on a case of the library study, and growth rates.

    As `turnout.metric.panel_check.panel_concerns`, but with the growth rate of the worst mode at
    the panel's friction and at 1.25 times it also where all modes decay [1/s].
    """
    panel = load_panel_or_case(f"plausible-panels:{number}")
    found = [*unusual_concerns(panel), *resting_concerns(panel), *blind_concerns(panel)]
    found += [*supply_concerns(panel), *concerns(simulate(panel))]
    sliding = [friction_stability(panel, friction_factor=f) for f in FACTORS]
    warnings = [item.text for item in found] + [str(item) for item in sliding if not item.stable]
    growth = [item.worst.growth_rate for item in sliding]
    return {
        "warnings": warnings,
        "growth": growth,
        "hertz": [item.worst.frequency for item in sliding],
    }


def check_table(rows: list[dict[str, Any]]) -> str:
    """Return how fast the least damped vibration decays in the panels that were checked."""
    own = [row for row in rows if "growth" in row]
    lines = [
        "| friction | panels checked | with warnings | growth rate of the worst mode, "
        "least ... median ... most [1/s] | its frequency [Hz] |",
        "|---|---:|---:|---:|---:|",
    ]
    warned = sum(bool(row["warnings"]) for row in own)
    for number, factor in enumerate(FACTORS):
        growth = np.array([row["growth"][number] for row in own])
        hertz = np.array([row["hertz"][number] for row in own])
        cells = f"{growth.min():.3g} ... {np.median(growth):.3g} ... {growth.max():.3g}"
        span = f"{hertz.min():.3g} to {hertz.max():.3g}"
        lines.append(f"| {factor:g} times | {len(own)} | {warned} | {cells} | {span} |")
    return "\n".join(lines)


def growth_table(facts: Facts, values: Any, rows: list[dict[str, Any]]) -> str:
    """Return sizes seen by friction, apart for rails that stand off at 0.4 and others."""
    names = [item.name for item in facts.answers]
    middle = values[:, names.index("f: smallest visible object at sleeper 6")]
    gap = values[:, names.index("f: open at Drive 2, friction 0.4")]
    sizes = np.column_stack([[row["0.3"] for row in rows], middle, [row["0.5"] for row in rows]])
    lines = [
        "| at friction 0.4, open at Drive 2 | panels | seen at 0.3, 0.4, 0.5 (median) [mm] "
        "| grows 0.3 to 0.4 | grows 0.4 to 0.5 |",
        "|---|---:|---:|---:|---:|",
    ]
    for name, own in ((f"below {NEAR:g} mm", gap < 1e-3 * NEAR), ("more", gap >= 1e-3 * NEAR)):
        if own.any():
            medians = ", ".join(f"{1e3 * np.median(column):.1f}" for column in sizes[own].T)
            grows = [int((np.diff(sizes[own], axis=1)[:, n] > 0.0).sum()) for n in (0, 1)]
            lines.append(f"| {name} | {own.sum()} | {medians} | {grows[0]} | {grows[1]} |")
    return "\n".join(lines)


def write(parts: dict[str, str]) -> None:
    """Put tables on the page."""
    text = PAGE.read_text(encoding="utf-8")
    for name, content in parts.items():
        text = put(text, name, content)
    PAGE.write_text(text, encoding="utf-8")


def main() -> None:
    """Write the tables of a complete matching."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--check", type=int, default=CHOSEN, metavar="N")
    parser.add_argument("--study", action="store_true")
    given = parser.parse_args()
    folder, facts = given.folder, load_facts("paper-facts")
    found = match_panel(facts, folder, count=0)
    chosen = found.points[farthest_points(found.points, CHOSEN)]
    shows = survey(facts, chosen, folder)
    rows = further(folder, facts, chosen, checked=given.check)
    parts = {
        "waves": waves_table(found),
        "ranges": ranges_table(facts, found.points),
        "pairs": pairs_list(facts, found.points),
        "answers": answers_table(facts.answers, shows.answers),
        "growth": growth_table(facts, shows.answers, rows),
    }
    if any("growth" in row for row in rows):
        parts["check"] = check_table(rows)
    parts["gains"] = gains_table(facts, shows.points, shows)
    write(parts)
    if not given.study:
        shows = survey(facts, found.points, folder)
        write({"gains": gains_table(facts, shows.points, shows)})
    say(found, rows)


def say(found: Matching, rows: list[dict[str, Any]]) -> None:
    """Print numbers for the page's text: cost, and warnings of the panels that were checked."""
    seconds = sum(item.seconds for item in found.tried)
    throws = sum(item.throws for item in found.tried)
    print(f"{len(found.points)} of {len(found.tried)}, {throws} throws, {seconds:.0f} s")
    warned = [row["warnings"] for row in rows if "warnings" in row]
    print(f"{len(warned)} checked, {sum(map(bool, warned))} with warnings: {warned}")


if __name__ == "__main__":
    main()
