"""What the drives are told to do: the markers at the far ends of their rods.

Drive 2 takes 0.2 s longer to come home than Drive 1.
"""

import turnout
from turnout.plot import Line, Row, Sheet, draw_sheet

throw = turnout.simulate(turnout.load_panel("uic60-760-1-15"))
marker = throw["drive_displacement"]
lines = [
    Line(label=f"Drive {d}", x=throw["time"].values, y=1e3 * marker.sel(drive=d).values,
         colour=number, dash=number)
    for number, d in enumerate(["1", "2"])
]  # fmt: skip
sheet = Sheet(
    name="markers",
    title="Marker motion: away through 115 mm and 75 mm with over-travel, and back",
    caption="",
    x_label="Time [s]",
    rows=(Row("Marker position [mm]", tuple(lines)),),
)
draw_sheet(sheet).savefig("markers.png", dpi=110)

away = abs(marker).max("time")
assert abs(float(away.sel(drive="1")) - 0.116) < 1e-6, "stroke of Drive 1 and 1 mm over-travel"
home = [float(throw["time"].where(abs(marker.sel(drive=d)) > 1e-4).max()) for d in ("1", "2")]
assert 0.15 < home[1] - home[0] < 0.25, f"Drive 2 is home {home[1] - home[0]} s after Drive 1"
