"""State of objects at the end: trapped in the switch or not, and results that depend on breaks."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turnout.core.channels import BREAK_NOTE

if TYPE_CHECKING:
    import xarray as xr


def is_trapped(contact: ArrayLike, taken: ArrayLike, left: ArrayLike) -> NDArray[np.bool_]:
    """Flag the objects that were touched and are still there at the end.

    Parameters
    ----------
    contact : array_like
        First contact of each object [s]; NaN for none.
    taken : array_like
        When it was taken out [s]; infinite where it was not by the end.
    left : array_like
        Size that is left of it at the end [m]; NaN where it remembers nothing, so all is left.

    Returns
    -------
    ndarray of bool
        False for what broke and left nothing, was taken out, or was never touched.

    Examples
    --------
    >>> never = float("inf")
    >>> is_trapped([7.1, 7.1, float("nan"), 7.1], [never, never, never, 9.0], [0.01, 0, 0.01, 0.01])
    array([ True, False, False, False])
    """
    first, end, size = (np.asarray(item, dtype=np.float64) for item in (contact, taken, left))
    gone = size <= 0.0  # not where it is NaN
    return np.asarray((first < end) & np.isinf(end) & ~gone)


def break_note(dataset: "xr.Dataset") -> str:
    """Return the note beside a verdict that may rest on how objects broke; empty for none.

    A single throw has one where the throws that it was compared with end otherwise. Sequences and
    sweeps, which are not compared, have one where an object broke.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run, a sequence or a throw of one, or labels of a sweep that stores `object_broken`.

    Examples
    --------
    >>> import xarray as xr
    >>> break_note(xr.Dataset({"object_broken": ("object", [3, 0])}))
    'An object broke: where its strength is nearly met, the verdict may depend on step and mode'
    >>> break_note(xr.Dataset({"object_broken": ("object", [0, 0])}))
    ''
    """
    if "break_check" in dataset.attrs:
        return str(dataset.attrs.get("break_note", ""))
    if "scenario" in dataset.dims or "break_note" not in dataset.attrs:
        broke = "object_broken" in dataset and bool((dataset["object_broken"] > 0).any())
        return BREAK_NOTE if broke else ""
    first = dataset.attrs.get("break_throw", 1)
    if "throw" in dataset.dims:
        return f"{BREAK_NOTE} (from throw {first} on)"
    return BREAK_NOTE if int(dataset.coords.get("throw", first)) >= first else ""
