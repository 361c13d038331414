"""The five measured channels with machines in place of markers: forces, and the motors' currents.

As Fig. 5 of the paper: objects at sleeper 6, averaged over 0.1 s. 10 and 13 mm are visible in the
current of Drive 2, 5 mm is not; the inrush is simulated, not typed in. The measured switch is
virtual: friction 0.41 and other bushings, noise of 20 N and 20 mA, gains up to 2 % off.
"""

import numpy as np

import turnout
from turnout.figures import Line, Row, Sheet, draw_sheet, shade_of

CLAMPS = {"machine.circuit.measured_current": "supply"}  # a motor lead shows the braking too
OTHER = {"chair.friction_coefficient": 0.41, "drive.1.stiffness": 735e3, "drive.2.stiffness": 780e3}
CHANNELS = {  # variable, drive, unit of the axis, gain and noise of the virtual measurement
    "Load cell\n[kN]": ("object_force", None, 1e3, 1.01, 20.0),
    "Drive 1\n[A]": ("drive_current", "1", 1.0, 1.02, 0.02),
    "Drive 2\n[A]": ("drive_current", "2", 1.0, 0.985, 0.02),
    "Drive 1\n[kN]": ("drive_force", "1", 1e3, 1.01, 20.0),
    "Drive 2\n[kN]": ("drive_force", "2", 1e3, 0.99, 20.0),
}
MEASURED = (0.013, 0.029)
panel = turnout.load_panel("uic60-760-1-15-jea73", overrides=CLAMPS)
begin = panel.movement["return"].start
sizes = [None, 0.005, 0.01, 0.013, 0.016, 0.018, 0.021, 0.023, 0.026, 0.029, 0.031]
chance = np.random.default_rng(5)


def channels(of, size, virtual=False):
    """Return the channels as a recorder shows them, averaged over 0.1 s [kN, A]."""
    piece = turnout.ForeignObject(size, at="sleeper 6") if size else None
    throw = turnout.simulate(of, foreign_object=piece)
    found = {}
    for row, (name, drive, unit, gain, noise) in CHANNELS.items():
        true = throw[name] if drive is None else throw[name].sel(drive=drive)
        seen = gain * true + chance.normal(0.0, noise, true.shape) if virtual else true
        part = turnout.filtered(seen).sel(time=slice(begin - 0.3, begin + 4.2))
        with_cell = drive is not None or (size or 0.0) >= 0.013  # it needs 13 mm of room
        found[row] = part / unit if with_cell else 0.0 * part
    return found


model = {size: channels(panel, size) for size in sizes}
other = panel.with_overrides(OTHER)
measured = {size: channels(other, size, virtual=True) for size in MEASURED}
time = model[None]["Drive 1\n[A]"]["time"].values - begin
rows, apart, residual = [], {"kN": [], "A": []}, {}
for row in CHANNELS:
    lines = []
    for number, (size, seen) in enumerate(model.items()):
        label = f"{1e3 * size:g} mm" if size else "no object"
        colour = shade_of(number / (len(sizes) - 1))
        lines.append(Line(label=label, x=time, y=seen[row].values, colour=colour, dash=number))
    name, unit = row.replace("\n", " ").strip("]").split(" [")
    less = {size: (seen[row] - model[size][row]).values for size, seen in measured.items()}
    for number, (size, seen) in enumerate(measured.items()):
        style = {"colour": "#000000", "dash": number, "width": 0.9}
        label = f"{1e3 * size:g} mm, measured"
        lines.append(Line(label=label, x=time, y=seen[row].values, **style))
    root = np.mean([part**2 for part in less.values()]) ** 0.5
    peak = max(float(abs(model[size][row]).max()) for size in MEASURED)
    residual[row] = root / peak
    style = {"colour": len(apart[unit]), "dash": len(apart[unit])}
    text = f"{name}: rms {root:.3f} {unit},\n{100 * root / peak:.1f} % of its peak"
    apart[unit].append(Line(label=text, x=time, y=less[0.029], **style))
    rows.append(Row(row, tuple(lines)))
rows += [Row(f"29 mm, difference\n[{unit}]", tuple(lines)) for unit, lines in apart.items()]
sheet = Sheet(
    name="paper-figure-5",
    title="Objects at sleeper 6, closing, 0.1 s mean, inrush cut off at 2.1 A; measured: virtual",
    caption="",
    x_label="Time from the onset [s]",
    one_legend=True,
    rows=tuple(rows),
)
figure = draw_sheet(sheet)
beside = {"bbox_to_anchor": (1.005, 1.0), "loc": "upper left", "frameon": False, "fontsize": 9}
figure.axes[0].legend(**beside).set_in_layout(False)  # beside two rows, which stay together
for ax in figure.axes[-2:]:
    ax.legend(**beside)
for ax in figure.axes[1:3]:
    ax.set_ylim(0.0, 2.1)  # the inrush goes on to 5 A
figure.draw_without_rendering()  # the ticks of seven rows are known after a first layout only
figure.savefig("paper_figure_5.png", dpi=110)

current = {size: seen["Drive 2\n[A]"] for size, seen in model.items()}
running = slice(begin + 2.8, begin + 3.38)  # before the cut-off without an object
rise = {s: float((c - current[None]).sel(time=running).max()) for s, c in current.items()}
assert abs(rise[0.005]) < 1e-3 < 0.01 < rise[0.010] < rise[0.013] < 0.2, rise
assert 4.0 < float(current[None].max()) < 5.0, "inrush of 10 A, averaged over 0.1 s"
assert all(share < 0.05 for share in residual.values()), residual
