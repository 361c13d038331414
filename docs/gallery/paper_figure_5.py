"""The five measured channels with machines in place of markers: forces, and the motors' currents.

As Fig. 5 of the paper: objects at sleeper 6, averaged over 0.1 s. 10 and 13 mm are visible in the
current of Drive 2, 5 mm is not; the inrush is simulated, not typed in.
"""

import turnout
from turnout.plot import Line, Row, Sheet, draw_sheet, shade_of

MACHINES = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
CLAMPS = {"machine.circuit.measured_current": "supply"}  # a motor lead shows the braking too
panel = turnout.load_panel("uic60-760-1-15", overrides=MACHINES).with_overrides(CLAMPS)
begin = panel.movement["return"].start
sizes = [None, 0.005, 0.01, 0.013, 0.016, 0.018, 0.021, 0.023, 0.026, 0.029, 0.031]
throws = {}
for size in sizes:
    piece = turnout.ForeignObject(size, at="sleeper 6") if size else None
    run = turnout.simulate(panel, foreign_object=piece)
    part = run[["object_force", "drive_current", "drive_force"]]
    throws[size] = part.map(turnout.filtered).sel(time=slice(begin - 0.3, begin + 4.2))


def lines(channel, drive=None, factor=1.0, least=0.0):
    """Return a line for each size from the least on that the channel shows."""
    found = []
    for number, (size, throw) in enumerate(throws.items()):
        values = throw[channel] if drive is None else throw[channel].sel(drive=drive)
        label = f"{1e3 * size:g} mm" if size else "no object"
        time = throw["time"].values - begin
        shown = factor * values.values if (size or 0.0) >= least else 0.0 * time
        colour = shade_of(number / (len(sizes) - 1))
        found.append(Line(label=label, x=time, y=shown, colour=colour, dash=number))
    return tuple(found)


sheet = Sheet(
    name="paper-figure-5",
    title="Objects at sleeper 6, closing: load cell, clamps and drive rods, 0.1 s mean",
    caption="",
    x_label="Time from the onset [s]",
    one_legend=True,
    rows=(
        Row("Load cell\n[kN]", lines("object_force", factor=1e-3, least=0.013)),
        Row("Drive 1\n[A]", lines("drive_current", "1")),
        Row("Drive 2\n[A]", lines("drive_current", "2")),
        Row("Drive 1\n[kN]", lines("drive_force", "1", 1e-3)),
        Row("Drive 2\n[kN]", lines("drive_force", "2", 1e-3)),
    ),
)
figure = draw_sheet(sheet)
figure.draw_without_rendering()  # the ticks of five rows are known after a first layout only
figure.savefig("paper_figure_5.png", dpi=110)

current = {size: throw["drive_current"].sel(drive="2") for size, throw in throws.items()}
running = slice(begin + 3.0, begin + 3.58)  # before the cut-off without an object
rise = {s: float((c - current[None]).sel(time=running).max()) for s, c in current.items()}
assert abs(rise[0.005]) < 1e-3 < 0.01 < rise[0.010] < rise[0.013] < 0.2, rise
assert 4.0 < float(current[None].max()) < 5.0, "inrush of 10 A, averaged over 0.1 s"
