"""The known-place bound along the blade, from the throws of `turnout limit`."""

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import Conditions
from turnout.detection.limit.known_place import (
    DRAWS,
    Draws,
    Population,
    Power,
    draw_sound,
    known_place_power,
)
from turnout.detection.limit.limit_map import (
    BOTH,
    LARGEST_SIZE,
    SIZE_STEP,
    SoundThrows,
    size_weights,
    smallest_seen,
    sound_throws,
)
from turnout.detection.throws import Throws

Floats = NDArray[np.float64]
Report = Callable[[int, int], None]

BEYOND = tuple(0.6e-3 * 1.35**number for number in range(10))
"""Sizes beyond the gap of a state that the ratio averages over, 0.6 to 8.9 mm [m]."""
TRIED = 33
"""Sizes at a place, evenly spaced, whose probability of detection is computed."""
UNITS = {
    "known_pod": ("1", "probability of detection if the place is known"),
    "known_a90": ("m", "smallest size from which nine of ten are detected if the place is known"),
    "known_a90_low": ("m", "lower end of its 95 % interval over draws and states"),
    "known_a90_high": ("m", "upper end of its 95 % interval over draws and states"),
    "known_threshold": ("1", "threshold of the logarithm of the likelihood ratio"),
    "known_alarm_rate_low": ("1", "lower end of the 95 % interval of the rate of drawn alarms"),
    "known_alarm_rate_high": ("1", "upper end of the 95 % interval of the rate of drawn alarms"),
}


def known_place_map(
    throws: Throws,
    conditions: Conditions,
    *,
    closing: float,
    channel: str = BOTH,
    draws: int = DRAWS,
    seed: int = 1,
    report: Report | None = None,
) -> xr.Dataset:
    """Return what can be seen at each place by a likelihood ratio for that place.

    Parameters
    ----------
    throws : Throws
        From `throw_all`.
    conditions : Conditions
        Discrepancy, noise, history, rate of false alarms.
    closing : float
        When the last closing begins [s].
    channel : str
        One of those of `limit_map`.
    draws : int
        Sound throws drawn from the local model.
    seed : int
        Of chance.
    report : callable, optional
        Called with places done and of how many.

    Returns
    -------
    xarray.Dataset
        `known_pod` over place and size; `known_a90` with its interval, `known_threshold` and the
        interval of the rate of alarms among the drawn sound throws over place. A size beyond the
        largest that was thrown counts as that one, and an a90 beyond it is NaN.
    """
    with one_blas_thread():
        known = sound_throws(throws, conditions, closing=closing)
        used = known.channels[channel]
        level = throws.level[throws.states]
        population = population_of(known, used, spread=conditions.level_deviation)
        drawn = draw_sound(population, level, draws=draws, seed=seed)
        signatures = known.features(throws.change)[..., used]
        rows = []
        for place in range(len(throws.places)):
            rows.append(_at(throws, place, signatures[:, place], drawn, conditions))
            if report is not None:
                report(place + 1, len(throws.places))
    names = tuple(UNITS)
    found = xr.Dataset(
        {
            name: (("place", "size") if name == "known_pod" else ("place",),
                   np.array([row[name] for row in rows]))
            for name in names
        },
        {"place": list(throws.places), "x": (("place",), throws.x), "size": _grid()},
        {"known_draws": draws},
    )  # fmt: skip
    for name, (units, text) in UNITS.items():
        found[name].attrs |= {"units": units, "long_name": text}
    return found


def population_of(known: SoundThrows, used: NDArray[np.intp], *, spread: float) -> Population:
    """Return some of the features of sound throws as local Gaussians."""
    return Population(
        level=known.levels,
        spread=spread,
        mean=known.mean[:, used],
        covariances=[item[np.ix_(used, used)] for item in known.covariances],
        shifts=[item[used] for item in known.shifts],
    )


def _grid() -> Floats:
    return np.arange(0.0, LARGEST_SIZE + 0.5 * SIZE_STEP, SIZE_STEP)


def _at(
    throws: Throws, place: int, signatures: Floats, drawn: Draws, conditions: Conditions
) -> dict[str, Floats | float]:
    """Return the row of a place; signatures of shape (n_states, n_sizes, n_features) [N]."""
    thrown, gaps = throws.sizes[place], throws.gap[:, place]
    signatures = _without_gaps(signatures)
    tried = np.linspace(max(float(gaps.min()), 0.0), float(thrown[-1]), TRIED)
    of_hypothesis = [
        size_weights(np.minimum(gap + np.array(BEYOND), thrown[-1]), thrown, gap=gap)
        for gap in gaps
    ]
    of_tried = [size_weights(tried, thrown, gap=gap) for gap in gaps]
    power = known_place_power(
        drawn,
        np.array([way @ own for way, own in zip(of_hypothesis, signatures, strict=True)]),
        np.array([way @ own for way, own in zip(of_tried, signatures, strict=True)]),
        false_alarm_rate=conditions.false_alarm_rate,
    )
    return _row(power, tried)


def _without_gaps(signatures: Floats) -> Floats:
    """Return signatures with those of sizes that found no room as the next smaller one's."""
    found = signatures.copy()
    found[:, 0] = np.nan_to_num(found[:, 0])
    for size in range(1, found.shape[1]):
        lacking = ~np.isfinite(found[:, size]).all(axis=-1)
        found[lacking, size] = found[lacking, size - 1]
    return found


def _row(power: Power, tried: Floats) -> dict[str, Floats | float]:
    sizes = _grid()
    pods = np.array([np.interp(sizes, tried, row) for row in (power.pod, *power.pods)])
    seen = smallest_seen(pods, sizes)
    seen = np.where(seen <= tried[-1], seen, np.inf)
    low, high = np.quantile(seen[1:], [0.025, 0.975], method="nearest")
    of_rate = power.alarm_rate
    ends = (float(value) if np.isfinite(value) else np.nan for value in (seen[0], low, high))
    a90, a90_low, a90_high = ends
    return {
        "known_pod": pods[0],
        "known_a90": a90,
        "known_a90_low": a90_low,
        "known_a90_high": a90_high,
        "known_threshold": power.threshold,
        "known_alarm_rate_low": of_rate[0],
        "known_alarm_rate_high": of_rate[1],
    }


def known_rows(dataset: xr.Dataset) -> list[dict[str, float | str | None]]:
    """Return the known-place a90 at each place and its interval [m]; None beyond thrown sizes."""
    rows: list[dict[str, float | str | None]] = []
    for place in dataset["place"].to_numpy().tolist():
        at = dataset.sel(place=place)
        row: dict[str, float | str | None] = {"place": str(place)}
        for name in UNITS:
            if name != "known_pod":
                value = float(at[name])
                row[name] = value if np.isfinite(value) else None
        rows.append(row)
    return rows
