"""A drive that is too soft stops short: 13 mm at Drive 2 with a tenth of its stiffness.

The soft drive leaves the rail so far open that it never touches the object.
"""

import turnout
from turnout.plot import Level, Line, Row, Sheet, draw_sheet

panel = turnout.load_panel("uic60-760-1-15")
trapped = turnout.ForeignObject(0.013, at="drive 2")
gaps, forces, throws = [], [], {}
for number, stiffness in enumerate((81e3, 810e3)):
    changed = panel.with_overrides({"drive.2.stiffness": stiffness})
    throw = turnout.simulate(changed, foreign_object=trapped)
    throws[stiffness] = throw
    there = throw.sel(time=slice(4.4, None), drive="2")
    style = {"label": f"{stiffness / 1e3:g} kN/m", "colour": number, "dash": number}
    gaps.append(Line(x=there["time"].values, y=1e3 * there["drive_gap"].values, **style))
    forces.append(Line(x=there["time"].values, y=1e-3 * there["drive_force"].values, **style))
sheet = Sheet(
    name="drive-2-stiffness",
    title="13 mm at Drive 2, by the stiffness of Drive 2",
    caption="",
    x_label="Time [s]",
    rows=(
        Row("Gap at Drive 2\n[mm]", tuple(gaps), (Level(13.0, "object"),)),
        Row("Force of Drive 2\n[kN]", tuple(forces)),
    ),
)
draw_sheet(sheet).savefig("drive_2_stiffness.png", dpi=110)

left = float(throws[81e3]["end_gap"].sel(drive="2"))
assert 20e-3 < left < 28e-3, f"{left} m remain at the soft drive"
assert not throws[81e3]["object_touched"]
