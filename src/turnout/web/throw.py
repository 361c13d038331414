"""Throw a panel as the page asks for it."""

import xarray as xr

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.response.placed import check_placed
from turnout.response.scheme import Scheme
from turnout.response.simulate import simulate
from turnout.web.request import AskedRun
from turnout.web.worker import Question, Superseded

# While a slider moves; once it rests the throw is computed as `turnout simulate` does.
PREVIEW = Scheme(step=4e-3)


def changed_panel(panel: LoadedPanel, asked: AskedRun) -> LoadedPanel:
    """Return the panel with what the page changed in it; PanelError tells all that is wrong."""
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
    given = asked.object
    trapped = None
    if given is not None:
        trapped = ForeignObject(given.size, given.at, stiffness=given.stiffness)
    try:
        dataset = simulate(
            panel,
            foreign_object=trapped,
            scheme=PREVIEW if asked.preview else Scheme(),
            throw=False,
            report=question.hear,
        )
    except KeyboardInterrupt:
        raise Superseded from None
    if dataset.attrs["outcome"] == "interrupted":
        raise Superseded
    check_placed(dataset)
    return dataset
