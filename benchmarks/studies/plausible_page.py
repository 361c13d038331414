"""The tables of docs/evidence/plausible-panels.md, from the folder of a matching of `paper-facts`.

`python -m benchmarks.studies.plausible_page FOLDER` writes them. What a matching does not throw,
sizes seen at other frictions and the whole check of `turnout panel check`, is thrown here for the
panels of the study and kept in the folder; `--check N` bounds how many are checked, at 8 s each;
`--study` leaves measurements to the panels of the study. Checked is what is shipped: the cases of
the library study `plausible-panels`, whose values are rounded.

Without FOLDER only the tables of the study's panels by machines are written: these need no
matching.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.page import EVIDENCE, put
from turnout.calibration.case import load_panel_or_case
from turnout.calibration.matching.facts import Facts, Sum, Term, load_facts
from turnout.calibration.matching.match import (
    Matching,
    Thrower,
    farthest_points,
    holds,
    match_panel,
    thrower_at,
    with_machines,
)
from turnout.calibration.matching.measures import MEASURES
from turnout.calibration.matching.survey import (
    Floats,
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
from turnout.panel.load import LoadedPanel
from turnout.throw.simulate import simulate

PAGE = EVIDENCE / "plausible-panels.md"
CHOSEN = 50
MOST_DRAWS = 400
"""Machines drawn for a panel at most."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Machines:
    """Machines with which a case of the library study meets the facts about currents.

    Attributes
    ----------
    number, draws : int
        Of the case; machines drawn until then, 0 where those of the facts file do.
    panel : LoadedPanel
        With them.
    point : ndarray, shape (n_parameters,), optional
        The last that was drawn, of which the values of machines count.
    of_file, currents : list of float
        The facts by the machines of the file and by these [A].
    """

    number: int
    draws: int
    panel: LoadedPanel
    point: Floats | None
    of_file: list[float]
    currents: list[float]


def about_currents(facts: Facts) -> tuple[Sum, ...]:
    """Return the facts whose throws are by machines."""
    return tuple(
        item
        for item in facts.facts
        if any(MEASURES[term.measure].by_machines for term in item.terms)
    )


def allowed_machines(facts: Facts, number: int) -> Machines:
    """Return the machines of the facts file, or else the first drawn that a case's facts allow.

    Unknown values of machines act on currents alone: forces of facts are of the panel without.
    They are drawn evenly, in hundredths of their ranges, by a seed of the case.

    Raises
    ------
    LookupError
        When none of `MOST_DRAWS` machines meets the facts.
    """
    panel, wanted = load_panel_or_case(f"plausible-panels:{number}"), about_currents(facts)
    rng, of_file = np.random.default_rng([facts.seed, number]), list[float]()
    for draws in range(MOST_DRAWS + 1):
        point = rng.integers(101, size=len(facts.parameters)) / 100.0 if draws else None
        machines = with_machines(facts, panel, point)
        thrower = Thrower(panel, "quick", machines)
        currents = [thrower.sum(fact, among=wanted) for fact in wanted]
        of_file = of_file or currents
        if all(map(holds, wanted, currents)):
            return Machines(
                number=number,
                draws=draws,
                panel=machines,
                point=point,
                of_file=of_file,
                currents=currents,
            )
    message = f"panel {number}: none of {MOST_DRAWS} machines meets the facts"
    raise LookupError(message)


def machines_table(facts: Facts, found: list[Machines]) -> str:
    """Return the panels that need other machines than those of the facts file."""
    unknown = [
        (number, item, *shown(item.unit))
        for number, item in enumerate(facts.parameters)
        if item.of_machine
    ]
    heads = [f"{item.name} [{unit}]" for _, item, unit, _ in unknown]
    lines = [
        "| case | 10 / 13 mm by the machine of the file [mA] | machines drawn | "
        + " | ".join(heads)
        + " | 10 / 13 mm by the last [mA] |",
        "|---:" * (4 + len(heads)) + "|",
    ]
    for row in found:
        if row.point is not None:
            before, after = (
                " / ".join(f"{1e3 * value:.1f}" for value in values)
                for values in (row.of_file, row.currents)
            )
            values = [
                f"{factor * float(item.value(row.point[number])):.4g}"
                for number, item, _, factor in unknown
            ]
            cells = [str(row.number), before, str(row.draws), *values, after]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def machine_parts(facts: Facts) -> dict[str, str]:
    """Return the tables of the study's panels by machines."""
    found = [allowed_machines(facts, number) for number in range(CHOSEN)]
    values = np.array([row.currents for row in found])
    return {
        "machines": machines_table(facts, found),
        "currents": answers_table(about_currents(facts), values),
    }


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
    """Write the tables of the study's panels by machines, and those of a complete matching."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--check", type=int, default=CHOSEN, metavar="N")
    parser.add_argument("--study", action="store_true")
    given = parser.parse_args()
    folder: Path | None = given.folder
    facts = load_facts("paper-facts")
    write(machine_parts(facts))
    if folder is None:
        return
    found = match_panel(facts, folder, count=0)
    chosen = farthest_points(found.points, CHOSEN)
    shows = survey(facts, found.points[chosen], folder)
    rows = further(folder, facts, found.points[chosen], checked=given.check)
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
