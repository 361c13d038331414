"""Two facts examined more closely: what the size seen depends on, and what "build-up" may mean.

Fact f on panels of less closing over-travel, and fact d by three definitions of a slope. Source of
the definitions: the paper speaks of the build-up from contact "through to saturation" and shows
signals averaged over 0.1 s; it gives no formula.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from tests.verification.facts import FRICTIONS, build_up
from tests.verification.runs import DEFAULT, throw

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.throw.simulate import simulate

SHARES = (0.0, 0.5, 1.0)
"""Of the panel's closing over-travels."""
SEEN = 50.0
"""Change of a drive's force that counts as seen [N]."""
SIZES = range(4, 17)
STIFFNESSES = {75e3: 1.8, 750e3: 22.0, 7500e3: 47.0}
"""Of Drive 1 [N/m], with the build-up of the paper [kN/s]."""


@dataclass(frozen=True)
class Seen:
    """Raw gap at Drive 2 without an object, and least size at sleeper 6 that a drive sees [mm]."""

    gap: float
    size: float


@cache
def least_size(share: float, friction: float) -> Seen:
    """Return what a share of the over-travel leaves open, and what a drive sees at a friction."""
    panel = load_panel(DEFAULT)
    keys = {
        f"drive.{name}.over_travel_closed": share * drive.over_travel_closed
        for name, drive in panel.drive.items()
    }
    panel = panel.with_overrides(keys | {"chair.friction_coefficient": friction})
    gap, without = _end(panel, 0)
    sizes = (size for size in SIZES if np.abs(_end(panel, size)[1] - without).max() > SEEN)
    return Seen(gap, float(next(sizes, np.inf)))


def _end(panel: LoadedPanel, size: int) -> tuple[float, np.ndarray]:
    """Return the gap at Drive 2 [mm] and the forces over the last 0.4 s [N], object in mm."""
    item = ForeignObject(size / 1e3, "sleeper 6") if size else None
    run = simulate(panel, foreign_object=item, mode="quick")
    force = run["drive_force"].sel(time=slice(8.1, 8.5)).mean("time").to_numpy()
    return 1e3 * float(run["end_gap"].sel(drive="2")), force


@cache
def slopes(stiffness: float) -> tuple[float, float]:
    """Return the build-up of Drive 1 with 13 mm there [kN/s]: the feature, and from contact on.

    The second is the mean slope of the unfiltered force from first contact until 99 % of its rise,
    which is slip or the arrival of the marker.
    """
    run = throw(DEFAULT, "drive 1", 13, (("drive.1.stiffness", stiffness),))
    force, time = run["drive_force"].sel(drive="1").values, run["time"].values
    first = int(np.searchsorted(time, float(run["contact_time"])))
    rise = force[first:] - force[first]
    last = first + int(np.argmax(rise >= 0.99 * rise.max()))
    return 1e-3 * build_up(run), 1e-3 * float(
        (force[last] - force[first]) / (time[last] - time[first])
    )


def size_table() -> str:
    """Return sizes seen over friction and over-travel as a table."""
    rows = [
        "| closing over-travel | " + " | ".join(f"friction {mu:g}" for mu in FRICTIONS) + " |",
        "|---|" + "---:|" * len(FRICTIONS),
    ]
    names = {0.0: "none", 0.5: "half", 1.0: "the panel's"}
    for share in SHARES:
        cells = [least_size(share, mu) for mu in FRICTIONS]
        texts = [f"{cell.size:g} mm ({cell.gap + 0.0:.1f})" for cell in cells]
        rows.append(f"| {names[share]} | " + " | ".join(texts) + " |")
    return "\n".join(rows)


def slope_table() -> str:
    """Return the build-up of Drive 1 by definition and stiffness as a table."""
    rows = [
        "| Drive 1 | independent study | `buildup_slope` | from contact on, unfiltered |",
        "|---|---:|---:|---:|",
    ]
    for stiffness, published in STIFFNESSES.items():
        feature, plain = slopes(stiffness)
        rows.append(
            f"| {stiffness / 1e3:g} kN/m | {published:g} kN/s | {feature:.2f} kN/s | "
            f"{plain:.2f} kN/s |"
        )
    return "\n".join(rows)
