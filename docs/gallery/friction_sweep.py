"""What friction costs: force of each drive at the end of a throw without an object.

It grows in proportion to the friction of the chairs, so dry chairs look like a small object.
"""

import numpy as np

import turnout
from turnout.plot import Level, Line, Row, Sheet, draw_sheet

FRICTION = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
panel = turnout.load_panel("uic60-760-1-15")
throws = [turnout.simulate(panel.with_overrides({"chair.friction_coefficient": mu}))
          for mu in FRICTION]  # fmt: skip
ends = {d: np.array([float(t["drive_force"].sel(drive=d)[-1]) for t in throws]) for d in "12"}
lines = tuple(
    Line(label=f"Drive {d}", x=FRICTION, y=1e-3 * force, colour=number, dash=number,
         style="line and marks", symbol=("circle", "square")[number])
    for number, (d, force) in enumerate(ends.items())
)  # fmt: skip
sheet = Sheet(
    name="friction-sweep",
    title="End force on the return without an object, by friction",
    caption="",
    x_label="Friction coefficient of all chairs",
    rows=(Row("Drive force [kN]", lines, (Level(6.0, "slips"),)),),
)
draw_sheet(sheet).savefig("friction_sweep.png", dpi=110)

slope, start = np.polyfit(FRICTION, ends["2"], 1)
assert abs(start) < 0.05 * ends["2"].max(), f"{start} N are left without friction"
assert 8e3 < slope < 1e4, f"Drive 2 gains {slope} N for each unit of friction"
