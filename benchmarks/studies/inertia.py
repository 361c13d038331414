"""Effect of inertia in a throw: the two integrators side by side on the default panel.

    python -m benchmarks.studies.inertia

writes docs/evidence/quasi-static.md and its figure.
"""

import argparse
from dataclasses import dataclass
from functools import cache

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from benchmarks.page import DOCS, EVIDENCE
from benchmarks.studies.battery_figures import BLUE, ORANGE, labelled, new_figure
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

DEFAULT = "uic60-760-1-15"
OBJECT = ForeignObject(0.013, "sleeper 6")
PHASES = {
    "unlocking, opening": (0.2, 0.8),
    "moving": (0.8, 3.4),
    "held after the throw": (3.5, 4.3),
    "unlocking, closing": (4.4, 5.2),
    "touching the object": (7.2, 7.6),
    "held after the return": (8.2, 8.5),
}
"""From and to, as the schedule of the default panel has them [s]."""
FRICTION = 0.4
"""Of every chair of the default panel; the runs are made with it [-]."""
AT_LIMIT = 1.0
"""A chair this near to its friction limit counts as at it [N]."""


@cache
def throws() -> tuple[xr.Dataset, xr.Dataset]:
    """Return the throw with the object without and with inertia, at the same instants."""
    panel = load_panel(DEFAULT).with_overrides({"chair.friction_coefficient": FRICTION})
    static = simulate(
        panel,
        foreign_object=OBJECT,
        scheme=Scheme.of("quasi-static", output_interval=1e-3),
    )
    return static, simulate(panel, foreign_object=OBJECT)


@dataclass(frozen=True, slots=True)
class Difference:
    """With inertia less without, of one drive in one phase: largest, when, and mean [N, s, N]."""

    largest: float
    when: float
    mean: float


def difference(drive: str, phase: str) -> Difference:
    """Compare the force of a drive in a phase."""
    first, last = PHASES[phase]
    static, moved = (ds["drive_force"].sel(drive=drive, time=slice(first, last)) for ds in throws())
    off = moved.values - static.values
    at = int(np.argmax(np.abs(off)))
    return Difference(float(off[at]), float(static["time"][at]), float(off.mean()))


def chairs_at_limit(dataset: xr.Dataset, time: float) -> int:
    """Return how many chairs hold as much friction as they can."""
    here = dataset.sel(time=time, method="nearest")
    coefficient = FRICTION
    spare = coefficient * here["chair_normal_force"] - np.abs(here["chair_friction_force"])
    return int((np.abs(spare) < AT_LIMIT).sum())


def least_heel_friction(dataset: xr.Dataset) -> float:
    """Return the least friction on the last chair from 2 s to the end of the throw [N]."""
    rail = dataset.attrs["instrumented_rail"]
    friction = dataset["chair_friction_force"].sel(rail=rail).isel(chair=-1)
    return float(friction.sel(time=slice(2.0, 4.3)).min())


def figure() -> Figure:
    """Draw the drive forces, and the ripple that is locked in."""
    static, moved = throws()
    drawn, axes = new_figure(2, rows=2)
    for column, (title, span) in enumerate(
        {"Drive 2, unlocking": (0.3, 1.8), "Drive 2, coming to rest": (7.0, 8.5)}.items()
    ):
        ax = axes[column]
        for dataset, colour, label in (
            (moved, BLUE, "with inertia"),
            (static, ORANGE, "without"),
        ):
            force = dataset["drive_force"].sel(drive="2", time=slice(*span))
            ax.plot(force["time"], force / 1e3, color=colour, linewidth=1.2, label=label)
        labelled(ax, title, "time [s]", "force on the rail [kN]", legend="best")
    for dataset, colour in ((moved, BLUE), (static, ORANGE)):
        part = dataset["object_force"].sel(time=slice(7.2, 7.8))
        axes[2].plot(part["time"], part / 1e3, color=colour, linewidth=1.2)
    labelled(axes[2], "Object, 13 mm at sleeper 6", "time [s]", "force [kN]")
    places = np.arange(static.sizes["chair"])
    rail = static.attrs["instrumented_rail"]
    for dataset, colour, shift in ((moved, BLUE, -0.2), (static, ORANGE, 0.2)):
        end = dataset["chair_friction_force"].sel(rail=rail).sel(time=4.3, method="nearest")
        axes[3].bar(places + shift, end, width=0.4, color=colour)
    labelled(axes[3], "Friction held at rest, 4.3 s", "chair from the toe", "force on the rail [N]")
    return drawn


TEXT = """# With and without inertia

Written by `python -m benchmarks.studies.inertia`, with its figure. The second integrator
(`--mode quasi-static`) goes from equilibrium to equilibrium, event by event: no masses, no dampers,
no iteration, and no step but the pieces in which the path of the markers is drawn. It shares laws
and solved columns with the first and nothing of the stepping. Where rails move slowly the two must
agree; where they do not, the difference is what inertia does.

![Both integrators on the default panel](../figures/quasi_static.png)

The default panel with 13 mm at sleeper 6; with inertia less without:

| phase | drive | largest [N] | at [s] | mean [N] |
|---|---|---:|---:|---:|
{rows}

Why they differ:

- **Unlocking.** The drives start within 0.3 s. Without inertia the rail follows at once; with it,
  it lags, and then swings about its way at its lowest frequency.
- **Moving.** The mean is nearly nothing: the swing comes and goes, since friction takes little of
  it while all chairs slip one way.
- **The object.** Without inertia its force grows from nothing; with it the rail strikes, up to
  {blow:.0f} N apart at one instant, and the peaks are {peak_moved:.0f} and {peak_static:.0f} N.
- **Locked-in ripple.** When the markers stop, a rail with inertia swings on until friction holds
  it. That last swing lets chairs off their limits: at 4.3 s {dynamic_chairs} of {chairs} chairs
  hold all the friction they can, without inertia {static_chairs}. So the drives hold less:
  {ends}.
  It is not an error of either; a throw four times slower ends within 2 % of the one without
  inertia (a test).
- **Friction near the heel does not turn with the swing.** Chairs there move so little that their
  friction turns more than a second after the motion has, in both. The swing takes some of it and
  never its sign: from 2 to 4.3 s the last chair holds at least {heel_moved:.0f} N,
  without inertia {heel_static:.0f} N.

Where friction follows the normal force an equilibrium need not go on: a foot may neither stick nor
slip. The walk then ends with the outcome `no static continuation`, the place and the time; a
block that lifts itself off when pushed shows it in the tests, and with inertia it jumps there.

Use it as a second opinion, for slow hand-cranked throws, and for the question whether an object
can be noticed at all. Forces at the end are too large by what the ripple takes.
"""


def page() -> str:
    """Return the text of the page."""
    static, moved = throws()
    rows = []
    for phase in PHASES:
        for drive in ("1", "2"):
            d = difference(drive, phase)
            rows.append(f"| {phase} | {drive} | {d.largest:.0f} | {d.when:.3f} | {d.mean:.1f} |")
    blow = np.abs(moved["object_force"] - static["object_force"]).max()
    ends = ", ".join(
        f"Drive {drive} {abs(float(moved['drive_force'].sel(drive=drive)[-1])):.0f} N for "
        f"{abs(float(static['drive_force'].sel(drive=drive)[-1])):.0f} N"
        for drive in ("1", "2")
    )
    return TEXT.format(
        rows="\n".join(rows),
        blow=float(blow),
        peak_moved=float(moved["object_force"].max()),
        peak_static=float(static["object_force"].max()),
        dynamic_chairs=chairs_at_limit(moved, 4.3),
        static_chairs=chairs_at_limit(static, 4.3),
        chairs=static.sizes["chair"] * static.sizes["rail"],
        ends=ends,
        heel_moved=least_heel_friction(moved),
        heel_static=least_heel_friction(static),
    )


def main() -> None:
    """Write the page and its figure."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    figure().savefig(DOCS / "figures" / "quasi_static.png", dpi=150)
    (EVIDENCE / "quasi-static.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
