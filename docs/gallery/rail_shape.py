"""A 13 mm object half-way between the drives bows the rail, and no control contact detects it.

The rail lies 12.97 mm open at the contact TKK1, whose limit is 13 mm: the switch is in control and
locked.
"""

import turnout
from turnout.figures import draw_sheet, shape_sheet

panel = turnout.load_panel("uic60-760-1-15")
trapped = turnout.simulate(panel, foreign_object=turnout.ForeignObject(0.013, at="sleeper 6"))
draw_sheet(shape_sheet(trapped, compare=turnout.simulate(panel))).savefig("rail_shape.png", dpi=110)

gap = float(trapped["sensor_gap"].sel(sensor="TKK1")[-1])
assert 12.9e-3 < gap < 13.0e-3, f"{gap} m at TKK1"
assert bool(trapped["locked"][-1])
