"""From paired throws to the map of what can be seen: probability of detection, a90, touch floor."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.core.channels import SCHEMA_VERSION
from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import FORCE
from turnout.detection.drive_quantities import noise_of, quantities_of
from turnout.detection.features import features_of, noise_covariance, window_means
from turnout.detection.floor import touch_floor, touched
from turnout.detection.limit.bound import predictive, probability_of_detection
from turnout.detection.limit.pooled_windows import pooled_windows
from turnout.detection.pod.roc import index_quantiles
from turnout.detection.population import local_models
from turnout.detection.reference import Conditions
from turnout.detection.signal_discrepancy import Signal, discrepancy_of_signals
from turnout.detection.throws import Throws

Floats = NDArray[np.float64]

SIZE_STEP, LARGEST_SIZE = 0.1e-3, 25e-3
"""Of the sizes at which the map is evaluated [m]."""
WANTED = 0.9
"""Probability of detection of the size a90 [-]."""
RESAMPLES = 200
KIND = "limit"
"""Attribute `kind` of the dataset."""
BOTH = "both drives"
"""Name of the channel that holds the features of all drives."""
UNITS = {
    "pod": ("1", "probability of detection"),
    "index_quantile": ("1", "index of detection that a share of the states stays below"),
    "a90": ("m", "smallest size from which nine of ten objects are detected"),
    "a90_low": ("m", "lower end of the 95 % interval of a90 over drawn states"),
    "a90_high": ("m", "upper end of the 95 % interval of a90 over drawn states"),
    "a90_resampled": ("m", "a90 of states drawn again with replacement; infinite beyond the sizes"),
    "touch_floor": ("m", "size that is touched in nine of ten states"),
    "largest_size": ("m", "largest size that was thrown"),
    "x": ("m", "position from the toe"),
    "size": ("m", "size of the object"),
}


def limit_map(
    throws: Throws,
    conditions: Conditions,
    *,
    closing: float,
    averaged: int = 1,
    beside: Floats | None = None,
) -> xr.Dataset:
    """Return probability of detection over place and size, from both drives and from each alone.

    Parameters
    ----------
    throws : Throws
        From `throw_all`.
    conditions : Conditions
        Discrepancy, noise, history, rate of false alarms.
    closing : float
        When the last closing begins [s].
    averaged : int
        Throws of the same switch, with the object in place, whose mean is judged.
    beside : ndarray, shape (n_states, n_places, n_sizes), optional
        Change of an independent reading by each object, in its standard deviations [-].

    Returns
    -------
    xarray.Dataset
        With `pod` over channel, place and size; `a90` with its interval over channel and place;
        `a90_resampled`, from which the interval is: maps of as many states have the same draws,
        so that their differences have intervals too; `touch_floor` over place. A size beyond the
        largest that was thrown at a place counts as that one, and an a90 beyond it is NaN.
    """
    with one_blas_thread():
        return _limit_map(throws, conditions, closing=closing, averaged=averaged, beside=beside)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoundThrows:
    """Knowledge of the bound about sound throws.

    Attributes
    ----------
    means : ndarray, shape (n_windows, n_times)
        Averages samples over windows.
    pooling : ndarray, shape (n_features, n_signals * n_windows), or None
        Pools windows of currents and powers, see `pooled_windows`; None for forces.
    covariances : tuple of ndarray, each of shape (n_features, n_features)
        Of a sound throw at each level, given the history [N^2].
    levels : ndarray, shape (n_levels,)
        Friction levels [-].
    mean : ndarray, shape (n_levels, n_features)
        Of the population at each level [N].
    shifts : tuple of ndarray, each of shape (n_features, r)
        What a history makes of the mean, from `Predictive` [N].
    channels : mapping of str to ndarray
        Features of all drives, of each alone, and of the forces where there are others too.
    """

    means: Floats
    pooling: Floats | None
    covariances: tuple[Floats, ...]
    levels: Floats
    mean: Floats
    shifts: tuple[Floats, ...]
    channels: Mapping[str, NDArray[np.intp]]

    def features(self, values: Floats) -> Floats:
        """Return the features of signals of shape (..., n_signals, n_times)."""
        return _pooled(features_of(values, self.means), self.pooling)

    def nearest(self, level: Floats) -> NDArray[np.intp]:
        """Return the number of the level that is nearest to each of some levels."""
        return np.asarray(np.abs(level[:, np.newaxis] - self.levels).argmin(axis=1))


def _pooled(features: Floats, pooling: Floats | None) -> Floats:
    return features if pooling is None else np.asarray(features @ pooling.T)


def _pooled_covariance(covariance: Floats, pooling: Floats | None) -> Floats:
    return covariance if pooling is None else pooling @ covariance @ pooling.T


def sound_throws(
    throws: Throws, conditions: Conditions, *, closing: float, averaged: int = 1
) -> SoundThrows:
    """Return the covariances of sound throws under some conditions.

    Parameters
    ----------
    throws : Throws
        From `throw_all`.
    conditions : Conditions
        Discrepancy, noise, history.
    closing : float
        When the last closing begins [s].
    averaged : int
        Throws of the same switch whose mean is judged.
    """
    means = window_means(throws.time, closing=closing)
    pooling = pooled_windows(throws.signals, means)
    models = local_models(
        _pooled(features_of(throws.sound, means), pooling),
        switch=throws.switch, level=throws.level,
    )  # fmt: skip
    sampled = 1.0 / float(throws.time[1] - throws.time[0])
    discrepancy = discrepancy_of_signals(
        throws.time, means,
        errors=throws.errors, signals=throws.signals, conditions=conditions,
    )  # fmt: skip
    noise = noise_covariance(
        means,
        noise=noise_of(throws.signals, conditions), conditions=conditions, sampled=sampled,
    )  # fmt: skip
    expected = predictive(
        models,
        discrepancy=_pooled_covariance(discrepancy, pooling),
        noise=_pooled_covariance(noise, pooling),
        fixed_share=conditions.fixed_share,
        level_deviation=conditions.level_deviation,
        history=conditions.history,
        averaged=averaged,
    )
    return SoundThrows(
        means=means,
        pooling=pooling,
        covariances=expected.covariances,
        levels=np.array([item.level for item in models]),
        mean=np.array([item.mean for item in models]),
        shifts=expected.shifts,
        channels=_channels(throws.signals, pooling, windows=len(means)),
    )


def _channels(
    signals: Sequence[Signal], pooling: Floats | None, *, windows: int
) -> dict[str, NDArray[np.intp]]:
    """Return the features of all signals, of each drive, and of forces if there are others too.

    Beside forces the windows of the others are too wide to show what they can do alone.
    """
    used = np.eye(len(signals) * windows) if pooling is None else pooling
    owner = used.argmax(axis=1) // windows
    of_each = [np.flatnonzero(owner == number) for number in range(len(signals))]
    drives = dict.fromkeys(item.drive for item in signals)
    quantities = {item.quantity for item in signals}
    kept = {BOTH: list(range(len(signals)))}
    for name in drives:
        kept[f"drive {name}"] = [n for n, item in enumerate(signals) if item.drive == name]
    for name in {FORCE} & quantities if len(quantities) > 1 else ():
        kept[name] = [n for n, item in enumerate(signals) if item.quantity == name]
    return {name: np.concatenate([of_each[row] for row in rows]) for name, rows in kept.items()}


def too_few_sound(throws: Throws, *, closing: float) -> str:
    """Return a warning where so few sound throws do not determine the covariance, or nothing.

    Of forces the discrepancy fills what throws leave open. What current and power are beside the
    force has a much smaller one, so directions in which few throws happen not to scatter count as
    visible.
    """
    pooling = pooled_windows(throws.signals, window_means(throws.time, closing=closing))
    if pooling is None or len(throws.sound) >= ENOUGH * len(pooling):
        return ""
    return (
        f"{len(throws.sound)} sound throws for {len(pooling)} features of "
        f"{len(throws.signals)} signals: the bound is too optimistic; take "
        f"{ENOUGH * len(pooling)} sound throws, or fewer channels"
    )


ENOUGH = 10
"""Sound throws for each feature where not all signals are forces: half of them then confirm, within
0.2 mm, the a90 that all of them claim."""


def _limit_map(
    throws: Throws,
    conditions: Conditions,
    *,
    closing: float,
    averaged: int,
    beside: Floats | None,
) -> xr.Dataset:
    known = sound_throws(throws, conditions, closing=closing, averaged=averaged)
    nearest = known.nearest(throws.level[throws.states])
    signatures = known.features(throws.change)
    sizes = np.arange(0.0, LARGEST_SIZE + 0.5 * SIZE_STEP, SIZE_STEP)
    on_sizes = [
        [size_weights(sizes, throws.sizes[place], gap=gap) for place, gap in enumerate(row)]
        for row in throws.gap
    ]
    pod = np.stack(
        [
            _detected(signatures, on_sizes, known.covariances, nearest, used, conditions, beside)
            for used in known.channels.values()
        ]
    )
    return _dataset(throws, conditions, pod=pod, sizes=sizes, channels=list(known.channels))


def size_weights(sizes: Floats, thrown: Floats, *, gap: float) -> Floats:
    """Return how signatures of thrown sizes make up those of others, by straight lines.

    At the gap of a sound closing the signature is zero, below it too.

    Parameters
    ----------
    sizes : ndarray, shape (n,)
        Wanted [m].
    thrown : ndarray, shape (k,)
        Rising [m].
    gap : float
        [m]

    Returns
    -------
    ndarray, shape (n, k)
        [-]

    Examples
    --------
    >>> thrown = np.array([1.0, 2.0, 4.0])
    >>> size_weights(np.array([1.0, 1.75, 3.0, 9.0]), thrown, gap=1.5).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]
    """
    kept = np.flatnonzero(thrown > gap)
    found = np.zeros((sizes.size, thrown.size))
    nodes = np.concatenate([[gap], thrown[kept]])
    for column, place in enumerate(kept, 1):
        hat = np.zeros(nodes.size)
        hat[column] = 1.0
        found[:, place] = np.interp(sizes, nodes, hat)
    return found


def _detected(
    signatures: Floats,
    on_sizes: Sequence[Sequence[Floats]],
    covariances: Sequence[Floats],
    nearest: NDArray[np.intp],
    used: NDArray[np.intp],
    conditions: Conditions,
    beside: Floats | None,
) -> Floats:
    """Return the probability of detection, shape (n_states, n_places, n_sizes)."""
    lower = [np.linalg.cholesky(item[np.ix_(used, used)]) for item in covariances]
    roots = [solve_triangular(item, np.eye(len(used)), lower=True).T for item in lower]
    found = []
    for state, row in enumerate(on_sizes):
        root = roots[nearest[state]]
        each = []
        for place, weights in enumerate(row):
            known = np.isfinite(signatures[state, place][:, used]).all(axis=-1)
            white = np.where(known[:, np.newaxis], signatures[state, place][:, used], 0.0) @ root
            gram = white @ white.T
            if beside is not None:
                gram += np.outer(beside[state, place], beside[state, place])
            squared = np.einsum("ni,ij,nj->n", weights, gram, weights)
            each.append(np.sqrt(np.maximum(squared, 0.0)))
        found.append(each)
    return probability_of_detection(np.array(found), false_alarm_rate=conditions.false_alarm_rate)


def smallest_seen(pod: Floats, sizes: Floats, *, wanted: float = WANTED) -> Floats:
    """Return the smallest size from which on a probability is reached, NaN where it never is.

    Parameters
    ----------
    pod : ndarray, shape (..., n_sizes)
        [-]
    sizes : ndarray, shape (n_sizes,)
        Rising [m].

    Examples
    --------
    >>> smallest_seen(np.array([[0.0, 0.95, 1.0], [0.0, 0.1, 0.2]]), np.array([1.0, 2.0, 3.0]))
    array([ 2., nan])
    """
    below = pod < wanted
    after = below.shape[-1] - np.argmax(below[..., ::-1], axis=-1)  # first one after the last below
    after = np.where(below.any(axis=-1), after, 0)
    reached = after < sizes.size
    return np.where(reached, sizes[np.minimum(after, sizes.size - 1)], np.nan)


def _dataset(
    throws: Throws,
    conditions: Conditions,
    *,
    pod: Floats,
    sizes: Floats,
    channels: list[str],
) -> xr.Dataset:
    rng = np.random.default_rng(1)
    states = pod.shape[1]
    largest = throws.sizes.max(axis=1)

    def seen(values: Floats) -> Floats:
        found = smallest_seen(values, sizes)
        return np.where(found <= largest, found, np.nan)

    drawn = np.array(
        [seen(pod[:, rng.integers(0, states, states)].mean(axis=1)) for _ in range(RESAMPLES)]
    )
    drawn = np.where(np.isnan(drawn), np.inf, drawn)
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0, method="nearest")
    places = ("channel", "place")
    agree = touched(throws.force_peak) == (throws.sizes > throws.gap[..., np.newaxis])
    dataset = xr.Dataset(
        {
            "pod": (("channel", "place", "size"), pod.mean(axis=1)),
            "index_quantile": (
                ("share", "channel", "place", "size"),
                index_quantiles(pod, false_alarm_rate=conditions.false_alarm_rate),
            ),
            "a90": (places, seen(pod.mean(axis=1))),
            "a90_low": (places, np.where(np.isinf(low), np.nan, low)),
            "a90_high": (places, np.where(np.isinf(high), np.nan, high)),
            "a90_resampled": (("resample", *places), drawn),
            "touch_floor": (("place",), touch_floor(throws.gap)),
            "largest_size": (("place",), largest),
        },
        {
            "channel": channels,
            "place": list(throws.places),
            "x": (("place",), throws.x),
            "size": sizes,
        },
        {
            "schema_version": SCHEMA_VERSION,
            "kind": KIND,
            "panel": throws.panel,
            "panel_hash": throws.panel_hash,
            **asdict(conditions),
            "states": states,
            "sound_throws": len(throws.sound),
            "object_throws": int(np.isfinite(throws.force_peak).sum()),
            "amplitude": throws.amplitude.tolist(),
            "quantities": quantities_of(throws.signals),
            "object_kind": throws.kind,
            "touch_agreement": float(agree.mean()),
            "bound": "linear-Gaussian: place, size and signature known; optimistic",
        },
    )
    for name, (units, long_name) in UNITS.items():
        dataset[name].attrs |= {"units": units, "long_name": long_name}
    return dataset


def rows_of(dataset: xr.Dataset) -> list[Mapping[str, float | str | None]]:
    """Return touch floor and a90 at each place, lengths in metres; None beyond what was thrown."""
    rows: list[Mapping[str, float | str | None]] = []
    for place in dataset["place"].to_numpy().tolist():
        at = dataset.sel(place=place)
        row: dict[str, float | str | None] = {
            "place": str(place),
            "x": float(at["x"]),
            "touch_floor": float(at["touch_floor"]),
            "largest_size": float(at["largest_size"]),
        }
        for channel in dataset["channel"].to_numpy().tolist():
            one = at.sel(channel=channel)
            for name in ("a90", "a90_low", "a90_high"):
                value = float(one[name])
                key = name if channel == BOTH else f"{name}, {channel}"
                row[key] = value if np.isfinite(value) else None
        rows.append(row)
    return rows
