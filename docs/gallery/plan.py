"""A panel from above, and the gap along its rails when they lie closed.

Sleepers, chairs, drives, links and control contacts stand where the panel file puts them. Below,
the gaps of a simulated throw: nothing is trapped, yet the rail stands off its stock rail by its fit
between the drives, and at Drive 2, which holds it through a spring.
"""

import turnout
from turnout.figures import plot_plan

panel = turnout.load_panel("uic60-760-1-15")
throw = turnout.simulate(panel)
plot_plan(panel, dataset=throw).savefig("plan.png", dpi=110)

stand_off = float(throw["end_gap"].sel(drive="2"))
assert 1.3e-3 < stand_off < 1.5e-3, f"{stand_off} m remain at Drive 2 without an object"
