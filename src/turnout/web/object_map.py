"""Objects that a switch reports, by size and place: many quick throws, one verdict each."""

from typing import Any

from turnout.core.errors import FileError, PanelError
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.throw.save import Save
from turnout.throw.simulate import simulate
from turnout.throw.verdict import verdict
from turnout.web.question import Question, Superseded
from turnout.web.request import MapRequest

MAPPED, MAPPED_KEPT = Scheme.of("quick"), Save(interval=0.02)
MOST_THROWS = 600
LEAST = "1 mm"
NOT_TOUCHED, NO_ROOM, FAILED = "not touched", "does not fit", "failed"


def object_map(panel: LoadedPanel, request: MapRequest, question: Question) -> dict[str, Any]:
    """Return the verdict on every object.

    Parameters
    ----------
    panel : LoadedPanel
        With the changes made.
    request : MapRequest
        Places and sizes; kind and stiffness as in its run.
    question : Question
        Takes the share that is done, and signals when to stop.

    Returns
    -------
    dict
        ``kinds`` (size, place): a kind of `turnout.throw.verdict`, or "not touched", "does not
        fit", "failed"; ``texts`` alike, the sentences.

    Raises
    ------
    FileError, PanelError
        For more throws than a page may ask for, a place that is none, a size that is none.
    Superseded
        When it was stopped.
    """
    for place in request.places:
        resolve_objects(panel, [_trapped(request, LEAST, place)])
    total = len(request.places) * len(request.sizes)
    if total > MOST_THROWS:
        message = f"a map of {total} throws: at most {MOST_THROWS}; use `turnout sweep` for more"
        raise FileError(message)
    cells = [[("", "") for _ in request.places] for _ in request.sizes]
    done = 0
    for column, place in enumerate(request.places):
        for row, size in enumerate(request.sizes):
            try:
                question.progress(done, total)
                cells[row][column] = _judged(panel, request, size, place, question)
            except KeyboardInterrupt:
                raise Superseded from None
            done += 1
    return {
        "places": request.places,
        "sizes": request.sizes,
        "kinds": [[kind for kind, _ in row] for row in cells],
        "texts": [[text for _, text in row] for row in cells],
    }


def _trapped(request: MapRequest, size: str, place: str) -> ForeignObject:
    given = request.run.object
    stiffness, kind = (None, "spring") if given is None else (given.stiffness, given.kind)
    return ForeignObject(size, place, stiffness=stiffness, kind=kind)


def _judged(
    panel: LoadedPanel, request: MapRequest, size: str, place: str, question: Question
) -> tuple[str, str]:
    """Return kind and sentence of one throw."""
    trapped = _trapped(request, size, place)
    try:
        dataset = simulate(
            panel,
            foreign_object=trapped,
            scheme=MAPPED,
            save=MAPPED_KEPT,
            throw=False,
            report=question.check,
        )
    except PanelError as error:  # its place and size are known to be good
        return NO_ROOM, str(error)
    if dataset.attrs["outcome"] == "interrupted":
        raise KeyboardInterrupt
    found = verdict(dataset)
    if not dataset.attrs["complete"]:
        return FAILED, str(dataset.attrs["outcome_message"])
    if "object_placed" in dataset and not bool(dataset["object_placed"]):
        return NO_ROOM, found.text
    if not bool(dataset["object_touched"]):
        return NOT_TOUCHED, found.text
    return found.kind, found.text
