"""The design of a study: from the number of a scenario to the value of every variable."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from turnout.study.distribution import Choice, Distribution
from turnout.study.sampling import correlate, count_states, sample_points
from turnout.study.scenario import Value

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Values that are gone through one by one: of one variable, or of several side by side.

    Attributes
    ----------
    names : tuple of str
        Variables that change together along this axis.
    rows : tuple of tuple
        A value for each of them, in SI.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A variable that is drawn from a distribution, in SI or as a factor [-]."""

    name: str
    law: Distribution | Choice


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """A number of the panel that may be drawn.

    Attributes
    ----------
    value : float
        That of the panel, in SI.
    replaced_by, multiplied_by : str
        Variables that do so, by name; empty where it does not vary.
    """

    value: float
    replaced_by: str = ""
    multiplied_by: str = ""

    def in_state(self, drawn: Mapping[str, Value]) -> float:
        """Return the number in a state, given the drawn values of the state.

        Examples
        --------
        >>> Input(value=2.0, multiplied_by="factor").in_state({"factor": 1.5})
        3.0
        """
        value = float(drawn[self.replaced_by]) if self.replaced_by else self.value
        return value * float(drawn[self.multiplied_by]) if self.multiplied_by else value


@dataclass(frozen=True, slots=True, kw_only=True)
class Holding:
    r"""Requirement on a drive for not slipping while it presses a rail home.

    .. math:: k (u - g) < S

    Attributes
    ----------
    stiffness : Input
        :math:`k` of the bushing [N/m].
    reach : Input
        Over-travel :math:`u` [m].
    fit : Input
        Gap :math:`g` that the closed rail leaves before it is pressed home [m].
    slip_level : Input
        :math:`S` [N].
    """

    stiffness: Input
    reach: Input
    fit: Input
    slip_level: Input

    def holds(self, drawn: Mapping[str, Value]) -> bool:
        """Return True if the drive holds the rail in a state, given its drawn values."""
        stretch = self.reach.in_state(drawn) - self.fit.in_state(drawn)
        return self.stiffness.in_state(drawn) * stretch < self.slip_level.in_state(drawn)


MOST_DRAWS = 200
"""So often a state is drawn; the last one is kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignSummary:
    """Facts of a design that an analysis of the results needs.

    Attributes
    ----------
    method : str
        One of `turnout.study.sampling.METHODS`.
    draws, states, cells : int
        Count of the study file; drawn states of the switch; combinations on the axes.
    drawn : tuple of str
        Names of the variables that are drawn.
    axes : tuple of tuple of str
        Names of the variables on each axis.
    """

    method: str
    draws: int
    states: int
    cells: int
    drawn: tuple[str, ...]
    axes: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """Every state that is drawn, thrown with every combination of the values on the axes.

    The last axis runs fastest; where a rule ends chains, it is the axis of the rule, so that a
    chain is a run of neighbouring numbers in which nothing else changes.

    Attributes
    ----------
    axes : tuple of Axis
        May be none.
    drawn : tuple of Drawn
        May be none.
    method : str
        How states are drawn, one of `turnout.study.sampling.METHODS`.
    draws : int
        The count of the study file; 1 where nothing is drawn.
    copula : ndarray, shape (n_drawn, n_drawn), optional
        Cholesky factor of the correlation of normal scores.
    seed : int
        Of the study.
    holdings : tuple of Holding
        States in which a drive would slip at rest are drawn again; of the method "random" alone.
    """

    axes: tuple[Axis, ...]
    drawn: tuple[Drawn, ...]
    method: str
    draws: int
    copula: FloatArray | None
    seed: int
    holdings: tuple[Holding, ...] = ()

    def __post_init__(self) -> None:
        """Refuse to draw states again that are known only together."""
        if self.holdings and self.method != "random":
            message = f"states of the method {self.method} cannot be drawn again one by one"
            raise ValueError(message)

    @property
    def cells(self) -> int:
        """Combinations of the values on the axes."""
        return math.prod(len(axis.rows) for axis in self.axes)

    @property
    def states(self) -> int:
        """States of the switch that are drawn."""
        return count_states(self.method, count=self.draws, dimensions=len(self.drawn))

    @property
    def count(self) -> int:
        """Scenarios in all."""
        return self.states * self.cells

    @property
    def names(self) -> tuple[str, ...]:
        """Variables, those on the axes first."""
        return tuple(name for axis in self.axes for name in axis.names) + tuple(
            item.name for item in self.drawn
        )

    def summary(self) -> DesignSummary:
        """Return the facts that an analysis of the results needs."""
        return DesignSummary(
            method=self.method,
            draws=self.draws,
            states=self.states,
            cells=self.cells,
            drawn=tuple(item.name for item in self.drawn),
            axes=tuple(axis.names for axis in self.axes),
        )

    def state_index(self, index: int) -> int:
        """Return the state that a scenario is thrown in."""
        return index // self.cells

    def axis_values(self, index: int) -> dict[str, Value]:
        """Return the values on the axes of a scenario, by variable.

        Examples
        --------
        >>> axis = Axis(names=("object.size",), rows=((0.01,), (0.013,)))
        >>> one = Design(axes=(axis,), drawn=(), method="random", draws=1, copula=None, seed=0)
        >>> one.count, one.axis_values(1)
        (2, {'object.size': 0.013})
        """
        rest = index % self.cells
        found: dict[str, Value] = {}
        for axis in reversed(self.axes):
            rest, place = divmod(rest, len(axis.rows))
            found.update(zip(axis.names, axis.rows[place], strict=True))
        return {name: found[name] for axis in self.axes for name in axis.names}

    def drawn_values(self, state: int) -> dict[str, Value]:
        """Return the values that are drawn for a state, by variable."""
        return self.drawn_states([state])[0]

    def drawn_states(self, states: Sequence[int]) -> list[dict[str, Value]]:
        """Return the `drawn_values` of each of some states, in a tenth of the time."""
        found = self._drawn_values(states, attempt=0)
        refused = list(range(len(states))) if self.holdings else []
        for attempt in range(1, MOST_DRAWS):
            refused = [n for n in refused if not all(x.holds(found[n]) for x in self.holdings)]
            if not refused:
                break
            again = self._drawn_values([states[n] for n in refused], attempt=attempt)
            for number, values in zip(refused, again, strict=True):
                found[number] = values
        return found

    def _drawn_values(self, states: Sequence[int], *, attempt: int) -> list[dict[str, Value]]:
        if not self.drawn:
            return [{} for _ in states]
        shares = sample_points(
            self.method,
            count=self.draws,
            dimensions=len(self.drawn),
            seed=self.seed,
            states=states,
            attempt=attempt,
        )
        if self.copula is not None:
            rows = [correlate(row, factor=self.copula) for row in shares]
            shares = np.array(rows).reshape(shares.shape)
        columns = [item.law.drawn(row) for item, row in zip(self.drawn, shares.T, strict=True)]
        names = [item.name for item in self.drawn]
        return [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]
