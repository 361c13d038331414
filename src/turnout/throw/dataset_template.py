"""Datasets of throws that are alike: one is made with all checks, others differ in values alone.

xarray takes longer to merge, label and check fifty small variables than a quick throw takes for its
channels. What it makes of them follows from names, dimensions, types, shapes and indexes, which are
the same for all throws of a panel, so an empty dataset of each kind is kept and filled with the
values of a throw.
"""

from collections.abc import Hashable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.channels import add_labels, check_schema
from turnout.core.lru_cache import LRUCache
from turnout.throw.coordinates import indexed
from turnout.throw.signals import Channel

if TYPE_CHECKING:
    import xarray as xr

_empty = LRUCache["_Kind"](8)


def labelled_dataset(
    channels: Mapping[str, Channel], coordinates: Mapping[str, Channel]
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

    index = [name for name, (dims, _) in coordinates.items() if dims == (name,)]
    key = (
        _kinds(channels),
        _kinds(coordinates),
        tuple([coordinates[name][1].tobytes() for name in index]),
    )
    kind = _empty.get(key)
    if kind is None:
        made = check_schema(add_labels(xr.Dataset(channels, indexed(coordinates))))
        nothing = {name: _without_values(variable) for name, variable in channels.items()}
        _empty.put(key, _Kind.of(made.copy(data=nothing)))
        return made
    values = {name: values for name, (_, values) in (*channels.items(), *coordinates.items())}
    for name in index:
        del values[name]
    quick = kind.parts and _fills_alike()
    return _filled(kind, values) if quick else _copied(kind.empty, values)


def clear_datasets() -> None:
    """Forget all kinds of datasets."""
    _empty.clear()


class _Kind(NamedTuple):
    """An empty dataset, and the parts of its variables: name, class, dims, data, attributes."""

    empty: "xr.Dataset"
    parts: Sequence[tuple[str, type["xr.Variable"], tuple[Hashable, ...], Any, dict[Any, Any]]]

    @classmethod
    def of(cls, empty: "xr.Dataset") -> "_Kind":
        """Read the variables of an empty dataset, in their order."""
        if not _fills_alike():
            return cls(empty, ())
        return cls(empty, _parts(empty))


def _parts(empty: "xr.Dataset") -> list[tuple[str, Any, Any, Any, dict[Any, Any]]]:
    return [
        (str(name), type(like), like._dims, like._data, dict(like.attrs))
        for name, like in empty._variables.items()
    ]


def _filled(kind: _Kind, values: Mapping[str, NDArray[np.generic]]) -> "xr.Dataset":
    """Return the dataset of `_copied` in a fraction of its time: variables are not checked again.

    Only indexes are shared, which cannot be changed. `_fills_alike` knows whether the installed
    xarray is made of these parts.
    """
    variables: dict[Hashable, xr.Variable] = {}
    for name, variable, dims, data, attributes in kind.parts:
        made = variables[name] = object.__new__(variable)
        made._dims, made._encoding = dims, None
        made._data = values.get(name, data)
        made._attrs = attributes.copy()
    empty = kind.empty
    return empty._construct_direct(
        variables,
        set(empty._coord_names),
        dims=dict(empty._dims),
        attrs=dict(empty.attrs),
        indexes=dict(empty._indexes),
    )


def _copied(empty: "xr.Dataset", values: Mapping[str, NDArray[np.generic]]) -> "xr.Dataset":
    """Return a dataset with other values in the way that xarray offers."""
    found = empty.copy(data={name: values[str(name)] for name in empty.data_vars})
    for name in values.keys() - set(empty.data_vars):
        found.variables[name].data = values[name]
    return found


@cache
def _fills_alike() -> bool:
    """Return True if `_filled` makes the dataset of `_copied` with the installed xarray."""
    import xarray as xr

    numbers = np.arange(2.0)
    own = xr.Coordinates({"x": ("x", numbers), "y": ("x", numbers, {"units": "m"})})
    empty = xr.Dataset({"f": ("x", np.zeros(2), {"units": "N"})}, own, {"kind": "trial"})
    values = {"f": numbers, "y": numbers + 1.0}
    try:
        found, copied = _filled(_Kind(empty, _parts(empty)), values), _copied(empty, values)
        alike = found.identical(copied) and set(found.xindexes) == set(copied.xindexes)
        return alike and found.sizes == copied.sizes and found["f"].encoding == {}
    except Exception:  # noqa: BLE001 - whatever another xarray makes of it
        return False


def _kinds(variables: Mapping[str, Channel]) -> Hashable:
    """Return names, dimensions, types and shapes of variables."""
    return tuple(
        [(name, dims, values.dtype, values.shape) for name, (dims, values) in variables.items()]
    )


def _without_values(variable: Channel) -> NDArray[np.generic]:
    """Return an array of the shape of a variable that takes no memory."""
    return np.broadcast_to(np.zeros((), variable[1].dtype), variable[1].shape)
