"""Prescribed motion of the drives: the markers at the far ends of their rods.

They begin and end beyond the closed position: that over-travel is the closing force. Drive 2 takes
0.2 s longer to come home than Drive 1.
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
    title="Marker motion: away through 115 mm and 80 mm with over-travel, and back",
    caption="",
    x_label="Time [s]",
    rows=(Row("Marker position [mm]", tuple(lines)),),
)
draw_sheet(sheet).savefig("paper_figure_7.png", dpi=110)

away = abs(marker).max("time")
assert abs(float(away.sel(drive="1")) - 0.117) < 1e-6, "stroke of Drive 1 and 2 mm over-travel"
travels = abs(marker - marker.isel(time=-1)) > 1e-4
home = [float(throw["time"].where(travels.sel(drive=d)).max()) for d in ("1", "2")]
assert 0.15 < home[1] - home[0] < 0.25, f"Drive 2 is home {home[1] - home[0]} s after Drive 1"
