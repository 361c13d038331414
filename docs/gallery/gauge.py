"""A wheel levers the rail about an object: the track is narrowest where the wheel is not.

With 13 mm at sleeper 6 the gauge is 12.9 mm narrow at rest. A flange force of 40 kN closes the gap
where the wheel is, and opens it on the other side of the object, to 17 mm. A wheel that also
presses 50 kN on the rail holds it down, which matters most at small flange forces.
"""

import turnout
from turnout.figures import plot_gauge

panel = turnout.load_panel("uic60-760-1-15")
trapped = turnout.ForeignObject(0.013, at="sleeper 6")
gauge = turnout.gauge_under_wheel(
    panel, lateral=[20e3, 40e3], vertical=[0.0, 50e3], foreign_object=trapped
)
plot_gauge(gauge).savefig("gauge.png", dpi=110)

narrowed = 1.435 - float(gauge["gauge"].isel(load=1).min())
assert 16.9e-3 < narrowed < 17.1e-3, f"{narrowed} m"
