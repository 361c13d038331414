"""Rows of a rail in the block of the condensed system that holds it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.mechanism.mechanism import RailBody
from turnout.solver.condense import BlockModel

Floats = NDArray[np.float64]

MOST_PRODUCTS = 256
"""Products of rows with blocks in memory, the latest used."""
MOST_PLACES = 512
"""Rails whose places in their blocks are kept in memory, the latest used; four of each set of
condensed rails, of which throws keep as many for what is watched of them."""

# Blocks are shared by many throws; they are named by identity and kept beside.
_places = LRUCache[tuple[tuple[int, int], object]](MOST_PLACES)


def block_of(blocks: Sequence[BlockModel], body: RailBody) -> tuple[int, int]:
    """Return the number of the block of a rail, and where in it its coordinates begin."""
    key = (id(blocks), body.first)
    kept = _places.get(key)
    if kept is not None:
        return kept[0]
    found = _find_block(blocks, body)
    if isinstance(blocks, tuple):  # else not there to stay
        _places.put(key, (found, blocks))
    return found


def _find_block(blocks: Sequence[BlockModel], body: RailBody) -> tuple[int, int]:
    for number, part in enumerate(blocks):
        first = int(np.searchsorted(part.block.coordinates, body.first))
        if first < part.block.coordinates.size and part.block.coordinates[first] == body.first:
            return number, first
    message = f"rail {body.name} is in no block"
    raise KeyError(message)


# Blocks and rows are shared by many throws; both are named by identity and kept beside.
_products = LRUCache[tuple[tuple[Floats, Floats, Floats], object]](MOST_PRODUCTS)


def in_block(part: BlockModel, rows: Floats, own: slice) -> tuple[Floats, Floats, Floats]:
    """Return what `multiply_by_block` does, made once for rows that throws share."""
    key = (id(part), id(rows), own.start)
    found = _products.get(key)
    if found is not None:
        return found[0]
    made = multiply_by_block(part, rows, own)
    if not rows.flags.writeable:
        _products.put(key, (made, (part, rows)))
    return made


def multiply_by_block(part: BlockModel, rows: Floats, own: slice) -> tuple[Floats, Floats, Floats]:
    """Return what rows of a rail come to for the modes, row forces and load of its block.

    Parameters
    ----------
    part : BlockModel
        The block.
    rows : ndarray, shape (n, n_coordinates)
        Over the coordinates of the rail.
    own : slice
        These among the coordinates of the block.

    Returns
    -------
    tuple of ndarray, shapes (n, n_modes), (n, n_rows), (n,)
    """
    model = part.model
    return (
        rows @ model.modes[own],
        rows @ model.residual_shapes[own],
        rows @ model.residual_load[own],
    )
