"""What friction costs: the force with which each drive slides the rails home.

It grows in proportion to the friction of the chairs. What bends the rails is taken off: the force
of a throw without friction.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet

FRICTION = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
panel = turnout.load_panel("uic60-760-1-15")
throws = [turnout.simulate(panel.with_overrides({"chair.friction_coefficient": mu}))
          for mu in (0.0, *FRICTION)]  # fmt: skip
plateau = [t["drive_force"].sel(time=slice(5.2, 6.8)).mean("time") for t in throws]
slides = {d: np.array([float((t - plateau[0]).sel(drive=d)) for t in plateau[1:]]) for d in "12"}
lines = tuple(
    Line(label=f"Drive {d}", x=FRICTION, y=1e-3 * force, colour=number, dash=number,
         style="line and marks", symbol=("circle", "square")[number])
    for number, (d, force) in enumerate(slides.items())
)  # fmt: skip
sheet = Sheet(
    name="friction-sweep",
    title="Sliding force on the return without an object, by friction",
    caption="",
    x_label="Friction coefficient of all chairs",
    rows=(Row("Drive force [kN]", lines),),
)
draw_sheet(sheet).savefig("friction_sweep.png", dpi=110)

slope, start = np.polyfit(FRICTION, slides["2"], 1)
assert abs(start) < 0.05 * slides["2"].max(), f"{start} N are left without friction"
assert 3e3 < slope < 1e4, f"Drive 2 gains {slope} N for each unit of friction"
