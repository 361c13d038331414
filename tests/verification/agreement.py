"""How a response agrees with the answers of independent programs, as checks with limits.

SB1 (its README): rms of the difference at most 0.3 % of the peak for the drives, 0.5 % for the
object leaving out 3.99-4.01 s where it vanishes under 7 kN; drives at 4.5 s and object at 3.98 s
within 0.3 %. SB2 (its README): end forces within 4 % or 40 N, forces filtered over 0.1 s within 5 %
of the peak, first contact within 0.03 s, gaps within 0.15 mm, roll within 15 %, static chair
forces 16.30 kN within 0.5 %. Signs: the files of SB2 count drive forces positive in the OPENING
direction and friction on the chair's spring; those of SB1 count as turnout, except friction.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from tests.verification.reference import Arrays

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Check:
    """One figure beside its limits."""

    what: str
    value: float
    low: float
    high: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the value lies within the limits (a NaN does not)."""
        return bool(self.low <= self.value <= self.high)

    def __str__(self) -> str:
        """Return one line for the screen."""
        return (
            f"{self.what}: {self.value:.4g} {self.unit} (allowed {self.low:.4g} to {self.high:.4g})"
        )


def at_times(ds: xr.Dataset, name: str, times: Floats, **where: object) -> Floats:
    """Return a channel at the reference's times by linear interpolation."""
    channel = ds[name].sel(where) if where else ds[name]
    return np.interp(times, ds["time"].to_numpy(), channel.to_numpy())


def rms_percent(ours: Floats, theirs: Floats) -> float:
    """Return the rms of the difference in percent of the reference's peak."""
    return float(100 * np.sqrt(np.mean((ours - theirs) ** 2)) / np.abs(theirs).max())


def filtered(values: Floats, times: Floats) -> Floats:
    """Return the centred moving average over 0.1 s, without the ends."""
    width = round(0.1 / (times[1] - times[0])) + 1
    return np.convolve(values, np.full(width, 1 / width), "valid")


def sb1_checks(ds: xr.Dataset, ref: Arrays) -> list[Check]:
    """Compare case A or B of SB1."""
    times = ref["time"]
    checks = []
    for drive in "12":
        ours = at_times(ds, "drive_force", times, drive=drive)
        theirs = ref[f"drive{drive}"]
        checks.append(Check(f"drive {drive}, rms", rms_percent(ours, theirs), 0, 0.3, "% of peak"))
        at = int(np.argmin(np.abs(times - 4.5)))
        off = 100 * (ours[at] / theirs[at] - 1)
        checks.append(Check(f"drive {drive} at 4.5 s", off, -0.3, 0.3, "%"))
    if ref["object"].any():
        ours = at_times(ds, "object_force", times)
        kept = np.abs(times - 4.0) > 0.01 + 1e-9
        rms = rms_percent(ours[kept], ref["object"][kept])
        checks.append(Check("object, rms", rms, 0, 0.5, "% of peak"))
        at = int(np.argmin(np.abs(times - 3.98)))
        off = 100 * (ours[at] / ref["object"][at] - 1)
        checks.append(Check("object at 3.98 s", off, -0.3, 0.3, "%"))
    # Not requested by the benchmark. The difference is in the stick phases of a 5 Hz ripple and
    # shrinks with the step; after 4 s the ring-down decides in which chairs friction locks.
    early = ref["time_chairs"] < 3.99
    rail = ds.isel(rail=0).interp(time=ref["time_chairs"][early], assume_sorted=True)
    rms = rms_percent(rail["chair_friction_force"].to_numpy().T, -ref["friction"][early])
    checks.append(Check("chair friction up to 3.99 s, rms", rms, 0, 2.5, "% of peak"))
    return checks


def sb2_checks(ds: xr.Dataset, ref: Arrays) -> list[Check]:
    """Compare one case of SB2; the reference's rail A is the instrumented one."""
    times, checks = ref["time"], []
    for drive in "12":
        ours = at_times(ds, "drive_force", times, drive=drive)
        theirs = -ref[f"drive{drive}"]
        allowed = max(40.0, 0.04 * abs(theirs[-1]))
        checks.append(
            Check(
                f"drive {drive} at the end, less reference",
                ours[-1] - theirs[-1],
                -allowed,
                allowed,
                "N",
            )
        )
        worst = np.abs(filtered(ours, times) - filtered(theirs, times)).max()
        share = 100 * worst / np.abs(theirs).max()
        checks.append(
            Check(f"drive {drive} filtered, largest difference", share, 0, 5, "% of peak")
        )
    if ref["object"].any():
        ours = at_times(ds, "object_force", times)
        off = ours[-1] - ref["object"][-1]
        allowed = max(40.0, 0.04 * ref["object"][-1])
        checks.append(Check("object at the end, less reference", off, -allowed, allowed, "N"))
        worst = np.abs(filtered(ours, times) - filtered(ref["object"], times)).max()
        share = 100 * worst / ref["object"].max()
        checks.append(Check("object filtered, largest difference", share, 0, 5, "% of peak"))
        late = float(ds["contact_time"]) - 7.357
        checks.append(Check("first contact, less 7.357 s", late, -0.03, 0.03, "s"))
    gaps = [ds["gap"].sel(rail="A").sel(x=x, method="nearest").to_numpy() for x in (0.3, 6.9)]
    gaps += [ds["sensor_gap"].sel(sensor=name).to_numpy() for name in ("TKK1", "TKK2")]
    for name, column, ours in zip(
        ("Drive 1", "Drive 2", "TKK1", "TKK2"), ref["gap"].T, gaps, strict=True
    ):
        off = 1e3 * np.abs(np.interp(times, ds["time"].to_numpy(), ours) - column).max()
        checks.append(Check(f"gap at {name}, largest difference", off, 0, 0.15, "mm"))
    static = 1e-3 * float(ds["chair_normal_force"].isel(time=0).sum())
    checks.append(Check("static chair forces", static, 16.30 * 0.995, 16.30 * 1.005, "kN"))
    return checks + _chair_checks(ds, ref)


def _chair_checks(ds: xr.Dataset, ref: Arrays) -> list[Check]:
    """Compare chairs by rms; the references agree among themselves to 0.5 % and 1.1 %."""
    rail_a = ds.sel(rail="A").interp(time=ref["time_chairs"], assume_sorted=True)
    normal = rms_percent(rail_a["chair_normal_force"].to_numpy().T, ref["chair_normal_A"])
    friction = rms_percent(rail_a["chair_friction_force"].to_numpy().T, ref["chair_friction_A"])
    return [
        Check("chair normal force, rms", normal, 0, 1.0, "% of peak"),
        Check("chair friction force, rms", friction, 0, 2.2, "% of peak"),
    ]
