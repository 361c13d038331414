"""Result of a validation as lines for the screen, a page in Markdown and a table."""

import csv
import io
import json

import numpy as np
import xarray as xr

from turnout.calibration.validation.acceptance import FEATURES, Acceptance, ChannelResult
from turnout.core.value_text import count_text


def acceptance_lines(verdict: Acceptance) -> list[str]:
    """Return a table for the screen: a line a channel, then what is furthest off.

    Parameters
    ----------
    verdict : Acceptance
        From `judge`.
    """
    lines = [
        f"{'channel':<10}{'movements':>10}{'RMS':>8}{'NRMSE':>8}{'repeats':>9}{'times':>7}"
        f"{'cover':>7}{'least':>7}{'contact':>12}{'slope':>12}{'peak':>14}{'plateau':>14}"
    ]
    for item in verdict.channels:
        cells = _error_cells(item)
        lines.append(
            f"{item.channel:<10}{item.movements:>10}{item.rms:>6.0f} N{100 * item.nrmse:>6.1f} %"
            f"{item.spread:>7.0f} N{item.spreads:>7.1f}{100 * item.cover:>5.0f} %"
            f"{100 * item.least_cover:>5.0f} %"
            f"{cells[0]:>12}{cells[1]:>12}{cells[2]:>14}{cells[3]:>14}"
        )
    seen = "held back" if verdict.held_back else "all used for the fit"
    seen = "each predicted without its place" if verdict.left_out else seen
    judged = count_text(verdict.judged, "movement")
    lines.append(f"{judged} judged, {seen}; {verdict.used} used for the fit")
    lines += [f"{'would notice' if n == 0 else '':<14}{t}" for n, t in enumerate(verdict.power)]
    lines += verdict.remarks
    lines += [f"{'furthest off' if n == 0 else '':<14}{t}" for n, t in enumerate(verdict.worst)]
    return lines


# Of features: factor from SI to the unit that is shown, that unit, and the SI unit.
_UNITS = {
    "contact": (1e3, "ms", "s"),
    "slope": (1e2, "%", "N/s"),
    "peak": (1.0, "N", "N"),
    "plateau": (1.0, "N", "N"),
}


def _error_cells(item: ChannelResult) -> list[str]:
    """Return mean and standard deviation of the error of each feature, as it is shown."""
    cells = []
    for name, (factor, unit, _) in _UNITS.items():
        mean, deviation = item.errors[name]
        if not np.isfinite(mean):
            cells.append("-")
            continue
        # Adding zero turns a negative zero into a plain one.
        cells.append(f"{round(factor * mean) + 0:+d} ± {factor * deviation:.0f} {unit}")
    return cells


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
        "| channel | movements | RMS | NRMSE | repeat spread | multiple of it | cover of band | "
        "at least |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {item.channel} | {item.movements} | {item.rms:.0f} N | {100 * item.nrmse:.1f} % | "
        f"{item.spread:.0f} N | {item.spreads:.1f} | {100 * item.cover:.0f} % | "
        f"{100 * item.least_cover:.0f} % |"
        for item in verdict.channels
    ]
    lines += ["", "Predicted less measured, mean ± standard deviation:", ""]
    lines += ["| channel | contact | build-up | peak | plateau |", "|---|---|---|---|---|"]
    lines += [f"| {' | '.join([item.channel, *_error_cells(item)])} |" for item in verdict.channels]
    judged = count_text(verdict.judged, "movement")
    lines += ["", f"{judged} judged; the fit has seen {verdict.used}.", ""]
    lines += [f"From throw to throw: {scatter_text(validation)}.", ""]
    lines += [f"{text}.\n" for text in notes(validation)]
    lines += [f"{text}.\n" for text in verdict.remarks]
    if verdict.power:
        lines += ["This validation would notice:", "", *(f"- {t}" for t in verdict.power), ""]
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
    content = io.StringIO()
    table = csv.writer(content, lineterminator="\n")
    pairs = [(name, side) for name in FEATURES for side in ("measured", "predicted")]
    table.writerow(
        ["movement", "direction", "size [m]", "place", "used", "channel", "rms [N]", "nrmse [-]"]
        + ["repeat_spread [N]", "cover [-]"]
        + [f"{name}_{side} [{_UNITS[name][2]}]" for name, side in pairs]
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
