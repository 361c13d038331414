"""Drive forces by object size at sleeper 6: the larger the object, the sooner and the higher.

5 mm changes nothing; 13 mm adds 0.82 kN at Drive 2; at 31 mm the drive slips.
"""

import turnout
from turnout.figures import Level, Line, Row, Sheet, draw_sheet, shade_of

SIZES = (0.0, 0.005, 0.010, 0.013, 0.020, 0.026, 0.031)
panel = turnout.load_panel("uic60-760-1-15")
throws = {}
for size in SIZES:
    trapped = turnout.ForeignObject(size, at="sleeper 6") if size else None
    throws[size] = turnout.simulate(panel, foreign_object=trapped).sel(time=slice(4.4, None))


def lines(channel, **choice):
    return tuple(
        Line(label=f"{1e3 * size:g} mm" if size else "no object", x=throw["time"].values,
             y=1e-3 * throw[channel].sel(choice).values, colour=shade_of(number / 6), dash=number)
        for number, (size, throw) in enumerate(throws.items())
    )  # fmt: skip


sheet = Sheet(
    name="object-sizes",
    title="Closing, with objects of several sizes at sleeper 6",
    caption="",
    x_label="Time [s]",
    one_legend=True,
    rows=(
        Row("Object force\n[kN]", lines("object_force")),
        Row("Drive 1\n[kN]", lines("drive_force", drive="1")),
        Row("Drive 2\n[kN]", lines("drive_force", drive="2"), (Level(6.85, "slips"),)),
    ),
)
draw_sheet(sheet).savefig("object_sizes.png", dpi=110)

ends = {size: float(throw["drive_force"].sel(drive="2")[-1]) for size, throw in throws.items()}
assert 600 < ends[0.013] - ends[0.0] < 1000, f"13 mm adds {ends[0.013] - ends[0.0]} N"
assert abs(ends[0.005] - ends[0.0]) < 1
assert ends[0.031] > 6840
