"""Verdict on a calibrated model by movements that it was not fitted to, and its power.

A verdict notices errors from a least one on. The prediction is moved as the error would move it,
and judged by the same rules on the same measurement: the error of each channel beside its repeats,
and the coverage of its band. A wrong value moves it by its slope and by a bend, from a throw where
the slope alone says that it is noticed: one to either side, since a drive may slip to one of them
only. The least amount is rounded up. Each is named by its kind: timing, level or shape.
"""

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.value_text import count_text
from turnout.metric.agreement import only_fitted

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
    if not off.any():
        return ""
    slope = np.nan_to_num(np.gradient(predicted, axis=1)[known])
    columns = {"timing": [slope], "level": [predicted[known], np.ones(off.size)]}
    left = {}
    for name, rows in columns.items():
        matrix = np.stack(rows, axis=1)
        rest = off - matrix @ np.linalg.lstsq(matrix, off, rcond=None)[0]
        left[name] = float(rest @ rest) / float(off @ off)
    best = min(left, key=lambda name: left[name])
    return best if left[best] < 1.0 - EXPLAINED else "shape"


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
    off = measured - predicted
    counts = np.isfinite(off).sum(axis=1)
    far = np.flatnonzero((counts > 0) & (np.nansum(off**2, axis=1) >= least**2 * counts))
    kinds = Counter(error_kind(measured[[n]], predicted[[n]]) for n in far)
    return dict(kinds.most_common())


# Largest error in spreads of repeats, and least coverage of all channels together.
MOST_SPREADS, LEAST_COVER = 3.0, 0.80
# Less is not accepted of any channel, though chance may leave a right model with less where few
# movements are judged: bands of right models have held 83 % and more in all campaigns of twins.
LEAST_OF_CHANNEL = 0.75


@dataclass(frozen=True, slots=True, eq=False)
class Rules:
    """By what a prediction is refused.

    Attributes
    ----------
    measured, reach : ndarray, shape (n_channels, n_movements, n_times)
        Measured forces, NaN for none, and half the band [N].
    spread, least_cover : ndarray, shape (n_channels,)
        Of repeats [N], and least coverage of the band [-].
    """

    measured: Floats
    reach: Floats
    spread: Floats
    least_cover: Floats

    @classmethod
    def of(cls, part: xr.Dataset) -> "Rules":
        """Return the rules for movements of a validation; the coverage is that of right models."""
        chance = part["cover_limit"].values if "cover_limit" in part else LEAST_COVER
        # No limit is known of a channel whose throws all failed.
        least = np.fmax(np.broadcast_to(chance, part.sizes["channel"]), LEAST_OF_CHANNEL)
        reach = rows_of(part["high"] - part["predicted"])
        return cls(rows_of(part["measured"]), reach, part["repeat_spread"].values, least)

    def errors(self, predicted: Floats) -> tuple[Floats, Floats, float]:
        """Return error [N] and coverage of each channel, NaN for none, and coverage of all.

        Instants without a prediction are not covered.
        """
        off = predicted - self.measured
        known = np.isfinite(off)
        count = known.sum(axis=2)
        squares = np.where(known, off, 0.0) ** 2
        own = np.divide(squares.sum(axis=2), count, out=np.zeros(count.shape), where=count > 0)
        within = (known & (np.abs(off) <= self.reach)).sum(axis=(1, 2))
        total = np.isfinite(self.measured).sum(axis=(1, 2))
        there = (count > 0).sum(axis=1)
        shares = [
            np.divide(sums, over, out=np.full(len(sums), np.nan), where=over > 0)
            for sums, over in ((own.sum(axis=1), there), (within, total))
        ]
        return np.sqrt(shares[0]), shares[1], float(within.sum() / total.sum())

    def refused(self, predicted: Floats) -> NDArray[np.bool_]:
        """Return which channels of a prediction are refused; the worst where all together are."""
        rms, cover, pooled = self.errors(predicted)
        found = (rms > MOST_SPREADS * self.spread) | (cover < self.least_cover)
        return np.asarray(found | (cover == np.nanmin(cover)) if pooled < LEAST_COVER else found)


def rows_of(values: xr.DataArray) -> Floats:
    """Return values by channel, movement and time."""
    return np.asarray(values.transpose("channel", "movement", "time").values, dtype=np.float64)


# Amounts of an error that are tried, as shares of the largest, in steps of a tenth.
AMOUNTS = np.geomspace(2e-4, 1.0, 80)
SIGNS = (1.0, -1.0)
# A wrong value has bands of its own: 13 % wider with friction 7 % too high (`sb1`); so much wider
# ones than those of the right values have to notice it.
WIDER = 1.15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PossibleError:
    """Possible error of a model, with the change that it makes.

    Attributes
    ----------
    name : str
        Of a value, or "onset".
    change : ndarray, shape (n_channels, n_movements, n_times)
        Of the prediction, to first order: for all of a value [N], or over its unit.
    largest : float
        That is tried.
    unit : str
        "m" for a length, "s" for an onset, which needs no throw; else none, it is a share.
    unchecked : str
        Why throws fail with it; else empty.
    """

    name: str
    change: Floats
    largest: float
    unit: str = ""
    unchecked: str = ""

    @property
    def by_throws(self) -> bool:
        """True if its change beyond first order is found by throws."""
        return self.unit != "s" and not self.unchecked

    def text(self, amount: float) -> str:
        """Return an amount in words, rounded up: less than stated need not be noticed.

        Examples
        --------
        >>> item = PossibleError(name="k", change=np.zeros(0), largest=0.5)
        >>> item.text(0.0451), item.text(0.1204), replace(item, unit="s").text(0.00631)
        ('4.6 %', '13 %', '7 ms')
        """
        factor, unit = {"": (100, "%"), "m": (1e3, "mm"), "s": (1e3, "ms")}[self.unit]
        number = factor * amount
        digits = 0 if self.unit == "s" else max(1 - math.floor(math.log10(number)), 0)
        return f"{math.ceil(number * 10**digits - 1e-9) / 10**digits:.{digits}f} {unit}"


def noticed_errors(
    rules: Rules,
    predicted: Floats,
    errors: Sequence[PossibleError],
    channels: Sequence[str],
    *,
    throw: Callable[[list[tuple[str, float]]], Sequence[Floats | str]],
) -> list[str]:
    """Say how large each error must be to be noticed, by which channel, and as what.

    Parameters
    ----------
    rules : Rules
        Of the verdict.
    predicted : ndarray, shape (n_channels, n_movements, n_times)
        Of the movements that are judged [N].
    errors : sequence of PossibleError
        What may be wrong.
    channels : sequence of str
        Their names.
    throw : callable
        From names of values, each with an amount by which it is off, to predictions with each, or
        why one failed.

    Returns
    -------
    list of str
        Such as "drive.1.stiffness off by 4.1 % (timing of drive 1)".
    """
    unchecked = {item.name: item.unchecked for item in errors if item.unchecked}
    tried = []
    for item in filter(lambda item: item.by_throws, errors):
        both = [_least(rules, predicted, item, sign) for sign in SIGNS]
        found = [(item, sign, least[0]) for sign, least in zip(SIGNS, both, strict=True) if least]
        tried += found if len(found) == len(SIGNS) else []
    made = throw([(item.name, sign * amount) for item, sign, amount in tried])
    bends: dict[tuple[str, float], Floats] = {}
    for (item, sign, amount), forces in zip(tried, made, strict=True):
        if isinstance(forces, str):
            unchecked.setdefault(item.name, forces)
            continue
        linear = predicted + sign * amount * item.change
        bends[item.name, sign] = np.nan_to_num(forces - linear) / amount**2
    lines = []
    for item in errors:
        if item.name in unchecked:
            # By its slope alone too little would be stated.
            lines.append(f"{item.name}: not checked by a throw: {unchecked[item.name]}")
            continue
        least = [
            _least(rules, predicted, item, sign, bends.get((item.name, sign), 0.0))
            for sign in SIGNS
        ]
        known = [found for found in least if found]
        if len(known) < len(least):
            lines.append(f"{item.name}: not noticed, tried up to {item.text(item.largest)}")
            continue
        amount, row, kind = max(known)
        lines.append(f"{item.name} off by {item.text(amount)} ({kind} of {channels[row]})")
    return lines


def _least(
    rules: Rules,
    predicted: Floats,
    item: PossibleError,
    sign: float,
    bend: Floats | float = 0.0,
) -> tuple[float, int, str] | None:
    """Return the least error of a sign that is noticed, in which channel, and as what."""
    if item.unit != "s":
        rules = replace(rules, reach=WIDER * rules.reach)
    # A channel that is refused already notices nothing more.
    before, change = rules.refused(predicted), np.nan_to_num(item.change)
    for amount in (item.largest * AMOUNTS).tolist():
        trial = predicted + sign * amount * change + amount**2 * bend
        new = np.flatnonzero(rules.refused(trial) & ~before)
        if new.size:
            sizes = np.sqrt(np.nanmean((trial - predicted) ** 2, axis=(1, 2))) / rules.spread
            row = int(new[np.argmax(sizes[new])])
            known = np.where(np.isfinite(rules.measured[row]), predicted[row], np.nan)
            return amount, row, error_kind(trial[row], known)
    return None


# Of features: factor from SI to the unit that is shown, that unit, and the SI unit.
FEATURES = {
    "contact": (1e3, "ms", "s"),
    "slope": (1e2, "%", "N/s"),
    "peak": (1.0, "N", "N"),
    "plateau": (1.0, "N", "N"),
}
# Movements furthest off that are named.
WORST = 3


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
        Root mean square difference [N], and over the largest measured force [-]; NaN of a channel
        whose throws all failed.
    spread : float
        Of repeats [N]; NaN if neither repeats nor throws say anything of it.
    cover : float
        Share of measured instants within the band of 95 %.
    errors : dict of str to (float, float)
        Mean and standard deviation of predicted less measured features: "contact" [s], "slope"
        (relative), "peak", "plateau" [N]; NaN for none.
    kinds : dict of str to int
        What most of the difference is in movements that are off by more than the spread of
        repeats: "timing", "level" or "shape", each in how many, the most common first.
    least_cover : float
        Share that the band must cover: `chance_cover`, 75 % at least.
    cover_samples : float
        Number of independent instants that the measured ones are worth; NaN if not known.
    chance_cover : float
        What a right model covers less of in one campaign of twenty.
    """

    channel: str
    movements: int
    rms: float
    nrmse: float
    spread: float
    cover: float
    errors: dict[str, tuple[float, float]]
    kinds: dict[str, int] = field(default_factory=dict)
    least_cover: float = LEAST_COVER
    cover_samples: float = float("nan")
    chance_cover: float = LEAST_COVER

    @property
    def kind(self) -> str:
        """Most common kind of difference of movements that are off; empty if none is."""
        return next(iter(self.kinds), "")

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
        """Reasons to refuse the prediction of this channel; empty if it is accepted."""
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

    @property
    def figures(self) -> list[str]:
        """RMS, NRMSE, repeats, their ratio, cover and least cover, as they are shown."""
        shown = [
            f"{self.rms:.0f} N",
            f"{100 * self.nrmse:.1f} %",
            f"{self.spread:.0f} N",
            f"{self.spreads:.1f}",
            f"{100 * self.cover:.0f} %",
            f"{100 * self.least_cover:.0f} %",
        ]
        return ["-" if text.startswith("nan") else text for text in shown]

    @property
    def cells(self) -> list[str]:
        """Mean and standard deviation of the error of each feature, as they are shown."""
        found = []
        for name, (factor, unit, _) in FEATURES.items():
            mean, deviation = self.errors[name]
            shown = f"{factor * mean:+.0f} ± {factor * deviation:.0f} {unit}"
            found.append("-" if math.isnan(mean) else shown.replace("-0 ±", "+0 ±"))
        return found


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
        How far off each value and the onset would have to be for the verdict to notice, in words;
        of a model that is not refused.
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
        hardly = [item for item in self.channels if item.chance_cover < LEAST_OF_CHANNEL]
        if not hardly:
            return ()
        names = ", ".join(item.channel for item in hardly)
        share = 100 * min(item.chance_cover for item in hardly)
        return (
            f"bands hardly judged: {names}; in so few movements a right model may by chance "
            f"cover no more than {share:.0f} %, measure more",
        )

    @property
    def lines(self) -> list[str]:
        """A table for the screen with a line per channel, then errors noticed and the furthest."""
        lines = [
            f"{'channel':<10}{'movements':>10}{'RMS':>8}{'NRMSE':>8}{'repeats':>9}{'times':>7}"
            f"{'cover':>7}{'least':>7}{'contact':>12}{'slope':>12}{'peak':>14}{'plateau':>14}"
        ]
        for item in self.channels:
            rms, nrmse, repeats, times, cover, least = item.figures
            contact, slope, peak, plateau = item.cells
            lines.append(
                f"{item.channel:<10}{item.movements:>10}{rms:>8}{nrmse:>8}{repeats:>9}{times:>7}"
                f"{cover:>7}{least:>7}{contact:>12}{slope:>12}{peak:>14}{plateau:>14}"
            )
        seen = "held back" if self.held_back else "all used for the fit"
        seen = "each predicted without its place" if self.left_out else seen
        judged = count_text(self.judged, "movement")
        lines.append(f"{judged} judged, {seen}; {self.used} used for the fit")
        lines += [f"{'would notice' if n == 0 else '':<14}{t}" for n, t in enumerate(self.power)]
        lines += self.remarks
        lines += [f"{'furthest off' if n == 0 else '':<14}{t}" for n, t in enumerate(self.worst)]
        return lines


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
        least 80 % of all channels together. Where the fit has seen every movement those are judged
        that could be predicted from other places; without any, all are, and nothing is accepted.
    """
    used = np.asarray(validation["used"].values, dtype=np.bool_)
    unseen = ~only_fitted(validation)
    part = validation.isel(movement=judged_movements(validation))
    rules = Rules.of(part)
    rms, covers, cover = rules.errors(rows_of(part["predicted"]))
    results = tuple(
        _result(part.isel(channel=n), float(rms[n]), float(covers[n]), float(rules.least_cover[n]))
        for n in np.flatnonzero(np.isfinite(covers))
    )
    reasons = [reason for item in results for reason in item.reasons]
    if cover < LEAST_COVER and all(item.cover >= item.least_cover for item in results):
        reasons.append(
            f"the band of 95 % covers {100 * cover:.0f} % of the measurement, less than "
            f"{100 * LEAST_COVER:.0f} %"
        )
    return Acceptance(
        channels=results,
        judged=part.sizes["movement"],
        used=int(used.sum()),
        held_back=bool(unseen.any()),
        cover=cover,
        reasons=tuple(reasons),
        worst=_worst(part),
        power=tuple(json.loads(validation.attrs.get("noticed", "[]"))),
        left_out=bool(used.all() and unseen.any()),
    )


def judged_movements(validation: xr.Dataset) -> NDArray[np.intp]:
    """Return which movements are judged.

    Parameters
    ----------
    validation : xarray.Dataset
        With `used`, and `left_out` where movements are predicted from other places alone.

    Returns
    -------
    ndarray of int
        Those that were held back; without any, those predicted from others; without these, all.
    """
    used = np.asarray(validation["used"].values, dtype=np.bool_)
    judged = ~used if not used.all() else ~only_fitted(validation)
    return np.flatnonzero(judged if judged.any() else used)


def _result(part: xr.Dataset, rms: float, cover: float, least: float) -> ChannelResult:
    """Return how a channel was predicted."""
    rows = [part[name].transpose("movement", "time").values for name in ("measured", "predicted")]
    spread = float(part["repeat_spread"])
    return ChannelResult(
        channel=str(part["channel"].values),
        movements=int(np.isfinite(rows[0]).any(axis=1).sum()),
        rms=rms,
        nrmse=rms / float(part["scale"]),
        spread=spread,
        cover=cover,
        errors={name: _error(part, name) for name in FEATURES},
        kinds=error_kinds(*rows, least=spread),
        least_cover=least,
        cover_samples=float(part.get("cover_samples", np.nan)),
        chance_cover=float(part.get("cover_limit", LEAST_COVER)),
    )


def _error(part: xr.Dataset, name: str) -> tuple[float, float]:
    """Return mean and standard deviation of the error of a feature."""
    measured = part[f"{name}_measured"].values
    errors = part[f"{name}_predicted"].values - measured
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
    found = []
    order = np.argsort(-known.max(axis=1))[:WORST]
    for number in order[known.max(axis=1)[order] >= 0.0].tolist():
        off = part.isel(movement=number, channel=int(known[number].argmax()))
        size = float(off["size"])
        what = f"{1e3 * size:g} mm at {off['place'].item()}" if size > 0 else "no object"
        kind = error_kind(off["measured"].values[None, :], off["predicted"].values[None, :])
        found.append(
            f"{off['movement'].item()} ({off['direction'].item()}, {what}): "
            f"{off['channel'].item()} off by {float(off['rms']):.0f} N, "
            f"{known[number].max():.1f} spreads" + (f", mostly in {kind}" if kind else "")
        )
    return tuple(found)


def page_text(validation: xr.Dataset, verdict: Acceptance, *, figures: list[str]) -> str:
    """Return a page in Markdown.

    Parameters
    ----------
    validation : xarray.Dataset
        From `validate`.
    verdict : Acceptance
        From `judge`.
    figures : list of str
        File names beside the page.
    """
    synthetic = str(validation.attrs.get("synthetic", "")).removeprefix("synthetic: ")
    parts = [
        f"# Validation: {validation.attrs.get('title', 'campaign')}",
        *([f"Synthetic: {synthetic}."] if synthetic else []),
        f"**{verdict.text}.**",
        "Errors of each channel (root mean square, over the largest measured force, over the "
        "spread of repeats), the share that the band covers and what it must at least, and "
        "predicted less measured features, mean ± standard deviation:",
        "\n".join(["```text", *verdict.lines, "```"]),
        f"From throw to throw: {scatter_text(validation)}.",
        *(f"{text}." for text in notes(validation)),
        "The band holds the uncertainty of the parameters, the noise, and the scatter from throw "
        "to throw. The spread of a channel without repeats is what the scatter of the others "
        "implies.",
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n\n".join(parts) + "\n"


def notes(validation: xr.Dataset) -> list[str]:
    """List movements and statements that a validation lacks, and the onsets that it moved.

    Examples
    --------
    >>> found = xr.Dataset({"onset_shift": ("movement", [0.0, 0.045, 0.052])})
    >>> notes(found.assign_attrs(noticed="[]", left_out='["a was left out: does not fit"]'))
    ['a was left out: does not fit', '2 onsets without motor current: ... 52 ms after the marks']
    """
    texts = [str(text) for text in json.loads(validation.attrs.get("left_out", "[]"))]
    if "noticed" not in validation.attrs:
        texts.append("made by an older version: validate again to see what would be noticed")
    if validation.attrs.get("chain"):
        texts.append(str(validation.attrs["chain"]))
    moved = validation["onset_shift"].values if "onset_shift" in validation else np.zeros(0)
    moved = 1e3 * moved[moved != 0.0]
    if moved.size > 1 and np.ptp(moved) == 0.0:
        texts.append(
            f"the motors run {moved[0]:.0f} ms before the rods move in "
            f"{count_text(moved.size, 'movement')}, "
            "which is taken off"
        )
    elif moved.size:
        texts.append(
            f"{count_text(moved.size, 'onset')} without motor current: those that fit the free "
            f"part of each movement are {moved.min():.0f} to {moved.max():.0f} ms after the marks"
        )
    return texts


def scatter_text(validation: xr.Dataset) -> str:
    """Return what differs from throw to throw in words.

    Examples
    --------
    >>> known = '{"chair.friction_coefficient": 0.021, "onset [s]": 0.004, "repeats": 5}'
    >>> scatter_text(xr.Dataset(attrs={"scatter": known}))
    'chair.friction_coefficient 2.1 %, onset 4 ms (from 5 repeats)'
    """
    known = json.loads(validation.attrs["scatter"])
    count, onset = known.pop("repeats"), known.pop("onset [s]")
    parts = [f"{name} {100 * size:.1f} %" for name, size in known.items()]
    origin = f"from {count} repeats" if count else "assumed, as nothing was repeated"
    return f"{', '.join([*parts, f'onset {1e3 * onset:.0f} ms'])} ({origin})"


def table_text(validation: xr.Dataset) -> str:
    """Return a table (CSV) with a line for each movement and channel, in SI.

    Parameters
    ----------
    validation : xarray.Dataset
        From `validate`.
    """
    names = {"rms": "N", "nrmse": "-", "repeat_spread": "N", "cover": "-"}
    for name, (*_, unit) in FEATURES.items():
        names |= {f"{name}_{side}": unit for side in ("measured", "predicted")}
    content = io.StringIO()
    table = csv.writer(content, lineterminator="\n")
    head = ["movement", "direction", "size [m]", "place", "used", "channel"]
    table.writerow([*head, *(f"{name} [{unit}]" for name, unit in names.items())])
    for number, row in np.ndindex(validation.sizes["movement"], validation.sizes["channel"]):
        one = validation.isel(movement=number, channel=row)
        if np.isfinite(float(one["rms"])):
            what = [one[name].item() for name in ("movement", "direction", "size", "place")]
            what += ["yes" if bool(one["used"]) else "no", one["channel"].item()]
            values = [float(one[name]) for name in names]
            table.writerow([*what, *("" if math.isnan(v) else f"{v:.6g}" for v in values)])
    return content.getvalue()
