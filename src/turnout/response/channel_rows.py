"""Rows over time that channels of a throw are made of, all written together."""

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.mechanism import Mechanism
from turnout.panel.model import Panel
from turnout.response.coordinates import stations
from turnout.response.gaps import displacements_and_gaps, gap_rows_over_time
from turnout.response.recovery import Motion, histories_of
from turnout.response.rows_over_time import rows_in_lines, write_rows
from turnout.response.save import Save
from turnout.response.signals import chair_rows, force_rows, stop_rows

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
        objects, "places" the open distances at all `turnout.response.gaps.gap_places`.
    """
    history = motion.history
    count = history.time.size
    objects, links = save.keeps(*OBJECTS), save.keeps("link_force")
    arrays, wanted = force_rows(panel, mechanism, count, objects=objects, links=links)
    if save.keeps("chair_normal_force", "chair_friction_force"):
        made, rows = chair_rows(panel, mechanism, count)
        arrays, wanted = arrays | made, wanted + rows
    if save.keeps("stop_force"):
        made, rows = stop_rows(panel, mechanism, count)
        arrays, wanted = arrays | made, wanted + rows
    if save.keeps(*SHAPES):
        x = stations(panel, mechanism, save)
        # One block of memory: the larger it is, the fewer pages it takes.
        both = rows_in_lines(len(panel.rail), 2, x.size, count)
        wanted += displacements_and_gaps(panel, motion, x, both)
        arrays |= {"gap": both[:, 1], "lateral_displacement": both[:, 0]}
    if save.keeps(*DRIVE_GAPS, *SENSOR_GAPS):
        gaps = gap_rows_over_time(panel, motion)
        wanted.append(gaps)
        arrays["places"] = gaps.out
    write_rows(wanted, histories_of(history))
    return arrays
