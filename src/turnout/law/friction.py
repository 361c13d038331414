"""The friction law of a foot: limit, trial force, stick or slip, work, and its course.

Elastic-plastic Coulomb friction: a spring between the foot and its anchor holds up to the limit, a
share of the force of the normal law; beyond, the anchor follows. All that depends on the law is
here: the solver asks for forces, limits and their rise, and for what violates or leaves a branch.
Branches of frictions are float64 numbers; `friction_limit` and `trial_force` take single numbers
and lanes alike. The coefficient may differ along the stroke: snow, ice, or wear on a part of a
chair.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple, TypeVar

import numpy as np

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    Bools,
    absolute,
    any_true,
    broadcast,
    gather,
    greater,
    greater_or_nan,
    horizontal_sum,
    load,
    logical_or,
    select,
    store,
)
from turnout.law.friction_state import FASTEST, FrictionCurve
from turnout.law.kernel import share_until_zero
from turnout.law.table import Floats, Ints

Numbers = TypeVar("Numbers", float, Floats)
STICK = 0
SLIP_FORWARD = 1
SLIP_BACKWARD = -1
RISING_SPAN = 0.1
"""Speed up to which the range of a rising curve counts [m/s]."""


@compiled_part
def friction_limit(coefficient: Numbers, normal: Numbers) -> Numbers:
    """Return the force at which a foot slips, from that of its normal law [N]."""
    return coefficient * normal


@compiled_part
def limit_line(coefficient: float, slope: float, constant: float) -> tuple[float, float]:
    """Return slope [N/m] and constant [N] of the limit, from those of the normal law."""
    return coefficient * slope, coefficient * constant


@compiled_part
def trial_force(stiffness: Numbers, displacement: Numbers, anchor: Numbers) -> Numbers:
    """Return the force of the spring between a foot and its anchor while that stays [N]."""
    return stiffness * (displacement - anchor)


@compiled
def friction_state(trial: float, limit: float, present: float, tolerance: float) -> float:
    """Return stick or slip for an elastic trial force; the `present` state is kept if it holds.

    Parameters
    ----------
    trial : float
        ``stick_stiffness * (displacement - anchor)`` with the anchor of the last instant [N].
    limit : float
        ``friction_coefficient * normal force``, not negative [N].
    present : float
        STICK, SLIP_FORWARD or SLIP_BACKWARD.
    tolerance : float
        Largest violation of the present state that is accepted [N].
    """
    if present == STICK:
        if abs(trial) <= limit + tolerance:
            return STICK
    elif limit <= 0.0 or present * trial >= limit - tolerance:
        return present
    if abs(trial) <= limit:
        return STICK
    return SLIP_FORWARD if trial > 0.0 else SLIP_BACKWARD


@compiled_loop
def branch_violated(trial: Floats, limit: Floats, branch: Floats, tolerance: Floats) -> Bools:
    """Return which of eight frictions violate their branches.

    Stick is violated by a trial force above the limit, slip by one below.
    """
    zero = broadcast(0.0)
    slips, closed = greater(absolute(branch), zero), greater(limit, zero)
    positive_limit = select(closed, limit, zero)
    lowest = select(closed, positive_limit - tolerance, broadcast(-np.inf))
    larger = select(slips, lowest, absolute(trial))
    return greater_or_nan(larger, select(slips, branch * trial, positive_limit + tolerance))


@compiled_loop
def trials_and_limits(
    of_normals: tuple[Floats, Ints, Floats],
    g: Floats,
    row: Ints,
    springs: tuple[Floats, Floats],
    beyond: Floats,
    branches: Floats,
    tolerance: float,
    trials: Floats,
    limits: Floats,
) -> bool:
    """Write trial forces and limits [N]; return whether any branch is violated by `tolerance` [N].

    `of_normals` are the forces of laws, the normal law and the coefficient of each friction,
    `springs` the anchors and stiffnesses, `beyond` the forces by which limits lie above those of a
    constant coefficient.
    """
    force, normal, coefficient = of_normals
    anchor, stiffness = springs
    zero, tolerance_8 = broadcast(0.0), broadcast(tolerance)
    violated = greater(zero, zero)
    for i in range(0, trials.size, LANES):
        limit = friction_limit(load(coefficient, i), gather(force, normal, i))
        limit = limit + load(beyond, i)
        trial = trial_force(load(stiffness, i), gather(g, row, i), load(anchor, i))
        store(limit, limits, i)
        store(trial, trials, i)
        branch = load(branches, i)
        violated = logical_or(violated, branch_violated(trial, limit, branch, tolerance_8))
    return any_true(violated)


@compiled_loop
def slip_anchors(
    branches: Floats,
    trials: Floats,
    limits: Floats,
    flexibility: Floats,
    forces: Floats,
    anchor: Floats,
) -> tuple[float, float]:
    """Move the anchors of slipping feet so that force and spring agree; return two works [J].

    The first is the mean force times the slip, which is dissipated; the second is what the force at
    the start does along the slip of a foot that reversed within the step.
    """
    zero, half = broadcast(0.0), broadcast(0.5)
    dissipated, reversed_work = zero, zero
    for i in range(0, trials.size, LANES):
        branch, force_n, trial = load(branches, i), load(forces, i), load(trials, i)
        force = select(greater(absolute(branch), zero), branch * load(limits, i), trial)
        slip = (trial - force) * load(flexibility, i)
        opposing = select(greater(zero, force_n * slip), force, force_n)
        dissipated = dissipated + half * (force + opposing) * slip
        reversed_work = reversed_work + half * (force_n - opposing) * slip
        store(force, forces, i)
        store(load(anchor, i) + slip, anchor, i)
    return horizontal_sum(dissipated), horizontal_sum(reversed_work)


@compiled
def branch_event(
    branch: int, trials: tuple[float, float], limits: tuple[float, float], force: float
) -> tuple[float, int]:
    """Return share of a path at which a friction leaves its branch, 2 for never, and the next one.

    Parameters
    ----------
    branch : int
        Present one.
    trials, limits : tuple of float
        Trial forces and limits at both ends of the path [N].
    force : float
        Largest violation that is accepted [N].
    """
    trial, trial_end = trials
    limit, limit_end = limits
    if branch == STICK:
        for side in (SLIP_FORWARD, SLIP_BACKWARD):
            margin, margin_end = limit - side * trial, limit_end - side * trial_end
            if margin_end < -force:
                return share_until_zero(margin, margin_end), side
        return 2.0, branch
    if limit <= 0.0 and limit_end <= 0.0:
        return 2.0, branch
    margin, margin_end = branch * trial - limit, branch * trial_end - limit_end
    if margin_end < -force:
        return share_until_zero(margin, margin_end), STICK
    return 2.0, branch


@compiled_loop
def forces_beyond_level(
    of_normals: tuple[Floats, Ints, Floats],
    curves: tuple[Floats, Floats, Floats],
    speeds: tuple[Floats, Ints],
    branches: Floats,
    step: float,
    present: Floats,
    shifts: Floats,
) -> bool:
    r"""Move how far limits lie above ``coefficient * normal``; return whether a sliding one moved.

    .. math:: B = \mu_k N\left(\frac{\mu_s/\mu_k - 1}{1 + (v/v_s)^2} + c\,v\right)

    A foot that sticks moves with its spring alone. Sliding ones keep their `present` value until it
    is off by more than `step` of the range of the curve.

    Parameters
    ----------
    of_normals : tuple of ndarray
        Forces of laws [N], normal law and level of each friction.
    curves : tuple of ndarray
        Excess ``mu_s / mu_k - 1`` [-], ``1 / v_s**2`` [s2/m2] and rise c [s/m] of each friction.
    speeds : tuple of ndarray
        Speeds of feet [m/s], and which of them is that of each friction.
    branches : ndarray
        Stick or slip.
    step : float
        Share of the range of a curve [-].
    present : ndarray
        Values B, changed in place [N].
    shifts : ndarray
        Receives what this adds to the force on each sliding foot [N].

    Notes
    -----
    Falling part: Hess and Soom, Journal of Tribology 112(1), 1990, 147-152.
    """
    force, normal, coefficient = of_normals
    excess, fall, rise = curves
    speed, speed_of = speeds
    zero, one = broadcast(0.0), broadcast(1.0)
    fastest, share, span = broadcast(FASTEST), broadcast(step), broadcast(RISING_SPAN)
    moved = greater(zero, zero)
    for i in range(0, shifts.size, LANES):
        branch, kept = load(branches, i), load(present, i)
        v = absolute(gather(speed, speed_of, i))
        v = select(greater(v, fastest), fastest, v)
        of_normal = gather(force, normal, i)
        level = load(coefficient, i) * select(greater(of_normal, zero), of_normal, zero)
        more, rises = load(excess, i), load(rise, i)
        wanted = level * (more / (one + load(fall, i) * v * v) + rises * v)
        differs = greater(absolute(wanted - kept), share * level * (more + rises * span))
        slides = greater(absolute(branch), zero)
        new = select(slides, select(differs, wanted, kept), wanted)
        shift = branch * (kept - new)
        moved = logical_or(moved, greater(absolute(shift), zero))
        store(new, present, i)
        store(shift, shifts, i)
    return any_true(moved)


class FrictionCourses(NamedTuple):
    """Friction coefficients over the opening of a rail, and over the speed of a foot.

    Both change between steps. Level and curve are constant between two openings of a course.

    Attributes
    ----------
    friction : ndarray of int, shape (n,)
        Friction of each course.
    coefficient : ndarray, shape (n,)
        Coefficient that its factors multiply [-].
    closed, side : ndarray, shape (n,)
        The opening is ``closed - side g`` with the displacement of the friction's row [m].
    start : ndarray of int, shape (n + 1,)
        First place of each course.
    opening, factor : ndarray, shape (m,)
        Openings from which on a factor holds, rising in each course [m], and the factors [-].
    excess_from, fall_from, rise_from : ndarray, shape (m,)
        Curves from there on.
    at : ndarray of int, shape (n,)
        Present place in each course, -1 before the first step.
    excess, fall, rise : ndarray, shape (n_frictions,)
        Present curve of each friction, see `forces_beyond_level`; of no length without curves.
    speed_of : ndarray of int, shape (n_frictions,)
        Which speed is that of each friction.
    feet : ndarray of int, shape (n_blocks,)
        Number of feet of each block.
    modes : ndarray, shape (n_modes + 1, width)
        Modes at the feet of their block; the last row is zero.
    speed : ndarray, shape (n_blocks * width,)
        Scratch array: speeds of the feet, block by block [m/s].
    """

    friction: Ints
    coefficient: Floats
    closed: Floats
    side: Floats
    start: Ints
    opening: Floats
    factor: Floats
    excess_from: Floats
    fall_from: Floats
    rise_from: Floats
    at: Ints
    excess: Floats
    fall: Floats
    rise: Floats
    speed_of: Ints
    feet: Ints
    modes: Floats
    speed: Floats

    @property
    def has_curves(self) -> bool:
        """True if some coefficient depends on speed."""
        return self.excess.size > 0

    def over_speed(self, speed: Floats) -> tuple[Floats, Floats]:
        """Return coefficients over those in motion [-], and their slopes over speed [s/m].

        Parameters
        ----------
        speed : ndarray, shape (n_frictions,)
            Of feet, at least 0 [m/s].
        """
        v = np.minimum(speed, FASTEST)
        share = 1.0 / (1.0 + self.fall * v**2)
        slope = self.rise - 2.0 * self.excess * self.fall * v * share**2
        return 1.0 + self.excess * share + self.rise * v, np.where(speed < FASTEST, slope, 0.0)

    def without_curves(self) -> "FrictionCourses":
        """Return the courses with the levels in motion alone."""
        nothing = np.zeros(0)
        return self._replace(excess=nothing, fall=nothing, rise=nothing)


@cache
def no_courses() -> FrictionCourses:
    """Return no course and no curve at all; all that have none share it."""
    nothing, numbers = np.zeros(0), np.zeros(0, dtype=np.int64)
    return FrictionCourses(
        friction=numbers,
        coefficient=nothing,
        closed=nothing,
        side=nothing,
        start=np.zeros(1, dtype=np.int64),
        opening=nothing,
        factor=nothing,
        excess_from=nothing,
        fall_from=nothing,
        rise_from=nothing,
        at=numbers,
        excess=nothing,
        fall=nothing,
        rise=nothing,
        speed_of=numbers.astype(np.uint64),
        feet=numbers,
        modes=np.zeros((0, 0)),
        speed=nothing,
    )


def curve_arrays(curves: Sequence[FrictionCurve]) -> tuple[Floats, Floats, Floats]:
    """Return excess [-], fall [s2/m2] and rise [s/m] of some curves."""
    rows = [(item.static_ratio - 1.0, item.stribeck_speed**-2, item.rise) for item in curves]
    excess, fall, rise = np.array(rows, dtype=float).reshape(-1, 3).T.copy()
    return excess, fall, rise
