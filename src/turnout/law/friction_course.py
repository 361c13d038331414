"""Friction that differs along the stroke: snow, ice or wear on a part of a chair."""

from typing import NamedTuple

import numpy as np

from turnout.law.table import Floats, Ints


class FrictionCourses(NamedTuple):
    """Courses of friction coefficients over the opening of a rail, one row for each friction.

    The coefficient is constant between two openings of a course. It changes between steps.

    Attributes
    ----------
    friction : ndarray of int, shape (n,)
        Friction of each.
    coefficient : ndarray, shape (n,)
        What its factors multiply [-].
    closed, side : ndarray, shape (n,)
        The opening is ``closed - side g`` with the displacement of the friction's row [m].
    start : ndarray of int, shape (n + 1,)
        Where the course of each begins.
    opening, factor : ndarray, shape (m,)
        Openings from which on a factor holds, rising in each course [m], and the factors [-].
    at : ndarray of int, shape (n,)
        Where each course is at present, -1 before the first step.
    """

    friction: Ints
    coefficient: Floats
    closed: Floats
    side: Floats
    start: Ints
    opening: Floats
    factor: Floats
    at: Ints


def no_courses() -> FrictionCourses:
    """Return no course at all."""
    nothing, numbers = np.zeros(0), np.zeros(0, dtype=np.int64)
    return FrictionCourses(
        friction=numbers,
        coefficient=nothing,
        closed=nothing,
        side=nothing,
        start=np.zeros(1, dtype=np.int64),
        opening=nothing,
        factor=nothing,
        at=numbers.copy(),
    )
