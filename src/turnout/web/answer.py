"""What the page is told of a throw: all of it made by metric and plot, here only put together."""

import json
import math
from typing import Any

import xarray as xr

from turnout.errors import SolverError
from turnout.metric.key_figure import KeyFigure, key_figures
from turnout.metric.lamp import lamps
from turnout.metric.summary import summary
from turnout.panel.model import Panel
from turnout.plot.moving_plan import FRAMES, motion_record
from turnout.plot.sheet import MOST_POINTS, sheet_record
from turnout.plot.throw_sheet import throw_sheet

# Units of the screen, their size in SI and how many decimals are shown.
SHOWN = {"N": ("kN", 1e3, 2), "m": ("mm", 1e-3, 2), "s": ("s", 1.0, 3)}
PREVIEW_FRAMES, PREVIEW_POINTS = 61, 500


def answer(panel: Panel, dataset: xr.Dataset, *, preview: bool = False) -> dict[str, Any]:
    """Return everything that the page shows of a throw, as plain data.

    Parameters
    ----------
    panel : Panel
        What was thrown.
    dataset : xarray.Dataset
        The run, whole or partial.
    preview : bool
        Whether fewer points of curves and instants of the motion will do.

    Raises
    ------
    SolverError
        When the run ended before there was anything to show.
    """
    if dataset.sizes["time"] < 2:
        raise SolverError(str(dataset.attrs["outcome_message"]))
    frames, points = (PREVIEW_FRAMES, PREVIEW_POINTS) if preview else (FRAMES, MOST_POINTS)
    motion = motion_record(panel, dataset, frames=frames)
    return {
        "complete": bool(dataset.attrs["complete"]),
        "message": "" if dataset.attrs["complete"] else str(dataset.attrs["outcome_message"]),
        "seconds": float(dataset.attrs["wall_time"]),
        "scheme": str(dataset.attrs["scheme"]),
        "objects": json.loads(dataset.attrs["foreign_objects"]),
        "summary": [list(line) for line in summary(dataset)],
        "lamps": _lamps(dataset, motion["at"]),
        "figures": [_figure(item) for item in key_figures(dataset)],
        "sheet": sheet_record(throw_sheet(dataset), most=points),
        "motion": motion,
    }


def _lamps(dataset: xr.Dataset, at: list[int]) -> list[dict[str, Any]]:
    return [
        {
            "kind": lamp.kind,
            "name": lamp.name,
            "on": lamp.on[at].tolist(),
            "wanted": lamp.wanted,
            "judged": lamp.judged[at].tolist(),
            "words": list(lamp.words),
            "rule": lamp.rule,
        }
        for lamp in lamps(dataset)
    ]


def _figure(item: KeyFigure) -> dict[str, Any]:
    unit, factor, decimals = SHOWN[item.unit]
    missing = math.isnan(item.value)
    # Adding zero turns a negative zero into a plain one.
    text = "-" if missing else f"{round(item.value / factor, decimals) + 0.0:.{decimals}f} {unit}"
    value = None if missing else item.value
    return {"key": item.key, "label": item.label, "value": value, "unit": item.unit, "text": text}
