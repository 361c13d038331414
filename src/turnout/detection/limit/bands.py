"""The limit for many panels: bands of a90 over plausible panels, or over the closing over-travel.

Each panel has a folder of its own, in which its throws are kept; a run that was stopped goes on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.load_study import load_study
from turnout.core.errors import StudyError
from turnout.core.progress import Pace
from turnout.core.workers import Workers
from turnout.detection.conditions import FORCE, Conditions
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.throws import (
    ELASTIC,
    QUICK_SOUND,
    QUICK_STEPS,
    closing_time,
    throw_all,
    throw_counts,
)
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.sweep.run import running

Floats = NDArray[np.float64]

OVER_TRAVELS = (0.0, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3)
"""Middles of the closing over-travel of all drives [m]."""
SHARES = (0.05, 0.5, 0.95)
UNITS = {
    "a90": ("m", "smallest size from which nine of ten objects are detected"),
    "touch_floor": ("m", "size that is touched in nine of ten states"),
    "x": ("m", "position from the toe, median of the panels"),
    "panel_x": ("m", "position from the toe in each panel"),
    "a90_band": ("m", "size that a share of the panels stays below; NaN beyond what was thrown"),
    "a90_band_low": ("m", "lower end of the 95 % interval of it over drawn states"),
    "a90_band_high": ("m", "upper end of the 95 % interval of it over drawn states"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One of the panels.

    Attributes
    ----------
    name : str
        Of its folder and in the result.
    panel : LoadedPanel or None
        None for that of the reference case.
    over_travel : float or None
        Middle of the closing over-travel of its drives; None leaves that of the population [m].
    """

    name: str
    panel: LoadedPanel | None
    over_travel: float | None = None


def panels_of(source: str, *, most: int | None = None) -> list[Member]:
    """Return the panels of a folder of panel files, or those that a study makes.

    Parameters
    ----------
    source : str
        A folder; a study of the library; or a study file, whose scenarios each change its panel.
    most : int, optional
        So many of them, evenly chosen from the first to the last.

    Raises
    ------
    StudyError
        When there is none.
    """
    folder = Path(source)
    if folder.is_dir():
        found = [
            Member(name=file.stem, panel=load_panel(str(file)))
            for file in sorted(folder.glob("*.toml"))
        ]
    else:
        study = load_study(source)
        found = [
            Member(name=f"panel-{number}", panel=study.panel.with_overrides(scenario.overrides))
            for number, scenario in ((n, study.scenario(n)) for n in evenly(study.count, most))
        ]
        return found
    if not found:
        message = "holds no panel file (.toml)"
        raise StudyError([message], source=source)
    return [found[number] for number in evenly(len(found), most)]


def evenly(count: int, most: int | None) -> list[int]:
    """Return at most so many numbers below a count, evenly from the first to the last.

    Examples
    --------
    >>> evenly(45, 4), evenly(3, None)
    ([0, 15, 29, 44], [0, 1, 2])
    """
    if most is None or most >= count:
        return list(range(count))
    return [round(number) for number in np.linspace(0.0, count - 1.0, most)]


def over_travels(panel: LoadedPanel | None) -> list[Member]:
    """Return a panel with its closing over-travel at 0 to 5 mm.

    Examples
    --------
    >>> [member.name for member in over_travels(None)][:2]
    ['over-travel-0', 'over-travel-1']
    """
    return [
        Member(name=f"over-travel-{1e3 * value:g}", panel=panel, over_travel=value)
        for value in OVER_TRAVELS
    ]


def limit_bands(
    members: Sequence[Member],
    folder: Path,
    conditions: Conditions,
    *,
    states: int,
    sound: int = QUICK_SOUND,
    steps: Sequence[float] = QUICK_STEPS,
    channels: str = FORCE,
    kind: str = ELASTIC,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> xr.Dataset:
    """Return a90 at each place for each panel, and its bands.

    Parameters
    ----------
    members : sequence of Member
        From `panels_of` or `over_travels`.
    folder : Path
        Holds a folder for each.
    conditions : Conditions
        Discrepancy, noise, history, rate of false alarms.
    states, sound : int
        States with objects and sound throws of each panel.
    steps : sequence of float
        Sizes thrown at a place beyond its touch floor [m].
    channels : str
        What is evaluated.
    kind : str
        Of the objects.
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts the throws.

    Returns
    -------
    xarray.Dataset
        `a90` and `touch_floor` over panel and place, `a90_band` with its interval over share and
        place.
    """
    maps, pace = [], pace or Pace()
    most = max(sound, states)
    first = throw_counts(members[0].panel, sound=most, states=states, steps=steps, kind=kind)
    for name, count in first.items():
        pace.plan(name, len(members) * count)
    with running(workers) as processes:
        for member in members:
            throws = throw_all(
                member.panel, folder / member.name,
                sound=most, states=states, channels=channels, steps=steps,
                over_travel=member.over_travel, kind=kind, workers=processes, pace=pace,
            )  # fmt: skip
            maps.append(limit_map(throws, conditions, closing=closing_time(member.panel)))
    return bands_of([member.name for member in members], maps)


def bands_of(names: Sequence[str], maps: Sequence[xr.Dataset]) -> xr.Dataset:
    """Put maps of panels side by side, at the places that all of them have.

    A drive or sleeper of one name may stand elsewhere in another panel: `panel_x` holds where it
    is in each, `x` the median, by which the places are sorted.

    Parameters
    ----------
    names : sequence of str
        Of the panels.
    maps : sequence of xarray.Dataset
        From `limit_map`.
    """
    common = [
        name
        for name in maps[0]["place"].to_numpy().tolist()
        if all(name in item["place"] for item in maps)
    ]
    if not common:
        message = "the panels have no place of the same name: nothing can be compared"
        raise StudyError([message], source="limit")
    x = np.array([item["x"].sel(place=common).to_numpy() for item in maps])
    along = np.argsort(np.median(x, axis=0), kind="stable")
    common, x = [common[number] for number in along], x[:, along]
    at = [item.sel(channel="both drives", place=common) for item in maps]
    a90 = np.array([item["a90"].to_numpy() for item in at])
    band = _quantiles(np.where(np.isfinite(a90), a90, np.inf), SHARES, axis=0)
    # the same states of every panel are drawn together, as all panels are thrown in them
    resampled = np.array([item["a90_resampled"].to_numpy() for item in at])
    of_draws = _quantiles(resampled, SHARES, axis=0)
    low, high = _quantiles(of_draws, (0.025, 0.975), axis=1)
    found = xr.Dataset(
        {
            "a90": (("panel", "place"), a90),
            "touch_floor": (
                ("panel", "place"), np.array([item["touch_floor"].to_numpy() for item in at])
            ),
            **{
                name: (("share", "place"), np.where(np.isfinite(values), values, np.nan))
                for name, values in (
                    ("a90_band", band), ("a90_band_low", low), ("a90_band_high", high)
                )
            },
        },
        {
            "panel": list(names), "place": common, "share": list(SHARES),
            "x": ("place", np.median(x, axis=0)), "panel_x": (("panel", "place"), x),
        },
        {**_shared(maps[0].attrs), "kind": "limit bands"},
    )  # fmt: skip
    for name, (units, text) in UNITS.items():
        found[name].attrs |= {"units": units, "long_name": text}
    return found


def _shared(said: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes of a map that are not those of its own panel."""
    return {name: value for name, value in said.items() if name not in OF_ONE_PANEL}


OF_ONE_PANEL = ("panel", "panel_hash", "amplitude", "touch_agreement")


def _quantiles(values: Floats, shares: Sequence[float], *, axis: int) -> Floats:
    return np.asarray(np.quantile(values, shares, axis=axis, method="nearest"))


def band_rows(dataset: xr.Dataset) -> list[dict[str, float | str | None]]:
    """Return the bands with their intervals place by place [m]; None beyond what was thrown."""
    rows: list[dict[str, float | str | None]] = []
    for place in dataset["place"].to_numpy().tolist():
        at = dataset.sel(place=place)
        row: dict[str, float | str | None] = {"place": str(place)}
        for name, share in zip(("a90_low", "a90_middle", "a90_high"), SHARES, strict=True):
            for end in ("", "_low", "_high"):
                value = float(at[f"a90_band{end}"].sel(share=share))
                key = name + (f"_interval{end}" if end else "")
                row[key] = value if np.isfinite(value) else None
        rows.append(row)
    return rows
