"""The published facts on the default panel (facts a to f), and that it is sound (g), as checks.

Source: the paper's sections 2 to 4 and Figures 5, 8 to 10; the limits are those that an
independent converged study supports (25 ... 27 mm, 30 ... 32 mm, 300 ... 1000 N, 30 % of a
build-up), and what railways ask of a switch (58 mm of flangeway, a lock that 5 mm refuse and 3 mm
do not). Drive 2's end of throw is at 7.8 s, the run ends at 8.5 s.

Two facts more closely: fact f on panels of less closing over-travel, and fact d by three
definitions of a slope. The paper speaks of the build-up from contact "through to saturation" and
shows signals averaged over 0.1 s; it gives no formula.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import xarray as xr
from tests.verification.agreement import Check
from tests.verification.runs import DEFAULT, end_force, throw

from turnout.core.toml import parse_toml
from turnout.metric.features import features
from turnout.metric.panel_check import panel_concerns
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, library_text, load_panel, panel_from_file
from turnout.throw.simulate import simulate
from turnout.throw.slip import last_instant_at

SIZES = (5, 10, 13, 16, 18, 21, 23, 26, 29, 31)
FRICTIONS = (0.1, 0.2, 0.3, 0.4, 0.5)
FRICTIONS_F = (0.3, 0.4, 0.5)
"""Below 0.3 the closing force brings Drive 2 home; see `fact_f`."""
LARGEST_SEEN = 20
PLATEAU = slice(5.2, 6.8)
"""The middle half of the return [s]: both drives slide their rails, which are not yet home."""


def fact_a() -> list[Check]:
    """Drive 2 at 81 kN/m, 13 mm at Drive 2: it stops short of the object."""
    ds = throw(DEFAULT, "drive 2", 13, (("drive.2.stiffness", 81e3),))
    gap = 1e3 * float(ds["end_gap"].sel(drive="2"))
    touched = float(ds["object_force"].max())
    return [
        Check("a: gap left at Drive 2 with 81 kN/m (paper: about 26)", gap, 25, 27, "mm"),
        Check("a: largest force on the 13 mm object there", touched, 0, 0, "N"),
    ]


def fact_b() -> list[Check]:
    """Sleeper 6: 5 mm is invisible, 10 and 13 mm are seen by Drive 2, by Drive 1 less."""
    without, checks = throw(DEFAULT), []
    hidden = throw(DEFAULT, "sleeper 6", 5)
    channels = ("drive_force", "drive_gap", "sensor_gap", "chair_normal_force", "stop_force")
    changed = sum(not hidden[name].equals(without[name]) for name in channels)
    checks.append(Check("b: 5 mm, channels that change by a single bit", changed, 0, 0, ""))
    for size, low, high in ((10, 300, 700), (13, 600, 1000)):
        change = throw(DEFAULT, "sleeper 6", size)["drive_force"] - without["drive_force"]
        first, second = change.sel(time=slice(8.1, 8.5)).mean("time").to_numpy()
        checks.append(
            Check(f"b: {size} mm, change of Drive 2 over the last 0.4 s", second, low, high, "N")
        )
        checks.append(
            Check(
                f"b: {size} mm, change of Drive 1 over the last 0.4 s", first, -second, second, "N"
            )
        )
    return checks


def fact_c() -> list[Check]:
    """End forces grow with size at sleeper 6; 29 mm still lock, a drive slips first at 31 mm."""
    runs = {size: throw(DEFAULT, "sleeper 6", size) for size in range(28, 34)}
    slipping = [size for size, ds in runs.items() if slips_on_return(ds)]
    checks = [
        Check("c: first size at which a drive slips", min(slipping, default=np.nan), 30, 32, "mm"),
        Check("c: 29 mm locked at the end", float(runs[29]["locked"][-1]), 1, 1, ""),
    ]
    grid = [throw(DEFAULT, "sleeper 6", size) for size in SIZES]
    for drive in "12":
        forces = np.array([end_force(ds, drive) for ds in grid])
        drop = 100 * max(0.0, float(-np.diff(forces).min())) / forces.max()
        checks.append(
            Check(f"c: largest drop of Drive {drive}'s end force with size", drop, 0, 1, "%")
        )
    return checks


def fact_d() -> list[Check]:
    """An object at a drive saturates it and moves the other little; build-up by stiffness."""
    checks = []
    for drive, other in (("1", "2"), ("2", "1")):
        without, ds = throw(DEFAULT), throw(DEFAULT, f"drive {drive}", 13)
        own = end_force(ds, drive) - end_force(without, drive)
        share = 100 * abs(end_force(ds, other) - end_force(without, other)) / own
        peak = float(ds["drive_force"].sel(drive=drive).max())
        level = float(ds["saturation_force"].sel(drive=drive))
        what = f"d: 13 mm at Drive {drive}, largest force over its slip level"
        checks.append(Check(what, peak - level, 0, 100, "N"))
        checks.append(Check("d: the other drive changes by", share, 0, 25, "% of this"))
    for stiffness, expected in ((75e3, 1.8), (750e3, 22.0), (7500e3, 47.0)):
        ds = throw(DEFAULT, "drive 1", 13, (("drive.1.stiffness", stiffness),))
        rate = 1e-3 * build_up(ds)
        what = f"d: build-up of Drive 1 at {stiffness / 1e3:g} kN/m"
        checks.append(Check(what, rate, 0.7 * expected, 1.3 * expected, "kN/s"))
    return checks


def fact_e() -> list[Check]:
    """The force that slides the rails home is proportional to the friction coefficient.

    A drive's force on the return also bends the rails. What friction adds is its force less that of
    a throw without friction, on the plateau before the rail is home, as in the paper's Fig. 8;
    at the end of the throw the closing force hides it.
    """
    bent = plateau(throw(DEFAULT, overrides=(("chair.friction_coefficient", 0.0),)))
    runs = [throw(DEFAULT, overrides=(("chair.friction_coefficient", mu),)) for mu in FRICTIONS]
    forces = np.array([plateau(run) - bent for run in runs])
    checks, largest = [], forces.max()
    for name, values in zip("12", forces.T, strict=True):
        slope, intercept = np.polyfit(FRICTIONS, values, 1)
        off = 100 * np.abs(slope * np.array(FRICTIONS) + intercept - values).max() / largest
        checks += [
            Check(f"e: Drive {name} off a straight line in mu", float(off), 0, 3, "% of largest"),
            Check(
                f"e: Drive {name} intercept at mu 0",
                100 * abs(float(intercept)) / float(largest),
                0,
                5,
                "% of largest",
            ),
        ]
    return checks


def plateau(ds: xr.Dataset) -> np.ndarray:
    """Return the mean force of every drive on the plateau of the return [N]."""
    mean: np.ndarray = ds["drive_force"].sel(time=PLATEAU).mean("time").to_numpy()
    return mean


def fact_f() -> list[Check]:
    """Friction hides objects: what the rail reaches, and what a drive feels, grows with it.

    The gap that a sound throw leaves at sleeper 6 is the smallest size that the rail reaches; it
    grows from 0.1 to 0.5. The smallest size that moves a drive by 50 N grows from 0.3 on. Below,
    the closing force brings the rail home at Drive 2 too, and contact with the stock rail takes up
    part of what the object pushes with: 7 and 8 mm are needed at 0.1 and 0.2.
    """
    panel, linked = load_panel(DEFAULT), third_link()
    runs = [throw(DEFAULT, overrides=(("chair.friction_coefficient", mu),)) for mu in FRICTIONS]
    reached = [1e3 * float(run["sensor_gap"].sel(sensor="TKK1")[-1]) for run in runs]
    least = float(np.diff(reached).min())
    checks = [
        Check("f: least growth of the size reached, mu 0.1 to 0.5 by 0.1", least, 0.1, 3, "mm")
    ]
    for name, one in (("", panel), ("third link half-way, ", linked)):
        sizes = [smallest_seen(one, friction) for friction in FRICTIONS_F]
        checks += [
            Check(f"f: {name}smallest size seen at mu {mu}", size, 1, LARGEST_SEEN, "mm")
            for mu, size in zip(FRICTIONS_F, sizes, strict=True)
        ]
        least = float(np.diff(sizes).min())
        what = f"f: {name}least growth of that size from one mu to the next"
        checks.append(Check(what, least, 1, 99, "mm"))
    for name, one in (("", panel), ("third link half-way, ", linked)):
        change = last_forces(one, 13) - last_forces(one, 0)
        checks += [
            Check(f"f: {name}13 mm change Drive {drive} by", value, 0, 2000, "N")
            for drive, value in zip("12", change, strict=True)
        ]
    return checks


def last_forces(panel: LoadedPanel, size: int) -> np.ndarray:
    """Return the drives' mean forces over the last 0.4 s [N], with an object of a size [mm]."""
    item = ForeignObject(size / 1e3, "sleeper 6") if size else None
    force = simulate(panel, foreign_object=item)["drive_force"]
    mean: np.ndarray = force.sel(time=slice(8.1, 8.5)).mean("time").to_numpy()
    return mean


def third_link() -> LoadedPanel:
    """Return the default panel with one more link between the switch rails, at sleeper 6."""
    text = library_text(DEFAULT) + '\n[link.half-way]\nx = "3.6 m"\n'
    return panel_from_file(parse_toml(text, source="third link"))


def smallest_seen(panel: LoadedPanel, friction: float) -> float:
    """Return the smallest whole size [mm] at sleeper 6 that moves a drive's end force by 50 N."""
    changed = panel.with_overrides({"chair.friction_coefficient": friction})
    without = last_forces(changed, 0)
    unseen, seen = 0, LARGEST_SEEN + 1
    while seen - unseen > 1:
        middle = (unseen + seen) // 2
        if np.abs(last_forces(changed, middle) - without).max() > 50.0:
            seen = middle
        else:
            unseen = middle
    return float(seen)


def slips_on_return(ds: xr.Dataset) -> bool:
    """Return whether a drive slips after the object was placed, at the onset of the return."""
    return bool(ds["drive_slipping"].sel(time=slice(4.4, None)).any())


def build_up(ds: xr.Dataset) -> float:
    """Return the slope of Drive 1's build-up as `turnout.features` measures it [N/s]."""
    found = features(ds)["buildup_slope"].sel(drive="1", direction="closing")
    return float(found)


def fact_g() -> list[Check]:
    """It is a sound switch: margins, flangeway, warnings, and what its lock refuses."""
    alone, panel = throw(DEFAULT), load_panel(DEFAULT)
    margin = alone["force_margin"].sel(drive="2", direction="opening")
    share = 100 * float(margin / alone["saturation_force"].sel(drive="2"))
    checks = [
        Check("g: warnings of panel check", len(panel_concerns(panel, alone)), 0, 0, ""),
        Check("g: margin of Drive 2 on opening", share, 10, 100, "% of its slip level"),
    ]
    for to, least in flangeways(alone, panel).items():
        what = f"g: least flangeway after the movement to {to}"
        checks.append(Check(what, 1e3 * least, 58, 75, "mm"))
    rubbed = throw(DEFAULT, overrides=(("chair.friction_coefficient", 0.5),))
    checks.append(Check("g: slips at mu 0.5", float(rubbed["drive_slipping"].any()), 0, 0, ""))
    for drive in "12":
        for size, locks in ((3, 1), (5, 0)):
            locked = float(throw(DEFAULT, f"drive {drive}", size)["locked"][-1])
            what = f"g: {size} mm piece at Drive {drive}, locked"
            checks.append(Check(what, locked, locks, locks, ""))
    return checks


def flangeways(ds: xr.Dataset, panel: LoadedPanel) -> dict[str, float]:
    """Return the least flangeway of the open rail at rest after a movement each way [m].

    From the gaps at chairs and drives, and where the running edges are further apart than a head.
    """
    found, x = {}, ds["x"].values
    for name, rail in panel.rail.items():
        to = "open" if rail.closes == "+y" else "closed"
        gap = last_instant_at(ds, to=to)["gap"].sel(rail=name).values
        edge = rail.running_edge
        assert edge is not None
        assert rail.head_width is not None
        beyond = (x + edge.lead) ** 2 / (2 * edge.radius) - rail.head_width
        found[to] = float(np.min(gap + np.maximum(beyond, 0.0)))
    return found


ALL = (fact_a, fact_b, fact_c, fact_d, fact_e, fact_f, fact_g)

SHARES = (0.0, 0.5, 1.0)
"""Of the panel's closing over-travels."""
SEEN = 50.0
"""Change of a drive's force that counts as seen [N]."""
SCANNED_SIZES = range(4, 17)
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
    sizes = (size for size in SCANNED_SIZES if np.abs(_end(panel, size)[1] - without).max() > SEEN)
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
