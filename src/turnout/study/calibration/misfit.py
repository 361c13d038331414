"""Weighted residuals of measured movements against simulated ones, over any set of movements."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from turnout.errors import SolverError
from turnout.study.calibration.evaluate import Evaluator, Response, Throw
from turnout.study.calibration.observed import Movement
from turnout.study.calibration.parameter import Parameter, overrides_of
from turnout.study.calibration.view import Comparison, Sensitivity, View, view_of

Floats = NDArray[np.float64]
# Far enough for the noise of the solver, near enough for a straight line [coordinate].
DIFFERENCE = 0.01
# A drive that stays this far below its slip level does not feel it [-].
UNTOUCHED = 0.98


@dataclass(slots=True, kw_only=True, eq=False)
class Misfit:
    """A set of movements, how they are compared, and what throws them.

    Attributes
    ----------
    evaluator : Evaluator
        Throws the panel.
    parameters : tuple of Parameter
        All that may differ from the panel.
    base : mapping of str to float
        Their values where a call does not name them [SI].
    movements : tuple of Movement
        Measured.
    comparison : Comparison
        How they are compared.
    own : mapping of str to tuple of float
        By parameter that scatters: how far each movement's own value is from the common one, as a
        share; throws are made there.
    law : callable, optional
        From values by name to further overrides of the panel, such as another law of a drive.
    shape : callable, optional
        From a response and the values by name to the response as it is compared.
    quick : bool
        Whether all throws are quick; else only those aside, whose differences alone count.
    """

    evaluator: Evaluator
    parameters: tuple[Parameter, ...]
    base: Mapping[str, float]
    movements: tuple[Movement, ...]
    comparison: Comparison
    own: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    law: Callable[[Mapping[str, float]], dict[str, object]] | None = None
    shape: Callable[[Response, Mapping[str, float]], Response] | None = None
    quick: bool = False
    frame: "Frame | None" = None

    def residuals(self, values: Mapping[str, float]) -> Floats:
        """Return the whitened residuals at values, in the frame of the misfit.

        The first call without a frame makes one at the base values.

        Parameters
        ----------
        values : mapping of str to float
            By name of parameter, in SI; those that are left out keep their base value.

        Returns
        -------
        ndarray, shape (n,)
            Measured less simulated, independent with a standard deviation of 1 where the model is
            right; NaN where a simulation failed.
        """
        if self.frame is None:
            self.frame = framed(self.local(self.base, ()), self)
        return self.residuals_of(self.responses([values])[0], self.frame)

    def residuals_of(self, responses: Sequence[Response], frame: "Frame") -> Floats:
        """Return the whitened residuals of the response to each movement."""
        rows = []
        for view, response in zip(frame.views, responses, strict=True):
            rows.append(view.whitened(view.measured - view.of(response)))
        return np.concatenate(rows) if rows else np.zeros(0)

    def responses(
        self, points: Sequence[Mapping[str, float]], *, quick: bool = False
    ) -> list[list[Response]]:
        """Return the response to each movement at each of several points, thrown together."""
        whole = [{**self.base, **point} for point in points]
        throws = [
            self._throw(number, values, quick=quick or self.quick)
            for values in whole
            for number in range(len(self.movements))
        ]
        count = len(self.movements)
        made = self.evaluator.responses(throws)
        rows = [made[n * count : (n + 1) * count] for n in range(len(points))]
        if self.shape is None:
            return rows
        return [
            [self.shape(item, values) for item in row]
            for row, values in zip(rows, whole, strict=True)
        ]

    def _throw(self, number: int, values: Mapping[str, float], *, quick: bool = True) -> Throw:
        movement = self.movements[number]
        mine = {
            name: values[name] * (1.0 + shares[number])
            for name, shares in self.own.items()
            if shares[number]
        }
        overrides: dict[str, object] = dict(overrides_of(self.parameters, {**values, **mine}))
        if self.law is not None:
            overrides |= self.law(values)
        return Throw(overrides=overrides, place=movement.place, size=movement.size, quick=quick)

    def local(self, values: Mapping[str, float], vary: Sequence[str]) -> "Local":
        """Simulate about values: responses there, and one step aside for each parameter.

        Parameters that scatter are always among those that are stepped.

        Raises
        ------
        SolverError
            When a simulation fails at the values, or on both sides of them.
        """
        whole = {**self.base, **values}
        stepped = [
            p
            for p in self.parameters
            if p.name in vary or self.comparison.scatter.get(p.name, 0.0) > 0
        ]
        here = self.responses([whole])[0]
        for movement, response in zip(self.movements, here, strict=True):
            if response.failure:
                message = f"{movement.text}: cannot be simulated: {response.failure}"
                raise SolverError(message)
        aside = {p.name: stepped_value(p, whole[p.name]) for p in stepped}
        # Differences of two quick throws are good slopes; quick against exact would be none.
        origin = self.responses([whole], quick=True)[0] if stepped else here
        moved = self._moved(whole, stepped, aside, origin)
        steps = {p.name: p.coordinate(aside[p.name]) - p.coordinate(whole[p.name]) for p in stepped}
        shares = {name: value / whole[name] - 1.0 for name, value in aside.items()}
        return Local(
            values=whole,
            here=tuple(here),
            origin=tuple(origin),
            moved=moved,
            steps=steps,
            shares=shares,
        )

    def _moved(
        self,
        whole: Mapping[str, float],
        stepped: Sequence[Parameter],
        aside: Mapping[str, float],
        here: Sequence[Response],
    ) -> dict[str, tuple[Response, ...]]:
        """Return the responses aside; where a parameter does not act, those that are known."""
        wanted: list[tuple[str, int]] = []
        throws = []
        found = {p.name: list(here) for p in stepped}
        for p in stepped:
            values = {**whole, p.name: aside[p.name]}
            for number in range(len(self.movements)):
                if _touches(p, whole[p.name], here[number]):
                    wanted.append((p.name, number))
                    throws.append(self._throw(number, values))
        made = self.evaluator.responses(throws)
        for (name, number), response in zip(wanted, made, strict=True):
            if response.failure:
                movement = self.movements[number]
                message = f"{movement.text}: cannot be simulated: {response.failure}"
                raise SolverError(message)
            values = {**whole, name: aside[name]}
            found[name][number] = response if self.shape is None else self.shape(response, values)
        if self.shape is not None:
            for p in stepped:
                if not p.keys:
                    values = {**whole, p.name: aside[p.name]}
                    raw = self.evaluator.responses(
                        [self._throw(n, values) for n in range(len(here))]
                    )
                    found[p.name] = [self.shape(item, values) for item in raw]
        return {name: tuple(row) for name, row in found.items()}


def stepped_value(parameter: Parameter, value: float) -> float:
    """Return a value one difference aside, on the side with more room."""
    here = parameter.coordinate(value)
    up = parameter.value(here + DIFFERENCE)
    if parameter.coordinate(up) - here >= 0.5 * DIFFERENCE:
        return up
    return parameter.value(here - DIFFERENCE)


def _touches(parameter: Parameter, value: float, response: Response) -> bool:
    """Tell whether a parameter can change a response: a slip level that is not reached cannot."""
    if not parameter.keys:
        return False
    levels = [key.split(".") for key in parameter.keys]
    if not all(
        len(parts) == 3 and parts[0] == "drive" and parts[2] == "saturation_force"
        for parts in levels
    ):
        return True
    return any(
        float(np.abs(response.drive_force[parts[1]]).max()) >= UNTOUCHED * value for parts in levels
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Local:
    """Responses at a point and one step aside for each parameter.

    Attributes
    ----------
    values : mapping of str to float
        The point.
    here : tuple of Response
        To each movement.
    origin : tuple of Response
        Where the steps aside were taken, as they were: here, or near by; thrown quickly.
    moved : mapping of str to tuple of Response
        By parameter.
    steps : mapping of str to float
        How far aside, in the coordinate.
    shares : mapping of str to float
        How far aside, as a share of the value.
    """

    values: Mapping[str, float]
    here: tuple[Response, ...]
    origin: tuple[Response, ...]
    moved: Mapping[str, tuple[Response, ...]]
    steps: Mapping[str, float]
    shares: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """Views of all movements, made about one point.

    Attributes
    ----------
    values : mapping of str to float
        The point.
    views : tuple of View
        In the order of the movements.
    """

    values: Mapping[str, float]
    views: tuple[View, ...]


def framed(local: Local, misfit: Misfit) -> Frame:
    """Make the views of all movements about a point."""
    views = []
    zeros = (0.0,) * len(misfit.movements)
    for number, movement in enumerate(misfit.movements):
        sensitivities = {
            name: Sensitivity(
                here=local.origin[number],
                aside=local.moved[name][number],
                step=local.shares[name] * (1.0 + own),
                own=own,
            )
            for name, share in misfit.comparison.scatter.items()
            if share > 0 and name in local.moved
            for own in [misfit.own.get(name, zeros)[number]]
        }
        views.append(
            view_of(
                movement,
                local.here[number],
                comparison=misfit.comparison,
                sensitivities=sensitivities,
            )
        )
    return Frame(values=local.values, views=tuple(views))


def jacobian(local: Local, frame: Frame, names: Sequence[str]) -> Floats:
    """Return the change of the whitened residuals with each coordinate.

    Returns
    -------
    ndarray, shape (n, len(names))
    """
    blocks = []
    for number, view in enumerate(frame.views):
        here = view.plain(local.origin[number])
        columns = [
            -view.whitened(view.plain(local.moved[name][number]) - here) / local.steps[name]
            if local.moved[name][number] is not local.origin[number]
            else np.zeros(here.size)
            for name in names
        ]
        blocks.append(np.column_stack(columns) if columns else np.zeros((here.size, 0)))
    return np.concatenate(blocks)
