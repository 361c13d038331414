"""Simulations about a point: there, and one step aside for each parameter; steps of a fit."""

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import hadamard
from scipy.optimize import lsq_linear

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.stages import (
    JOINT_MOVEMENTS,
    Parameter,
    coordinates,
    is_of_object,
    prior_information,
    prior_residuals,
    prior_slopes,
)
from turnout.core.errors import SolverError

T = TypeVar("T")
Floats = NDArray[np.float64]
Plane = tuple[Response, dict[str, Response]]
Thrown = list[tuple[Mapping[str, float], Response]]
"""Values of a movement of its own, and the response to them."""
Differences = Mapping[str, tuple[Response, Response, float]]
"""By parameter the response aside, the one before, and how far this is [reaches]."""
# Far enough for the noise of the solver, near enough for a straight line [coordinate]: of quick
# throws and of parameters with priors, and of those near the end, where slips begin nearby.
DIFFERENCE, FINE_DIFFERENCE = 0.01, 0.003
# Within this, steps aside are not simulated again [coordinate]: of fits that only lead near, and of
# those whose small rest, without nuisances, has to point the right way.
SAME_ROUGH_SLOPE, SAME_SLOPE = 0.04, 0.01
# Of objects: forces are straight lines over half of what is stated of them, and less of a step is
# lost in the noise of the solver [coordinate].
OBJECT_DIFFERENCE = 0.05
# Slopes with thickness and place of an object change so much less over a coordinate [-].
SLOWER = 0.2
# Throws for a plane are at least so far to all sides [coordinate], which is what instants of slips
# change over, and otherwise so many deviations of the values, so many reaches at most.
REACH, WIDE, WIDEST = 1e-3, 3.0, 60.0
# Pairs of throws on opposite sides for the first plane, more where slopes of as many parameters are
# not known; those of one near by; throws within so many reaches make a plane together.
FIRST_PAIRS, MORE_PAIRS, NEAR_REACHES = 8, 2, 3.0
# The share of a difference that bounds must leave room for [-].
LEAST_ROOM = 0.5
# Longest step, a factor of 1.6 [coordinate].
MAX_STEP = 0.5
# A drive that stays this far below its slip level does not feel it [-].
UNTOUCHED = 0.98


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearisation:
    """Responses at a point and one step aside for each parameter.

    Attributes
    ----------
    values : mapping of str to float
        Common values of the parameters at the point, in SI.
    simulated : tuple of Response
        To each movement.
    origin : tuple of Response
        Where the steps aside were taken, as they were: here, or near by.
    stepped : mapping of str to tuple of Response
        Responses one step away, by name of the parameter, one for each movement.
    steps : mapping of str to tuple of float
        How far aside for each movement, in the coordinate.
    shares : mapping of str to tuple of float
        How far aside, as a share of the common value; not of a value of zero.
    about : tuple of mapping of str to float
        Values of each movement where its steps aside were taken.
    quick : bool
        Whether the steps aside were thrown quickly.
    """

    values: Mapping[str, float]
    simulated: tuple[Response, ...]
    origin: tuple[Response, ...]
    stepped: Mapping[str, tuple[Response, ...]]
    steps: Mapping[str, tuple[float, ...]]
    shares: Mapping[str, tuple[float, ...]]
    about: tuple[Mapping[str, float], ...]
    quick: bool

    def moved(self, values: Mapping[str, float], step: Mapping[str, float]) -> "Linearisation":
        """Return this with the responses that slopes predict a step away, without any throw.

        Parameters
        ----------
        values : mapping of str to float
            Common values there.
        step : mapping of str to float
            How far each parameter goes, in its coordinate.
        """
        simulated = tuple(
            _along(response, self._changes(number, step))
            for number, response in enumerate(self.simulated)
        )
        return replace(self, values=values, simulated=simulated)

    def each_moved(self, steps: Sequence[Mapping[str, float]]) -> "Linearisation":
        """Return this with each response as slopes predict it a step of its own away."""
        pairs = zip(self.simulated, steps, strict=True)
        simulated = tuple(
            _along(response, self._changes(number, step)) if any(step.values()) else response
            for number, (response, step) in enumerate(pairs)
        )
        return replace(self, simulated=simulated)

    def apart(
        self, one: Mapping[str, float], other: Mapping[str, float], parameters: Sequence[Parameter]
    ) -> float:
        """Return how far values are apart in what has slopes [coordinate]."""
        shifts = [
            abs(p.coordinate(one[p.name]) - p.coordinate(other[p.name]))
            * (SLOWER if is_of_object(p) else 1.0)
            for p in parameters
            if p.name in self.stepped
        ]
        return max(shifts, default=0.0)

    def _changes(
        self, number: int, way: Mapping[str, float]
    ) -> list[tuple[Response, Response, float]]:
        """Return what slopes predict over a distance, as shares of differences of responses."""
        before = self.origin[number]
        return [
            (self.stepped[name][number], before, size / self.steps[name][number])
            for name, size in way.items()
            if self.stepped[name][number] is not before
        ]

    def differences(self, number: int, parameters: Sequence[Parameter]) -> Differences:
        """Return the known slopes of a movement with some parameters."""
        before = self.origin[number]
        return {
            p.name: (aside, before, self.steps[p.name][number] / REACH)
            for p in parameters
            for aside in [self.stepped[p.name][number] if p.name in self.stepped else before]
            if aside is not before
        }

    def with_movements(self, numbers: Sequence[int], other: "Linearisation") -> "Linearisation":
        """Return this with some movements of another one, in the order of the numbers."""
        place = {number: n for n, number in enumerate(numbers)}

        def joined(mine: tuple[T, ...], others: tuple[T, ...]) -> tuple[T, ...]:
            return tuple(others[place[n]] if n in place else item for n, item in enumerate(mine))

        def by_name(
            mine: Mapping[str, tuple[T, ...]], others: Mapping[str, tuple[T, ...]]
        ) -> dict[str, tuple[T, ...]]:
            return {name: joined(row, others[name]) for name, row in mine.items() if name in others}

        return replace(
            self,
            simulated=joined(self.simulated, other.simulated),
            origin=joined(self.origin, other.origin),
            stepped=by_name(self.stepped, other.stepped),
            steps=by_name(self.steps, other.steps),
            shares=by_name(self.shares, other.shares),
            about=joined(self.about, other.about),
        )


def _along(base: Response, changes: Sequence[tuple[Response, Response, float]]) -> Response:
    """Return a response with shares of the differences of others, which are on the same times."""
    return replace(
        base,
        drive_force={
            name: row
            + sum(
                size * (after.drive_force[name] - was.drive_force[name])
                for after, was, size in changes
            )
            for name, row in base.drive_force.items()
        },
        object_force=base.object_force
        + sum(size * (after.object_force - was.object_force) for after, was, size in changes),
    )


def apart_in_reaches(
    one: Mapping[str, float], other: Mapping[str, float], parameters: Sequence[Parameter]
) -> Floats:
    """Return how far values are from others, in reaches of each parameter, shape (p,)."""
    return np.array(
        [(p.coordinate(one[p.name]) - p.coordinate(other[p.name])) / REACH for p in parameters],
        dtype=np.float64,
    )


def reaches_of(parameters: Sequence[Parameter], J: Floats, scattering: Container[str]) -> Floats:
    r"""Return how far to all sides values are thrown for a plane, shape (p, p), in reaches.

    .. math:: R = V \max(1, \min(3 s, 60)) V^T, \quad V (\rho s)^2 V^T = (J^T J + P)^{-1}

    Over less, a slope in a direction that is hardly known would be that of what is rough, which
    looks like information; over more, responses are no planes. The reach :math:`\rho` is `REACH`. A
    parameter that scatters goes `FINE_DIFFERENCE`: each movement shows its own well, however little
    is known of their mean.

    Parameters
    ----------
    parameters : sequence of Parameter
        The p that differ.
    J : ndarray, shape (n, p)
        Of whitened residuals with each coordinate.
    scattering : container of str
        Names of the parameters of which each movement has a value of its own.
    """
    covariance = np.linalg.inv(J.T @ J + np.diag(prior_information(parameters)))
    alike = np.array([item.name not in scattering for item in parameters])
    shared = np.where(np.outer(alike, alike), covariance, 0.0)
    squares, V = np.linalg.eigh(shared / REACH**2)
    far = np.clip(WIDE * np.sqrt(np.maximum(squares, 0.0)), 1.0, WIDEST)
    own = np.where(alike, 0.0, FINE_DIFFERENCE / REACH - 1.0)
    return np.asarray(V * far @ V.T + np.diag(own))


def pairs_wanted(parameters: int, planes: int, *, near: int, known: bool) -> int:
    """Return the pairs of throws that a plane takes, beside those that are near by.

    What is rough differs from movement to movement: more than `JOINT_MOVEMENTS` average it with
    half of the throws each.

    Parameters
    ----------
    parameters, planes : int
        How many differ in a throw, and how many movements have a plane of their own.
    near : int
        Pairs that are near by already.
    known : bool
        Whether slopes are known: then the first plane wants no pairs for all of them.

    Examples
    --------
    >>> [pairs_wanted(16, planes, near=0, known=True) for planes in (14, 77)]
    [8, 4]
    >>> pairs_wanted(16, 14, near=0, known=False), pairs_wanted(16, 14, near=8, known=True)
    (16, 2)
    """
    if near:
        return MORE_PAIRS
    if not known:
        return len(orthogonal_signs(parameters))
    return FIRST_PAIRS if planes <= JOINT_MOVEMENTS else FIRST_PAIRS // 2


def points_about(
    values: Mapping[str, float],
    parameters: Sequence[Parameter],
    reaches: Floats,
    pairs: Iterable[int],
) -> list[dict[str, float]]:
    """Return values on both sides of others, at several distances, in which all parameters differ.

    What is rough over a part of the distance then differs from throw to throw.

    Parameters
    ----------
    values : mapping of str to float
        In the middle.
    parameters : sequence of Parameter
        The p that differ.
    reaches : ndarray, shape (p, p)
        Of `reaches_of`.
    pairs : iterable of int
        Numbers of pairs, taken in turn.
    """
    count = len(parameters)
    half = orthogonal_signs(count)
    far = 0.5 + (np.arange(len(half)) + 0.5) / len(half)
    rows = (half[:, :count] * far[:, None])[np.array([*pairs]) % len(half)] @ reaches
    return [
        {
            **values,
            **{
                p.name: p.value(p.coordinate(values[p.name]) + float(side) * REACH)
                for p, side in zip(parameters, row, strict=True)
            },
        }
        for row in np.vstack([rows, -rows])
    ]


def plane_of(
    steps: Floats, names: Sequence[str], responses: Sequence[Response], known: Differences
) -> Plane:
    """Return the plane nearest to responses: in the middle, and one reach aside by name.

    A known slope counts as the two throws that it is from, whose level does not count: over
    some reaches it is surer than what a few throws about the middle say of it, and a slope of what
    is rough would count as information. A plane of many parameters then wants no throws for all its
    slopes at once.

    Parameters
    ----------
    steps : ndarray, shape (n, p)
        How far from the middle each was thrown, in reaches.
    names : sequence of str
        Of the p parameters.
    responses : sequence of Response
        On the same times.
    known : mapping of str to (Response, Response, float)
        Of some of the parameters: aside, before that, and how far this is [reaches].
    """
    own = [(names.index(name), *item) for name, item in known.items()]
    rows = np.zeros((len(steps) + len(own), 1 + len(names)))
    rows[: len(steps)] = np.column_stack([np.ones(len(steps)), steps])
    # The difference of two throws has twice the variance of one.
    for row, (number, *_, far) in zip(rows[len(steps) :], own, strict=True):
        row[1 + number] = far * 0.5**0.5
    weights = np.linalg.pinv(rows)
    of_known = weights[:, len(steps) :] * 0.5**0.5
    weights = np.hstack([weights[:, : len(steps)], of_known, -of_known])
    thrown = [*responses, *(item[1] for item in own), *(item[2] for item in own)]
    return combined(thrown, weights[0]), {
        name: combined(thrown, weights[0] + row)
        for name, row in zip(names, weights[1:], strict=True)
    }


def combined(responses: Sequence[Response], weights: NDArray[np.float64]) -> Response:
    """Return a weighted sum of responses, which are on the same times."""
    return replace(
        responses[0],
        drive_force={
            name: weights @ np.stack([item.drive_force[name] for item in responses])
            for name in responses[0].drive_force
        },
        object_force=weights @ np.stack([item.object_force for item in responses]),
    )


def orthogonal_signs(count: int) -> Floats:
    """Return signs in orthogonal columns, at least so many.

    With the mirror image of each row no slope is taken for that of another parameter, nor for its
    change with a third (Plackett and Burman 1946, doi 10.1093/biomet/33.4.305).

    Examples
    --------
    >>> [orthogonal_signs(count).shape for count in (2, 9)]
    [(8, 8), (16, 16)]
    """
    return np.asarray(hadamard(1 << (max(FIRST_PAIRS, count) - 1).bit_length()), dtype=np.float64)


def leaders_of(
    movements: Sequence[MeasuredMovement],
    stepped: Sequence[Parameter],
    own: Sequence[Mapping[str, float]],
    *,
    within: float,
) -> list[int]:
    """Return for each movement the first with the same object that is thrown near its values.

    Its steps aside serve for both. A movement without an object is thrown there and back, whichever
    way it went.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        What was measured.
    stepped : sequence of Parameter
        Those that are stepped.
    own : sequence of mapping of str to float
        Values by name at which each movement is thrown.
    within : float
        How far apart they may be [coordinate].
    """
    points = [[item.coordinate(values[item.name]) for item in stepped] for values in own]
    leaders: list[int] = []
    for number, movement in enumerate(movements):
        near = (
            other
            for other in dict.fromkeys(leaders)
            if (movements[other].place, movements[other].size) == (movement.place, movement.size)
            and all(
                abs(a - b) <= within for a, b in zip(points[other], points[number], strict=True)
            )
        )
        leaders.append(next(near, number))
    return leaders


def difference_of(parameter: Parameter) -> float:
    """Return the step aside of a parameter with a prior [coordinate]; 0 for any other."""
    if not parameter.prior:
        return 0.0
    return OBJECT_DIFFERENCE if is_of_object(parameter) else DIFFERENCE


def stepped_value(parameter: Parameter, value: float, difference: float = DIFFERENCE) -> float:
    """Return a value one difference aside, on the side with more room."""
    here = parameter.coordinate(value)
    up = parameter.value(here + difference)
    if parameter.coordinate(up) - here >= LEAST_ROOM * difference:
        return up
    return parameter.value(here - difference)


Moved = dict[str, tuple[Response, ...]]


def moved_aside(
    throw: Callable[[Sequence[Parameter], Mapping[str, float]], Moved],
    whole: Mapping[str, float],
    stepped: Sequence[Parameter],
    aside: Mapping[str, float],
) -> tuple[dict[str, float], Moved]:
    """Throw one difference aside of values, on the other side where that cannot be simulated.

    Parameters
    ----------
    throw : callable
        From parameters and their values aside to the responses of each; SolverError where one
        cannot be simulated.
    whole, aside : mapping of str to float
        Values of all parameters, and those aside.
    stepped : sequence of Parameter
        Those that are stepped.

    Returns
    -------
    dict of str to float
        Values aside as they were thrown.
    dict of str to tuple of Response
        By parameter.

    Raises
    ------
    SolverError
        Where neither side of a value can be simulated.
    """
    with suppress(SolverError):
        return dict(aside), throw(stepped, aside)
    sides, found = dict(aside), Moved()
    for p in stepped:
        try:
            found |= throw([p], sides)
        except SolverError:
            here = p.coordinate(whole[p.name])
            step = here - p.coordinate(aside[p.name])
            sides[p.name] = p.value(here + step)
            if abs(p.coordinate(sides[p.name]) - here) < LEAST_ROOM * abs(step):
                raise
            found |= throw([p], sides)
    return sides, found


def is_slip_level(parameter: Parameter) -> bool:
    """Return whether a parameter is nothing but the force at which drives slip."""
    parts = [key.split(".") for key in parameter.keys]
    return bool(parts) and all(
        len(part) == 3 and part[0] == "drive" and part[2] == "saturation_force" for part in parts
    )


def touches(parameter: Parameter, value: float, response: Response) -> bool:
    """Return whether a parameter can change a response: a slip level that is not reached cannot."""
    if not is_slip_level(parameter):
        return bool(parameter.keys)
    drives = [key.split(".")[1] for key in parameter.keys]
    largest = [float(np.abs(response.drive_force[name]).max()) for name in drives]
    return max(largest) >= UNTOUCHED * value


def bounded_step(
    r: Floats,
    J: Floats,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    damping: float,
) -> tuple[Floats, float]:
    r"""Return the Levenberg-Marquardt step within bounds, and the predicted decrease of the cost.

    .. math::

        \min_s \|J s + r\|^2 + \lambda \|D s\|^2, \quad D_{jj} = \|J_{:j}\|

    Parameters
    ----------
    r : ndarray, shape (n,)
        Whitened residuals [-].
    J : ndarray, shape (n, p)
        Their change with each coordinate.
    parameters : sequence of Parameter
        With bounds, in the order of the columns of `J`.
    values : mapping of str to float
        At the present point.
    damping : float
        :math:`\lambda` [-].
    """
    theta = coordinates(parameters, values)
    J = np.vstack([J, np.diag(prior_slopes(parameters))])
    r = np.concatenate([r, prior_residuals(parameters, theta)])
    D = np.sqrt((J**2).sum(axis=0))
    D = np.where(D > 0, D, 1.0)
    lower = np.array([item.coordinate(item.lower) for item in parameters]) - theta
    upper = np.array([item.coordinate(item.upper) for item in parameters]) - theta
    lower = np.minimum(np.maximum(lower, -MAX_STEP), -1e-12)
    upper = np.maximum(np.minimum(upper, MAX_STEP), 1e-12)
    # The triangle of [J r] gives the same step as the tall matrices.
    R: Floats = np.asarray(np.linalg.qr(np.column_stack([J, r]), mode="r"), dtype=np.float64)
    p = len(parameters)
    matrix = np.vstack([R[:, :p], np.sqrt(damping) * np.diag(D)])
    right = np.concatenate([-R[:, p], np.zeros(p)])
    step = lsq_linear(matrix, right, bounds=(lower, upper)).x
    r_linear = r + J @ step
    return np.asarray(step), float(r @ r - r_linear @ r_linear)
