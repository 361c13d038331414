"""Foreign objects at nodes whose displacements are coordinates of the rails.

Such an object changes no rail: those that are built with it have the same matrices to the last bit,
and its row follows from the shapes that are there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.build_rails import approach_ends
from turnout.mechanism.mechanism import RailBody, RailData
from turnout.mechanism.reduce import superelement_of
from turnout.mechanism.structure import form_rows
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.model import Panel

Floats = NDArray[np.float64]


def node_rows(
    panel: Panel,
    objects: Sequence[PlacedObject],
    rails: Sequence[RailData],
    bodies: Sequence[RailBody],
) -> list[Floats] | None:
    """Return the rows of a switch rail's approach to its stock rail where objects stand.

    Parameters
    ----------
    panel : Panel
        The panel.
    objects : sequence of PlacedObject
        The objects.
    rails : sequence of RailData
        All rails without them.
    bodies : sequence of RailBody
        The same, reduced.

    Returns
    -------
    list of ndarray, shape (n_coordinates,)
        None if a rail needs a node or coordinates that it does not have.
    """
    by_name = {body.name: (data, body) for data, body in zip(rails, bodies, strict=True)}
    rows = []
    for item in objects:
        row = np.zeros(sum(body.count for body in bodies))
        for name, point in approach_ends(panel, item.rail, x=item.x, height=item.height):
            data, body = by_name[name]
            if data.matrices is None and np.round(point.x, 9) not in data.x:
                return None
            structure, element, _ = superelement_of(data)
            own = form_rows(structure, (point,), name=name)
            if not np.isin(own.indices[own.data != 0.0], element.interface).all():
                return None
            row[body.first : body.first + body.count] += (own @ element.transformation)[0]
        rows.append(row)
    return rows
