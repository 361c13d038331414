"""Prescribed motion of the drives: the markers at the far ends of their rods.

They begin and end beyond the closed position: that over-travel is the closing force. Drive 2 takes
0.2 s longer to come home than Drive 1. The measured motion is virtual: transducers on the rods with
noise of 0.3 mm, gains of 1.005 and 0.99, and a clock 10 ms late.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet

GAIN = {"1": 1.005, "2": 0.99}
NOISE, LATE = 0.3e-3, 0.01  # [m], [s]
throw = turnout.simulate(turnout.load_panel("uic60-760-1-15"))
marker = throw["drive_displacement"]
chance = np.random.default_rng(7)
lines, less, residual = [], [], {}
for number, (drive, gain) in enumerate(GAIN.items()):
    motion = marker.sel(drive=drive)
    time = motion["time"].values
    seen = gain * np.interp(time - LATE, time, motion) + chance.normal(0.0, NOISE, time.shape)
    measured = 1e3 * turnout.filtered(motion.copy(data=seen)).values
    model = 1e3 * turnout.filtered(motion).values
    apart = measured - model
    root, share = (apart**2).mean() ** 0.5, abs(apart).max() / abs(model).max()
    residual[drive] = root, share
    style = {"x": time, "dash": number}
    lines.append(Line(label=f"Drive {drive}, model", y=model, colour=number, **style))
    lines.append(Line(label=f"Drive {drive}, measured (virtual)", y=measured, colour="#000000",
                      width=0.8, **style))  # fmt: skip
    label = f"Drive {drive}: rms {root:.2f} mm,\nat most {100 * share:.1f} % of the peak"
    less.append(Line(label=label, y=apart, colour=number, **style))
sheet = Sheet(
    name="markers",
    title="Marker motion: away through 115 mm and 80 mm with over-travel, and back, 0.1 s mean",
    caption="",
    x_label="Time [s]",
    rows=(Row("Marker position\n[mm]", tuple(lines)), Row("difference\n[mm]", tuple(less))),
)
draw_sheet(sheet).savefig("paper_figure_7.png", dpi=110)

away = abs(marker).max("time")
assert abs(float(away.sel(drive="1")) - 0.117) < 1e-6, "stroke of Drive 1 and 2 mm over-travel"
travels = abs(marker - marker.isel(time=-1)) > 1e-4
home = [float(throw["time"].where(travels.sel(drive=d)).max()) for d in ("1", "2")]
assert 0.15 < home[1] - home[0] < 0.25, f"Drive 2 is home {home[1] - home[0]} s after Drive 1"
assert all(root < 1.0 and share < 0.02 for root, share in residual.values()), residual
