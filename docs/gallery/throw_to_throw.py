"""A ridge of ice over 60 throws: it grows in frost and melts above.

For 16 throws nothing reports it, and each differs from the one before by 0.3 mm of ice.
"""

import numpy as np

import turnout
from turnout.figures import Level, Line, Row, Sheet, draw_sheet, shade_of

panel = turnout.load_panel("uic60-760-1-15")
ridge = turnout.ForeignObject("8 mm", at="sleeper 6", kind="ice", length="1 m")
drift = turnout.Drift(
    temperature=("-15 degC", "-10 degC", "6 degC"), ice_growth="0.3 mm", melting="0.4 mm"
)
week = turnout.simulate_sequence(panel, throws=60, foreign_object=ridge, drift=drift)

throw = week["throw"].values.astype(float)
end = week.isel(time=-1)
reported = ~(end["locked"] & end["in_control"].all("sensor")).values


def line(label, values):
    return Line(label=label, x=throw, y=np.asarray(values), colour=shade_of(0.6), dash=0)


sheet = Sheet(
    name="throw-to-throw",
    title="A ridge of ice at sleeper 6 in a winter week",
    caption="",
    x_label="Throw",
    rows=(
        Row("Ice [mm]", (line("ice", 1e3 * week["object_size"].sel(object="1")),)),
        Row("End force\n[kN]", (line("Drive 2", 1e-3 * end["drive_force"].sel(drive="2")),)),
        Row("TKK1 gap\n[mm]", (line("TKK1", 1e3 * end["sensor_gap"].sel(sensor="TKK1")),),
            (Level(13.0, "limit"),)),
    ),
)  # fmt: skip
draw_sheet(sheet).savefig("throw_to_throw.png", dpi=110)

first, last = throw[reported][[0, -1]]
assert (first, last) == (17, 58), f"reported from throw {first:g} to {last:g}"
