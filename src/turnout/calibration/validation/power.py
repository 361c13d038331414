"""Least errors that a verdict notices: how far off a value, an onset or a lag must be.

The prediction is moved as the error would move it, and judged by the same rules on the same
measurement: the error of each channel beside its repeats, and the coverage of its band. A wrong
value moves it by its slope and by a bend, from a throw where the slope alone says that it is
noticed: one to either side, since a drive may slip to one of them only. The least amount is rounded
up. Each is named by its kind: timing, level or shape.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.measured_movements import later

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


# What is tried, as a share of a value; of lengths [m], onsets and lags [s].
SHARES = np.geomspace(1e-4, 0.5, 86)
LENGTHS, TIMES = np.geomspace(1e-6, 1e-2, 81), np.geomspace(1e-3, 0.5, 55)
# A wrong value has bands of its own: 13 % wider with friction 7 % too high (`sb1`); so much wider
# ones than those of the right values have to notice it.
WIDER = 1.15
# A lead of the motors beyond this is taken off before anything is judged [s].
LEAD_TAKEN_OFF = 0.015


@dataclass(frozen=True, slots=True, eq=False)
class Rules:
    """By what a prediction is refused.

    Attributes
    ----------
    measured, reach : ndarray, shape (n_channels, n_movements, n_times)
        Measured forces, NaN where there are none, and half the band [N].
    most_rms, least_cover : ndarray, shape (n_channels,)
        Largest error [N] and least coverage of each channel [-].
    least_pooled : float
        Least coverage of all channels together [-].
    """

    measured: Floats
    reach: Floats
    most_rms: Floats
    least_cover: Floats
    least_pooled: float

    def refused(self, predicted: Floats) -> NDArray[np.bool_]:
        """Return which channels of a prediction are refused; all where their coverage is."""
        off = predicted - self.measured
        known = np.isfinite(off)
        count = known.sum(axis=2)
        squares = np.where(known, off, 0.0) ** 2
        own = np.divide(squares.sum(axis=2), count, out=np.zeros(count.shape), where=count > 0)
        measured = np.maximum((count > 0).sum(axis=1), 1)
        rms = np.sqrt(own.sum(axis=1) / measured)
        within = (known & (np.abs(off) <= self.reach)).sum(axis=(1, 2))
        total = np.maximum(count.sum(axis=1), 1)
        found = (rms > self.most_rms) | (within / total < self.least_cover)
        found &= count.any(axis=1)
        if within.sum() < self.least_pooled * total[count.any(axis=1)].sum():
            found |= within / total == np.min((within / total)[count.any(axis=1)])
        return np.asarray(found)


def noticed_errors(part: xr.Dataset, rules: Rules) -> tuple[str, ...]:
    """Say how far each value, the onset and the lag of each drive must be off to be noticed.

    Parameters
    ----------
    part : xarray.Dataset
        From `validate`, of the movements that are judged.
    rules : Rules
        Of the verdict.

    Returns
    -------
    tuple of str
        Such as "drive.1.stiffness off by 4.1 % (timing of drive 1)": by which channel, and whether
        it is the timing, the level or the shape of its force that changes most.
    """
    predicted, wide = _rows(part["predicted"]), _of_wrong_values(rules)
    channels = [str(name) for name in part["channel"].values]
    found = []
    unchecked = json.loads(part.attrs.get("unchecked", "{}"))
    for name in part["parameter"].values if "change" in part else ():
        if name in unchecked:
            # By its slope alone too little would be stated.
            found.append(f"{name}: not checked by a throw: {unchecked[name]}")
            continue
        is_length, amounts, moved = _changed(part, str(name), predicted)
        least = _least(wide, predicted, moved, amounts, both=True)
        text, largest = (
            "" if item is None else _size(item, is_length=is_length)
            for item in (least and least[0], float(amounts[-1]))
        )
        found.append(_said(str(name), text, largest, least, channels))
    for name, moved, most in _timings(part, predicted, channels):
        # What is said to have been tried was.
        amounts = np.append(TIMES[most > TIMES], most)
        # No value is wrong, which would have bands of its own.
        least = _least(rules, predicted, moved, amounts, both=name == "onset")
        text = "" if least is None else _milliseconds(least[0])
        found.append(_said(name, text, _milliseconds(most), least, channels))
    if part.attrs.get("onsets") == "fitted":
        found.append("onset: not judged, it is fitted to each movement that no motor current marks")
    return tuple(found)


def noticed_to_first_order(part: xr.Dataset, rules: Rules) -> dict[str, tuple[float, float]]:
    """Return by how much each value must be off to be noticed, as far as its slope says.

    Parameters
    ----------
    part : xarray.Dataset
        With `change`, of the movements that are judged.
    rules : Rules
        Of the verdict.

    Returns
    -------
    dict of str to tuple of float
        The least amounts upwards (positive) and downwards (negative), as shares of the value, of a
        length in metres; nothing for values that are not noticed in both directions.
    """
    predicted, wide = _rows(part["predicted"]), _of_wrong_values(rules)
    found = {}
    for name in part["parameter"].values:
        _, amounts, moved = _changed(part, str(name), predicted)
        least = [_least(wide, predicted, moved, sign * amounts, both=False) for sign in (1.0, -1.0)]
        reached = [item[0] for item in least if item is not None]
        if len(reached) == len(least):
            found[str(name)] = (reached[0], reached[1])
    return found


def _rows(field: xr.DataArray) -> Floats:
    """Return values by channel, movement and time, after a side where there is one."""
    return np.asarray(field.transpose(..., "channel", "movement", "time").values, dtype=np.float64)


def _of_wrong_values(rules: Rules) -> Rules:
    """Return the rules with the wider bands that a wrong value has of its own."""
    return replace(rules, reach=WIDER * rules.reach)


def _changed(
    part: xr.Dataset, name: str, predicted: Floats
) -> tuple[bool, Floats, Callable[[float], Floats]]:
    """Return whether a value is a length, what is tried of it, and how it moves a prediction."""
    one = part["change"].sel(parameter=name)
    change, is_length = np.nan_to_num(_rows(one)), str(one["unit"].values) == "m"
    bends = np.zeros((2, *change.shape))
    if "bend" in part:
        bends = np.nan_to_num(_rows(part["bend"].sel(parameter=name)))

    def moved(amount: float) -> Floats:
        bend = bends[0 if amount > 0.0 else 1]
        return np.asarray(predicted + amount * change + amount**2 * bend)

    return is_length, LENGTHS if is_length else SHARES, moved


def _along(predicted: Floats, change: Floats) -> Callable[[float], Floats]:
    return lambda amount: np.asarray(predicted + amount * np.nan_to_num(change))


def _timings(
    part: xr.Dataset, predicted: Floats, channels: list[str]
) -> list[tuple[str, Callable[[float], Floats], float]]:
    """Return errors in time by name: how they move a prediction, and how large they can be [s]."""
    step = float(part["time"][1] - part["time"][0])
    found: list[tuple[str, Callable[[float], Floats], float]] = []
    if part.attrs.get("onsets") == "marked":
        found.append(("onset", _along(predicted, later(predicted)), LEAD_TAKEN_OFF))
    if "touched" not in part:
        return found
    touched = part["touched"].values
    for row, name in enumerate(channels):
        if not name.startswith("drive ") or not np.isfinite(touched).any():
            continue
        start = np.where(np.isfinite(touched), touched, np.inf)
        late = part["time"].values[None, :] >= start[:, None]

        def moved(lag: float, row: int = row, late: NDArray[np.bool_] = late) -> Floats:
            found = predicted.copy()
            found[row] = _lagged(predicted[row], late, float(1.0 - np.exp(-step / lag)))
            return found

        found.append((f"lag of {name}", moved, float(TIMES[-1])))
    return found


def _lagged(force: Floats, late: NDArray[np.bool_], share: float) -> Floats:
    """Let forces, shape (n_movements, n_times), follow with a first-order lag where it is late."""
    found = force.copy()
    for number in range(1, force.shape[1]):
        before = found[:, number - 1]
        followed = before + share * (force[:, number] - before)
        found[:, number] = np.where(late[:, number], followed, force[:, number])
    return found


def _least(
    rules: Rules,
    predicted: Floats,
    moved: Callable[[float], Floats],
    amounts: Floats,
    *,
    both: bool,
) -> tuple[float, int, str] | None:
    """Return the least error that is noticed whatever its sign, in which channel, and as what."""
    # A channel that is refused already notices nothing more.
    before = rules.refused(predicted)
    noticed: list[tuple[float, int, str]] = []
    for sign in (1.0, -1.0) if both else (1.0,):
        for amount in amounts.tolist():
            trial = moved(sign * amount)
            new = np.flatnonzero(rules.refused(trial) & ~before)
            if new.size:
                change = np.sqrt(np.nanmean((trial - predicted) ** 2, axis=(1, 2)))
                row = int(new[np.argmax((change / rules.most_rms)[new])])
                known = np.where(np.isfinite(rules.measured[row]), predicted[row], np.nan)
                noticed.append((amount, row, error_kind(trial[row], known)))
                break
        else:
            return None
    return max(noticed, default=None)


def _size(amount: float, *, is_length: bool) -> str:
    number = 1e3 * amount if is_length else 100 * amount
    # Up: what is less than stated need not be noticed.
    digits = max(1 - math.floor(math.log10(number)), 0)
    text = f"{math.ceil(number * 10**digits - 1e-9) / 10**digits:.{digits}f}"
    return f"{text} mm" if is_length else f"{text} %"


def _milliseconds(amount: float) -> str:
    """Return a time in words, rounded up.

    Examples
    --------
    >>> _milliseconds(0.00631), _milliseconds(0.015)
    ('7 ms', '15 ms')
    """
    return f"{math.ceil(1e3 * amount - 1e-9)} ms"


def _said(
    name: str, text: str, most: str, least: tuple[float, int, str] | None, channels: list[str]
) -> str:
    if least is None:
        return f"{name}: not noticed, tried up to {most}"
    by = "of" if name.startswith("lag") else "off by"
    return f"{name} {by} {text} ({least[2]} of {channels[least[1]]})"
