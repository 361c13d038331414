"""The gap along the rail while it closes on a 31 mm object at sleeper 6.

The tip comes home, the middle stays up.
"""

import turnout
from turnout.figures import draw_sheet, gap_sheet

panel = turnout.load_panel("uic60-760-1-15")
throw = turnout.simulate(panel, foreign_object=turnout.ForeignObject(0.031, at="sleeper 6"))
draw_sheet(gap_sheet(throw)).savefig("gap_over_time.png", dpi=110)

gap = throw["gap"].sel(rail="straight").isel(time=-1)
assert 30.8e-3 < float(gap.sel(x=3.6)) < 31e-3
assert float(gap.sel(x=0.0)) < 3e-3, f"{float(gap.sel(x=0.0))} m at the toe"
