"""A validation as text: a page to read and a table of all movements."""

import csv
import io
import json

import numpy as np
import xarray as xr

from turnout.validation.verdict import FEATURES, Verdict

_UNITS = {"contact": "s", "slope": "N/s", "peak": "N", "plateau": "N"}


def page_text(validation: xr.Dataset, verdict: Verdict, *, figures: list[str]) -> str:
    """Return a page in Markdown.

    Parameters
    ----------
    validation : xarray.Dataset
        From `validate`.
    verdict : Verdict
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
    if verdict.worst:
        lines += ["Furthest off:", "", *(f"- {text}" for text in verdict.worst), ""]
    lines += [f"![{name}]({name})\n" for name in figures]
    lines.append(
        "NRMSE is the RMS difference over the largest measured force of the channel. The band "
        "holds the doubt of the parameters, of noise, and of what differs from throw to throw. "
        "The spread of a channel without repeats is what the scatter of the others implies.\n"
    )
    return "\n".join(lines)


def notes(validation: xr.Dataset) -> list[str]:
    """Say which movements are not among the predicted ones, and which onsets were moved.

    Examples
    --------
    >>> told = xr.Dataset({"onset_shift": ("movement", [0.0, 0.045, 0.052])})
    >>> notes(told.assign_attrs(left_out='["a was left out: no room"]'))
    ['a was left out: no room', 'no motor current told 2 onsets: ... 45 to 52 ms after the marks']
    """
    texts = [str(text) for text in json.loads(validation.attrs.get("left_out", "[]"))]
    moved = validation["onset_shift"].values if "onset_shift" in validation else np.zeros(0)
    moved = 1e3 * moved[moved != 0.0]
    if moved.size:
        texts.append(
            f"no motor current told {moved.size} onsets: those that fit the free part of each "
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
