"""Acceptance of a calibrated model on movements that it was not fitted to, and its power.

A verdict notices errors from a least one on. The
prediction is moved as the error would move it, and judged by the same rules on the same
measurement: the error of each channel beside its repeats, and the coverage of its band. A wrong
value moves it by its slope and by a bend, from a throw where the slope alone says that it is
noticed: one to either side, since a drive may slip to one of them only. The least amount is rounded
up. Each is named by its kind: timing, level or shape.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.measured_movements import later
from turnout.core.value_text import count_text

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


# Of all channels together; of each channel where `validate` did not say what chance would do.
LEAST_COVER, MOST_SPREADS = 0.80, 3.0
FEATURES = ("contact", "slope", "peak", "plateau")
WORST = 3
# Less is not accepted of any channel, though chance may leave a right model with less where few
# movements are judged: bands of right models have held 83 % and more in all campaigns of twins.
LEAST_OF_CHANNEL = 0.75


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelResult:
    """Prediction of one channel over the movements that were held back.

    Attributes
    ----------
    channel : str
        Such as "drive 1" or "object".
    movements : int
        In which it was measured.
    rms, nrmse : float
        Root mean square difference [N], and over the largest measured force [-].
    spread : float
        Of repeats [N].
    cover : float
        Share of measured instants within the band of 95 %.
    kind : str
        What most of the difference is, of all movements together: "timing", "level" or "shape".
    kinds : dict of str to int
        The same of single movements that are off by more than the spread of repeats: how many.
    least_cover : float
        Share that the band must cover: `chance_cover`, 75 % at least.
    cover_samples : float
        Number of independent instants that the measured ones are worth; NaN where not known.
    chance_cover : float
        What a right model covers less of in one campaign of twenty.
    errors : dict of str to (float, float)
        Mean and standard deviation of predicted less measured features: "contact" [s], "slope"
        (relative), "peak", "plateau" [N]; NaN where there are none.
    """

    channel: str
    movements: int
    rms: float
    nrmse: float
    spread: float
    cover: float
    errors: dict[str, tuple[float, float]]
    kind: str = ""
    kinds: dict[str, int] = field(default_factory=dict)
    least_cover: float = LEAST_COVER
    cover_samples: float = float("nan")
    chance_cover: float = LEAST_COVER

    @property
    def kind_text(self) -> str:
        """Largest part of the difference in words; by movement where these differ."""
        if len(self.kinds) < 2:
            return f"mostly in {self.kind}" if self.kind else ""
        parts = (f"in {kind} in {count_text(n, 'movement')}" for kind, n in self.kinds.items())
        return ", ".join(parts)

    @property
    def spreads(self) -> float:
        """The RMS difference as a multiple of the spread of repeats [-]."""
        return self.rms / self.spread

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the prediction of this channel is not accepted; empty where it is."""
        found = []
        kind = f", {self.kind_text}" if self.kind_text else ""
        if self.spreads > MOST_SPREADS:
            found.append(
                f"{self.channel} is off by {self.rms:.0f} N, {self.spreads:.1f} times the spread "
                f"of repeats, more than {MOST_SPREADS:g}{kind}"
            )
        if self.cover < self.least_cover:
            found.append(
                f"the band of 95 % covers {100 * self.cover:.0f} % of {self.channel}, less than "
                f"{100 * self.least_cover:.0f} %" + (kind if not found else "")
            )
        return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """Result of a validation.

    Attributes
    ----------
    channels : tuple of ChannelResult
        Over the movements that were judged.
    judged, used : int
        Movements that were judged, and that the fit had seen.
    cover : float
        Share of all measured instants, of all channels, within the band of 95 %.
    held_back : bool
        Whether the judged ones were held back, or predicted from other places; if not, this is a
        test of the fit alone.
    left_out : bool
        Whether each was predicted from the movements at all other places.
    reasons : tuple of str
        Why the model is not accepted.
    worst : tuple of str
        Movements that are furthest off, in words.
    power : tuple of str
        How far off each value, the onset and a lag of a drive would have to be for the verdict to
        notice, in words; of a model that is not refused.
    """

    channels: tuple[ChannelResult, ...]
    judged: int
    used: int
    cover: float
    held_back: bool
    reasons: tuple[str, ...]
    worst: tuple[str, ...]
    power: tuple[str, ...] = ()
    left_out: bool = False

    @property
    def accepted(self) -> bool:
        """True if the model predicts what was held back."""
        return self.held_back and not self.reasons

    @property
    def text(self) -> str:
        """The verdict in one sentence."""
        if self.reasons:
            return "NOT VALID: " + "; ".join(self.reasons)
        if not self.held_back:
            return (
                "NOT VALIDATED: the fit has seen every movement, so this only shows that it fits; "
                "leave some out with `turnout calibrate --exclude MOVEMENT`"
            )
        seen = (
            ", each predicted from the other places alone,"
            if self.left_out
            else " that the fit has not seen"
        )
        return (
            f"VALID: all {len(self.channels)} channels of "
            f"{count_text(self.judged, 'movement')}{seen} lie "
            f"within {MOST_SPREADS:g} repeat spreads, and the band of 95 % covers "
            f"{100 * self.cover:.0f} % of the measurement"
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Limits of the verdict: bands that can hardly be judged."""
        found = []
        hardly = [item for item in self.channels if item.chance_cover < LEAST_OF_CHANNEL]
        if hardly:
            names = ", ".join(item.channel for item in hardly)
            share = 100 * min(item.chance_cover for item in hardly)
            found.append(
                f"bands hardly judged: {names}; in so few movements a right model may by chance "
                f"cover no more than {share:.0f} %, measure more"
            )
        return tuple(found)


def judge(validation: xr.Dataset) -> Acceptance:
    """Judge predictions of movements that the fit has not seen.

    Parameters
    ----------
    validation : xarray.Dataset
        From `validate`.

    Returns
    -------
    Acceptance
        Accepted where each channel is off by at most three times its spread of repeats, the band
        of 95 % covers as much of it as that of a right model does in 19 campaigns of 20, and at
        least 80 % of all channels together. Where the fit has seen every movement
        those are judged that could be predicted from other places; without any, all are, and
        nothing is accepted.
    """
    used, left = validation["used"].values, _left_out(validation)
    part = _judged_part(validation)
    results, cover = _results(part), _cover(part)
    reasons = _reasons(results, cover)
    return Acceptance(
        channels=results,
        judged=part.sizes["movement"],
        used=int(used.sum()),
        held_back=bool((~used).any() or left.any()),
        cover=cover,
        reasons=reasons,
        worst=_worst(part),
        # What a refused prediction would notice beside says nothing.
        power=noticed_errors(part, _rules(part)) if "change" in part and not reasons else (),
        left_out=bool(used.all() and left.any()),
    )


def first_order_power(validation: xr.Dataset) -> dict[str, tuple[float, float]]:
    """Return by how much values must be off for the verdict to notice, as far as slopes say.

    Parameters
    ----------
    validation : xarray.Dataset
        From `validate`.

    Returns
    -------
    dict of str to tuple of float
        As of `noticed_to_first_order`; nothing where the model is refused.
    """
    part = _judged_part(validation)
    if _reasons(_results(part), _cover(part)):
        return {}
    return noticed_to_first_order(part, _rules(part))


def judged_movements(used: NDArray[np.bool_], left_out: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return which movements are judged.

    Parameters
    ----------
    used, left_out : ndarray of bool, shape (n_movements,)
        Whether the fit has seen each, and whether it is predicted from other places alone.

    Returns
    -------
    ndarray of int
        Those that were held back; without any, those predicted from others; without these, all.
    """
    judged = ~used if (~used).any() else left_out if left_out.any() else np.ones_like(used)
    return np.flatnonzero(judged)


def _judged_part(validation: xr.Dataset) -> xr.Dataset:
    """Return the movements that are judged."""
    chosen = judged_movements(validation["used"].values, _left_out(validation))
    return validation.isel(movement=chosen)


def _results(part: xr.Dataset) -> tuple[ChannelResult, ...]:
    """Return how each channel that was measured was predicted."""
    return tuple(
        _result(part.sel(channel=name), float(least), float(samples))
        for name, least, samples in zip(part["channel"].values, *_least_covers(part), strict=True)
        if part["rms"].sel(channel=name).notnull().any()
    )


def _reasons(results: tuple[ChannelResult, ...], cover: float) -> tuple[str, ...]:
    """Return why a prediction is not accepted: by channel, then by the coverage of all."""
    found = [reason for item in results for reason in item.reasons]
    if cover < LEAST_COVER and all(item.cover >= item.least_cover for item in results):
        found.append(
            f"the band of 95 % covers {100 * cover:.0f} % of the measurement, less than "
            f"{100 * LEAST_COVER:.0f} %"
        )
    return tuple(found)


def _left_out(validation: xr.Dataset) -> NDArray[np.bool_]:
    if "left_out" in validation:
        return np.asarray(validation["left_out"].values, dtype=np.bool_)
    return np.zeros(validation.sizes["movement"], dtype=np.bool_)


def _least_covers(part: xr.Dataset) -> tuple[Floats, Floats]:
    """Return the least coverage by chance, and the independent instants that it rests on."""
    count = part.sizes["channel"]
    if "cover_limit" not in part:
        return np.full(count, LEAST_COVER), np.full(count, np.nan)
    return part["cover_limit"].values, part["cover_samples"].values


def _rules(part: xr.Dataset) -> Rules:
    measured = part["measured"].transpose("channel", "movement", "time").values
    half = (part["high"] - part["predicted"]).transpose("channel", "movement", "time").values
    return Rules(
        measured=measured,
        reach=half,
        most_rms=MOST_SPREADS * part["repeat_spread"].values,
        least_cover=np.maximum(_least_covers(part)[0], LEAST_OF_CHANNEL),
        least_pooled=LEAST_COVER,
    )


def _result(part: xr.Dataset, chance: float, samples: float) -> ChannelResult:
    rms, known = part["rms"].values, part["rms"].notnull().values
    pooled = float(np.sqrt(np.mean(rms[known] ** 2)))
    rows = [
        np.atleast_2d(part[name].transpose("movement", "time").values)
        for name in ("measured", "predicted")
    ]
    return ChannelResult(
        channel=str(part["channel"].values),
        movements=int(known.sum()),
        rms=pooled,
        nrmse=pooled / float(part["scale"]),
        spread=float(part["repeat_spread"]),
        cover=_cover(part),
        errors={name: _error(part, name) for name in FEATURES},
        kind=error_kind(*rows),
        kinds=error_kinds(*rows, least=float(part["repeat_spread"])),
        least_cover=max(chance, LEAST_OF_CHANNEL),
        cover_samples=samples,
        chance_cover=chance,
    )


def _cover(part: xr.Dataset) -> float:
    """Return the share of measured instants in the band, all together."""
    within = (part["measured"] >= part["low"]) & (part["measured"] <= part["high"])
    return float(within.sum() / part["measured"].notnull().sum())


def _error(part: xr.Dataset, name: str) -> tuple[float, float]:
    """Return mean and standard deviation of the error of a feature."""
    measured, forecast = part[f"{name}_measured"].values, part[f"{name}_predicted"].values
    errors = forecast - measured
    if name == "slope":
        errors = np.divide(errors, measured, out=np.full_like(errors, np.nan), where=measured != 0)
    errors = errors[np.isfinite(errors)]
    if not errors.size:
        return float("nan"), float("nan")
    return float(errors.mean()), float(errors.std(ddof=1)) if errors.size > 1 else 0.0


def _worst(part: xr.Dataset) -> tuple[str, ...]:
    """Name the movements that are furthest off, in repeat spreads."""
    ratio = (part["rms"] / part["repeat_spread"]).transpose("movement", "channel").values
    known = np.where(np.isfinite(ratio), ratio, -1.0)
    order = np.argsort(-known.max(axis=1))[:WORST]
    found = []
    for number in order:
        one = part.isel(movement=int(number))
        channel = part["channel"].values[int(known[number].argmax())]
        size = float(one["size"])
        what = f"{1e3 * size:g} mm at {one['place'].item()}" if size > 0 else "no object"
        off = one.sel(channel=channel)
        kind = error_kind(off["measured"].values[None, :], off["predicted"].values[None, :])
        found.append(
            f"{one['movement'].item()} ({one['direction'].item()}, {what}): {channel} off by "
            f"{float(off['rms']):.0f} N, {known[number].max():.1f} spreads"
            + (f", mostly in {kind}" if kind else "")
        )
    return tuple(found)
