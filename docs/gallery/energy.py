"""Where the work of the drives goes: almost all of it into the friction of the chairs.

The energy residual is rounding error; numerical dissipation is small beside the total.
"""

import turnout
from turnout.figures import draw_sheet, energy_sheet

panel = turnout.load_panel("uic60-760-1-15")
throw = turnout.simulate(panel, foreign_object=turnout.ForeignObject(0.013, at="sleeper 6"))
draw_sheet(energy_sheet(throw)).savefig("energy.png", dpi=110)

share = float(throw["energy_friction"][-1] / throw["work_markers"][-1])
assert 0.9 < share < 1.0, f"{share} of the work is lost to friction"
assert float(abs(throw["energy_residual"]).max()) < 1e-6 * throw.attrs["energy_scale"]
