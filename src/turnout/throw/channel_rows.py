"""Rows over time that channels of a throw are made of, all written together."""

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.mechanism import Mechanism
from turnout.panel.model import Panel
from turnout.throw.coordinates import stations
from turnout.throw.gaps import place_block, shape_block
from turnout.throw.recipes import RowBlock, merge_blocks
from turnout.throw.recovery import Motion, histories_of, row_blocks_of
from turnout.throw.rows_over_time import Rows, write_rows
from turnout.throw.save import Save
from turnout.throw.signals import chair_block, force_block, stop_block

Floats = NDArray[np.float64]

OBJECTS = ("object_force", "single_object_force")
SHAPES = ("gap", "lateral_displacement")
DRIVE_GAPS = ("drive_gap", "end_gap", "locked")
SENSOR_GAPS = ("sensor_gap", "in_control")
FLANGEWAYS = ("least_flangeway", "least_flangeway_x", "least_flangeway_rail")


def channel_rows(
    panel: Panel, mechanism: Mechanism, motion: Motion, save: Save
) -> dict[str, Floats]:
    """Return the rows over time that channels are made of, written together.

    Parameters
    ----------
    panel, mechanism, motion
        What was thrown, and how it moved.
    save : Save
        What is kept.

    Returns
    -------
    dict of str to ndarray
        By the name of a channel, the last axis time; "object" are the forces of all laws of
        objects, "places" the open distances at all `turnout.throw.gaps.gap_places`.
    """
    index, history = mechanism.index, motion.history
    x = stations(panel, mechanism, save) if save.keeps(*SHAPES) else None
    wanted = (
        *(save.keeps(*OBJECTS), save.keeps("link_force")),
        bool(panel.chair) and save.keeps("chair_normal_force", "chair_friction_force"),
        bool(panel.stop or panel.stud) and save.keeps("stop_force"),
        save.keeps(*DRIVE_GAPS, *SENSOR_GAPS),
    )

    def blocks() -> list[RowBlock]:
        objects, links, chairs, stops, gaps = wanted
        few = [force_block(panel, mechanism, objects=objects, links=links)]
        few += [place_block(panel, motion)] if gaps else []
        many = [chair_block(panel, mechanism)] if chairs else []
        many += [stop_block(panel, mechanism)] if stops else []
        many += [] if x is None else [shape_block(panel, motion, x)]
        return [merge_blocks(found) for found in (few, many) if found]

    named = (
        *(panel.rail, panel.stock_rail, panel.chair, panel.stop, panel.stud, panel.drive),
        *(panel.link, panel.sensor, panel.object_defaults, index.drive, index.object, index.link),
        *(index.chair, index.chair_friction, index.stop),
    )
    values = (*wanted, panel.instrumented_rail, None if x is None else x.tobytes())
    arrays, rows = dict[str, Floats](), list[Rows]()
    for block in row_blocks_of(motion, named, values, blocks):
        made, own = block.lay_out(history.time.size)
        arrays |= made
        rows += own
    write_rows(rows, histories_of(history))
    return arrays
