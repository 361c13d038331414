"""Datasets of throws that are alike: one is made with all checks, others differ in values alone.

xarray takes longer to merge, label and check fifty small variables than a quick throw takes for its
channels. What it makes of them follows from names, dimensions, types, shapes and indexes, which are
the same for all throws of a panel, so an empty dataset of each kind is kept and copied with the
values of a throw.
"""

from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.response.coordinates import indexed
from turnout.response.signals import Variable
from turnout.schema.channels import add_labels, check_schema

if TYPE_CHECKING:
    import xarray as xr

MOST_KEPT = 8
"""Kinds of datasets in memory, the latest used; of each its time and names, no channel."""
_empty = LRUCache["xr.Dataset"](MOST_KEPT)


def labelled_dataset(
    channels: Mapping[str, Variable], coordinates: Mapping[str, Variable]
) -> "xr.Dataset":
    """Return a labelled and checked dataset.

    Parameters
    ----------
    channels : mapping of str to (dims, ndarray)
        By the names of the schema, in SI.
    coordinates : mapping of str to (dims, ndarray)
        Those named like their dimension have an index.

    Returns
    -------
    xarray.Dataset
        It shares no array with other datasets but those of indexes, which cannot be written to.

    Raises
    ------
    ResponseError
        With everything in which it departs from the schema.
    """
    import xarray as xr  # those who want bare arrays need not wait for it

    index = {name for name, (dims, _) in coordinates.items() if dims == (name,)}
    key = (
        tuple([(name, _kind(variable)) for name, variable in channels.items()]),
        tuple(
            [
                (name, _kind(variable), variable[1].tobytes() if name in index else b"")
                for name, variable in coordinates.items()
            ]
        ),
    )
    empty = _empty.get(key)
    if empty is None:
        made = check_schema(add_labels(xr.Dataset(channels, indexed(coordinates))))
        nothing = {name: _without_values(variable) for name, variable in channels.items()}
        _empty.put(key, made.copy(data=nothing))
        return made
    found = empty.copy(data={name: values for name, (_, values) in channels.items()})
    for name, (_, values) in coordinates.items():
        if name not in index:
            found.variables[name].data = values
    return found


def clear_datasets() -> None:
    """Forget all kinds of datasets."""
    _empty.clear()


def _kind(variable: Variable) -> Hashable:
    """Return dimensions, type and shape of a variable."""
    dims, values = variable
    return dims, values.dtype.str, values.shape


def _without_values(variable: Variable) -> NDArray[np.generic]:
    """Return an array of the shape of a variable that takes no memory."""
    return np.broadcast_to(np.zeros((), variable[1].dtype), variable[1].shape)
