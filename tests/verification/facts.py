"""The published facts on the default panel (facts a to f), as checks with limits.

Source: the paper's sections 2 to 4 and Figures 5, 8 to 10; the limits are those that an independent
converged study of the same panel supports. Drive 2's end of throw is at 7.8 s, the run ends at
8.5 s.
"""

import numpy as np
import xarray as xr
from tests.verification.agreement import Check, filtered
from tests.verification.runs import DEFAULT, end_force, throw

from turnout.core.toml import parse_toml
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, library_text, load_panel, panel_from_file
from turnout.response.simulate import simulate

SIZES = (5, 10, 13, 16, 18, 21, 23, 26, 29, 31)
FRICTIONS = (0.1, 0.2, 0.3, 0.4, 0.5)
FRICTIONS_F = (0.2, 0.3, 0.4, 0.5)
LARGEST_SEEN = 20
SLOW = tuple(
    (f"movement.{name}.{key}", value)
    for name, start in (("throw", 0.2), ("return", 14.4))
    for key, value in (("start", start), ("duration", 12.8), ("ramp", 1.2))
) + (
    ("movement.return.extra_time.2", 0.8),
    ("schedule.end", 30.0),
    ("object_defaults.appears", 14.4),
)


def fact_a() -> list[Check]:
    """Drive 2 at 81 kN/m, 13 mm at Drive 2: it stops short of the object."""
    ds = throw(DEFAULT, "drive 2", 13, (("drive.2.stiffness", 81e3),))
    gap = 1e3 * float(ds["end_gap"].sel(drive="2"))
    touched = float(ds["object_force"].max())
    return [
        Check("a: gap left at Drive 2 with 81 kN/m (paper: about 26)", gap, 20, 28, "mm"),
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
            Check(f"b: {size} mm, change of Drive 1 over the last 0.4 s", first, 0, second, "N")
        )
    return checks


def fact_c() -> list[Check]:
    """End forces grow with size at sleeper 6; a drive slips first at about 31 mm."""
    runs = {size: throw(DEFAULT, "sleeper 6", size) for size in range(26, 35)}
    slipping = [size for size, ds in runs.items() if slips_on_return(ds)]
    checks = [
        Check("c: first size at which a drive slips", min(slipping, default=np.nan), 27, 33, "mm")
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
        checks.append(Check(f"d: 13 mm at Drive {drive}, its largest force", peak, 6000, 6100, "N"))
        checks.append(Check("d: the other drive changes by", share, 0, 25, "% of this"))
    for stiffness, expected in ((75e3, 1.8), (750e3, 22.0), (7500e3, 47.0)):
        ds = throw(DEFAULT, "drive 1", 13, (("drive.1.stiffness", stiffness),))
        rate = 1e-3 * build_up(ds, "1")
        what = f"d: build-up of Drive 1 at {stiffness / 1e3:g} kN/m"
        checks.append(Check(what, rate, 0.7 * expected, 1.3 * expected, "kN/s"))
    return checks


def fact_e() -> list[Check]:
    """End forces on the return are linear in the friction coefficient."""
    checks = _linear("e", ())
    opening = throw(DEFAULT, overrides=(("chair.friction_coefficient", 0.5),))
    margin = float(opening["force_margin"].sel(drive="2", direction="opening"))
    checks.append(
        Check("e: margin of Drive 2 in the opening throw at mu 0.5", margin, -100, 0, "N")
    )
    return checks


def fact_e_slow() -> list[Check]:
    """The same four times slower, where the locked-in ripple is gone: Drive 1 is linear too."""
    return _linear("e, throw of 12.8 s", SLOW, alone=True)


def fact_f() -> list[Check]:
    """Friction hides objects: the smallest size that moves a drive grows with it; a link helps."""
    panel, linked = load_panel(DEFAULT), third_link()
    sizes = [smallest_seen(panel, friction) for friction in FRICTIONS_F]
    with_link = [smallest_seen(linked, friction) for friction in FRICTIONS_F]
    checks = [
        Check(f"f: smallest size seen at mu {mu}", size, 1, LARGEST_SEEN, "mm")
        for mu, size in zip(FRICTIONS_F, sizes, strict=True)
    ]
    least = min(np.diff(sizes))
    checks.append(Check("f: least growth of that size from one mu to the next", least, 0, 99, "mm"))
    growth = sizes[-1] - sizes[0]
    checks.append(Check("f: growth of that size from mu 0.2 to 0.5", growth, 1, 99, "mm"))
    checks += [
        Check(f"f: third link half-way, smallest size seen at mu {mu}", size, 1, LARGEST_SEEN, "mm")
        for mu, size in zip(FRICTIONS_F, with_link, strict=True)
    ]
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


def _linear(
    name: str, overrides: tuple[tuple[str, float], ...], *, alone: bool = False
) -> list[Check]:
    runs = [
        throw(DEFAULT, overrides=(*overrides, ("chair.friction_coefficient", mu)))
        for mu in FRICTIONS
    ]
    forces = {f"Drive {drive}": np.array([end_force(ds, drive) for ds in runs]) for drive in "12"}
    largest = max(values.max() for values in forces.values())
    checks = []
    for label, values in forces.items():
        slope, intercept = np.polyfit(FRICTIONS, values, 1)
        scale = values.max() if alone else largest
        off = 100 * np.abs(slope * np.array(FRICTIONS) + intercept - values).max() / scale
        checks.append(
            Check(f"{name}: {label} off a straight line in mu", float(off), 0, 3, "% of largest")
        )
        share = 100 * abs(intercept) / scale
        checks.append(
            Check(f"{name}: {label} intercept at mu 0", float(share), 0, 5, "% of largest")
        )
    return checks


def slips_on_return(ds: xr.Dataset) -> bool:
    """Tell whether a drive slips after the object was placed, at the onset of the return."""
    return bool(ds["drive_slipping"].sel(time=slice(4.4, None)).any())


def build_up(ds: xr.Dataset, drive: str) -> float:
    """Return the slope from 10 to 90 % of the rise after contact, filtered over 0.1 s [N/s]."""
    times = ds["time"].to_numpy()
    force = filtered(ds["drive_force"].sel(drive=drive).to_numpy(), times)
    times = times[50:-50]
    start = int(np.searchsorted(times, float(ds["contact_time"]) - 0.05))
    rise = force[start:] - force[start]
    low, high = (int(np.argmax(rise >= share * rise.max())) for share in (0.1, 0.9))
    return float((rise[high] - rise[low]) / (times[start + high] - times[start + low]))


ALL = (fact_a, fact_b, fact_c, fact_d, fact_e, fact_e_slow, fact_f)
