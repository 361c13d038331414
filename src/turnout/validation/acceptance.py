"""Whether a calibrated model may be trusted on movements that it was not fitted to."""

import csv
import io
import json
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.problems import choices
from turnout.validation.error_kind import error_kind

Floats = NDArray[np.float64]
LEAST_COVER, MOST_SPREADS = 0.80, 3.0
FEATURES = ("contact", "slope", "peak", "plateau")
WORST = 3
# A parameter that may be off by more than this is not judged at all [-].
MOST_POWER = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelResult:
    """How one channel was predicted, over the movements that were held back.

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
        What most of the difference is: "timing", "level" or "shape".
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

    @property
    def spreads(self) -> float:
        """The RMS difference as a multiple of the spread of repeats [-]."""
        return self.rms / self.spread

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the prediction of this channel is not accepted; empty where it is."""
        if self.spreads <= MOST_SPREADS:
            return ()
        kind = f", mostly in {self.kind}" if self.kind else ""
        return (
            f"{self.channel} is off by {self.rms:.0f} N, {self.spreads:.1f} times the spread of "
            f"repeats, more than {MOST_SPREADS:g}{kind}",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """What a validation came to.

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
        How far off each parameter would have to be for the verdict to notice, in words.
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
        """Whether the model predicts what was held back."""
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
            "each predicted from the other places alone,"
            if self.left_out
            else "that the fit has not seen"
        )
        return (
            f"VALID: all {len(self.channels)} channels of {self.judged} movements {seen} lie "
            f"within {MOST_SPREADS:g} repeat spreads, and the band of 95 % covers "
            f"{100 * self.cover:.0f} % of the measurement"
        )


def judge(validation: xr.Dataset) -> Acceptance:
    """Judge predictions of movements that the fit has not seen.

    Parameters
    ----------
    validation : xarray.Dataset
        From `validate`.

    Returns
    -------
    Acceptance
        Accepted where the band of 95 % covers at least 80 % of the measurement, and each channel
        is off by at most three times its spread of repeats. Where the fit has seen every movement
        those are judged that could be predicted from other places; without any, all are, and
        nothing is accepted.
    """
    used = validation["used"].values
    left = validation["left_out"].values if "left_out" in validation else np.zeros_like(used)
    held_back = bool((~used).any() or left.any())
    judged = ~used if (~used).any() else left if left.any() else np.ones_like(used)
    chosen = np.flatnonzero(judged)
    part = validation.isel(movement=chosen)
    results = tuple(
        _result(part.sel(channel=name))
        for name in part["channel"].values
        if part["rms"].sel(channel=name).notnull().any()
    )
    cover = _cover(part)
    reasons = [reason for item in results for reason in item.reasons]
    if cover < LEAST_COVER:
        reasons.append(
            f"the band of 95 % covers {100 * cover:.0f} % of the measurement, less than "
            f"{100 * LEAST_COVER:.0f} %"
        )
    return Acceptance(
        channels=results,
        judged=int(chosen.size),
        used=int(used.sum()),
        held_back=held_back,
        cover=cover,
        reasons=tuple(reasons),
        worst=_worst(part),
        power=_power(part),
        left_out=bool(used.all() and left.any()),
    )


def _power(part: xr.Dataset) -> tuple[str, ...]:
    """Say by how much each parameter would have to be off for a channel to be refused.

    A parameter that is off by a share `e` changes a channel by `e` times its answer, which must
    exceed three repeat spreads, beside what the channel is off already.
    """
    if "answer" not in part or not part.sizes.get("parameter", 0):
        return ()
    answer = ((part["answer"] ** 2).mean("movement")) ** 0.5
    allowed = (MOST_SPREADS * part["repeat_spread"]) ** 2 - (part["rms"] ** 2).mean("movement")
    needed = allowed.clip(min=0.0) ** 0.5
    found = []
    for name in part["parameter"].values:
        shares = (needed / answer.sel(parameter=name)).values
        # A channel that is refused already notices nothing more.
        shares = shares[np.isfinite(shares) & (shares > 0.0)]
        if shares.size and shares.min() < MOST_POWER:
            found.append(f"{name} off by {100 * shares.min():.2g} %")
        else:
            found.append(f"{name} by no means")
    return tuple(found)


def _result(part: xr.Dataset) -> ChannelResult:
    rms, known = part["rms"].values, part["rms"].notnull().values
    pooled = float(np.sqrt(np.mean(rms[known] ** 2)))
    return ChannelResult(
        channel=str(part["channel"].values),
        movements=int(known.sum()),
        rms=pooled,
        nrmse=pooled / float(part["scale"]),
        spread=float(part["repeat_spread"]),
        cover=_cover(part),
        errors={name: _error(part, name) for name in FEATURES},
        kind=error_kind(
            np.atleast_2d(part["measured"].transpose("movement", "time").values),
            np.atleast_2d(part["predicted"].transpose("movement", "time").values),
        ),
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
        found.append(
            f"{one['movement'].item()} ({one['direction'].item()}, {what}): {channel} off by "
            f"{float(one['rms'].sel(channel=channel)):.0f} N, {known[number].max():.1f} spreads"
        )
    return tuple(found)


def acceptance_lines(verdict: Acceptance) -> list[str]:
    """Return a table for the screen: a line a channel, then what is furthest off.

    Parameters
    ----------
    verdict : Acceptance
        From `judge`.
    """
    lines = [
        f"{'channel':<10}{'movements':>10}{'RMS':>8}{'NRMSE':>8}{'repeats':>9}{'times':>7}"
        f"{'cover':>7}{'contact':>12}{'slope':>12}{'peak':>14}{'plateau':>14}"
    ]
    for item in verdict.channels:
        errors = item.errors
        cells = (
            _pair(errors["contact"], 1e3, "ms"),
            _pair(errors["slope"], 1e2, "%"),
            _pair(errors["peak"], 1.0, "N"),
            _pair(errors["plateau"], 1.0, "N"),
        )
        lines.append(
            f"{item.channel:<10}{item.movements:>10}{item.rms:>6.0f} N{100 * item.nrmse:>6.1f} %"
            f"{item.spread:>7.0f} N{item.spreads:>7.1f}{100 * item.cover:>5.0f} %"
            f"{cells[0]:>12}{cells[1]:>12}{cells[2]:>14}{cells[3]:>14}"
        )
    seen = "held back" if verdict.held_back else "all used for the fit"
    seen = "each predicted without its place" if verdict.left_out else seen
    lines.append(f"{verdict.judged} movements judged, {seen}; {verdict.used} used for the fit")
    if verdict.power:
        lines.append(f"would notice: {', '.join(verdict.power)}")
    if verdict.worst:
        lines.append(f"furthest off: {choices(verdict.worst)}")
    return lines


def _pair(error: tuple[float, float], factor: float, unit: str) -> str:
    if not np.isfinite(error[0]):
        return "-"
    mean = round(factor * error[0]) + 0
    return f"{mean:+d} ± {factor * error[1]:.0f} {unit}"


_UNITS = {"contact": "s", "slope": "N/s", "peak": "N", "plateau": "N"}


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
    synthetic = str(validation.attrs.get("synthetic", ""))
    lines = [f"# Validation: {validation.attrs.get('title', 'campaign')}", ""]
    if synthetic:
        lines += [f"Synthetic: {synthetic.removeprefix('synthetic: ')}.", ""]
    lines += [f"**{verdict.text}.**", ""]
    lines += [
        "| channel | movements | RMS | NRMSE | repeat spread | multiple of it | cover of band |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {item.channel} | {item.movements} | {item.rms:.0f} N | {100 * item.nrmse:.1f} % | "
        f"{item.spread:.0f} N | {item.spreads:.1f} | {100 * item.cover:.0f} % |"
        for item in verdict.channels
    ]
    lines += ["", "Predicted less measured, mean ± standard deviation:", ""]
    lines += ["| channel | contact | build-up | peak | plateau |", "|---|---|---|---|---|"]
    lines += [
        f"| {item.channel} | {_cell(item.errors['contact'], 1e3, 'ms')} | "
        f"{_cell(item.errors['slope'], 1e2, '%')} | {_cell(item.errors['peak'], 1.0, 'N')} | "
        f"{_cell(item.errors['plateau'], 1.0, 'N')} |"
        for item in verdict.channels
    ]
    lines += ["", f"{verdict.judged} movements judged; the fit has seen {verdict.used}.", ""]
    lines += [f"From throw to throw: {scatter_text(validation)}.", ""]
    lines += [f"{text}.\n" for text in notes(validation)]
    if verdict.power:
        lines += [f"This validation would notice: {', '.join(verdict.power)}.", ""]
    if verdict.worst:
        lines += ["Furthest off:", "", *(f"- {text}" for text in verdict.worst), ""]
    lines += [f"![{name}]({name})\n" for name in figures]
    lines.append(
        "NRMSE is the RMS difference over the largest measured force of the channel. The band "
        "holds the uncertainty of the parameters, the noise, and the scatter from throw to throw. "
        "The spread of a channel without repeats is what the scatter of the others implies.\n"
    )
    return "\n".join(lines)


def notes(validation: xr.Dataset) -> list[str]:
    """Say which movements are not among the predicted ones, and which onsets were moved.

    Examples
    --------
    >>> found = xr.Dataset({"onset_shift": ("movement", [0.0, 0.045, 0.052])})
    >>> notes(found.assign_attrs(left_out='["a was left out: does not fit"]'))
    ['a was left out: does not fit', '2 onsets without motor current: ... 52 ms after the marks']
    """
    texts = [str(text) for text in json.loads(validation.attrs.get("left_out", "[]"))]
    if validation.attrs.get("chain"):
        texts.append(str(validation.attrs["chain"]))
    moved = validation["onset_shift"].values if "onset_shift" in validation else np.zeros(0)
    moved = 1e3 * moved[moved != 0.0]
    if moved.size > 1 and np.ptp(moved) == 0.0:
        texts.append(
            f"the motors run {moved[0]:.0f} ms before the rods move in {moved.size} movements, "
            "which is taken off"
        )
    elif moved.size:
        texts.append(
            f"{moved.size} onsets without motor current: those that fit the free part of each "
            f"movement are {moved.min():.0f} to {moved.max():.0f} ms after the marks"
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
    content = io.StringIO()
    table = csv.writer(content, lineterminator="\n")
    pairs = [(name, side) for name in FEATURES for side in ("measured", "predicted")]
    table.writerow(
        ["movement", "direction", "size [m]", "place", "used", "channel", "rms [N]", "nrmse [-]"]
        + ["repeat_spread [N]", "cover [-]"]
        + [f"{name}_{side} [{_UNITS[name]}]" for name, side in pairs]
    )
    for number in range(validation.sizes["movement"]):
        for row in range(validation.sizes["channel"]):
            one = validation.isel(movement=number, channel=row)
            if not np.isfinite(float(one["rms"])):
                continue
            head = [one["movement"].item(), one["direction"].item(), f"{float(one['size']):g}"]
            head += [one["place"].item(), "yes" if bool(one["used"]) else "no"]
            values = [one[name] for name in ("rms", "nrmse", "repeat_spread", "cover")]
            values += [one[f"{name}_{side}"] for name, side in pairs]
            cells = ["" if np.isnan(float(v)) else f"{float(v):.6g}" for v in values]
            table.writerow([*head, one["channel"].item(), *cells])
    return content.getvalue()


def _cell(error: tuple[float, float], factor: float, unit: str) -> str:
    if not np.isfinite(error[0]):
        return "-"
    return f"{factor * error[0]:+.0f} ± {factor * error[1]:.0f} {unit}"
