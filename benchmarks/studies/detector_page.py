"""Tables of docs/evidence/detection-results.md from the figures of a detector in a folder.

    python -m benchmarks.studies.detector_page DIR --seed 550000

DIR and seed are those of `benchmarks.studies.detector` and `benchmarks.studies.detector_histories`;
the newest figures of that seed are printed, and nothing is computed.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.studies.detector_histories import SOFT_KINDS, SOFT_PLACES
from benchmarks.studies.detector_sets import JUDGED_SEED

Figures = Mapping[str, Any]

KINDS = {
    "sound": "sound throws",
    "dry chairs": "dry chairs under one rail after the history",
    "dry chairs, low friction": "of these from friction below 0.3",
    "dry chairs, high friction": "of these from friction above 0.3",
    "adjustment": "one drive re-adjusted by 1 mm after the history",
}
KNOWN_PLACE = {
    "alone": (0.7, 1.7, 4.1, 7.3, 10.2, 12.4, 13.1, 11.2, 9.0, 6.1, 4.3, 3.4, 3.4),
    "known": (0.6, 1.0, 3.1, 6.1, 8.7, 10.5, 11.1, 10.1, 7.7, 5.6, 4.0, 3.1, 3.1),
}
LINEAR = {
    "alone": (0.6, 1.5, 3.5, 6.7, 9.2, 10.9, 11.4, 10.5, 8.4, 5.8, 4.1, 3.3, 3.3),
    "known": (0.4, 0.9, 3.0, 5.7, 8.3, 10.0, 10.4, 9.4, 7.3, 5.4, 3.8, 3.0, 3.0),
}
"""a90 of the bounds on docs/evidence/blind-zones.md, Drive 1 to Drive 2 [mm]."""
GAPS = {"sensor TKK1": "TKK1", "sensor TKK2": "TKK2", "drive 1": "Drive 1", "drive 2": "Drive 2"}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=JUDGED_SEED)
    given = parser.parse_args()
    said = newest(given.folder, f"figures-*-{given.seed}.json")
    said |= newest(given.folder, f"histories-*-{given.seed}.json")
    if {"rates alone", "alone", "known", "unknown"} <= set(said):
        print("\n".join(goal_table(said)) + "\n")
    tables: tuple[tuple[Sequence[str], Callable[[Figures], list[str]]], ...] = (
        (("alone", "known"), places_table),
        (("rates alone", "known"), alarm_table),
        (("alone", "known"), object_table),
        (("alone", "known"), cause_table),
        (("unknown", "known"), unknown_table),
        (("alone", "known"), missed_table),
        (("5 known",), histories_table),
        (("soft",), soft_table),
        (("price",), price_table),
        (("year",), lambda said: ["year: " + ", ".join(alarms(item) for item in said["year"])]),
        (("robustness",), robustness_table),
        (("robustness known",), robustness_known_table),
    )
    for needed, table in tables:
        if set(needed) <= set(said):
            print("\n".join(table(said)) + "\n")
    for name in ("ice", "known place", "time", "other", "narrow"):
        if name in said:
            shown = {key: item for key, item in dict_of(said[name]).items() if key != "objects"}
            print(f"{name}: {json.dumps(shown)}\n")


def dict_of(item: Any) -> dict[str, Any]:
    """Return a record as it is, and a list by its numbers."""
    return item if isinstance(item, dict) else {str(i): value for i, value in enumerate(item)}


def newest(folder: Path, pattern: str) -> dict[str, Any]:
    """Return the last figures that were written under a name, or none."""
    found = sorted(folder.glob(pattern), key=lambda path: path.stat().st_mtime)
    return json.loads(found[-1].read_text()) if found else {}


def heads(places: Sequence[str]) -> list[str]:
    """Return the two lines above a table of places.

    Examples
    --------
    >>> heads(["drive 1", "sleeper 2"])
    ['| | D1 | 2 |', '|---|--|--|']
    """
    names = [name.replace("sleeper ", "").replace("drive ", "D") for name in places]
    return [f"| | {' | '.join(names)} |", "|---|" + "--|" * len(names)]


def row(label: str, values: Sequence[float], *, factor: float = 1e3, form: str = ".1f") -> str:
    """Return a line of a table, in millimetres.

    Examples
    --------
    >>> row("a90", [0.0112, 0.003])
    '| a90 | 11.2 | 3.0 |'
    """
    return f"| {label} | {' | '.join(format(factor * value, form) for value in values)} |"


def alarms(item: Mapping[str, float]) -> str:
    """Return alarms of throws, and the upper limit of their rate.

    Examples
    --------
    >>> alarms({"alarms": 7.0, "throws": 32200.0, "upper": 0.41e-3})
    '7 of 32,200, 0.41/1,000'
    """
    return f"{item['alarms']:.0f} of {item['throws']:,.0f}, {1e3 * item['upper']:.2f}/1,000"


def distinct(item: Mapping[str, float]) -> str:
    """Return how many throws there are without counting uses with other errors."""
    return f"{item['distinct']:,.0f}" if "distinct" in item else "-"


def a90_cells(found: Mapping[str, Sequence[float]]) -> list[str]:
    """Return a90 by place [mm]; if no object was missed it is at most the smallest size.

    Examples
    --------
    >>> a90_cells({"drive 1": [0.0014, 0.0017, 138, 0], "sleeper 1": [0.0021, 0.003, 138, 4]})
    ['≤ 1.4', '2.1']
    """
    return [
        ("≤ " if len(item) > 3 and not item[3] else "") + f"{1e3 * item[0]:.1f}"
        for item in found.values()
    ]


def places_table(said: Figures) -> list[str]:
    """Return a90, its limit and a90 at 1/10,000 by place."""
    lines = heads(list(said["alone"]["a90"]))
    for name, label in (("alone", "no history"), ("known", "20 throws known")):
        found = said[name]
        lines.append(f"| **{label}** | {' | '.join(a90_cells(found['a90']))} |")
        lines.append(row("a90/95", [item[1] for item in found["a90"].values()]))
        rare = a90_cells(found["a90 at 1/10,000"])
        lines.append(f"| at 1/10,000 | {' | '.join(rare)} |")
    for name, label in (("alone", "no history"), ("known", "20 throws known")):
        for bound, sizes in (("linear bound", LINEAR), ("known place", KNOWN_PLACE)):
            middle, worst = excess(said[name], sizes[name])
            lines.append(f"- {label}, over the {bound}: median {middle:.2f}, worst {worst:.2f} mm")
    return lines


def excess(found: Figures, bound: Sequence[float]) -> tuple[float, float]:
    """Return by how much a90 lies above a bound: median and largest of the places [mm]."""
    sizes = [1e3 * item[0] for item in found["a90"].values()]
    over = [own - least for own, least in zip(sizes, bound, strict=True)]
    return median(over), max(over)


def goal_table(said: Figures) -> list[str]:
    """Return the goal of each figure beside its value."""
    alone, known = said["alone"], said["known"]
    lines = ["| goal | found | met |", "|---|---|---|"]

    def add(goal: str, found: str, met: bool) -> None:
        lines.append(f"| {goal} | {found} | {'yes' if met else 'no'} |")

    for label, rates in (
        ("no history", {rate: item for rate, item in said["rates alone"].items()}),
        ("20 known", {rate: item["sound"] for rate, item in known["rates"].items()}),
    ):
        own, rare = rates["0.001"], rates["0.0001"]
        add(f"sound throws, {label}: at most 1/1,000", alarms(own), own["upper"] <= 1e-3)
        add(f"none at 1/10,000, {label}", alarms(rare), rare["alarms"] == 0)
    for name in ("dry chairs", "adjustment"):
        own = known["rates"]["0.001"][name]
        add(f"{KINDS[name]}: at most 5/1,000", alarms(own), own["upper"] <= 5e-3)
    middle, worst = excess(known, LINEAR["known"])
    shown = f"{middle:.2f} / {worst:.2f} mm"
    add("over the linear bound, 20 known: 0.7 / 1.8 mm", shown, middle <= 0.7 and worst <= 1.8)
    middle, worst = excess(alone, KNOWN_PLACE["alone"])
    shown = f"{middle:.2f} / {worst:.2f} mm"
    add("over the known place, no history: 0.5 / 1.2 mm", shown, middle <= 0.5 and worst <= 1.2)
    for kind, most in (("sound", 1.0), ("object", 1.5)):
        errors = [1e3 * known["gaps"][kind][name]["median_error"] for name in GAPS]
        shares = [100 * known["gaps"][kind][name]["coverage"] for name in GAPS]
        add(f"gaps, {kind}, 20 known: {most} mm in the median", f"{max(errors):.1f} mm",
            max(errors) <= most)  # fmt: skip
        add(f"their intervals, {kind}, 20 known: hold 93 to 97 %",
            f"{min(shares):.1f} to {max(shares):.1f} %",
            min(shares) >= 93 and max(shares) <= 97)  # fmt: skip
    for name in ("sensor TKK1", "drive 2"):
        own = known["gaps"]["object"][name]
        add(f"gaps 2 mm above the limit at {GAPS[name]}: 97 % called",
            f"{round(own['called'] * own['above'])} of {own['above']:.0f}",
            own["called"] >= 0.97)  # fmt: skip
    held = known["objects"]
    add("place, 20 known: 0.4 m in the median, 0.6 m in 90 %",
        f"{held['place_median']:.2f} / {held['place_90']:.2f} m",
        held["place_median"] <= 0.4 and held["place_90"] <= 0.6)  # fmt: skip
    add("size, 20 known: 1.5 mm in the median; 93 to 97 % in the interval",
        f"{1e3 * held['size_median']:.1f} mm; {100 * held['size_coverage']:.1f} %",
        held["size_median"] <= 1.5e-3 and 0.93 <= held["size_coverage"] <= 0.97)  # fmt: skip
    for label, found in (("no history", alone), ("20 known", known)):
        score = found["severe causes"]["macro_f1"]
        add(f"macro-F1 of severe causes, {label}: 0.90", f"{score:.3f}", score >= 0.9)
        row_of = found["causes"]["table"]["object"]
        called, count = row_of.get("dry chairs", 0), sum(row_of.values())
        add(f"objects called dry chairs, {label}: 1 %", f"{called} of {count:,}",
            called <= 0.01 * count)  # fmt: skip
    for label, scores in (("no history", said["unknown"]), ("20 known", known["unknown"])):
        name = min(scores, key=lambda item: scores[item]["severe"])
        least = scores[name]["severe"]
        add(f"area under the curve of unknown severe causes, {label}: 0.90",
            f"{least:.3f} ({name})", least >= 0.9)  # fmt: skip
    return lines


def alarm_table(said: Figures) -> list[str]:
    """Return alarms at both rates."""
    rare = said["rates alone"]
    lines = [
        "| alarms, upper 95 % limit by switches | 1/1,000 | 1/10,000 | distinct throws |",
        "|---|---|---|---|",
    ]
    cells = [alarms(rare[rate]) for rate in ("0.001", "0.0001")]
    lines.append(f"| sound throws, no history | {' | '.join(cells)} | {distinct(rare['0.001'])} |")
    known = said["known"]["rates"]
    for name, label in KINDS.items():
        cells = [alarms(known[rate][name]) for rate in ("0.001", "0.0001")]
        cells.append(distinct(known["0.001"][name]))
        lines.append(f"| {label}{', 20 known' * (name == 'sound')} | {' | '.join(cells)} |")
    return lines


def object_table(said: Figures) -> list[str]:
    """Return errors of place, size and gaps, and how their intervals hold."""
    columns = [_objects(said[name]) for name in ("alone", "known")]
    lines = ["| | no history | 20 throws known |", "|---|---|---|"]
    return lines + [f"| {name} | {columns[0][name]} | {columns[1][name]} |" for name in columns[0]]


def _objects(found: Figures) -> dict[str, str]:
    own, gaps = found["objects"], found["gaps"]
    lines = {
        "place, median / 90 %; in the 95 % interval": (
            f"{own['place_median']:.2f} / {own['place_90']:.2f} m; "
            f"{100 * own['place_coverage']:.0f} %"
        ),
        "true place in the reported set (90 % wanted)": f"{100 * own['place_in_set']:.0f} %",
        "size, median / 90 %; in the 95 % interval": (
            f"{1e3 * own['size_median']:.1f} / {1e3 * own['size_90']:.1f} mm; "
            f"{100 * own['size_coverage']:.0f} %"
        ),
    }
    for name, label in GAPS.items():
        sound, held = gaps["sound"][name], gaps["object"][name]
        lines[f"gap at {label}, median error sound / object; in the 95 % interval"] = (
            f"{1e3 * sound['median_error']:.1f} / {1e3 * held['median_error']:.1f} mm; "
            f"{100 * sound['coverage']:.1f} % / {100 * held['coverage']:.1f} %"
        )
    for name in ("sensor TKK1", "drive 2"):
        held = gaps["object"][name]
        lines[f"gaps 2 mm above their limit called, {GAPS[name]}"] = (
            f"{round(held['called'] * held['above'])} of {held['above']:.0f}"
            if held["above"]
            else "none"
        )
    return lines


def cause_table(said: Figures) -> list[str]:
    """Return how severe causes are named, and the macro-F1."""
    lines = []
    for name, label in (("alone", "no history"), ("known", "20 throws known")):
        severe, every = said[name]["severe causes"], said[name]["causes"]
        lines += ["", f"{label}: macro-F1 {severe['macro_f1']:.3f} of severe causes"]
        lines[-1] += (
            f", {macro_f1(severe['table'], few=FEW):.3f} of those with {FEW} throws at least"
        )
        for kind, counts in severe["table"].items():
            told = ", ".join(f"{word} {count}" for word, count in sorted(counts.items()))
            lines.append(f"- {kind}, {sum(counts.values())} throws: {told}")
        held = every["table"]["object"]
        lines.append(
            f"- objects called dry chairs: {held.get('dry chairs', 0)} of {sum(held.values())}"
        )
    return lines


FEW = 10
"""Throws of a cause below which its score is left out of a second macro-F1."""


def macro_f1(table: Mapping[str, Mapping[str, int]], *, few: int) -> float:
    """Return the macro-F1 over the kinds of which there are some throws at least.

    Examples
    --------
    >>> macro_f1({"sound": {"sound": 9, "object": 1}, "object": {"object": 10}}, few=10)
    0.9498...
    """
    scores = []
    for kind, counts in table.items():
        said = sum(item.get(kind, 0) for item in table.values())
        if sum(counts.values()) >= few:
            scores.append(2.0 * counts.get(kind, 0) / (said + sum(counts.values())))
    return sum(scores) / len(scores)


def unknown_table(said: Figures) -> list[str]:
    """Return the area under the curve of each cause that is left out."""
    lines = [
        "| severe cause left out | no history | 20 throws known | all with 20 known |",
        "|---|---|---|---|",
    ]
    known, alone = said["known"]["unknown"], said["unknown"]
    for name, item in known.items():
        first = f"{alone[name]['severe']:.3f}" if name in alone else "none"
        count = f"{item['severe throws']:.0f}"
        lines.append(
            f"| {name} ({count} throws) | {first} | {item['severe']:.3f} | {item['all']:.2f} |"
        )
    return lines


def missed_table(said: Figures) -> list[str]:
    """Return shares of touched objects that are missed, by size."""
    rows: dict[str, Mapping[str, Mapping[str, float]]] = {
        "detector, no history": said["alone"]["missed"],
        "detector, 20 throws known": said["known"]["missed"],
    }
    classes = list(said["known"]["missed"])
    lines = [f"| missed [%] | {' | '.join(classes)} |", "|---|" + "--|" * len(classes)]
    lines += [
        row(name, [item["detector"] for item in found.values()], factor=100, form=".0f")
        for name, found in rows.items()
    ]
    own = list(said["known"]["missed"].values())
    for name, label in (("lock", "lock"), ("sensors", "TKK"), ("objects", "objects")):
        factor = 1 if name == "objects" else 100
        lines.append(row(label, [item[name] for item in own], factor=factor, form=".0f"))
    return lines


def histories_table(said: Figures) -> list[str]:
    """Return a90 and false alarms of five throws known, and of closings alone."""
    names = ("5 known", "closings alone")
    found = {name: said[name] for name in names if name in said}
    lines = heads(list(said["5 known"]["a90"]))
    lines += [row(name, list(item["a90"].values())) for name, item in found.items()]
    return lines + [
        f"- {name}: threshold {item['threshold']:.2f}, {alarms(item['false alarms'])}"
        for name, item in found.items()
    ]


def soft_table(said: Figures) -> list[str]:
    """Return the share of called objects of each kind, and a90 by place; "-" beyond all sizes."""
    lines = [f"| | {' | '.join(SOFT_KINDS)} |", "|---|" + "--|" * len(SOFT_KINDS)]
    for known in (0, 20):
        own = [said["soft"][f"{kind}, {known} known"] for kind in SOFT_KINDS]
        called = [item["called"] for item in own]
        lines.append(row(f"called, {known} known [%]", called, factor=100, form=".0f"))
        for place, largest in SOFT_PLACES.items():
            cells = [f"{1e3 * item[place]:.1f}" if item[place] <= largest else "-" for item in own]
            lines.append(f"| a90 at {place}, {known} known | {' | '.join(cells)} |")
    touched = [said["soft"][f"{kind}, 0 known"]["touched"] for kind in SOFT_KINDS]
    return [*lines, row("touched", touched, factor=1, form=".0f")]


def price_table(said: Figures) -> list[str]:
    """Return the cost of a larger assumed discrepancy with a history."""
    lines = [
        "| with 20 throws known | false alarms | a90 at sleeper 6 | median of places |",
        "|---|---|---|---|",
    ]
    for name, item in said["price"].items():
        sizes = sorted(item["a90"].values())
        cells = (1e3 * item["a90"]["sleeper 6"], 1e3 * sizes[len(sizes) // 2])
        lines.append(
            f"| {name} | {alarms(item['false alarms'])} | {cells[0]:.1f} | {cells[1]:.1f} |"
        )
    return lines


def robustness_table(said: Figures) -> list[str]:
    """Return alarms and objects seen with errors that are not the assumed ones."""
    lines = ["| test throws | alarms | objects seen | a90 at sleeper 6 |", "|---|---|---|---|"]
    for name, item in said["robustness"].items():
        lines.append(
            f"| {name} | {item['alarms']:.0f} of {item['throws']:,.0f} | "
            f"{100 * item['seen']:.0f} % | {1e3 * item['a90 at sleeper 6']:.1f} mm |"
        )
    return lines


def robustness_known_table(said: Figures) -> list[str]:
    """Return verdicts after a history whose throws have other errors too."""
    lines = [
        "| throws, known and judged | alarms | unknown | objects seen | scatter |",
        "|---|---|---|---|---|",
    ]
    for name, item in said["robustness known"].items():
        throws = f"{item['throws']:,.0f}"
        lines.append(
            f"| {name} | {item['alarms']:.0f} of {throws} | {item['unknown']:.0f} of {throws} | "
            f"{100 * item['seen']:.0f} % | {item['scatter']:.2f}, {item['largest scatter']:.2f} |"
        )
    return lines


if __name__ == "__main__":
    main()
