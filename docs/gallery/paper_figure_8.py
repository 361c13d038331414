"""Both drives over time by friction, without an object, and a virtual measurement between them.

The measured switch is virtual: friction 0.41 and other bushings, noise of 20 N on each rod. Below
stands what it shows less the model at 0.4.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet, shade_of

FRICTION = (0.1, 0.2, 0.3, 0.4, 0.5)
OTHER = {"chair.friction_coefficient": 0.41, "drive.1.stiffness": 735e3, "drive.2.stiffness": 780e3}
panel = turnout.load_panel("uic60-760-1-15")
begin = panel.movement["return"].start


def closing(forces):
    return turnout.filtered(forces).sel(time=slice(begin - 0.2, begin + 4.0))


model = {}
for mu in FRICTION:
    throw = turnout.simulate(panel.with_overrides({"chair.friction_coefficient": mu}))
    model[mu] = closing(throw["drive_force"])
force = turnout.simulate(panel.with_overrides(OTHER))["drive_force"]
noise = np.random.default_rng(8).normal(0.0, 20.0, force.shape)
measured = closing(force + noise)
time = measured["time"].values - begin


def line(label, forces, drive, colour, dash=0):
    return Line(label=label, x=time, y=1e-3 * forces.sel(drive=drive).values,
                colour=colour, dash=dash)  # fmt: skip


rows = []
for drive in "12":
    by_friction = [line(f"friction {mu:g}", model[mu], drive, shade_of(number / 4), number)
                   for number, mu in enumerate(FRICTION)]  # fmt: skip
    by_friction.append(line("measured (virtual)", measured, drive, "#000000"))
    rows.append(Row(f"Drive {drive}\n[kN]", tuple(by_friction)))
    less = line("measured less model at 0.4", measured - model[0.4], drive, "#000000")
    rows.append(Row("difference\n[kN]", (less,)))
sheet = Sheet(
    name="paper-figure-8",
    title="Closing without an object, by friction of the chairs, 0.1 s mean",
    caption="",
    x_label="Time from the onset [s]",
    rows=tuple(rows),
)
draw_sheet(sheet).savefig("paper_figure_8.png", dpi=110)

sliding = slice(begin + 0.8, begin + 2.4)
apart = {mu: float(abs(measured - model[mu]).sel(time=sliding).mean()) for mu in FRICTION}
assert min(apart, key=apart.get) == 0.4, apart
