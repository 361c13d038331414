"""Room for an object between the rails at its place, and the refusal of one that never has any."""

from typing import TYPE_CHECKING

from turnout.core.errors import FileError
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import OPENING_MARGIN, ForeignObject, resolve_objects
from turnout.panel.layout import largest_opening
from turnout.panel.load import LoadedPanel
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

if TYPE_CHECKING:
    import xarray as xr


def object_fits(panel: LoadedPanel, size: float, place: str) -> bool:
    """Return True if the rails stand far enough apart at a place for an object to be there.

    An object is placed between the rails as soon as they stand far enough apart; where they never
    do, a throw with it is one without. The opening is estimated from the panel; only objects near
    the estimate are thrown to find out.

    Parameters
    ----------
    panel : LoadedPanel
        A panel that knows the place.
    size : float
        Of the object [m].
    place : str
        Such as "sleeper 6".

    Raises
    ------
    PanelError
        When the panel has no such place, or the object is far larger than the opening.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> object_fits(load_panel("sb1"), 0.005, "sleeper 6")
    True
    """
    item = ForeignObject(size, place)
    opening = estimated_opening(panel, resolve_objects(panel, [item])[-1].x)
    if opening is None or size < opening - OPENING_MARGIN:
        return True
    run = simulate(
        panel,
        foreign_object=item,
        scheme=Scheme.of("quick"),
        save=Save(fields=("object_placed",)),
        throw=False,
    )
    return bool(run.get("object_placed", True))


def estimated_opening(panel: LoadedPanel, x: float) -> float | None:
    """Return the approximate largest distance between the rails at a position [m]."""
    return largest_opening(panel, str(panel.object_defaults.rail), x)


def check_placed(dataset: "xr.Dataset") -> None:
    """Refuse a whole run in which an object was never placed.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `simulate`.

    Raises
    ------
    FileError
        With what to change.

    Examples
    --------
    >>> import xarray as xr
    >>> check_placed(xr.Dataset({"object_placed": True}, attrs={"complete": True}))
    """
    if dataset.attrs["complete"] and not dataset.get("object_placed", True):
        message = (
            "object: does not fit: the gap is smaller at all times from its onset on; "
            "take a smaller size, another place or another time"
        )
        raise FileError(message)
