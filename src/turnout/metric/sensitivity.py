"""Sensitivity of an output of many throws to each input, from the throws as they are."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import ResponseError

Floats = NDArray[np.float64]

# Numbers that take more values than this are put into classes of equal count: as many as leave so
# many throws in each, between two bounds.
MOST_LEVELS = 16
PER_CLASS, FEWEST_CLASSES, MOST_CLASSES = 25, 4, 24
RESAMPLES = 200
# Standard deviations to either side that hold 95 % of a normal distribution [-].
NORMAL_QUANTILE = 1.959964
OUTPUTS = ("peak_force", "object_force_peak", "end_gap")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NumericOutput:
    """One number of each throw: its name with drive or sensor, its unit, and its values."""

    name: str
    units: str
    values: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class SobolIndex:
    """The share of the variance of an output that an input has.

    Attributes
    ----------
    name : str
        Name of the input, a key of the study.
    first, first_confidence : float
        First-order index, and half the width of its 95 % interval [-].
    total, total_confidence : float
        With all interactions [-]; NaN where the throws do not identify it.
    """

    name: str
    first: float
    first_confidence: float
    total: float = float("nan")
    total_confidence: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Effect:
    """The mean of an output over one input.

    Attributes
    ----------
    name, units : str
        Name of the input, a key of the study, and its SI unit.
    levels : tuple of float or str
        Values, or the middles of classes.
    mean, confidence : ndarray, shape (n_levels,)
        Mean of the output, and half the width of its 95 % interval.
    """

    name: str
    units: str
    levels: tuple[float | str, ...]
    mean: Floats
    confidence: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputEffects:
    """Sensitivity of one output to all inputs.

    Attributes
    ----------
    output : NumericOutput
        Name, unit and values.
    indices : tuple of Index
        One an input, first and, from a sweep that was made for it, total.
    effects : tuple of Effect
        One an input.
    """

    output: NumericOutput
    indices: tuple[SobolIndex, ...]
    effects: tuple[Effect, ...]


def varying_inputs(labels: xr.Dataset) -> list[str]:
    """List the inputs of a sweep that differ between its throws.

    Parameters
    ----------
    labels : xarray.Dataset
        Of a sweep, with the dimension scenario; inputs are coordinates with ``attrs["input"]``.
    """
    names = [
        str(name)
        for name, values in labels.coords.items()
        if values.dims == ("scenario",) and name != "scenario" and "input" in values.attrs
    ]
    return [name for name in names if len({str(item) for item in labels[name].values}) > 1]


def numeric_outputs(
    labels: xr.Dataset, names: tuple[str, ...] = OUTPUTS, *, direction: str = "closing"
) -> list[NumericOutput]:
    """Return outputs one by one, each with its drive or sensor.

    Parameters
    ----------
    labels : xarray.Dataset
        Of a sweep, with the dimension scenario.
    names : tuple of str
        Labels or features; those that were not kept are refused, but for the default.
    direction : str
        Movement that is examined.

    Raises
    ------
    ResponseError
        When there is no such output, with those there are.
    """
    numeric = [str(n) for n, v in labels.data_vars.items() if v.dtype.kind in "fi" and v.ndim <= 3]
    unknown = [name for name in names if name not in numeric]
    if unknown and names is not OUTPUTS:
        message = f"no output '{unknown[0]}' in this sweep; there are {', '.join(numeric)}"
        raise ResponseError(message)
    found = []
    for name in names:
        if name in unknown:
            continue
        values = labels[name]
        if "direction" in values.dims:
            values = values.sel(direction=direction, drop=True)
        units = str(values.attrs.get("units", ""))
        others = [dim for dim in values.dims if dim != "scenario"]
        if not others:
            found.append(NumericOutput(name=name, units=units, values=_numbers(values)))
            continue
        dim = others[0]
        for item in values[dim].values if dim in values.coords else range(values.sizes[dim]):
            one = values.sel({dim: item}) if dim in values.coords else values.isel({dim: item})
            found.append(
                NumericOutput(name=f"{name}, {dim} {item}", units=units, values=_numbers(one))
            )
    return found


def _numbers(values: xr.DataArray) -> Floats:
    """Return values as numbers; logical ones of which nothing is known, -1, as NaN."""
    numbers = np.asarray(values.to_numpy(), dtype=np.float64)
    return np.where(numbers < 0, np.nan, numbers) if values.dtype.kind == "i" else numbers


def first_order_index(inputs: xr.DataArray, output: Floats, *, seed: int = 0) -> SobolIndex:
    r"""Estimate the first-order index of an input from throws of any design.

    The output is averaged over classes of the input; what the averages scatter more than chance
    would make them is the share of the input,

    .. math:: S = 1 - \frac{SS_\text{within} / (n - k)}{SS_\text{all} / (n - 1)},

    Kelley 1935, doi 10.1073/pnas.21.9.554. It takes inputs to be independent. The interval is that
    of resampled throws.

    Parameters
    ----------
    inputs : xarray.DataArray, shape (n,)
        Numbers or texts.
    output : ndarray, shape (n,)
        NaN where a throw has none.
    seed : int
        Of the resampling.

    Examples
    --------
    >>> x = xr.DataArray(np.linspace(0.0, 1.0, 200), dims="scenario", name="x")
    >>> first_order_index(x, 2.0 * x.values).first > 0.98
    True
    """
    known = ~np.isnan(output)
    classes, y = _classes(inputs.to_numpy())[0][known], output[known]
    rng = np.random.default_rng(seed)
    draws = rng.integers(0, y.size, (RESAMPLES, y.size)) if y.size else np.empty((0, 0), dtype=int)
    resampled = np.array([_share(classes[draw], y[draw]) for draw in draws])
    deviation = float(np.nanstd(resampled)) if resampled.size else float("nan")
    return SobolIndex(
        name=str(inputs.name),
        first=_share(classes, y),
        first_confidence=NORMAL_QUANTILE * deviation,
    )


def _share(classes: NDArray[np.int64], y: Floats) -> float:
    """Return the share of the variance between classes, less its expected value by chance."""
    if y.size < 2 or np.ptp(y) == 0.0:
        return 0.0
    counts = np.bincount(classes)
    used = counts > 0
    freedom = y.size - int(used.sum())
    if freedom < 1:
        return float("nan")
    sums = np.bincount(classes, weights=y)
    means = np.divide(sums, counts, out=np.zeros(counts.size), where=used)
    within = float(np.sum((y - means[classes]) ** 2)) / freedom
    return 1.0 - within / float(np.var(y, ddof=1))


def main_effect(inputs: xr.DataArray, output: Floats) -> Effect:
    """Average an output over the values of one input.

    Parameters
    ----------
    inputs : xarray.DataArray, shape (n,)
        Numbers or texts.
    output : ndarray, shape (n,)
        NaN where a throw has none.

    Examples
    --------
    >>> x = xr.DataArray([1.0, 1.0, 2.0, 2.0], dims="scenario", name="x")
    >>> main_effect(x, np.array([1.0, 3.0, 5.0, 7.0])).mean.tolist()
    [2.0, 6.0]
    """
    classes, levels = _classes(inputs.to_numpy())
    mean, half = np.full(len(levels), np.nan), np.full(len(levels), np.nan)
    for number in range(len(levels)):
        inside = output[(classes == number) & ~np.isnan(output)]
        if inside.size:
            mean[number] = inside.mean()
        if inside.size > 1:
            half[number] = NORMAL_QUANTILE * inside.std(ddof=1) / np.sqrt(inside.size)
    units = str(inputs.attrs.get("units", ""))
    return Effect(name=str(inputs.name), units=units, levels=levels, mean=mean, confidence=half)


def value_classes(
    values: NDArray[np.generic], *, most: int
) -> tuple[NDArray[np.int64], NDArray[np.generic]] | None:
    """Return the class of each text or number, and what each class has; None for more numbers."""
    if values.dtype.kind not in "fiu":
        names = dict.fromkeys(values.astype(str).tolist())
        numbers = dict(zip(names, range(len(names)), strict=True))
        return np.array([numbers[text] for text in values.astype(str).tolist()]), np.array([*names])
    known = np.unique(values)
    return (np.searchsorted(known, values), known) if known.size <= most else None


def _classes(values: NDArray[np.generic]) -> tuple[NDArray[np.int64], tuple[float | str, ...]]:
    """Return the class of each value, and the representative of each class."""
    found = value_classes(values, most=MOST_LEVELS)
    if found is not None:
        return found[0], tuple(found[1].tolist())
    numbers = values.astype(np.float64)
    count = int(np.clip(numbers.size // PER_CLASS, FEWEST_CLASSES, MOST_CLASSES))
    edges = np.quantile(numbers, np.linspace(0.0, 1.0, count + 1))[1:-1]
    classes = np.searchsorted(edges, numbers, side="right")
    middles = [
        float(np.median(numbers[classes == n])) for n in range(count) if (classes == n).any()
    ]
    _, dense = np.unique(classes, return_inverse=True)
    return dense, tuple(middles)
