"""Bands over the plausible panels: the table and the figure of docs/evidence/blind-zones.md.

    python -m benchmarks.limit_panels FOLDER --default FOLDER

FOLDER is that of `turnout limit --panels plausible-panels`, the other that of `turnout limit` for
the default panel. Throws are read as they are; of the default panel only as many states, sound
throws and sizes as the panels have.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.detection.limit.bands import bands_of, panels_of
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.reference import Conditions
from turnout.detection.throws import QUICK_STEPS, STEPS, Throws, closing_time, stored_throws
from turnout.figures.limit import plot_bands
from turnout.figures.style import rendered
from turnout.study.sweep.read import open_batches

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "limit_panels.png"
STUDY = "plausible-panels"
SHOWN = {"low": 0, "middle": 1, "high": 2}


def main() -> None:
    """Print rows in millimetres, write the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path)
    options.add_argument("--default", type=Path, required=True)
    given = options.parse_args()
    maps, names, states, sound = [], [], [], []
    for member in panels_of(STUDY):
        folder = given.folder / member.name
        if not thrown(folder):
            print(f"{member.name}: not thrown, or not all of it")
            continue
        throws = stored_throws(member.panel, folder)
        maps.append(limit_map(throws, Conditions(), closing=closing_time(member.panel)))
        names.append(member.name)
        states.append(len(throws.states))
        sound.append(len(throws.sound))
    print(f"states {min(states)} to {max(states)}, sound throws {min(sound)} to {max(sound)}")
    usual = as_thrown(stored_throws(None, given.default), states=max(states), sound=max(sound))
    default = limit_map(usual, Conditions(), closing=closing_time())
    found = bands_of(names, maps)
    FIGURE.write_bytes(rendered(plot_bands(found), ".png"))
    report(found, maps, default)


def thrown(folder: Path) -> bool:
    """Return True if all throws of a panel are there."""
    kept = folder / "objects"
    return kept.exists() and not open_batches(kept).attrs["missing"]


def as_thrown(throws: Throws, *, states: int, sound: int) -> Throws:
    """Return the first states and sound throws, with the sizes of a quick estimate."""
    sizes = [STEPS.index(step) for step in QUICK_STEPS]
    kept = throws.states < states
    return replace(
        throws, sound=throws.sound[:sound], switch=throws.switch[:sound],
        level=throws.level[:sound], states=throws.states[kept],
        change=throws.change[kept][:, :, sizes], force_peak=throws.force_peak[kept][:, :, sizes],
        gap=throws.gap[kept], sizes=throws.sizes[:, sizes],
    )  # fmt: skip


def report(found: xr.Dataset, maps: list[xr.Dataset], default: xr.Dataset) -> None:
    """Print bands, their intervals, and those of the difference from the default panel."""
    both = [item.sel(channel="both drives", place=found["place"]) for item in (*maps, default)]
    a90 = np.array([item["a90"].to_numpy() for item in both])
    drawn = np.array([item["a90_resampled"].to_numpy() for item in both])
    print(row("default panel", a90[-1]))
    for share, number in SHOWN.items():
        for end in ("", "_low", "_high"):
            print(row(f"{share}{end}", found[f"a90_band{end}"].to_numpy()[number]))
    beyond = np.isnan(a90[:-1]).sum(axis=0)
    print("beyond what was thrown:", dict(zip(found["place"].values, beyond, strict=True)))
    filled = np.where(np.isfinite(a90), a90, np.inf)
    same = [len(item) == len(drawn[-1]) for item in drawn[:-1]]
    difference = filled[:-1] - filled[-1]
    with np.errstate(invalid="ignore"):  # where both lie beyond, the difference is not known
        of_draws = drawn[:-1][same] - drawn[-1]
    for share in (0.05, 0.5, 0.95):
        ends = np.nanquantile(of_draws, share, axis=0, method="nearest")
        low, high = np.nanquantile(ends, (0.025, 0.975), axis=0, method="nearest")
        value = np.quantile(difference, share, axis=0, method="nearest")
        print(row(f"less the default, {share:g}", value))
        print(row("   low", low), "\n" + row("   high", high))
    floor = found["touch_floor"].to_numpy()
    at = list(found["place"].values).index("sleeper 6")
    known = np.isfinite(a90[:-1, at])
    fit = np.corrcoef(floor[known, at], a90[:-1][known, at])[0, 1]
    print(f"sleeper 6: touch floor {1e3 * floor[:, at].min():.1f} to {1e3 * floor[:, at].max():.1f}"
          f" mm, correlation with a90 {fit:.2f}")  # fmt: skip


def row(title: str, values: np.ndarray) -> str:
    """Return a row of a table in millimetres."""
    cells = [f"{1e3 * value:.1f}" if np.isfinite(value) else "-" for value in values]
    return f"| {title} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
