"""Parameters and stages of a calibration: values to fit, from which movements, channels and time.

A fit moves in coordinates in which a step of 0.01 is about one per cent of a value.

Trapped objects are unknowns too: how thick they truly are, and where, against the run sheet. All
objects of a campaign are thicker by something in common, in every fit. Where this is not enough,
each size and each place has a difference of its own, as a cause. A common shift of places in every
fit led campaigns of few movements to values that were wrong by many deviations.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import PanelError
from turnout.core.problems import choices, nearest
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.panel.model import PANEL_KEYS

if TYPE_CHECKING:
    # A record that is read does not wait for what reads campaigns.
    from turnout.calibration.measured_movements import MeasuredMovement

Floats = NDArray[np.float64]
TRANSFORMS = ("log", "linear", "share")
# A free key may come to between a third and three times of what the panel says.
REACH = 3.0
# One unit of the coordinate of a linear parameter with a prior, in its standard deviations [-].
PRIOR_SCALE = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One value to calibrate.

    Attributes
    ----------
    name : str
        What it is called in stages, records and messages.
    keys : tuple of str
        Keys of the panel that it sets, all to the same value; none for a parameter that acts on
        the simulated signals alone.
    start, lower, upper : float
        Start value and bounds in SI; lower < upper.
    unit : str
        SI unit; "1" for a plain number.
    vary : bool
        Whether stages that name it may change it.
    transform : str
        "log" (steps are shares of the value, which must be positive), "linear", or "share": the
        value is how much less something is, as a logarithm, and steps are shares of what it is.
    scatter : float
        Standard deviation from movement to movement, as a share of the value, that is expected
        before the measurement is seen; 0 for a value that all movements share.
    prior : float
        Standard deviation about `start` before the measurement, as a share of the value with the
        transform "log", else in its unit, with "share" where it starts; 0 for a flat density
        between the bounds.

    Examples
    --------
    >>> stiffness = Parameter(
    ...     name="k1", keys=("drive.1.stiffness",), start=7e5, lower=1e5, upper=1e7, unit="N/m"
    ... )
    >>> round(stiffness.value(stiffness.coordinate(8e5)))
    800000
    """

    name: str
    keys: tuple[str, ...]
    start: float
    lower: float
    upper: float
    unit: str = "1"
    vary: bool = True
    transform: str = "log"
    scatter: float = 0.0
    prior: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what cannot be, all at once."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        problems = []
        if self.transform not in TRANSFORMS:
            problems.append(f'transform = "{self.transform}": must be one of {choices(TRANSFORMS)}')
        if not self.lower < self.upper:
            problems.append(
                f"bounds {self.lower:g} ... {self.upper:g}: the lower must be below the upper"
            )
        elif not self.lower <= self.start <= self.upper:
            problems.append(
                f"start = {self.start:g}{unit}: is outside its bounds {self.lower:g} ... "
                f"{self.upper:g}{unit}; widen them, or start inside (--set)"
            )
        if self.transform == "log" and not self.lower > 0:
            problems.append(
                f'lower = {self.lower:g}: must be positive for the transform "log"; '
                'raise it, or take "linear"'
            )
        if not self.scatter >= 0:
            problems.append(f"scatter = {self.scatter:g}: must be at least 0")
        if not self.prior >= 0:
            problems.append(f"prior = {self.prior:g}: must be at least 0")
        if problems:
            raise PanelError([f"{self.name}: {text}" for text in problems], source="parameter")

    @property
    def scale(self) -> float:
        """Size of one unit of the coordinate of a linear parameter [its unit]."""
        if self.prior > 0.0:
            return PRIOR_SCALE * self.prior
        return max(abs(self.start), 0.1 * (self.upper - self.lower))

    @property
    def prior_width(self) -> float:
        """Standard deviation of the prior in the coordinate [-]; infinite for a flat one."""
        if self.prior == 0.0:
            return math.inf
        return self.prior if self.transform == "log" else self.prior / self.slope(self.start)

    def coordinate(self, value: float) -> float:
        """Return the coordinate in which a fit moves: a change of 0.01 is about one per cent."""
        if self.transform == "share":
            return -math.exp(-value)
        return math.log(value) if self.transform == "log" else value / self.scale

    def value(self, coordinate: float) -> float:
        """Return the value of a coordinate, within the bounds [its unit]."""
        if self.transform == "share":
            raw = -math.log(-coordinate) if coordinate < 0.0 else math.inf
        else:
            raw = math.exp(coordinate) if self.transform == "log" else coordinate * self.scale
        return min(max(raw, self.lower), self.upper)

    def slope(self, value: float) -> float:
        """Return the change of the value with its coordinate [its unit]."""
        if self.transform == "share":
            return math.exp(value)
        return value if self.transform == "log" else self.scale

    def at_bound(self, value: float) -> bool:
        """Return whether a value lies on a bound, so that the fit would have gone on.

        Not where a prior expects it there, as for what is usually none.
        """
        reach = 1e-6 * (self.upper - self.lower)
        if self.prior and abs(value - self.start) <= reach:
            return False
        return value - self.lower <= reach or self.upper - value <= reach


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """One parameter as it came out.

    Attributes
    ----------
    name, keys, unit
        As of the parameter.
    value : float
        Best fit, in SI.
    deviation : float
        Standard deviation; NaN where it was not fitted or is not identified.
    lower, upper : float
        Bounds of the fit in SI.
    interval : tuple of float
        95 % interval.
    start : float
        Where the first stage began.
    state : str
        "fitted", "fixed", "at its bound" or "not identified".
    """

    name: str
    keys: tuple[str, ...]
    unit: str
    value: float
    deviation: float
    lower: float
    upper: float
    interval: tuple[float, float]
    start: float
    state: str = "fitted"


def coordinates(parameters: Sequence[Parameter], values: Mapping[str, float]) -> Floats:
    """Return the coordinates of values, in the order of the parameters."""
    return np.array([item.coordinate(values[item.name]) for item in parameters])


def prior_slopes(parameters: Sequence[Parameter]) -> Floats:
    """Return the inverse standard deviation of each prior, 0 for flat ones, shape (p,)."""
    return np.array([1.0 / item.prior_width for item in parameters], dtype=np.float64)


def prior_information(parameters: Sequence[Parameter]) -> Floats:
    """Return the inverse variance of each coordinate: of a flat density, and of its prior."""
    widths = [item.coordinate(item.upper) - item.coordinate(item.lower) for item in parameters]
    flat = np.array([12.0 / width**2 for width in widths])
    return flat + prior_slopes(parameters) ** 2


def prior_residuals(parameters: Sequence[Parameter], point: Floats) -> Floats:
    """Return how far coordinates are from their priors' means, in deviations, shape (..., p).

    Examples
    --------
    >>> fit = Parameter(
    ...     name="g", keys=(), start=2e-3, lower=-1e-2, upper=1e-2, transform="linear", prior=1e-3
    ... )
    >>> prior_residuals([fit], coordinates([fit], {"g": 4e-3})).round(6)
    array([2.])
    """
    means = np.array([item.coordinate(item.start) for item in parameters], dtype=np.float64)
    return np.asarray((point - means) * prior_slopes(parameters))


def values_at(parameters: Sequence[Parameter], point: Floats) -> dict[str, float]:
    """Return values by name at coordinates."""
    return {item.name: item.value(float(x)) for item, x in zip(parameters, point, strict=True)}


def overrides_of(parameters: Iterable[Parameter], values: Mapping[str, float]) -> dict[str, float]:
    """Return the overrides of a panel that values stand for, in SI.

    Examples
    --------
    >>> friction = Parameter(name="mu", keys=("a", "b"), start=0.4, lower=0.1, upper=1.0)
    >>> overrides_of([friction], {"mu": 0.3})
    {'a': 0.3, 'b': 0.3}
    """
    return {key: values[item.name] for item in parameters for key in item.keys}


def value_in(panel: LoadedPanel, key: str) -> float:
    """Return the value of a panel at a key; of a family, that of its first member.

    Raises
    ------
    PanelError
        When there is no such key, or no number there.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> value_in(load_panel("sb1"), "chair.friction_coefficient")
    0.4
    """
    found = next(iter(panel.values_at(key).values()), None)
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise PanelError([f"{key}: is not a number, so it cannot be fitted"], source="parameter")
    return float(found)


def unit_in(key: str) -> str:
    """Return the SI unit of a panel's key, "1" for a plain number.

    Examples
    --------
    >>> unit_in("drive.1.stiffness"), unit_in("chair.friction_coefficient"), unit_in("gravity")
    ('N/m', '1', 'm/s^2')
    """
    found = PANEL_KEYS.find(key)
    return (found.unit if found else "") or "1"


def free_parameter(panel: LoadedPanel, key: str, *, scatter: float = 0.0) -> Parameter:
    """Return a parameter for a key of a panel, with wide bounds about what the panel says.

    Raises
    ------
    PanelError
        When there is no number at the key.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> free_parameter(load_panel("sb1"), "drive.1.stiffness").upper
    2250000.0
    """
    value = value_in(panel, key)
    if value <= 0:
        problem = f"{key} = {value:g}: is not positive; state its bounds in a plan"
        raise PanelError([problem], source="parameter")
    found = PANEL_KEYS.find(key)
    least, most = found.bounds if found else (-math.inf, math.inf)
    return Parameter(
        name=key,
        keys=(key,),
        start=value,
        lower=max(value / REACH, least),
        upper=min(value * REACH, most),
        unit=unit_in(key),
        scatter=scatter,
    )


METHODS = ("sweep", "fit", "sweep and fit")
# The published calibration: friction 0.1 ... 0.5; a tenth and ten times of a drive's stiffness.
FRICTION_SWEEP = (0.1, 0.2, 0.3, 0.4, 0.5)
STIFFNESS_SWEEP = (75e3, 150e3, 300e3, 750e3, 1.5e6, 3e6, 7.5e6)
# Of friction from throw to throw, as repeats show [-].
FRICTION_SCATTER = 0.02
# The object of the published test [m].
TEST_SIZE = 0.013
# Enough for five parameters; what is left over is there to validate.
JOINT_MOVEMENTS = 20
# How well over-travel and fit are known [m], and the stress-free fraction [-]; bounds are so many
# deviations away.
MILLIMETRE, FRACTION, FURTHEST = 1e-3, 0.05, 6.0
ANY = "any"
NONE = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Which movements a stage uses.

    Attributes
    ----------
    objects : str
        "none" (without an object), "any" (with one), or "all".
    place : str
        Place of the object, such as "drive 1"; compared by position. Empty for every place.
    size : float or None
        The nearest size to this at the place is taken [m].
    direction : str
        "closing", "opening", or empty for both.
    names : tuple of str
        Only these movements; empty for all.
    most : int
        At most so many, spread over places and sizes; 0 for all.
    """

    objects: str = "all"
    place: str = ""
    size: float | None = None
    direction: str = ""
    names: tuple[str, ...] = ()
    most: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One step of a calibration.

    Attributes
    ----------
    name : str
        What it is called.
    parameters : tuple of str
        Names of the parameters that it changes.
    movements : Selection
        What it is fitted to.
    channels : tuple of str
        Of the schema.
    window : tuple of float and (float or None)
        Time from the onset that is compared [s]; None for the end of the movement and its rest.
    method : str
        "sweep" over the grid of the first parameter, "fit", or "sweep and fit".
    grid : tuple of float
        Values of the first parameter that are swept [its unit].
    optional : bool
        Whether the stage is left out, with a warning, where no movement is selected.
    """

    name: str
    parameters: tuple[str, ...]
    movements: Selection
    channels: tuple[str, ...] = ("drive_force", "object_force")
    window: tuple[float, float | None] = (0.0, None)
    method: str = "fit"
    grid: tuple[float, ...] = ()
    optional: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be, all at once."""
        problems = []
        if self.method not in METHODS:
            problems.append(f'method = "{self.method}": must be one of {choices(METHODS)}')
        if not self.parameters:
            problems.append("names no parameter; give at least one")
        if "sweep" in self.method and not self.grid:
            problems.append("a sweep needs a grid of values")
        if self.window[1] is not None and not self.window[0] < self.window[1]:
            problems.append(f"window {self.window}: must begin before it ends")
        if problems:
            raise PanelError([f"stage {self.name}: {text}" for text in problems], source="stages")


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationPlan:
    """Parameters and stages of a calibration.

    Attributes
    ----------
    parameters : tuple of Parameter
        All that any stage may change.
    stages : tuple of Stage
        In the order in which they are done; each begins where the one before ended.
    """

    parameters: tuple[Parameter, ...]
    stages: tuple[Stage, ...]

    def __post_init__(self) -> None:
        """Refuse stages that name unknown parameters."""
        known = [item.name for item in self.parameters]
        problems = [
            f"stage {stage.name}: unknown parameter '{name}'{nearest(name, known)}; "
            f"there are {choices(known)}"
            for stage in self.stages
            for name in stage.parameters
            if name not in known
        ]
        if len(set(known)) < len(known):
            problems.append("two parameters have the same name")
        if problems:
            raise PanelError(problems, source="stages")

    def named(self, names: Sequence[str]) -> tuple[Parameter, ...]:
        """Return the parameters of some names that may vary, in the order of the plan."""
        return tuple(item for item in self.parameters if item.name in names and item.vary)


def default_plan(
    panel: LoadedPanel,
    *,
    free: Sequence[str] = (),
    fixed: Sequence[str] = (),
    most: int = JOINT_MOVEMENTS,
) -> CalibrationPlan:
    """Return the published stages, with slip levels free, and a joint refinement.

    Friction comes from movements without an object; then the stiffness of each drive, and the
    force at which it slips, from a 13 mm object at that drive; then all of it from movements of
    every kind.

    Parameters
    ----------
    panel : LoadedPanel
        Gives drives and start values.
    free : sequence of str
        Further keys of the panel, for the joint refinement.
    fixed : sequence of str
        Keys among the default ones that keep the panel's value.
    most : int
        Movements of the joint refinement, spread over places and sizes, so that the others can
        judge the result; 0 for all.

    Raises
    ------
    PanelError
        For unknown keys.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [stage.name for stage in default_plan(load_panel("sb1")).stages]
    ['friction', 'drive 1', 'drive 2', 'joint']
    """
    friction = "chair.friction_coefficient"
    parameters = [free_parameter(panel, friction, scatter=FRICTION_SCATTER)]
    parameters[0] = replace(parameters[0], lower=0.02, upper=1.2)
    stages = [
        Stage(
            name="friction",
            parameters=(friction,),
            movements=Selection(objects=NONE),
            method="sweep and fit",
            grid=FRICTION_SWEEP,
        )
    ]
    for name in panel.drive:
        keys = (f"drive.{name}.stiffness", f"drive.{name}.saturation_force")
        stiffness, level = (free_parameter(panel, key) for key in keys)
        low, high = min(STIFFNESS_SWEEP), max(STIFFNESS_SWEEP)
        bounds = (min(low, stiffness.lower) / 1.5, max(high, stiffness.upper) * 1.5)
        parameters += [replace(stiffness, lower=bounds[0], upper=bounds[1]), level]
        stages.append(
            Stage(
                name=f"drive {name}",
                parameters=keys,
                movements=Selection(
                    objects=ANY, place=f"drive {name}", size=TEST_SIZE, direction="closing"
                ),
                method="sweep and fit",
                grid=STIFFNESS_SWEEP,
                optional=True,
            )
        )
    parameters += nuisances(panel)
    known = [item.name for item in parameters]
    parameters += [free_parameter(panel, key) for key in free if key not in known]
    problems = [
        f"{key}: is not a parameter of the default stages{nearest(key, known)}; they are "
        f"{choices(known)}"
        for key in fixed
        if key not in known
    ]
    problems += [f"{key}: is both freed and fixed; take one" for key in free if key in fixed]
    if problems:
        raise PanelError(problems, source="fixed")
    kept = tuple(replace(p, vary=False) if p.name in fixed else p for p in parameters)
    joint = Stage(
        name="joint",
        parameters=tuple(item.name for item in kept),
        movements=Selection(most=most),
    )
    return CalibrationPlan(parameters=kept, stages=(*stages, joint))


def nuisances(panel: LoadedPanel) -> list[Parameter]:
    """Return what is known of a panel to a part of a millimetre only, each with a prior.

    How far each drive goes beyond the closed position, where each rail stands without any force,
    and the gap that it leaves closed. Forces hold them, so they are fitted in the joint stage; what
    a drive pushes further is much like what it is stiffer.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [item.name for item in nuisances(load_panel("uic60-760-1-15"))][:2]
    ['drive.1.over_travel_closed', 'drive.2.over_travel_closed']
    >>> nuisances(load_panel("sb1"))
    []
    """
    found = [
        known_to(f"drive.{name}.over_travel_closed", drive.over_travel_closed, MILLIMETRE)
        for name, drive in panel.drive.items()
        if drive.over_travel_closed != 0.0
    ]
    for name in dict.fromkeys(drive.rail for drive in panel.drive.values()):
        rail = panel.rail[name]
        if isinstance(rail.stress_free, float):
            key = f"rail.{name}.stress_free"
            item = known_to(key, rail.stress_free, FRACTION, unit="1")
            found.append(replace(item, lower=max(item.lower, 0.0), upper=min(item.upper, 1.0)))
        if isinstance(rail.fit_gap, float):
            found.append(known_to(f"rail.{name}.fit_gap", rail.fit_gap, MILLIMETRE))
    return found


def with_unknowns(plan: CalibrationPlan, unknowns: Sequence[Parameter]) -> CalibrationPlan:
    """Return a plan whose last stage fits further unknowns of the campaign too."""
    *stages, last = plan.stages
    if not plan.named(last.parameters):
        return plan
    names = (*last.parameters, *(item.name for item in unknowns))
    return CalibrationPlan(
        parameters=(*plan.parameters, *unknowns),
        stages=(*stages, replace(last, parameters=names)),
    )


def known_to(
    key: str, value: float, prior: float, *, unit: str = "m", keys: tuple[str, ...] | None = None
) -> Parameter:
    """Return a parameter for a key that is known to a standard deviation about a value.

    Examples
    --------
    >>> known_to("drive.1.over_travel_open", 2e-3, MILLIMETRE).upper
    0.008
    """
    return Parameter(
        name=key,
        keys=(key,) if keys is None else keys,
        start=value,
        lower=value - FURTHEST * prior,
        upper=value + FURTHEST * prior,
        unit=unit,
        transform="linear",
        prior=prior,
    )


def spread(count: int, most: int) -> list[int]:
    """Return at most so many numbers out of `count`, evenly spread, first and last among them.

    Examples
    --------
    >>> spread(10, 4)
    [0, 3, 6, 9]
    """
    if most <= 0 or count <= most:
        return list(range(count))
    if most == 1:
        return [0]
    return sorted({math.floor(i * (count - 1) / (most - 1) + 0.5) for i in range(most)})


# Objects nearer to each other than this are at one place, as run sheets state places [m].
SAME_PLACE = 0.05


def selected(
    movements: "Sequence[MeasuredMovement]", selection: Selection, panel: LoadedPanel
) -> "tuple[MeasuredMovement, ...]":
    """Return the movements that a stage uses.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        All there are.
    selection : Selection
        Objects, places, sizes and directions to include, and how many at most.
    panel : LoadedPanel
        Knows where places are.
    """
    found = [
        item
        for item in movements
        if (not selection.direction or item.direction == selection.direction)
        and (not selection.names or item.name in selection.names)
        and (selection.objects != NONE or item.size == 0)
        and (selection.objects != ANY or item.size > 0)
    ]
    if selection.place:
        x = resolve_objects(panel, [ForeignObject(1e-6, selection.place)])[-1].x
        found = [item for item in found if abs(item.x - x) <= SAME_PLACE]
    if selection.size is not None and found:
        wanted = selection.size
        nearest = min((item.size for item in found), key=lambda size: abs(size - wanted))
        found = [item for item in found if abs(item.size - nearest) < 1e-6]
    if selection.most and len(found) > selection.most:
        found.sort(key=lambda item: (item.size > 0, item.x if item.size else 0.0, item.size))
        # The largest force of a drive identifies the force at which it slips, or that it does not.
        hardest = {_hardest(found, name) for name in panel.drive}
        rest = [number for number in range(len(found)) if number not in hardest]
        evenly = spread(len(rest), max(selection.most - len(hardest), 1))
        found = [found[n] for n in sorted(hardest | {rest[number] for number in evenly})]
    return tuple(found)


def _hardest(movements: "Sequence[MeasuredMovement]", drive: str) -> int:
    """Return which movement has the largest force of a drive."""
    forces = [
        [
            np.nanmax(np.abs(s.values))
            for s in item.signals
            if (s.channel, s.drive) == ("drive_force", drive)
        ]
        for item in movements
    ]
    return int(np.argmax([max(found, default=0.0) for found in forces]))


# How well the thickness of an object and its place are known from a run sheet [m].
THICKNESS, PLACE = 0.2e-3, 50e-3
# What all objects are tried to be thicker by after a rough fit: whether a drive slips, or an object
# is touched, may change on the way, which no slope shows [m].
THICKER = (-1e-3, -0.5e-3, 0.5e-3, 1e-3)
_KIND = "object."
_THICKNESS, _PLACE = "thickness", "place"


def thickness_name(size: float = 0.0) -> str:
    """Return the name of what objects of a stated size, or all, are thicker than stated.

    Examples
    --------
    >>> thickness_name(0.013), thickness_name()
    ('object.13mm.thickness', 'object.thickness')
    """
    return f"{_KIND}{1e3 * size:g}mm.{_THICKNESS}" if size > 0 else _KIND + _THICKNESS


def shift_name(place: str = "") -> str:
    """Return the name of how much further from the toe objects at a stated place, or all, are.

    Examples
    --------
    >>> shift_name("sleeper 7"), shift_name()
    ('object.sleeper 7.place', 'object.place')
    """
    return f"{_KIND}{place}.{_PLACE}" if place else _KIND + _PLACE


def common_unknowns(movements: "Sequence[MeasuredMovement]") -> list[Parameter]:
    """Return what all objects of a campaign may be thicker by than its run sheet says [m]."""
    if not any(item.size > 0 for item in movements):
        return []
    return [known_to(thickness_name(), 0.0, THICKNESS, keys=())]


def own_thicknesses(movements: "Sequence[MeasuredMovement]") -> list[Parameter]:
    """Return the difference of each size of object from the common one [m]."""
    sizes = sorted({item.size for item in movements if item.size > 0})
    return [known_to(thickness_name(size), 0.0, THICKNESS, keys=()) for size in sizes]


def own_places(movements: "Sequence[MeasuredMovement]") -> list[Parameter]:
    """Return the difference of each place of objects from the common one [m]."""
    places = dict.fromkeys(item.place for item in movements if item.size > 0)
    return [known_to(shift_name(place), 0.0, PLACE, keys=()) for place in places]


def is_of_object(parameter: Parameter | Fitted) -> bool:
    """Return whether a parameter is of trapped objects."""
    return parameter.name.startswith(_KIND)


def is_thickness(name: str) -> bool:
    """Return whether the name of an unknown of objects is that of a thickness, not of a place."""
    return name.endswith(_THICKNESS)


def acts_on(parameter: Parameter, movement: "MeasuredMovement") -> bool:
    """Return whether a parameter of objects is of the one that a movement trapped."""
    own = (thickness_name(movement.size), shift_name(movement.place))
    return movement.size > 0 and parameter.name in (thickness_name(), shift_name(), *own)


def object_change(movement: "MeasuredMovement", values: Mapping[str, float]) -> tuple[float, float]:
    """Return how much thicker, and further from the toe, the object of a movement is [m].

    Parameters
    ----------
    movement : MeasuredMovement
        With an object.
    values : mapping of str to float
        Of a fit, by name.
    """
    thicker = values.get(thickness_name(), 0.0) + values.get(thickness_name(movement.size), 0.0)
    return thicker, values.get(shift_name(), 0.0) + values.get(shift_name(movement.place), 0.0)


def thrown_object(movement: "MeasuredMovement", values: Mapping[str, float]) -> tuple[str, float]:
    """Return place and size of the object of a movement at values; "none" and 0 without one [m]."""
    if not movement.size > 0:
        return movement.place, movement.size
    thicker, further = object_change(movement, values)
    place = f"x = {movement.x + further!r} m" if further else movement.place
    return place, movement.size + thicker


def object_lines(objects: Sequence[Fitted], *, leaves: float) -> list[str]:
    """Say which objects are not as the run sheet states them.

    Parameters
    ----------
    objects : sequence of Fitted
        What objects are thicker, and further from the toe, than stated [m].
    leaves : float
        How many stated deviations off is said [-].
    """
    lines = []
    for item in objects:
        thick = is_thickness(item.name)
        if abs(item.value) <= leaves * (THICKNESS if thick else PLACE):
            continue
        which = _which(item.name, thick=thick)
        digits, more = (2, ("thicker", "thinner")) if thick else (0, ("further", "less far"))
        size = f"{1e3 * abs(item.value):.{digits}f} ± {1e3 * item.deviation:.{digits}f} mm"
        way = more[item.value < 0.0] + ("" if thick else " from the toe")
        lines.append(f"objects: {which} are {size} {way} than the run sheet says; correct it")
    return lines


def _which(name: str, *, thick: bool) -> str:
    """Return which objects an unknown is of, in words."""
    what = name.removeprefix(_KIND).rpartition(".")[0]
    if not what:
        return "all"
    return f"those of {what.removesuffix('mm')} mm" if thick else f"those at {what}"
