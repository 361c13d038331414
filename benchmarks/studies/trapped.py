"""Throw each kind of object on the default panel: the tables of docs/evidence/trapped-objects.md.

``python -m benchmarks.studies.trapped`` throws each kind and size twice in mode quick, writes the
tables, measures how long 200 throws with an ice ramp take, and writes the tables of parameters
into docs/use/objects.md.
"""

import argparse
import time
from pathlib import Path

from benchmarks.page import DOCS, put
from turnout.core.units import Dimension
from turnout.law.object_kind import DIMENSIONS, OBJECT_KINDS
from turnout.measurement.chain.recorder import ERRORS
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.drift import Drift
from turnout.throw.sequence import simulate_sequence
from turnout.throw.verdict import throw_table

PAGE = DOCS / "use" / "objects.md"
RESULTS = DOCS / "evidence" / "trapped-objects.md"
SIZES = (10, 15, 20)
PLACES = ("sleeper 6", "drive 1")
SHOWN = {"N/m^2": (1e-6, "MPa"), "m": (1e3, "mm"), "kg/m^3": (1.0, "kg/m³"), "K": (1.0, "K")}
RAMP = {"throws": 200, "drift": Drift(ice_growth="0.1 mm", temperature=("-20 degC", "-2 degC"))}


def row(kind: str, size: float, place: str) -> str:
    """Return the line of one kind and size [mm] at a place: two throws, one after the other."""
    item = ForeignObject(1e-3 * size, place, kind=kind)
    made = simulate_sequence(load_panel("uic60-760-1-15"), throws=2, foreign_object=item)
    first, second = throw_table(made)
    broken = sum(first["broken"])
    left = first["left"][0] if first["left"] else 1e-3 * size
    dented = 1e-3 * size - left > 5e-5
    change = f"breaks {broken} times" if broken > 1 else "breaks" if broken else ""
    change = change or (f"dent of {size - 1e3 * left:.1f} mm" if dented else "no")
    met = f"{1e3 * second['size'][0]:.1f} mm, {1e-3 * second['object_force_peak']:.2f} kN"
    if second["size"][0] == 0.0:
        met = "nothing"
    cells = (kind, f"{size:g} mm", f"{1e-3 * first['object_force_peak']:.2f} kN", change)
    return f"| {' | '.join((*cells, first['state'], met, second['state']))} |"


def object_table(place: str) -> str:
    """Return the table of all kinds at a place."""
    head = "| kind | size | peak force | breaks | reported | next throw meets | reported then |\n"
    head += "|---|---|---|---|---|---|---|\n"
    return head + "".join(f"{row(kind, size, place)}\n" for kind in OBJECT_KINDS for size in SIZES)


def parameter_table() -> str:
    """Return the table of all parameters, with defaults, ranges and origins."""
    lines = ["| kind | parameter | default | range | origin |", "|---|---|---|---|---|"]
    for kind, row in OBJECT_KINDS.items():
        for name, item in row.parameters.items():
            factor, unit = SHOWN[DIMENSIONS[name].unit] if name in DIMENSIONS else (1.0, "")
            default = "see below" if name == "strength" else "size"
            if item.default is not None:
                default = f"{factor * item.default:g} {unit}".rstrip()
            span = f"{factor * item.least:g} to {factor * item.most:g} {unit}".rstrip()
            lines.append(f"| {kind} | `{name}` | {default} | {span} | {item.origin} |")
    return "\n".join(lines) + "\n"


def recorder_table() -> str:
    """Return the table of all errors of a recorder, with ranges and origins."""
    lines = ["| state | key | usual | allowed | origin |", "|---|---|---|---|---|"]
    for name, item in ERRORS.items():
        unit = item.kind.unit if isinstance(item.kind, Dimension) else ""
        span = f"{item.least:g} to {item.most:g} {unit}".rstrip()
        cells = (name.replace("_", " "), f"`recorder.{name}`", item.usual, span, item.origin)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def rate() -> str:
    """Return how long throws with a growing ridge of ice take."""
    ice = ForeignObject("5 mm", "sleeper 6", kind="ice", length="2 m")
    panel = load_panel("uic60-760-1-15")
    simulate_sequence(panel, throws=2, foreign_object=ice)
    began = time.process_time()
    made = simulate_sequence(panel, foreign_object=ice, **RAMP)
    took = time.process_time() - began
    return (
        f"{RAMP['throws']} throws with a ridge of ice of 2 m that grows by 0.1 mm a throw, in mode "
        f"quick: {took:.1f} s of one processor, {RAMP['throws'] / took:.0f} throws a second; the "
        f"switch reports it first at throw {first_report(made)}.\n"
    )


def first_report(made: object) -> int:
    """Return the first throw of a sequence that lock or control report."""
    rows = throw_table(made)
    return next(item["throw"] for item in rows if item["state"] != "locked, in control")


def main() -> None:
    """Write the tables between their marks in the pages."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    found = {"rate": rate()} | {place: object_table(place) for place in PLACES}
    write(PAGE, {"parameters": parameter_table(), "recorder": recorder_table()})
    write(RESULTS, found)


def write(page: Path, parts: dict[str, str]) -> None:
    """Write parts of a page between their marks."""
    text = page.read_text(encoding="utf-8")
    for name, part in parts.items():
        text = put(text, name, f"\n{part}")
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
