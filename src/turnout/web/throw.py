"""Simulate a requested throw, roll a wheel over it; assemble the reply and the files."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, cast

import xarray as xr

from turnout.core.errors import FileError, PanelError, SolverError
from turnout.core.scheme import Scheme
from turnout.core.units import FORCE, parse_quantity
from turnout.figures.gauge import gauge_sheet
from turnout.figures.moving_plan import FRAMES, motion_record
from turnout.figures.over_time_sheet import throw_sheet
from turnout.figures.sheet import MOST_POINTS, sheet_record
from turnout.figures.style import rendered
from turnout.figures.throw import plot_throw
from turnout.measurement.formats.history import history_text
from turnout.metric.finding import headline
from turnout.metric.key_figure import KeyFigure, key_figures
from turnout.metric.least_gauge import wheel_findings
from turnout.metric.summary import summary
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel
from turnout.panel.new_panel import names_other_file
from turnout.throw.checks import (
    Check,
    Lamp,
    checks,
    direction_of,
    format_gap,
    lamps,
    meaning_of,
    quantity_text,
)
from turnout.throw.object_fit import check_placed
from turnout.throw.save import Save
from turnout.throw.simulate import prepare_panel, simulate
from turnout.throw.store import response_bytes
from turnout.throw.verdict import Verdict, verdict
from turnout.throw.wheel import Course, gauge_under_wheel
from turnout.web.controls import controls
from turnout.web.question import Question, Superseded
from turnout.web.request import RunRequest, WheelRequest

# While a slider moves; once it rests the throw is computed as `turnout simulate` does.
PREVIEW, PREVIEW_KEPT = Scheme.of("quick"), Save(interval=0.02)
# Each way along the slider; more would not stay in memory.
PLACES_AHEAD = 10
FILE_MESSAGE = "names another file, which the page cannot; start with `turnout studio --panel`"


def changed_panel(panel: LoadedPanel, request: RunRequest) -> LoadedPanel:
    """Return the panel with the changes of the page in it; PanelError lists all problems."""
    named = [
        key
        for key, value in request.settings.items()
        if names_other_file(key.split(".")[-1].strip(), value)
    ]
    if named:
        raise PanelError([f"{key}: {FILE_MESSAGE}" for key in named], source="overrides")
    return panel.with_overrides(request.settings, si=False) if request.settings else panel


def simulate_request(
    panel: LoadedPanel, request: RunRequest, question: Question, *, report: bool = False
) -> xr.Dataset:
    """Simulate a throw, unless a newer request supersedes it.

    Parameters
    ----------
    panel : LoadedPanel
        With the changes made.
    request : RunRequest
        Gives the object and whether it is a preview.
    question : Question
        Signals when to stop.
    report : bool
        Whether to say how much is done.

    Returns
    -------
    xarray.Dataset
        Complete, or partial if the run stopped early.

    Raises
    ------
    Superseded
        When a newer request arrived.
    PanelError, FileError
        When the object does not fit the panel.
    """
    try:
        dataset = simulate(
            panel,
            foreign_object=trapped_object(request),
            scheme=PREVIEW if request.preview else Scheme(),
            save=PREVIEW_KEPT if request.preview else None,
            throw=False,
            report=question.progress if report else question.check,
        )
    except KeyboardInterrupt:
        raise Superseded from None
    if dataset.attrs["outcome"] == "interrupted":
        raise Superseded
    check_placed(dataset)
    return dataset


def places_around(panel: LoadedPanel, request: RunRequest) -> list[RunRequest]:
    """Return the throws for the neighbouring slider positions, nearest first."""
    given = request.object
    if given is None:
        return []
    slider = next(item for item in controls(panel) if item["key"] == "object.x")
    x = resolve_objects(panel, [ForeignObject(given.size, given.at)])[-1].x
    here, step = round(x / slider["step"]), slider["step"]
    places = [step * (here + side * n) for n in range(1, PLACES_AHEAD + 1) for side in (1, -1)]
    return [
        request.model_copy(update={"object": given.model_copy(update={"at": f"x = {place:.4f} m"})})
        for place in places
        if slider["least"] <= place <= slider["most"]
    ]


def made_ready(panel: LoadedPanel, request: RunRequest) -> None:
    """Reduce the rails of a likely next throw in advance."""
    prepare_panel(panel, foreign_object=trapped_object(request))


def trapped_object(request: RunRequest) -> ForeignObject | None:
    """Return the foreign object of a request, None without."""
    given = request.object
    if given is None:
        return None
    return ForeignObject(given.size, given.at, stiffness=given.stiffness, kind=given.kind)


PREVIEW_FRAMES, PREVIEW_POINTS = 61, 500


def throw_reply(panel: Panel, dataset: xr.Dataset, *, preview: bool = False) -> dict[str, Any]:
    """Return the reply about a throw as plain data.

    Parameters
    ----------
    panel : Panel
        Panel that was thrown.
    dataset : xarray.Dataset
        The run, whole or partial.
    preview : bool
        Whether to return fewer points and instants.

    Raises
    ------
    SolverError
        When the run ended before its second instant.
    """
    if dataset.sizes["time"] < 2:
        raise SolverError(str(dataset.attrs["outcome_message"]))
    frames, points = (PREVIEW_FRAMES, PREVIEW_POINTS) if preview else (FRAMES, MOST_POINTS)
    motion = motion_record(panel, dataset, frames=frames)
    made = checks(dataset)
    judged = verdict(dataset, made)
    return {
        "complete": bool(dataset.attrs["complete"]),
        "message": "" if dataset.attrs["complete"] else str(dataset.attrs["outcome_message"]),
        "seconds": float(dataset.attrs["wall_time"]),
        "scheme": str(dataset.attrs["scheme"]),
        "objects": json.loads(dataset.attrs["foreign_objects"]),
        "verdict": _verdict(judged, dataset),
        "checks": [_check(item, dataset, missed=judged.missed) for item in made],
        "summary": [list(line) for line in summary(dataset, made)],
        "lamps": [
            _lamp(item, dataset, missed=judged.missed) for item in lamps(dataset, motion["at"])
        ],
        "figures": [_figure(item) for item in key_figures(dataset, made)],
        "sheet": sheet_record(throw_sheet(dataset, title=""), most=points),
        "motion": motion,
    }


def _verdict(found: Verdict, dataset: xr.Dataset) -> dict[str, Any]:
    """Return the verdict with the level of the report's headline; a preview is judged alike."""
    return {
        "kind": found.kind,
        "text": found.text,
        "meaning": found.meaning,
        "level": headline(found, dataset).level,
        "missed": found.missed,
    }


def _state(item: Check, *, missed: bool) -> str:
    """Return the state of a check; what accepts a trapped object is "missed", not "good"."""
    if item.met is None:
        return "rest"
    return "bad" if not item.met else "missed" if missed else "good"


def _check(item: Check, dataset: xr.Dataset, *, missed: bool) -> dict[str, Any]:
    after = "" if item.movement is None else direction_of(item.movement)
    return {
        "key": item.key,
        "kind": item.kind,
        "label": f"{item.label or item.name}{f', {after}' if after else ''}",
        "text": item.numbers or item.text,
        "margin": item.left,
        "state": _state(item, missed=missed),
        "meaning": meaning_of(item.kind, dataset),
    }


def _lamp(lamp: Lamp, dataset: xr.Dataset, *, missed: bool) -> dict[str, Any]:
    """Return a lamp over the frames: state, word and number of each are those of its instant."""
    several = len({check.movement for check in lamp.checks}) > 1
    words = []
    for lit, check in zip(lamp.on, lamp.checks, strict=True):
        word = lamp.words[0 if lit else 1]
        after = lamp.kind == "lock" and several and check.met is not None
        after &= check.movement is not None
        words.append(f"{word} after {direction_of(check.movement)}" if after else word)
    return {
        "kind": lamp.kind,
        "name": lamp.name,
        "title": f"{lamp.words[0]} when {lamp.rule}. {meaning_of(lamp.kind, dataset)}",
        "words": words,
        "states": [_state(check, missed=missed) for check in lamp.checks],
        "numbers": [
            f"{check.label} {check.numbers}".strip() if lamp.kind == "lock" else check.numbers
            for check in lamp.checks
        ],
        "margins": [check.left for check in lamp.checks],
    }


def _figure(item: KeyFigure) -> dict[str, Any]:
    missing = math.isnan(item.value)
    text = quantity_text(item.value, item.unit, decimals=3 if item.unit == "s" else 2)
    if item.unit == "m":
        text = format_gap(item.value)
    value = None if missing else item.value
    return {
        "key": item.key,
        "label": item.label,
        "value": value,
        "unit": item.unit,
        "text": "-" if missing else text,
    }


FILES: Mapping[str, str] = {
    "nc": "application/x-netcdf",
    "csv": "text/csv",
    "png": "image/png",
    "svg": "image/svg+xml",
    "pdf": "application/pdf",
    "toml": "application/toml",
    "txt": "text/plain",
    "py": "text/x-python",
}
"""Kinds of files with their media types."""
TEXTS = ("toml", "txt", "py")
"""Kinds that describe the computation: a panel file, a command, a script."""


def made_file(kind: str, dataset: xr.Dataset, *, behind: xr.Dataset | None = None) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    kind : str
        One of `FILES` but `TEXTS`: the dataset (nc), its channels as a table (csv), a figure.
    dataset : xarray.Dataset
        Throw that the page shows, a complete run.
    behind : xarray.Dataset, optional
        Drawn grey behind it in a figure.
    """
    if kind == "nc":
        return response_bytes(dataset)
    if kind == "csv":
        return history_text(dataset).encode()
    return rendered(plot_throw(dataset, compare=behind), f".{kind}")


def wheel_record(panel: LoadedPanel, request: WheelRequest) -> dict[str, Any]:
    """Return the least gauges at rest, at the wheel and anywhere under it, and their curves.

    Parameters
    ----------
    panel : LoadedPanel
        With the changes made.
    request : WheelRequest
        Load, course, and the trapped object.

    Returns
    -------
    dict
        ``findings`` as of a report; ``sheet``, the gauge along the rail.

    Raises
    ------
    FileError, ResponseError, PanelError
        For a load that is none, a panel without data of its gauge, an object that does not fit.
    NotConverged
        Where there is no equilibrium with sliding feet next to the last one.
    """
    forces = {}
    for name in ("lateral", "vertical"):
        try:
            forces[name] = parse_quantity(getattr(request, name), FORCE)
        except ValueError as error:
            message = f"{name} = '{getattr(request, name)}': {error}"
            raise FileError(message) from None
    dataset = gauge_under_wheel(
        panel,
        lateral=forces["lateral"],
        vertical=forces["vertical"],
        foreign_object=trapped_object(request.run),
        course=cast("Course", request.course),
    )
    findings = [asdict(item) for item in wheel_findings(dataset)]
    return {"findings": findings, "sheet": sheet_record(gauge_sheet(dataset))}
