"""What to say of an object for which there was never room."""

from typing import TYPE_CHECKING

from turnout.core.errors import FileError

if TYPE_CHECKING:
    import xarray as xr


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
