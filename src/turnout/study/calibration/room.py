"""Movements that the model cannot follow: objects that there is never room for."""

from collections.abc import Sequence

from turnout.errors import MeasurementError
from turnout.integrate.scheme import Scheme
from turnout.panel.foreign_object import OPENING_MARGIN, ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.panel.opening import largest_opening
from turnout.response.save import Save
from turnout.response.simulate import simulate
from turnout.study.calibration.observed import Movement


def with_room(
    movements: Sequence[Movement], panel: LoadedPanel
) -> tuple[tuple[Movement, ...], list[str]]:
    """Return the movements whose object the model has room for, and what to say of the others.

    An object is placed between the rails as soon as they stand far enough apart. Where they never
    do it is not there, and a throw with it is one without: comparing it with a measurement in
    which it was squeezed in would spoil every value. Only objects near the estimated opening are
    thrown to find out.

    Parameters
    ----------
    movements : sequence of Movement
        As observed.
    panel : LoadedPanel
        What was measured.

    Raises
    ------
    MeasurementError
        When nothing is left.
    """
    rooms = {(item.place, item.size): _has_room(panel, item) for item in movements if item.size > 0}
    kept = tuple(item for item in movements if rooms.get((item.place, item.size), True))
    texts = [
        f"{item.text} was left out: the gap of panel {panel.name} never has room for the object; "
        "check size and place in the run sheet, and the geometry of the panel there"
        for item in movements
        if not rooms.get((item.place, item.size), True)
    ]
    if not kept:
        raise MeasurementError(texts, source="no movement is left")
    return kept, texts


def _has_room(panel: LoadedPanel, item: Movement) -> bool:
    opening = largest_opening(panel, str(panel.object_defaults.rail), item.x)
    if opening is None or item.size < opening - OPENING_MARGIN:
        return True
    run = simulate(
        panel,
        foreign_object=ForeignObject(item.size, item.place),
        scheme=Scheme.of("quick"),
        save=Save(fields=("object_placed",)),
        throw=False,
    )
    return bool(run.get("object_placed", True))
