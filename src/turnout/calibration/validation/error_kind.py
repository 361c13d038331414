"""What most of a difference is: timing, level or shape."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# Share of a difference that a shift or a factor must explain to name it.
EXPLAINED = 0.5


def error_kind(measured: Floats, predicted: Floats) -> str:
    """Return what most of a difference is: "timing", "level" or "shape".

    Timing is what a shift explains (the slope of the prediction), level what a factor and an offset
    do; where neither explains half of it, the shape differs.

    Parameters
    ----------
    measured, predicted : ndarray, shape (n_movements, n_times)
        NaN where nothing was measured [N].

    Returns
    -------
    str
        Of all movements together, with one shift or one factor and offset; "" without a difference.

    Examples
    --------
    >>> wave = np.sin(np.arange(200) / 20.0)[None, :]
    >>> error_kind(np.roll(wave, 3), wave), error_kind(1.1 * wave + 0.2, wave)
    ('timing', 'level')
    """
    known = np.isfinite(measured) & np.isfinite(predicted)
    off = (measured - predicted)[known]
    total = float(off @ off)
    if not total:
        return ""
    slope = np.gradient(predicted, axis=1)
    columns = {
        "timing": [slope[known]],
        "level": [predicted[known], np.ones(off.size)],
    }
    shares = {}
    for name, rows in columns.items():
        matrix = np.nan_to_num(np.stack(rows, axis=1))
        rest = off - matrix @ np.linalg.lstsq(matrix, off, rcond=None)[0]
        shares[name] = 1.0 - float(rest @ rest) / total
    best = max(shares, key=lambda name: shares[name])
    return best if shares[best] > EXPLAINED else "shape"


def error_kinds(measured: Floats, predicted: Floats, *, least: float) -> dict[str, int]:
    """Return in how many movements most of the difference is of each kind, the most common first.

    Parameters
    ----------
    measured, predicted : ndarray, shape (n_movements, n_times)
        As of `error_kind`.
    least : float
        Movements whose root mean square difference is less do not count: theirs is chance [N].

    Examples
    --------
    >>> wave = np.sin(np.arange(200) / 20.0)
    >>> measured = np.stack([np.roll(wave, 3), np.roll(wave, -3), 1.1 * wave + 0.2])
    >>> error_kinds(measured, np.stack([wave] * 3), least=0.1)
    {'timing': 2, 'level': 1}
    """
    found: dict[str, int] = {}
    for one, other in zip(measured, predicted, strict=True):
        known = np.isfinite(one) & np.isfinite(other)
        if not known.any() or np.sqrt(np.mean((one - other)[known] ** 2)) < least:
            continue
        kind = error_kind(one[None, :], other[None, :])
        found[kind] = found.get(kind, 0) + 1
    return dict(sorted(found.items(), key=lambda item: -item[1]))
