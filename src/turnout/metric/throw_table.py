"""Reports of lock and control on each throw of a sequence, beside the trapped objects."""

from typing import TYPE_CHECKING, Any

import numpy as np

from turnout.metric.verdict import verdict

if TYPE_CHECKING:
    import xarray as xr


def throw_table(dataset: "xr.Dataset") -> list[dict[str, Any]]:
    """Return a row for each throw of a sequence.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `simulate_sequence`, with what it keeps by default.

    Returns
    -------
    list of dict
        `throw`; `size` before and `left` after it of each object, `broken` in it [m];
        `object_force_peak`, `drive_force_end` and least `force_margin` of each drive [N]; `locked`,
        `in_control` of each sensor, and `state` in words, at the end; `verdict`, its kind, which
        judges the movements before it too.
    """
    found = []
    dataset = dataset.load()
    for number in range(dataset.sizes["throw"]):
        one = dataset.isel(throw=number)
        controls = one["in_control"].values[:, -1].tolist() if "in_control" in one else []
        locked = bool(one["locked"].values[-1])
        names = one["sensor"].values.tolist() if "in_control" in one else []
        row: dict[str, Any] = {
            "throw": int(one["throw"]),
            "size": _values(one, "object_size"),
            "left": _values(one, "object_left"),
            "broken": _values(one, "object_broken"),
            "object_force_peak": float(one["object_force"].max()),
            "drive_force_end": one["drive_force"].values[:, -1].tolist(),
            "force_margin": np.nanmin(one["force_margin"].values, axis=1).tolist(),
            "locked": locked,
            "in_control": controls,
            "state": _state(locked, dict(zip(names, controls, strict=True))),
            "verdict": verdict(one).kind,
        }
        if "throw_temperature" in one:
            row["temperature"] = float(one["throw_temperature"])
        found.append(row)
    return found


def _values(one: "xr.Dataset", name: str) -> list[float]:
    return np.nan_to_num(one[name].values).tolist() if name in one else []


def _state(locked: bool, controls: dict[str, bool]) -> str:
    """Name the faults that lock and control contacts report."""
    open_ones = [name for name, holds in controls.items() if not holds]
    if locked and not open_ones:
        return "locked, in control"
    said = [] if locked else ["not locked"]
    return ", ".join(said + [f"{name} not in control" for name in open_ones])
