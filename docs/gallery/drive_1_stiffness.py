"""How stiff a drive is decides how steeply its force builds up on a 13 mm object beside it.

Drive 1 at a tenth, at its value and at ten times that.
"""

import numpy as np

import turnout
from turnout.plot import Level, Line, Row, Sheet, draw_sheet

panel = turnout.load_panel("uic60-760-1-15")
trapped = turnout.ForeignObject(0.013, at="drive 1")
lines, rates = [], {}
for number, stiffness in enumerate((75e3, 750e3, 7500e3)):
    changed = panel.with_overrides({"drive.1.stiffness": stiffness})
    throw = turnout.simulate(changed, foreign_object=trapped).sel(time=slice(6.5, None))
    time, force = throw["time"].values, throw["drive_force"].sel(drive="1").values
    low, high = force[time > float(throw["contact_time"])].min(), force.max()
    share = (force - low) / (high - low)
    rising = (time > float(throw["contact_time"])) & (share > 0.2) & (share < 0.8)
    rates[stiffness] = np.polyfit(time[rising], force[rising], 1)[0]
    lines.append(Line(label=f"{stiffness / 1e3:g} kN/m", x=time, y=1e-3 * force, colour=number,
                      dash=number))  # fmt: skip
sheet = Sheet(
    name="drive-1-stiffness",
    title="13 mm at Drive 1: build-up of its force, by its stiffness",
    caption="",
    x_label="Time [s]",
    rows=(Row("Force of Drive 1 [kN]", tuple(lines), (Level(6.0, "slips"),)),),
)
draw_sheet(sheet).savefig("drive_1_stiffness.png", dpi=110)

assert 15e3 < rates[750e3] < 29e3, f"{rates[750e3]} N/s at 750 kN/m"
assert rates[75e3] < 3e3 < rates[750e3] < rates[7500e3]
