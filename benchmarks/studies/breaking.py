"""Random objects that break, in mode waveform and finer: verdicts and gaps of both.

    python -m benchmarks.studies.breaking run --count 150 --out DIR --workers 1
    python -m benchmarks.studies.breaking report DIR

Index n is one throw: a panel of `PANELS` in turn, from n = 150 on any of the library, with drawn
friction, clutches and stick stiffness, and one or two objects of stone, ice or others on either
rail that are drawn anew until one breaks in some scheme. It is thrown in each of `SCHEMES`. A throw
is fixed by its index; a job that was stopped goes on.
"""

import re
from typing import Any

import numpy as np

from benchmarks.studies.resumable import Record, command_line
from turnout.core.channels import DEPENDS
from turnout.core.errors import PanelError
from turnout.core.scheme import Scheme
from turnout.law.object_kind import OBJECT_KINDS
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, library_names, load_panel
from turnout.throw.checks import checks
from turnout.throw.simulate import simulate
from turnout.throw.verdict import verdict

SEED = 20261130
COUNT = 150
PANELS = ("uic60-760-1-15", "60e1-500-1-12", "60e1-300-1-9")
SCHEMES = {
    "quick": Scheme.of("quick"),
    "waveform": Scheme.of("waveform"),
    "a quarter of the step": Scheme.of("waveform", step=2.5e-4),
    "1 kHz": Scheme.of("waveform", cutoff_frequency=1000.0),
}
FIRST = ("quick", "waveform")
"""In which an object must break."""
CLOSE = 0.3
"""Difference of end gaps that needs no range [mm]."""
ROUNDED = 0.051
"""Rounding of stated ranges [mm]."""
SIZES, STRENGTHS = (5e-3, 0.035), {"stone": (2e6, 40e6), "ice": (2e6, 30e6)}
"""Of drawn objects [m, Pa]."""


def drawn_panel(number: int, random: np.random.Generator) -> LoadedPanel:
    """Return a panel with drawn friction, clutches and stick stiffness."""
    changes: dict[str, object] = {
        "chair.friction_coefficient": random.uniform(0.1, 0.5),
        "chair.stick_stiffness": float(np.exp(random.uniform(np.log(1e6), np.log(3e7)))),
    }
    later = str(random.choice(library_names()))
    panel = load_panel(PANELS[number % len(PANELS)] if number < COUNT else later)
    for name, drive in panel.drive.items():
        level = drive.saturation_force * random.uniform(0.8, 1.4)
        changes[f"drive.{name}.saturation_force"] = level
    return panel.with_overrides(changes)


def drawn_object(panel: LoadedPanel, random: np.random.Generator) -> ForeignObject:
    """Return an object that may break, or one time in ten another one."""
    others = [kind for kind in OBJECT_KINDS if kind not in STRENGTHS]
    kind = str(random.choice([*STRENGTHS, "other"], p=[0.45, 0.45, 0.1]))
    given: dict[str, Any] = {}
    if kind == "other":
        kind = str(random.choice(others))
    else:
        least, most = STRENGTHS[kind]
        given["strength"] = float(np.exp(random.uniform(np.log(least), np.log(most))))
        given["piece"] = float(random.uniform(0.0, 0.7))
    first = min(drive.x for drive in panel.drive.values())
    place = f"x = {first + random.uniform(-0.3, 7.5):.3f} m"
    size, rail = float(random.uniform(*SIZES)), str(random.choice(list(panel.rail)))
    return ForeignObject(size, place, rail=rail, kind=kind, **given)


def thrown(panel: LoadedPanel, objects: list[ForeignObject], scheme: Scheme) -> Record:
    """Throw once; return verdict, gaps at the rests that are judged [m], breaks, note."""
    dataset = simulate(panel, foreign_object=objects, scheme=scheme)
    found = checks(dataset)
    judged, said = verdict(dataset, found), dataset.attrs
    asked = [check for check in found if check.kind == "control" and check.numbers]
    return {
        "verdict": judged.kind,
        "own": judged.own or judged.kind,
        "gap": {f"{check.name} {check.time:.2f}": check.value for check in asked},
        "broken": dataset["object_broken"].values.tolist() if "object_broken" in dataset else [],
        "said": said.get("break_note", "") or said.get("break_gaps", ""),
        "force": float(np.nanmax(dataset["object_force"].values)),
    }


def result_of(index: int) -> Record:
    """Draw until something breaks; return the throw in every scheme."""
    random = np.random.default_rng([SEED, index])
    drawn = 0
    while True:
        panel = drawn_panel(index, random)
        objects = [drawn_object(panel, random) for _ in range(1 + int(random.random() < 0.2))]
        drawn += 1
        try:
            found = {name: thrown(panel, objects, SCHEMES[name]) for name in FIRST}
        except PanelError:  # larger than the opening there
            continue
        if any(any(item["broken"]) for item in found.values()):
            break
    found |= {name: thrown(panel, objects, SCHEMES[name]) for name in SCHEMES if name not in FIRST}
    given = ("size", "kind", "at", "rail", "strength", "piece")
    texts = [" ".join(str(getattr(item, name)) for name in given) for item in objects]
    return {"index": index, "panel": panel.name, "drawn": drawn, "objects": texts, **found}


def report(records: list[Record]) -> None:
    """Print how often throws differ from those in mode waveform, and whether the coarser said so.

    What came of a throw by itself is compared, whatever finer or other throws say. Gaps that differ
    must be within a stated range.
    """
    for name in SCHEMES:
        pairs = [(record["waveform"], record[name]) for record in records]
        pairs = [pair[::-1] if name == "quick" else pair for pair in pairs]  # the coarser first
        off = [_differences(*pair) for pair in pairs]
        other = [coarse["own"] != fine["own"] for coarse, fine in pairs]
        silent = sum(
            differs and coarse["verdict"] != DEPENDS
            for differs, (coarse, _) in zip(other, pairs, strict=True)
        )
        verdicts = [record[name]["verdict"] == DEPENDS for record in records]
        told = sum(bool(record[name]["said"]) for record in records) - sum(verdicts)
        widths = [most - least for r in records for least, most in _stated(r[name]["said"])]
        most = [max((gap for gap, _ in gaps), default=0.0) for gaps in off]
        outside = [max((gap for gap, said in gaps if not said), default=0.0) for gaps in off]
        print(
            f"{name}: {sum(verdicts)} of {len(records)} depend on how it breaks, {told} others "
            f"name gaps, ranges of at most {max(widths, default=0.0):.1f} mm; {sum(other)} other "
            f"verdicts, {silent} unannounced; {sum(gap > CLOSE for gap in most)} with gaps further "
            f"off than {CLOSE:g} mm, {sum(gap > CLOSE for gap in outside)} outside a stated range; "
            f"median {np.median(most):.4f} mm, largest {max(most):.2f} mm"
        )
        for record, (coarse, fine), gap, differs in zip(records, pairs, most, other, strict=True):
            if gap > CLOSE or differs:
                what = f"{record['index']} {record['panel']} {record['objects']}"
                said = coarse["said"] or "nothing said"
                print(f"  {what}: {coarse['own']} / {fine['own']}, {gap:.2f} mm; {said}")


def _differences(coarse: Record, fine: Record) -> list[tuple[float, bool]]:
    """Return how far gaps are apart [mm], and whether the coarser states ranges with the finer."""
    found = []
    for at in coarse["gap"].keys() & fine["gap"].keys():
        gap, ranges = 1e3 * fine["gap"][at], _stated(coarse["said"], at.split()[0])
        said = any(least - ROUNDED <= gap <= most + ROUNDED for least, most in ranges)
        found.append((abs(gap - 1e3 * coarse["gap"][at]), said))
    return found


def _stated(said: str, name: str = r"\w+") -> list[tuple[float, float]]:
    """Return the ranges of gaps of a sensor, or of all, in a note on breaks [mm]."""
    found = re.findall(name + r"(?: after \w+)? (-?\d+\.\d)(?: to (-?\d+\.\d))? mm", said)
    return [(float(least), float(most or least)) for least, most in found]


if __name__ == "__main__":
    command_line(result_of, report, count=COUNT)
