"""13 mm at Drive 2, with a tenth of its stiffness, its stiffness and ten times that.

With 81 kN/m it stops short and never touches the object. The measured switch is virtual: friction
0.41 and other bushings, noise of 20 N on rods and load cell.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet

STIFFNESS = (81e3, 810e3, 8100e3)
OTHER = {"chair.friction_coefficient": 0.41, "drive.1.stiffness": 735e3, "drive.2.stiffness": 780e3}
panel = turnout.load_panel("uic60-760-1-15")
begin = panel.movement["return"].start
piece = turnout.ForeignObject(0.013, at="drive 2")
throws = {
    value: turnout.simulate(
        panel.with_overrides({"drive.2.stiffness": value}), foreign_object=piece
    )
    for value in STIFFNESS
}
virtual = turnout.simulate(panel.with_overrides(OTHER), foreign_object=piece)
chance = np.random.default_rng(10)


def forces(throw, noise=0.0):
    """Return the three channels as a recorder shows them, averaged over 0.1 s [kN]."""
    found = {}
    for name in ("Drive 1", "Drive 2", "Object"):
        force = throw["object_force"] if name == "Object" else throw["drive_force"]
        force = force if name == "Object" else force.sel(drive=name[-1])
        noisy = force + chance.normal(0.0, noise, force.shape)
        found[name] = 1e-3 * turnout.filtered(noisy).sel(time=slice(begin + 2.0, begin + 4.0))
    return found


model = {value: forces(throw) for value, throw in throws.items()}
measured = forces(virtual, noise=20.0)
time = measured["Object"]["time"].values - begin
rows = []
for name, seen in measured.items():
    lines = []
    for number, value in enumerate(STIFFNESS):
        style = {"label": f"{value / 1e3:g} kN/m", "colour": number, "dash": number}
        lines.append(Line(x=time, y=model[value][name].values, **style))
    lines.append(Line(label="measured (virtual)", x=time, y=seen.values, colour="#000000"))
    rows.append(Row(f"{name}\n[kN]", tuple(lines)))
    apart = seen.values - model[810e3][name].values
    rows.append(
        Row(
            "difference\n[kN]",
            (Line(label="measured less 810 kN/m", x=time, y=apart, colour="#000000"),),
        )
    )
sheet = Sheet(
    name="paper-figure-10",
    title="13 mm at Drive 2, by the stiffness of Drive 2, 0.1 s mean",
    caption="",
    x_label="Time from the onset [s]",
    rows=tuple(rows),
)
draw_sheet(sheet).savefig("paper_figure_10.png", dpi=110)

left = float(throws[81e3]["end_gap"].sel(drive="2"))
assert 25e-3 < left < 27e-3, f"{left} m remain at the soft drive"
assert not throws[81e3]["object_touched"]
