"""What the slide chairs carry, and where the rail lifts off.

A trapped object presses above the foot, so it twists the rail and takes load off the chairs near
it. The open rail hangs free at its tip.
"""

import turnout
from turnout.figures import chair_sheet, draw_sheet

panel = turnout.load_panel("uic60-760-1-15")
throw = turnout.simulate(panel, foreign_object=turnout.ForeignObject(0.031, at="sleeper 6"))
draw_sheet(chair_sheet(throw)).savefig("chair_forces.png", dpi=110)

load = throw["chair_normal_force"].sel(rail="straight")
weight = float(load.isel(time=0).sum())
assert 7.5e3 < weight < 9e3, f"{weight} N rest on the chairs of a rail"
