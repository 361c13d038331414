r"""Margin of this program's detector over the others, and the order of methods, by conditions.

Throws of a switch are alike, so switches are drawn with replacement, for all methods the same ones
(Efron and Tibshirani 1993, chapter 8). In each draw every method gets the threshold that
1 in 1,000 of the sound throws drawn exceeds, and a90 at each place from `weighted_a90`, a throw
weighing as often as its switch was drawn.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.data import Side
from benchmarks.detection.definition import EQUAL, HARD, MARKERS, MID_SPAN, SOUND
from benchmarks.detection.metrics import weighted_a90
from benchmarks.detection.run_methods import (
    ASSUMED,
    ASSUMING,
    OURS,
    RESULTS,
    Conditions,
    digest_of,
)
from benchmarks.detection.tables import NOTHING, markdown_table, millimetres
from benchmarks.detection.verdicts import read_verdicts
from turnout.core.files import write_atomic
from turnout.core.json_files import to_plain
from turnout.core.provenance import content_hash

Floats = NDArray[np.float64]
Results = Mapping[str, Mapping[str, Any]]

SOURCES = ("metrics.py", "order.py")
FILE = "margins.json"
CLEAR = 2e-3
"""Margin that was wanted [m]."""
LINEAR_BOUND = {(0, 0.05): 10.1, (20, 0.03): 8.0, (20, 0.05): 9.1, (20, 0.10): 11.7}
"""a90 of the linear bound for forces on the default panel, mean of sleepers 4 to 8, by throws known
and discrepancy [mm]; from docs/evidence/blind-zones.md."""


def margins_of(folder: Path, conditions: Conditions, results: Results) -> dict[str, Any]:
    """Return a90 mid-span of each method and the margins of this program's, with intervals.

    Parameters
    ----------
    folder : Path
        Of the benchmark.
    conditions : Conditions
        That the results were made under.
    results : mapping of str to mapping
        By method, from `run_methods`.

    Returns
    -------
    dict
        "a90" by method (value, low, high); with a result of this program also "over" by baseline
        and "best" (as `Margin`), "first", the best baseline, and "assuming", the margin of the
        detector that assumes the usual discrepancy where there is one.
    """
    path = folder / RESULTS / conditions.name / FILE
    key = content_hash([
        {name: item["key"] for name, item in results.items()}, digest_of(SOURCES), DRAWS
    ])  # fmt: skip
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if found.get("key") == key:
            return found
    except (OSError, ValueError):
        pass
    side = conditions.judged(folder)
    scores = {
        name: read_verdicts(
            path.with_name(f"{name}.csv"), throws=side.throw, positions=side.positions
        ).score
        for name in results
    }
    found = {"key": key, **margins_from(mid_span_draws(side, scores))}
    text = json.dumps(to_plain(found, nonfinite=lambda _: None), indent=1)
    write_atomic(path, text + "\n")
    return dict(json.loads(text))


def margins_from(draws: Mapping[str, Floats]) -> dict[str, Any]:
    """Return figures of draws of a90: each method's, and the margins of this program's detector."""
    found: dict[str, Any] = {"a90": {name: _interval(row) for name, row in draws.items()}}
    others = {name: row for name, row in draws.items() if not name.startswith(OURS)}
    if OURS in draws and others:
        own = draws[OURS]
        found["over"] = {name: asdict(margin_over(own, [row])) for name, row in others.items()}
        found["best"] = asdict(margin_over(own, list(others.values())))
        found["first"] = min(others, key=lambda name: others[name][0])
        if ASSUMING in draws:
            found["assuming"] = asdict(margin_over(draws[ASSUMING], list(others.values())))
    return found


def _interval(row: Floats) -> dict[str, float]:
    low, high = central_interval(row[1:])
    return {"value": float(row[0]), "low": low, "high": high}


def order_table(
    conditions: Sequence[Conditions], results: Mapping[str, Results], margins: Mapping[str, Any]
) -> str:
    """Return a table of who is first under which conditions, as Markdown."""
    heads = (
        *("track", "channels", "history", "discrepancy", "turnout detector [mm]"),
        *("best baseline [mm]", "", "margin [mm]", "ahead in", "linear bound [mm]"),
    )
    rows = []
    for own, assumed, name, best in _compared(conditions, margins):
        found = margins[own.name]
        seen = best["other"] is not None
        title = results[own.name][found["first"]]["title"] if seen else "none"
        bound = LINEAR_BOUND.get((own.history, own.discrepancy)) if own.track == MARKERS else None
        rows.append([
            own.track, own.channels, str(own.history), f"{own.discrepancy:.0%}{assumed}",
            sized(found["a90"][name]), sized(found["a90"][found["first"]]), title,
            f"{_signed(best['value'])} ({_signed(best['low'])} to {_signed(best['high'])})",
            f"{best['ahead']:.0%}", NOTHING if bound is None else f"{bound:.1f}",
        ])  # fmt: skip
    return markdown_table(heads, rows)


def _compared(
    conditions: Sequence[Conditions], margins: Mapping[str, Any]
) -> Iterator[tuple[Conditions, str, str, Mapping[str, Any]]]:
    """Yield conditions, another assumed discrepancy, the name of the detector and its margin."""
    for own in conditions:
        found = margins.get(own.name, {})
        for key, name, assumed in (
            ("best", OURS, ""), ("assuming", ASSUMING, f", {ASSUMED:.0%} assumed")
        ):  # fmt: skip
            if key in found:
                yield own, assumed, name, found[key]


def sized(interval: Mapping[str, float | None]) -> str:
    """Return a size in mm with its interval.

    Examples
    --------
    >>> sized({"value": 0.011, "low": 0.0101, "high": None})
    '11.0 (10.1 to -)'
    """
    value, low, high = (millimetres(interval[name]) for name in ("value", "low", "high"))
    return NOTHING if value == NOTHING else f"{value} ({low} to {high})"


def _signed(value: float | None) -> str:
    return NOTHING if value is None or not np.isfinite(value) else f"{1e3 * value:+.1f}"


def order_changes(conditions: Sequence[Conditions], margins: Mapping[str, Any]) -> list[str]:
    """Return a sentence per condition under which this program's detector is not clearly first.

    With the discrepancy it is said at which one the margin would be zero, on the straight line
    between the two nearest.
    """
    found = []
    for own, assumed, _, best in _compared(conditions, margins):
        name, by = f"{own.name}{assumed}", 1e3 * (best["value"] or 0.0)
        if best["own"] is None and best["other"] is None:
            found.append(f"{name}: no method sees nine of ten at all places.")
        elif best["own"] is None:
            found.append(
                f"{name}: a baseline is first, and only it sees nine of ten at all places."
            )
        elif best["other"] is None:
            continue
        elif by <= 0.0:
            found.append(f"{name}: a baseline is first by {-by:.1f} mm.")
        elif best["low"] is None or best["low"] <= 0.0:
            found.append(
                f"{name}: first by {by:.1f} mm, but a baseline is in "
                f"{1.0 - best['ahead']:.0%} of the draws of switches."
            )
        elif best["value"] < CLEAR:
            found.append(f"{name}: first by {by:.1f} mm, less than {1e3 * CLEAR:g} mm.")
    usual = Conditions()
    line = sorted(
        (own.discrepancy, margins[own.name]["best"]["value"])
        for own in conditions
        if own.track == MARKERS and own.history == usual.history
        and (margins.get(own.name, {}).get("best") or {}).get("value") is not None
    )  # fmt: skip
    for (low, above), (high, below) in zip(line, line[1:], strict=False):
        if above * below < 0.0:
            at = low + (high - low) * above / (above - below)
            found.append(f"The order changes at a discrepancy of {at:.1%} (straight line).")
    return found or ["Under none of these conditions is a baseline first."]


# ---- margins

DRAWS = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """Difference in a90 of two methods; positive if the first sees smaller objects.

    Attributes
    ----------
    own, other : float
        a90 of both, mean of sleepers 4 to 8 at equal false alarms [m]; infinite where some size is
        never seen in nine of ten throws.
    value, low, high : float
        Other less own, and its 95 % interval over drawn switches [m].
    ahead : float
        Share of the draws in which it is positive [-].
    """

    own: float
    other: float
    value: float
    low: float
    high: float
    ahead: float


def mid_span_draws(
    side: Side, scores: Mapping[str, Floats], *, draws: int = DRAWS, seed: int = 0
) -> dict[str, Floats]:
    """Return a90 of each method, of all switches first and then of draws of them.

    Parameters
    ----------
    side : Side
        Judged test throws.
    scores : mapping of str to ndarray, shape (n,)
        Of each method, higher where an object is likelier.
    draws : int
        Of switches.
    seed : int
        Of chance.

    Returns
    -------
    dict of str to ndarray, shape (1 + draws,)
        Mean of sleepers 4 to 8, stones and metal, at equal false alarms [m].
    """
    switches, own = np.unique(side.groups, return_inverse=True)
    chosen = np.random.default_rng(seed).integers(0, len(switches), (draws, len(switches)))
    times = np.array([np.bincount(row, minlength=len(switches)) for row in chosen])
    times = np.vstack([np.ones((1, len(switches))), times])
    sound = side.labels["role"] == SOUND
    hard = np.isin(side.labels["kind"], HARD)
    places = [name for name in MID_SPAN if np.any(hard & (side.labels["place"] == name))]
    found = {}
    for name, score in scores.items():
        level = equal_levels(score[sound], times[:, own[sound]])
        each = []
        for place in places:
            rows = hard & (side.labels["place"] == place)
            hit = score[rows] > level[:, np.newaxis]
            each.append(weighted_a90(side.labels["size"][rows], hit, times[:, own[rows]]))
        found[name] = np.mean(each, axis=0) if each else np.full(len(times), np.inf)
    return found


def equal_levels(score: Floats, weight: Floats) -> Floats:
    """Return the score that a share `EQUAL` of weighted throws exceeds, shape (n_draws,).

    Examples
    --------
    >>> equal_levels(np.arange(2000.0), np.ones((1, 2000))).tolist()
    [1997.0]
    """
    order = np.argsort(score)[::-1]
    above = np.cumsum(weight[:, order], axis=1)
    allowed = EQUAL * above[:, -1:]
    return np.asarray(score[order][np.argmax(above > allowed, axis=1)], dtype=np.float64)


def margin_over(own: Floats, others: Sequence[Floats]) -> Margin:
    """Return the margin over the best of some methods, which each draw chooses again.

    Parameters
    ----------
    own : ndarray, shape (1 + n_draws,)
        From `mid_span_draws`.
    others : sequence of ndarray
        Likewise.

    Examples
    --------
    >>> found = margin_over(np.array([10.0, 9.0, 11.0]), [np.array([12.0, 12.0, 10.5])])
    >>> found.value, found.ahead
    (2.0, 0.5)
    """
    best = np.min(others, axis=0)
    with np.errstate(invalid="ignore"):
        margin = best - own
    margin = np.where(np.isfinite(own), margin, np.where(np.isfinite(best), -np.inf, np.nan))
    drawn = margin[1:][~np.isnan(margin[1:])]
    if not drawn.size:
        drawn = np.array([np.nan])
    low, high = central_interval(drawn)
    return Margin(
        own=float(own[0]), other=float(best[0]), value=float(margin[0]),
        low=low, high=high,
        ahead=float(np.mean(drawn > 0.0)),
    )  # fmt: skip


def central_interval(drawn: Floats) -> tuple[float, float]:
    """Return the ends between which 95 % of draws lie, infinite ones included.

    Examples
    --------
    >>> central_interval(np.arange(100.0))
    (2.0, 97.0)
    """
    rising, tail = np.sort(drawn), int(0.025 * len(drawn))
    return float(rising[tail]), float(rising[-1 - tail])
