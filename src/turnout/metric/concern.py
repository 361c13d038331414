"""What an engineer should know about a panel after it was thrown without an object."""

from dataclasses import dataclass

import xarray as xr

from turnout.metric.books import is_inaccurate
from turnout.metric.movement import LEAST_SHARE, margins

# A chair that never bears more than this does not carry [N].
LEAST_LOAD = 1.0


@dataclass(frozen=True, slots=True)
class Concern:
    """One thing to look at.

    Attributes
    ----------
    what, where, number, remedy : str
        For the screen, with units.
    """

    what: str
    where: str
    number: str
    remedy: str

    @property
    def text(self) -> str:
        """All of it in one line."""
        return f"{self.what}: {self.where}: {self.number}; {self.remedy}"


def concerns(dataset: xr.Dataset) -> list[Concern]:
    """Return what a throw without an object shows that a switch should not.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run with drive forces, flangeway and chair forces.

    Returns
    -------
    list of Concern
        Runs that ended early or are inaccurate, drives within a tenth of their slip level in either
        direction, a flangeway below its limit, chairs that never carry; empty where all is well.
    """
    found = []
    if dataset.attrs.get("foreign_objects", "[]") != "[]":
        found.append(
            Concern(
                "thrown with an object",
                "the panel file",
                "it has foreign objects of its own",
                "take them out to see the switch alone",
            )
        )
    if not dataset.attrs.get("complete", True):
        message = str(dataset.attrs.get("outcome_message", "ended early"))
        what, where = "throw not complete", f"t = {_last_time(dataset):.3f} s"
        remedy = "what follows holds until then only"
        if is_inaccurate(dataset):
            what, where = "throw is inaccurate", "its whole time"
            remedy = "what follows is not to be trusted either"
        found.append(Concern(what, where, message, remedy))
    if not dataset.sizes.get("time", 0):
        return found
    return [*found, *_near_slip(dataset), *_narrow(dataset), *_idle_chairs(dataset)]


def _last_time(dataset: xr.Dataset) -> float:
    return float(dataset["time"][-1]) if dataset.sizes.get("time", 0) else 0.0


def _near_slip(dataset: xr.Dataset) -> list[Concern]:
    found = []
    for margin in margins(dataset):
        if not margin.tight:
            continue
        place = float(dataset["drive_x"].sel(drive=margin.drive))
        left = f"{margin.force / 1e3:.2f} kN ({100 * margin.share:.1f} %)"
        if margin.force <= 0:
            left = "nothing"
        found.append(
            Concern(
                "drive near its slip level",
                f"drive {margin.drive} at x = {place:g} m, {margin.direction}",
                f"{margin.largest / 1e3:.2f} kN of {margin.limit / 1e3:.2f} kN, {left} left, "
                f"at least {100 * LEAST_SHARE:.0f} % wanted",
                "less friction, another drive or a higher slip level; "
                "a slip here is no trapped object",
            )
        )
    return found


def _narrow(dataset: xr.Dataset) -> list[Concern]:
    limit = float(dataset.attrs.get("flangeway_limit", float("nan")))
    if "least_flangeway" not in dataset or not float(dataset["least_flangeway"]) < limit:
        return []
    least, x = float(dataset["least_flangeway"]), float(dataset["least_flangeway_x"])
    return [
        Concern(
            "flangeway below its limit",
            f"rail {dataset['least_flangeway_rail'].values!s} at x = {x:g} m",
            f"{1e3 * least:.2f} mm, limit {1e3 * limit:g} mm",
            "more stroke or over-travel at the nearest drive, or a drive closer to the place",
        )
    ]


def _idle_chairs(dataset: xr.Dataset) -> list[Concern]:
    if "chair_normal_force" not in dataset:
        return []
    largest = dataset["chair_normal_force"].max("time")
    found = []
    for rail in largest["rail"].values:
        loads = largest.sel(rail=rail)
        idle = loads["chair"].values[(loads < LEAST_LOAD).values]
        for chair in idle:
            load, x = float(loads.sel(chair=chair)), float(dataset["chair_x"].sel(chair=chair))
            found.append(
                Concern(
                    "chair never carries",
                    f"chair {chair} under rail {rail} at x = {x:g} m",
                    f"at most {load:.1f} N at any time",
                    f"check its height, chair.{chair}.clearance and chair.{chair}.foot_height",
                )
            )
    return found
