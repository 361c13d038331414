"""A recorded movement and its simulation on top of each other.

The recording is synthetic: a throw with its own friction as sensors, filters and noise would have
delivered it. With a campaign of your own, name its folder instead.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet

panel = turnout.load_panel("uic60-760-1-15")
campaign = turnout.build_campaign(
    "validation-campaign", panel=panel, places=["sleeper 6"], sizes=[0.013], object_free=0, seed=5
).dataset
measured = campaign.isel(movement=int(np.flatnonzero(campaign["size"].values == 0.013)[0]))

throw = turnout.simulate(panel, foreign_object=turnout.ForeignObject(0.013, at="sleeper 6"))
simulated = turnout.filtered(throw["drive_force"]).sel(time=slice(4.4, None))
simulated = simulated.assign_coords(time=simulated["time"] - 4.4)

rows, worst = [], 0.0
for number, name in enumerate(["1", "2"]):
    both = []
    for label, force, dash in (
        ("recorded", measured["drive_force"], 1),
        ("simulated", simulated, 0),
    ):
        one = force.sel(drive=name)
        one = one.sel(time=slice(0, 4)).dropna("time")
        both.append(Line(label=label, x=one["time"].values, y=1e-3 * one.values,
                         colour=6 if dash else number, dash=dash))  # fmt: skip
    rows.append(Row(f"Drive {name}\n[kN]", tuple(both)))
    apart = both[0].y - np.interp(both[0].x, both[1].x, both[1].y)
    less = Line(label="recorded less simulated", x=both[0].x, y=apart, colour=number)
    rows.append(Row("difference\n[kN]", (less,)))
    worst = max(worst, float(np.sqrt(np.mean(apart**2))))
sheet = Sheet(
    name="validation",
    title="13 mm at sleeper 6, closing: recorded (synthetic) and simulated",
    caption="",
    x_label="Time since onset of motion [s]",
    rows=tuple(rows),
)
draw_sheet(sheet).savefig("validation.png", dpi=110)

assert worst < 0.2, f"recorded and simulated drive forces differ by {worst} kN rms"
