"""Weighted residuals of measured movements against simulated ones, over any set of movements."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.comparison import Comparison, Sensitivity, View, view_of
from turnout.calibration.evaluate import Evaluator, Response, Throw
from turnout.calibration.local import (
    DIFFERENCE,
    FINE_DIFFERENCE,
    SAME_FINE_SLOPE,
    SAME_SLOPE,
    Local,
    stepped_value,
    touches,
)
from turnout.calibration.observed import Movement
from turnout.calibration.parameter import Parameter, overrides_of
from turnout.errors import SolverError

Floats = NDArray[np.float64]


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
    always : tuple of str
        Parameters that act in every movement, whatever forces the plain law would ask for.
    quick : bool
        Whether throws are quick, and slopes taken over wider differences.
    fine : bool
        Whether throws have shorter steps, those aside excepted, whose differences alone count.
    """

    evaluator: Evaluator
    parameters: tuple[Parameter, ...]
    base: Mapping[str, float]
    movements: tuple[Movement, ...]
    comparison: Comparison
    own: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    law: Callable[[Mapping[str, float]], dict[str, object]] | None = None
    shape: Callable[[Response, Mapping[str, float]], Response] | None = None
    always: tuple[str, ...] = ()
    quick: bool = False
    fine: bool = False
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
        """Return the whitened residuals of the response to each movement, thrown at its own."""
        rows = []
        for number, (view, response) in enumerate(zip(frame.views, responses, strict=True)):
            own = {name: self.share(name, number) for name in view.own}
            rows.append(view.whitened(view.measured - view.of(response, own)))
        return np.concatenate(rows) if rows else np.zeros(0)

    def share(self, name: str, number: int) -> float:
        """Return how far a movement's own value of a parameter is from the common one."""
        return self.own[name][number] if name in self.own else 0.0

    def responses(self, points: Sequence[Mapping[str, float]]) -> list[list[Response]]:
        """Return the response to each movement at each of several points, thrown together."""
        whole = [{**self.base, **point} for point in points]
        throws = [
            self._throw(number, values) for values in whole for number in range(len(self.movements))
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

    def _throw(self, number: int, values: Mapping[str, float]) -> Throw:
        movement = self.movements[number]
        mine = {
            name: values[name] * (1.0 + shares[number])
            for name, shares in self.own.items()
            if shares[number]
        }
        overrides: dict[str, object] = dict(overrides_of(self.parameters, {**values, **mine}))
        if self.law is not None:
            overrides |= self.law({**values, **mine})
        return Throw(
            overrides=overrides,
            place=movement.place,
            size=movement.size,
            quick=self.quick,
            fine=self.fine,
        )

    def local(self, values: Mapping[str, float], vary: Sequence[str]) -> Local:
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
        difference = DIFFERENCE if self.quick else FINE_DIFFERENCE
        aside = {p.name: stepped_value(p, whole[p.name], difference) for p in stepped}
        plain = replace(self, fine=False)
        origin = plain.responses([whole])[0] if self.fine and stepped else here
        moved = plain._moved(whole, stepped, aside, origin)
        count = len(self.movements)
        steps = {
            p.name: (p.coordinate(aside[p.name]) - p.coordinate(whole[p.name]),) * count
            for p in stepped
        }
        shares = {
            p.name: tuple(
                (aside[p.name] / whole[p.name] - 1.0) * (1.0 + self.share(p.name, n))
                for n in range(count)
            )
            for p in stepped
            if whole[p.name] != 0.0
        }
        return Local(
            values=whole,
            here=tuple(here),
            origin=tuple(origin),
            moved=moved,
            steps=steps,
            shares=shares,
            about=tuple(self._thrown_at(whole, n) for n in range(len(self.movements))),
            quick=self.quick,
        )

    def local_near(self, values: Mapping[str, float], vary: Sequence[str], known: Local) -> Local:
        """Return what `local` does; steps aside that were taken near by are not simulated anew.

        Near is told movement by movement, as each is thrown at its own values.
        """
        whole = {**self.base, **values}
        most = SAME_SLOPE if self.quick else SAME_FINE_SLOPE
        stale = [n for n in range(len(self.movements)) if self._shift(whole, n, known) > most]
        same = set(vary) <= set(known.moved) and known.quick == self.quick
        if not same or len(stale) == len(self.movements):
            return self.local(whole, vary)
        here = tuple(self.responses([whole])[0])
        found = replace(known, values=whole, here=here)
        if not stale:
            return found
        part = replace(
            self,
            movements=tuple(self.movements[n] for n in stale),
            own={name: tuple(row[n] for n in stale) for name, row in self.own.items()},
        )
        return found.with_movements(stale, part.local(whole, vary))

    def _thrown_at(self, values: Mapping[str, float], number: int) -> dict[str, float]:
        return {name: value * (1.0 + self.share(name, number)) for name, value in values.items()}

    def _shift(self, values: Mapping[str, float], number: int, known: Local) -> float:
        """Return how far a movement is thrown from where its steps aside were taken."""
        before, now = known.about[number], self._thrown_at(values, number)
        return max(
            abs(p.coordinate(now[p.name]) - p.coordinate(before[p.name]))
            for p in self.parameters
            if p.name in known.moved
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
                if p.name in self.always or touches(p, whole[p.name], here[number]):
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
        return {name: tuple(row) for name, row in found.items()}


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
    for number, movement in enumerate(misfit.movements):
        sensitivities = {
            name: Sensitivity(
                here=local.origin[number],
                aside=local.moved[name][number],
                step=local.shares[name][number],
                own=misfit.share(name, number),
            )
            for name, share in misfit.comparison.scatter.items()
            if share > 0 and name in local.moved
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


def slopes_of(local: Local, frame: Frame, names: Sequence[str]) -> list[Floats]:
    """Return the change of each movement's prediction with each coordinate.

    Returns
    -------
    list of ndarray, shape (n, len(names))
    """
    found = []
    for number, view in enumerate(frame.views):
        here = view.plain(local.origin[number])
        block = np.zeros((here.size, len(names)))
        for column, name in enumerate(names):
            moved = local.moved[name][number]
            if moved is not local.origin[number]:
                block[:, column] = (view.plain(moved) - here) / local.steps[name][number]
        found.append(block)
    return found


def jacobian(local: Local, frame: Frame, names: Sequence[str]) -> Floats:
    """Return the change of the whitened residuals with each coordinate.

    Returns
    -------
    ndarray, shape (n, len(names))
    """
    slopes = slopes_of(local, frame, names)
    rows = [-view.whitened(slope) for view, slope in zip(frame.views, slopes, strict=True)]
    return np.concatenate(rows)
