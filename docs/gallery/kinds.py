"""Kinds of objects at Drive 1: force over compression of stone, ice, snow and wood.

Each is 15 mm; metal and the paper's spring would follow the steepest line up to 5.8 kN.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet, shade_of

KINDS = ("stone", "ice", "snow", "wood")
panel = turnout.load_panel("uic60-760-1-15")
lines, peaks, rises = [], {}, {}
for number, kind in enumerate(KINDS):
    trapped = turnout.ForeignObject("15 mm", at="drive 1", kind=kind)
    throw = turnout.simulate(panel, foreign_object=trapped)
    throw = throw.sel(time=slice(4.4, None))
    gap = 1e3 * throw["gap"].sel(rail="straight").interp(x=0.3).values
    force = 1e-3 * throw["object_force"].values
    closing = (np.minimum.accumulate(gap) == gap) & (gap < 15.5)
    lines.append(
        Line(label=kind, x=15.0 - gap[closing], y=force[closing],
             colour=shade_of(number / 3), dash=number)
    )  # fmt: skip
    peaks[kind], rises[kind] = float(force.max()), float(np.diff(force)[force.argmax() - 1])

sheet = Sheet(
    name="kinds",
    title="Objects of 15 mm at Drive 1 while the rail closes",
    caption="",
    x_label="Compression [mm]",
    rows=(Row("Object force [kN]", tuple(lines)),),
)
draw_sheet(sheet).savefig("kinds.png", dpi=110)

# A stone splits at 20 MPa of its size squared, between two of the instants that are stored: the
# last force before is below that by less than what the next instant would have added.
assert 0.0 <= 4.5 - peaks["stone"] < rises["stone"] < 0.05
assert peaks["wood"] > 5.0 > peaks["ice"]
