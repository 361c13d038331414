"""The panel from above, with its rails bent by an object half-way between the drives.

Sleepers, chairs, fastenings, drives, links and control contacts stand where the panel file puts
them. The gap below is that of a simulated throw with 31 mm at sleeper 6.
"""

import turnout
from turnout.figures import plot_plan

panel = turnout.load_panel("uic60-760-1-15")
throw = turnout.simulate(panel, foreign_object=turnout.ForeignObject(0.031, at="sleeper 6"))
plot_plan(panel, dataset=throw).savefig("paper_figure_2_6.png", dpi=110)

assert len(panel.sleeper) == 11, "sleepers between the drives"
assert panel.sensor["TKK1"].x == panel.sleeper["6"].x, "the first control contact is at sleeper 6"
gap = float(throw["sensor_gap"].sel(sensor="TKK1")[-1])
assert 30.5e-3 < gap < 31.5e-3, f"{gap} m at TKK1"
