"""Changes from throw to throw: weather, friction, clutches, adjustment, and objects with them.

Rates are constant, a temperature may take a course. Usual values and origins: docs/use/objects.md.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from turnout.core.errors import PanelError, ResponseError
from turnout.core.units import LENGTH, MELTING, TEMPERATURE, TEMPERATURE_COEFFICIENT, parse_quantity
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.object_laws import named_obstructions
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.layout import largest_opening
from turnout.panel.load import LoadedPanel
from turnout.solver.integration import History
from turnout.throw.signals import lasting_dents

LEAST_LEFT = 5e-4
"""A thinner object is gone [m]."""
LENGTHS = ("ice_growth", "snow_growth", "melting", "adjustment")
"""Of the rates."""
WITH_UNIT = (*LENGTHS, "friction_temperature", "friction_reference")
"""A text of these needs a unit."""
_AT_LEAST_ZERO = ("ice_growth", "snow_growth", "melting", "fall")
_CHANCES = ("fall", "clutch")


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Changes from each throw to the next; lengths may be texts with a unit.

    Parameters
    ----------
    temperature : float, str or sequence of them, optional
        Of ice and snow [K]; several values are spread evenly over the throws, linear in between.
        Default: each object keeps its own.
    ice_growth, snow_growth : float or str
        Added to the size of ice and snow after each throw, below the melting point [m].
    melting : float or str
        Taken from ice and snow after each throw, for each kelvin above the melting point [m].
    fall : float
        Chance after each throw that what has broken, in it or before, falls out [-].
    friction : float
        Added after each throw to the factor of the friction of all chairs [-].
    friction_temperature : float or str
        Change of that factor for each kelvin above `friction_reference`, as a rule negative
        [1/K]; needs `temperature`, which without it leaves the chairs alone.
    friction_reference : float or str
        Temperature at which the friction of chairs is that of the panel [K]; default 10 degC.
    clutch : float
        Share of the slip level that each drive loses after each throw [-]; of a drive that is a
        machine the torque of its clutch.
    adjustment : float or str
        Added after each throw to the closing over-travel of every drive, which moves the closed
        blade against its stock rail [m].
    seed : int
        Of the chances.

    Examples
    --------
    >>> Drift(ice_growth="0.3 mm", temperature=("-20 degC", "-5 degC")).ice_growth
    0.0003
    """

    temperature: float | str | Sequence[float | str] | None = None
    ice_growth: float | str = 0.0
    snow_growth: float | str = 0.0
    melting: float | str = 0.0
    fall: float = 0.0
    friction: float = 0.0
    friction_temperature: float | str = 0.0
    friction_reference: float | str = 283.15
    clutch: float = 0.0
    adjustment: float | str = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Turn texts into SI numbers; refuse all impossible values at once."""
        problems = []
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "seed" or value is None:
                continue
            try:
                number = _read(item.name, value)
            except (ValueError, TypeError) as error:
                problems.append(f"{item.name} = {value!r}: {error}")
                continue
            object.__setattr__(self, item.name, number)
        if not isinstance(self.seed, int) or isinstance(self.seed, bool):
            problems.append(f"seed = {self.seed!r}: must be a whole number")
        if not problems:
            problems += self._faults_of_temperature()
        if problems:
            raise ResponseError("drift: " + "; ".join(problems))

    def _faults_of_temperature(self) -> list[str]:
        """Return the faults that keep the temperature from acting on the friction of chairs."""
        if not self.friction_temperature:
            return []
        shown = f"friction_temperature = {self.friction_temperature:g} 1/K"
        if self.temperature is None:
            return [f"{shown}: needs temperature, such as -20 degC to 5 degC"]
        course = np.atleast_1d(np.asarray(self.temperature, dtype=float))
        least = course[np.argmin(self.temperature_factor(course))]
        if self.temperature_factor(least) < 0.0:
            warm = f"{least - MELTING:g} degC"
            return [f"{shown}: friction would be negative at {warm}; take a smaller one"]
        return []

    def temperature_factor(self, temperature: np.ndarray) -> np.ndarray:
        """Return the factor of the chairs' friction, 1 + k (T - T0), at temperatures [K]."""
        above = temperature - float(self.friction_reference)
        return np.asarray(1.0 + float(self.friction_temperature) * above)

    def temperatures(self, throws: int) -> np.ndarray | None:
        """Return the temperature at each throw [K], or None if objects keep their own."""
        if self.temperature is None:
            return None
        course = np.atleast_1d(np.asarray(self.temperature, dtype=float))
        places = np.linspace(0.0, 1.0, throws)
        return np.asarray(np.interp(places, np.linspace(0.0, 1.0, course.size), course))

    def overrides(
        self, panel: LoadedPanel, number: int, temperature: float | None = None
    ) -> dict[str, object]:
        """Return the changes of the panel at a throw, counted from 0, at a temperature [K]."""
        found: dict[str, object] = {}
        factor = 1.0 + self.friction * number
        if self.friction_temperature and temperature is not None:
            factor *= float(self.temperature_factor(np.asarray(temperature)))
        if factor != 1.0:
            values = {name: chair.friction_coefficient for name, chair in panel.chair.items()}
            if len(set(values.values())) == 1:
                found["chair.friction_coefficient"] = factor * next(iter(values.values()))
            else:
                for name, value in values.items():
                    found[f"chair.{name}.friction_coefficient"] = factor * value
        for name, drive in panel.drive.items():
            if self.adjustment and number:
                reach = drive.over_travel_closed + float(self.adjustment) * number
                found[f"drive.{name}.over_travel_closed"] = reach
            if self.clutch and number:
                left = (1.0 - self.clutch) ** number
                if drive.machine is None:
                    found[f"drive.{name}.saturation_force"] = drive.saturation_force * left
                else:
                    torque = panel.machine[drive.machine].clutch.torque
                    found[f"machine.{drive.machine}.clutch.torque"] = torque * left
        return found


# What changes the same values of the panel.
_CAUSES = (("friction", "friction_temperature"), ("clutch",), ("adjustment",))


def check_drift(panel: LoadedPanel, drift: Drift, throws: int) -> None:
    """Refuse a drift that leads to a switch that cannot be, before the first throw.

    Rates are constant, so what they change is extreme at the last throw; friction that follows the
    temperature may be so at any.

    Raises
    ------
    ResponseError
        Naming rate, throw, and what the panel does not allow.
    """
    problems = []
    for names in _CAUSES:
        given = [name for name in names if getattr(drift, name)]
        others = [name for cause in _CAUSES if cause != names for name in cause]
        none: dict[str, Any] = dict.fromkeys(others, 0.0)
        alone = replace(drift, **none)
        temperatures = drift.temperatures(throws)
        for number in _extremes(alone, temperatures, throws) if given else ():
            warmth = None if temperatures is None else float(temperatures[number])
            try:
                panel.with_overrides(alone.overrides(panel, number, warmth))
            except PanelError as error:
                rates = ", ".join(f"{name} = {getattr(drift, name):g}" for name in given)
                problems.append(
                    f"drift: {rates}: throw {number + 1} of {throws} is not possible: "
                    f"{error.problems[0]}; take a smaller rate or fewer throws"
                )
                break
    if problems:
        raise ResponseError("\n".join(problems))


def _extremes(drift: Drift, temperatures: np.ndarray | None, throws: int) -> list[int]:
    """Return the throws, counted from 0, at which a drifting quantity is extreme."""
    factor = 1.0 + drift.friction * np.arange(throws)
    if drift.friction_temperature and temperatures is not None:
        factor *= drift.temperature_factor(temperatures)
    return sorted({int(np.argmin(factor)), int(np.argmax(factor)), throws - 1})


def _read(name: str, value: object) -> object:
    """Return a value of `Drift` in SI; ValueError or TypeError states the requirement."""
    if name == "temperature":
        items = value if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
        course = tuple(parse_quantity(item, TEMPERATURE, si=True) for item in items)
        if not course or min(course) < 200.0 or max(course) > 350.0:
            message = "must be between 200 K and 350 K"
            raise ValueError(message)
        return course
    if name == "friction_reference":
        number = parse_quantity(value, TEMPERATURE, si=True)
        if not 200.0 <= number <= 350.0:
            message = "must be between 200 K and 350 K"
            raise ValueError(message)
    elif name == "friction_temperature":
        number = parse_quantity(value, TEMPERATURE_COEFFICIENT, si=True)
    elif name in LENGTHS:
        number = parse_quantity(value, LENGTH, si=True)
    elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        message = "must be a finite plain number"
        raise TypeError(message)
    else:
        number = float(value)
    if name in _AT_LEAST_ZERO and number < 0.0:
        message = "must be at least 0"
        raise ValueError(message)
    if name in _CHANCES and abs(number) > 1.0:
        message = "must be at most 1"
        raise ValueError(message)
    return number


def aged_objects(
    objects: Sequence[PlacedObject],
    mechanism: Mechanism,
    history: History,
    *,
    panel: LoadedPanel,
    drift: Drift,
    temperature: float | None,
    random: np.random.Generator,
    densities: dict[str, float],
) -> tuple[PlacedObject, ...]:
    """Return the parts of objects that the next throw meets.

    Parameters
    ----------
    objects : sequence of PlacedObject
        Parts that were thrown against.
    mechanism, history
        Of that throw.
    panel : LoadedPanel
        Its opening limits what grows.
    drift : Drift
        Rates of growth, melting and falling.
    temperature : float or None
        Of this throw [K].
    random : Generator
        For the chances.
    densities : dict
        Of snow that falls, by the name of the part [kg/m3].
    """
    rows = named_obstructions(history.obstructions, mechanism.index.object)
    dents = lasting_dents(mechanism, history)
    found = []
    for item in objects:
        row = rows.get(item.name)
        if row is None:
            found.append(item)
            continue
        broken = item.broken + int(history.obstructions.broken[row])
        if broken and drift.fall > 0.0 and random.random() < drift.fall:
            continue
        changes = drift.temperature is not None or _growth(item, drift, temperature) != 0.0
        after = _remembered(item, history, row, float(dents[row]), changes=changes)
        after = replace(after, broken=broken)
        after = _weathered(after, drift, temperature, densities.get(item.name, 0.0))
        opening = largest_opening(panel, item.rail, item.x)
        room = (math.inf if opening is None else opening) + after.lost
        after = replace(after, size=min(after.size, room))
        if after.size - after.lost > LEAST_LEFT:
            found.append(after)
    return tuple(found)


def _remembered(
    item: PlacedObject, history: History, row: int, dent: float, *, changes: bool
) -> PlacedObject:
    """Return an object as a throw left it."""
    obstructions = history.obstructions
    changed = item.of_kind.left(
        item,
        lost=item.size - float(obstructions.size[row]),
        deepest=float(obstructions.deepest[row]),
        dent=dent,
        changes=changes,
        broke=bool(item.broken or obstructions.broken[row]),
    )
    return replace(item, **changed)  # type: ignore[arg-type]


def _weathered(
    item: PlacedObject, drift: Drift, temperature: float | None, fresh: float
) -> PlacedObject:
    """Let ice and snow grow below the melting point, and melt above."""
    change = _growth(item, drift, temperature)
    return replace(item, **item.of_kind.grown(item, change, fresh))  # type: ignore[arg-type]


def _growth(item: PlacedObject, drift: Drift, temperature: float | None) -> float:
    """Return what ice and snow gain after a throw, or lose above the melting point [m]."""
    if not item.of_kind.growth:
        return 0.0
    growth = getattr(drift, item.of_kind.growth)
    warmth = 0.0 if temperature is None else max(temperature - MELTING, 0.0)
    return -float(drift.melting) * warmth if warmth > 0.0 else float(growth)
