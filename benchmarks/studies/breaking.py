"""Random objects that break, in mode waveform and finer: verdicts and gaps of both.

    python -m benchmarks.studies.breaking run --count 150 --out DIR --workers 1
    python -m benchmarks.studies.breaking report DIR

Index n is one throw: a panel of `PANELS` in turn with drawn friction, clutches and stick stiffness,
and one or two objects of stone, ice or others that are drawn anew until one breaks in some scheme.
It is thrown in each of `SCHEMES`. A throw is fixed by its index; a job that was stopped goes on.
"""

from typing import Any

import numpy as np

from benchmarks.studies.resumable import Record, command_line
from turnout.core.channels import DEPENDS
from turnout.core.errors import PanelError
from turnout.core.scheme import Scheme
from turnout.law.object_kind import OBJECT_KINDS
from turnout.metric.verdict import verdict
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.throw.simulate import simulate

SEED = 20261129
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
SIZES, STRENGTHS = (5e-3, 0.035), {"stone": (2e6, 40e6), "ice": (2e6, 30e6)}
"""Of drawn objects [m, Pa]."""


def drawn_panel(number: int, random: np.random.Generator) -> LoadedPanel:
    """Return a panel with drawn friction, clutches and stick stiffness."""
    changes: dict[str, object] = {
        "chair.friction_coefficient": random.uniform(0.1, 0.5),
        "chair.stick_stiffness": float(np.exp(random.uniform(np.log(1e6), np.log(3e7)))),
    }
    panel = load_panel(PANELS[number % len(PANELS)])
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
    return ForeignObject(float(random.uniform(*SIZES)), place, kind=kind, **given)


def thrown(panel: LoadedPanel, objects: list[ForeignObject], scheme: Scheme) -> Record:
    """Throw once; return verdict, end gaps [m], breaks, and the stated range of the gaps."""
    dataset = simulate(panel, foreign_object=objects, scheme=scheme)
    judged = verdict(dataset)
    return {
        "verdict": judged.kind,
        "gap": dataset["sensor_gap"].values[..., -1].tolist(),
        "broken": dataset["object_broken"].values.tolist() if "object_broken" in dataset else [],
        "note": dataset.attrs.get("break_note", ""),
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
    texts = [f"{1e3 * item.size:.1f} mm {item.kind} {item.at} {item.strength}" for item in objects]
    return {"index": index, "panel": panel.name, "drawn": drawn, "objects": texts, **found}


def report(records: list[Record]) -> None:
    """Print how often verdicts and gaps differ from those of mode waveform."""
    for name in SCHEMES:
        off = [1e3 * _largest_difference(record, name) for record in records]
        other = [r for r in records if r[name]["verdict"] != r["waveform"]["verdict"]]
        silent = [r for r in other if DEPENDS not in (r[name]["verdict"], r["waveform"]["verdict"])]
        depends = sum(record[name]["verdict"] == DEPENDS for record in records)
        print(
            f"{name}: {depends} of {len(records)} depend on how it breaks, {len(silent)} other "
            f"verdicts unannounced, {sum(gap > CLOSE for gap in off)} gaps further off than "
            f"{CLOSE:g} mm, median {np.median(off):.4f} mm, largest {np.max(off):.2f} mm"
        )
        for record, gap in zip(records, off, strict=True):
            if gap > CLOSE or record in other:
                both = f"{record['waveform']['verdict']} / {record[name]['verdict']}"
                what = f"{record['index']} {record['panel']} {record['objects']}"
                print(f"  {what}: {both}, {gap:.2f} mm")


def _largest_difference(record: Record, name: str) -> float:
    """Return the largest difference of the end gaps of a throw from mode waveform [m]."""
    return float(np.max(np.abs(np.subtract(record[name]["gap"], record["waveform"]["gap"]))))


if __name__ == "__main__":
    command_line(result_of, report, count=150)
