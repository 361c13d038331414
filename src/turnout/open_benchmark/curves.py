"""What the figures of the benchmark show: curves of stored verdicts."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.open_benchmark.definition import HARD, MID_SPAN, SOUND
from turnout.open_benchmark.method import object_touched
from turnout.open_benchmark.metrics import roc_curve
from turnout.open_benchmark.score import KNOWN_PLACE
from turnout.open_benchmark.sides import Side
from turnout.open_benchmark.verdicts import read_verdicts

Floats = NDArray[np.float64]
EDGES = 1e-3 * np.array([1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.5, 20.0, 23.0, 27.0, 31.0])
"""Of the classes of sizes [m]."""


def benchmark_curves(
    results: Mapping[str, Mapping[str, Any]], side: Side, place: Path
) -> tuple[dict[str, tuple[Floats, Floats]], Floats, dict[str, Floats]]:
    """Return curves over false alarms, middles of classes of sizes, and curves over size.

    Parameters
    ----------
    results : mapping of str to mapping
        Of the methods, by name.
    side : Side
        Judged test throws, of the same track.
    place : Path
        Folder with their verdict files.
    """
    sound, touched = side.labels["role"] == SOUND, object_touched(side)
    middle = np.isin(side.labels["place"], MID_SPAN) & np.isin(side.labels["kind"], HARD)
    which = np.digitize(side.labels["size"], EDGES) - 1
    roc, pod = {}, {}
    for name, result in results.items():
        verdicts = read_verdicts(place / f"{name}.csv", throws=side.throw, positions=side.positions)
        title = str(result["title"])
        roc[title] = roc_curve(verdicts.score[sound], verdicts.score[touched])
        share = []
        for number in range(len(EDGES) - 1):
            own = middle & (which == number)
            share.append(float(verdicts.alarm[own].mean()) if own.sum() >= LEAST else np.nan)
        pod[title] = np.array(share)
    return roc, 0.5 * (EDGES[1:] + EDGES[:-1]), pod


LEAST = 4
"""Objects in a class that is drawn."""


def bound_mid_span(history: int) -> float | None:
    """Return a90 of the bound at a known place, mean of sleepers 4 to 8 [m].

    Examples
    --------
    >>> round(1e3 * bound_mid_span(20), 2)
    9.62
    """
    found = KNOWN_PLACE.get(history)
    return None if found is None else 1e-3 * float(np.mean(found[4:9]))
