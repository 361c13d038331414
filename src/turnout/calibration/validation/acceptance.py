"""Acceptance of a calibrated model on movements that it was not fitted to."""

from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.validation.power import (
    Rules,
    error_kind,
    error_kinds,
    noticed_errors,
    noticed_to_first_order,
)
from turnout.core.value_text import count_text

Floats = NDArray[np.float64]
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
