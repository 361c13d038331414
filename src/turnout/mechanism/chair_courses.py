"""Friction of chairs along the stroke."""

import numpy as np

from turnout.core.errors import MechanicsError
from turnout.law.friction_course import FrictionCourses, no_courses
from turnout.mechanism.build_rails import SIGN
from turnout.mechanism.mechanism import LawIndex
from turnout.mechanism.travel import Travel
from turnout.panel.model import Panel
from turnout.panel.pending_members import all_lack


def friction_courses(panel: Panel, index: LawIndex, travel: Travel) -> FrictionCourses:
    """Return the courses of all frictions on chairs that have one.

    The opening counts from the closed position of the rail at the chair: a rail that is stress-free
    at a share of its way has come from there by this share.

    Parameters
    ----------
    panel : Panel
        With the courses of its chairs.
    index : LawIndex
        Frictions by rail and chair.
    travel : Travel
        Ways of the rails from closed to open.
    """
    if all_lack(panel, "chair", "friction_factor"):
        return no_courses()
    rows: list[tuple[int, float, float, float]] = []
    courses: list[tuple[tuple[float, ...], list[float]]] = []
    for (rail, name), frictions in index.chair_friction.items():
        chair, shape = panel.chair[name], travel.shapes.get(rail)
        if chair.friction_factor is None or chair.friction_opening is None or shape is None:
            continue
        way = float(shape.travel_at(np.array([chair.x]))[0])
        if not np.isfinite(way):
            message = (
                f"chair.{name}.friction_opening: how far rail {rail} moves there is not known; "
                "give the rail fit_gap in place of stock_rail_gap"
            )
            raise MechanicsError(message)
        closed, side = panel.rail[rail].fraction * way, SIGN[panel.rail[rail].closes]
        for friction in frictions:
            rows.append((friction, chair.friction_coefficient, closed, side))
            courses.append((tuple(chair.friction_opening), chair.friction_factor))
    if not rows:
        return no_courses()
    columns = np.array(rows, dtype=float).T
    counts = [len(opening) for opening, _ in courses]
    return FrictionCourses(
        friction=columns[0].astype(np.int64),
        coefficient=columns[1].copy(),
        closed=columns[2].copy(),
        side=columns[3].copy(),
        start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        opening=np.concatenate([opening for opening, _ in courses]).astype(float),
        factor=np.concatenate([factor for _, factor in courses]).astype(float),
        at=np.full(len(rows), -1, dtype=np.int64),
    )
