"""13 and 29 mm half-way between the drives, at the first control contact: drives and object.

Nothing is fitted: the model has the values of the paper. The measured switch is virtual: friction
0.41 and other bushings, noise of 20 N on rods and load cell. Drive 1 ends at 3.0 and 4.5 kN; it
slips at 6 kN.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet

SIZES = (0.013, 0.029)
OTHER = {"chair.friction_coefficient": 0.41, "drive.1.stiffness": 735e3, "drive.2.stiffness": 780e3}
panel = turnout.load_panel("uic60-760-1-15")
begin = panel.movement["return"].start
chance = np.random.default_rng(11)


def forces(of, size, noise=0.0):
    """Return the three channels as a recorder shows them, averaged over 0.1 s [kN]."""
    throw = turnout.simulate(of, foreign_object=turnout.ForeignObject(size, at="sensor TKK1"))
    found = {}
    for name in ("Drive 1", "Drive 2", "Object"):
        force = throw["object_force"] if name == "Object" else throw["drive_force"]
        force = force if name == "Object" else force.sel(drive=name[-1])
        noisy = force + chance.normal(0.0, noise, force.shape)
        found[name] = 1e-3 * turnout.filtered(noisy).sel(time=slice(begin + 1.5, begin + 4.0))
    return found


model = {size: forces(panel, size) for size in SIZES}
virtual = panel.with_overrides(OTHER)
measured = {size: forces(virtual, size, noise=20.0) for size in SIZES}
time = model[0.013]["Object"]["time"].values - begin
rows = []
for name in ("Drive 1", "Drive 2", "Object"):
    lines, less = [], []
    for number, size in enumerate(SIZES):
        label = f"{1e3 * size:g} mm"
        style = {"x": time, "colour": number, "dash": 0}
        lines.append(Line(label=f"model, {label}", y=model[size][name].values, **style))
        seen = measured[size][name].values
        black = {"x": time, "colour": "#000000", "dash": number}
        lines.append(Line(label=f"measured (virtual), {label}", y=seen, **black))
        less.append(Line(label=label, y=seen - model[size][name].values, **style))
    rows += [Row(f"{name}\n[kN]", tuple(lines)), Row("difference\n[kN]", tuple(less))]
sheet = Sheet(
    name="paper-figure-11",
    title="13 and 29 mm at the first control contact (TKK1), 0.1 s mean",
    caption="",
    x_label="Time from the onset [s]",
    rows=tuple(rows),
)
draw_sheet(sheet).savefig("paper_figure_11.png", dpi=110)

largest = {size: float(model[size]["Drive 1"].max()) for size in SIZES}
assert 2.5 < largest[0.013] < largest[0.029] < 5.0, f"Drive 1 {largest} kN, it slips at 6 kN"
