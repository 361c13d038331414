"""Judged throws over their number: friction, and the odds of an object and of other causes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from turnout.figures.sheet import Level, Line, Row, Sheet
from turnout.study.defects import DEFECTS


def trend_sheet(verdicts: Sequence[Mapping[str, Any]]) -> Sheet:
    """Return how judged throws of a switch change from throw to throw.

    Parameters
    ----------
    verdicts : sequence of mapping
        Fields of `turnout.detection.detector.throw_verdict.Verdict`, in the order of the throws.

    Returns
    -------
    Sheet
        Friction level; logarithm of the likelihood ratio of an object with its threshold; those of
        other causes. A throw that could not be judged leaves a hole.

    Examples
    --------
    >>> throw = {"friction": 0.3, "log_ratio": -5.0, "threshold": 4.0, "odds": {"clutch": 0.1}}
    >>> [len(row.lines) for row in trend_sheet([throw, throw]).rows]
    [1, 1, 1]
    """
    number = np.arange(1.0, len(verdicts) + 1.0)

    def line(label: str, values: list[float], colour: int) -> Line:
        return Line(
            label=label,
            x=number,
            y=np.array(values),
            colour=colour,
            dash=colour,
            style="line and marks",
        )

    thresholds = {round(float(v), 4) for v in _of(verdicts, "threshold") if np.isfinite(v)}
    drawn = sorted((d.trend, name) for name, d in DEFECTS.items() if d.trend)
    named = [name for _, name in drawn if any(name in item["odds"] for item in verdicts)]
    causes = [
        line(name, [_log(item["odds"].get(name)) for item in verdicts], colour)
        for colour, name in enumerate(named, 2)
    ]
    rows = [
        Row("Friction\nlevel [-]", (line("friction", _of(verdicts, "friction"), 0),)),
        Row(
            "Log odds,\nobject [-]",
            (line("object", _of(verdicts, "log_ratio"), 1),),
            tuple(Level(value, "alarm") for value in sorted(thresholds)),
        ),
        Row("Log odds,\nother causes [-]", tuple(causes)),
    ]
    return Sheet(
        name="trends",
        title="From throw to throw",
        caption="In the order of the throws. Log odds above the dashed line are an alarm; of "
        "other causes, against a sound switch. A throw that could not be judged leaves a hole.",
        x_label="Throw",
        rows=tuple(row for row in rows if row.lines),
    )


def _of(verdicts: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    return [float(item[name]) for item in verdicts]


def _log(odds: float | None) -> float:
    return float(np.log(odds)) if odds is not None and 0.0 < odds < np.inf else float("nan")
