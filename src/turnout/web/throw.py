"""Throw a panel as the page asks for it."""

import xarray as xr

from turnout.errors import PanelError
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.response.placed import check_placed
from turnout.response.save import Save
from turnout.response.scheme import Scheme
from turnout.response.simulate import prepare, simulate
from turnout.web.controls import controls
from turnout.web.question import Question, Superseded
from turnout.web.request import AskedRun

# While a slider moves; once it rests the throw is computed as `turnout simulate` does.
PREVIEW, PREVIEW_KEPT = Scheme.of("quick"), Save(interval=0.02)
# Each way along the slider; more would not stay in memory.
PLACES_AHEAD = 10
# Keys of a panel that name a file, which would be one of this machine.
FILE_KEYS = ("matrices", "table_file")
FILE_MESSAGE = "names another file, which the page cannot; start with `turnout studio --panel`"


def changed_panel(panel: LoadedPanel, asked: AskedRun) -> LoadedPanel:
    """Return the panel with what the page changed in it; PanelError tells all that is wrong."""
    named = [key for key in asked.settings if key.split(".")[-1].strip() in FILE_KEYS]
    if named:
        raise PanelError([f"{key}: {FILE_MESSAGE}" for key in named], source="overrides")
    return panel.with_overrides(asked.settings, si=False) if asked.settings else panel


def thrown(panel: LoadedPanel, asked: AskedRun, question: Question) -> xr.Dataset:
    """Throw a panel, unless something newer was asked.

    Parameters
    ----------
    panel : LoadedPanel
        With the changes made.
    asked : AskedRun
        Gives the object and whether a preview will do.
    question : Question
        Tells when to give way.

    Returns
    -------
    xarray.Dataset
        Whole, or partial where the run could not go on.

    Raises
    ------
    Superseded
        When something newer was asked meanwhile.
    PanelError, FileError
        When the object does not fit the panel.
    """
    try:
        dataset = simulate(
            panel,
            foreign_object=_trapped(asked),
            scheme=PREVIEW if asked.preview else Scheme(),
            save=PREVIEW_KEPT if asked.preview else None,
            throw=False,
            report=question.hear,
        )
    except KeyboardInterrupt:
        raise Superseded from None
    if dataset.attrs["outcome"] == "interrupted":
        raise Superseded
    check_placed(dataset)
    return dataset


def places_around(panel: LoadedPanel, asked: AskedRun) -> list[AskedRun]:
    """Return the throws whose object lies where the slider comes next, the nearest first."""
    given = asked.object
    if given is None:
        return []
    slider = next(item for item in controls(panel) if item["key"] == "object.x")
    x = resolve_objects(panel, [ForeignObject(given.size, given.at)])[-1].x
    here, step = round(x / slider["step"]), slider["step"]
    places = [step * (here + side * n) for n in range(1, PLACES_AHEAD + 1) for side in (1, -1)]
    return [
        asked.model_copy(update={"object": given.model_copy(update={"at": f"x = {place:.4f} m"})})
        for place in places
        if slider["least"] <= place <= slider["most"]
    ]


def made_ready(panel: LoadedPanel, asked: AskedRun) -> None:
    """Reduce the rails of a throw that may be asked for, so that it is answered sooner."""
    prepare(panel, foreign_object=_trapped(asked))


def _trapped(asked: AskedRun) -> ForeignObject | None:
    given = asked.object
    if given is None:
        return None
    return ForeignObject(given.size, given.at, stiffness=given.stiffness)
