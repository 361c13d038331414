"""Random part of a study: fields along the switch, correlations, draws; friction by temperature.

A random field gives each member of a family a value, alike where members stand near each other. A
temperature law multiplies values of the panel, as a rule the friction of the chairs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from turnout.core.errors import PanelError
from turnout.core.problems import choices, nearest, show_value
from turnout.core.units import (
    LENGTH,
    TEMPERATURE,
    TEMPERATURE_COEFFICIENT,
    Dimension,
    parse_quantity,
)
from turnout.study.distribution import PROBABILITY_MARGIN, Distribution, normal_share
from turnout.study.study_file import StudyRecord
from turnout.study.variable import TEMPERATURE_KEY, value_kind
from turnout.study.variables import ParsedStudy, read_field_law

FloatArray = npt.NDArray[np.float64]
# Added to the diagonal: a Gaussian correlation of close places is singular in rounding [-].
JITTER = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomField:
    """A Gaussian field along x, seen through the quantiles of a distribution.

    Attributes
    ----------
    name : str
        Of the field in the results.
    key : str
        Family and field of the panel, such as "chair.friction_coefficient".
    members : tuple of str
        Names of the members, in the order of `x`.
    x : tuple of float
        Their places [m].
    distribution : Distribution
        Of the value at each place.
    correlation_length : float
        Distance in which the correlation falls to 1/e [m].
    correlation : str
        "exponential", :math:`e^{-d/L}`, rough, or "gaussian", :math:`e^{-(d/L)^2}`, smooth.
    factor : bool
        Whether its values multiply those of the panel instead of replacing them.
    """

    name: str
    key: str
    members: tuple[str, ...]
    x: tuple[float, ...]
    distribution: Distribution
    correlation_length: float
    correlation: str = "exponential"
    factor: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """Full key of each member in the panel, such as "chair.5.friction_coefficient"."""
        return _member_keys(self.key, self.members)

    def values(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw a value for each member, in SI or as a factor [-].

        Examples
        --------
        >>> law = Distribution(kind="uniform", parameters={"minimum": 0.1, "maximum": 0.3})
        >>> field = RandomField(
        ...     name="friction", key="chair.friction_coefficient", members=("1", "2"), x=(0.0, 0.6),
        ...     distribution=law, correlation_length=2.0,
        ... )
        >>> list(field.values(np.random.default_rng(1)))
        ['1', '2']
        """
        return dict(zip(self.members, self.drawn([rng])[0].tolist(), strict=True))

    def drawn(self, generators: Sequence[np.random.Generator]) -> FloatArray:
        """Return the `values` of some generators, shape (n_generators, n_members)."""
        root = _root_at(tuple(self.x), self.correlation_length, self.correlation)
        # One product each, so that a draw is the same to the last bit whatever it is drawn with.
        scores = [root @ rng.standard_normal(len(self.x)) for rng in generators]
        shares = normal_share(np.array(scores).reshape(-1, len(self.x)))
        return self.distribution.quantile(
            np.clip(shares, PROBABILITY_MARGIN, 1.0 - PROBABILITY_MARGIN)
        )


@lru_cache(maxsize=16)
def _member_keys(key: str, members: tuple[str, ...]) -> tuple[str, ...]:
    """Return a key of a family with the name of each member in it."""
    family, _, below = key.partition(".")
    return tuple([f"{family}.{member}.{below}" for member in members])


@lru_cache(maxsize=16)
def _root_at(x: tuple[float, ...], length: float, kind: str) -> FloatArray:
    """Return `correlation_root`, found once for all draws of a field."""
    root = correlation_root(np.array(x), length=length, kind=kind)
    root.flags.writeable = False
    return root


def correlation_root(x: FloatArray, *, length: float, kind: str) -> FloatArray:
    """Return the Cholesky factor of the correlation between places.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Places [m].
    length : float
        Distance in which the correlation falls to 1/e [m].
    kind : str
        "exponential" or "gaussian".

    Returns
    -------
    ndarray, shape (n, n)
        Lower triangle; with its transpose it gives the correlation.

    Examples
    --------
    >>> root = correlation_root(np.array([0.0, 2.0]), length=2.0, kind="exponential")
    >>> round(float((root @ root.T)[0, 1]), 6)
    0.367879
    """
    distance = np.abs(x[:, np.newaxis] - x[np.newaxis, :]) / length
    matrix = np.exp(-distance) if kind == "exponential" else np.exp(-(distance**2))
    jittered = (matrix + JITTER * np.eye(x.size)) / (1.0 + JITTER)
    return np.linalg.cholesky(jittered).astype(np.float64)


FRICTION_KEY = "chair.friction_coefficient"


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureLaw:
    r"""A factor on values of the panel as a function of temperature.

    Either linear,

    .. math:: f(T) = 1 + c\,(T - T_0),

    or from a table between whose points the factor is linear. Beyond the table there is no law.

    Attributes
    ----------
    key : str
        Key whose values are multiplied.
    reference : float
        :math:`T_0` [K].
    coefficient : float
        :math:`c` [1/K].
    temperatures, factors : tuple of float
        The table [K], [-]; empty for the linear law.
    """

    key: str = FRICTION_KEY
    reference: float = 293.15
    coefficient: float = 0.0
    temperatures: tuple[float, ...] = ()
    factors: tuple[float, ...] = ()

    def factor(self, temperature: float) -> float:
        """Return the factor at a temperature [K].

        Examples
        --------
        >>> TemperatureLaw(coefficient=-0.01).factor(303.15)
        0.9
        >>> TemperatureLaw(temperatures=(250.0, 290.0), factors=(1.5, 1.0)).factor(270.0)
        1.25
        """
        if self.temperatures:
            return float(np.interp(temperature, self.temperatures, self.factors))
        return round(1.0 + self.coefficient * (temperature - self.reference), 12)

    def faults(self, least: float, largest: float) -> list[str]:
        """Return the faults that keep the law from holding between two temperatures [K]."""
        problems = []
        if self.temperatures:
            ends = self.temperatures[0], self.temperatures[-1]
            if least < ends[0] or largest > ends[1]:
                low, high = map(format_celsius, ends)
                problems.append(
                    f"the law is given from {low} to {high}, "
                    f"the study goes from {format_celsius(least)} to {format_celsius(largest)}"
                )
        lowest = min(self.factor(least), self.factor(largest), *self.factors)
        if not lowest > 0:
            problems.append(
                f"friction would be {lowest:.2g} times that of the panel between "
                f"{format_celsius(least)} and {format_celsius(largest)}; must stay more than 0"
            )
        return problems


def format_celsius(temperature: float) -> str:
    """Show a temperature in degrees Celsius.

    Examples
    --------
    >>> format_celsius(253.15)
    '-20 °C'
    """
    return f"{temperature - 273.15:.4g} °C"


MOST_SCENARIOS = 10_000_000


def read_quantity(
    parsed: ParsedStudy, where: str, value: object, dimension: Dimension
) -> float | None:
    """Read a quantity; note a value that is not one, and return None."""
    try:
        return parse_quantity(value, dimension)
    except ValueError as error:
        parsed.add_problem(where, f" = {show_value(value)}: {error}")
        return None


def read_fields(parsed: ParsedStudy, record: StudyRecord) -> list[RandomField]:
    """Read the random fields of a study."""
    fields_read: list[RandomField] = []
    for number, item in enumerate(record.field, 1):
        where = f"field {number} ({item.key})"
        read = read_field_law(parsed, item, where=where)
        length = read_quantity(
            parsed, f"{where}.correlation_length", item.correlation_length, LENGTH
        )
        if length is not None and not length > 0:
            parsed.add_problem(f"{where}.correlation_length", ": must be more than 0")
        if read is None or length is None or not length > 0:
            continue
        variable, law = read
        if variable.name in {*parsed.variables, *(known.name for known in fields_read)}:
            text = f': the name "{variable.name}" is already used; give it another `name`'
            parsed.add_problem(where, text)
            continue
        family, _, below = item.key.partition(".")
        members = getattr(parsed.panel, family, {})
        if not isinstance(members, dict) or below.split(".")[0] in members or not members:
            parsed.add_problem(
                where, ": a field goes over a family, such as chair.friction_coefficient"
            )
            continue
        placed = {name: getattr(member, "x", None) for name, member in members.items()}
        if not all(isinstance(x, float) for x in placed.values()):
            parsed.add_problem(where, f": the members of {family} have no places along the switch")
            continue
        fields_read.append(
            RandomField(
                name=variable.name,
                key=item.key,
                members=tuple(placed),
                x=tuple(float(str(x)) for x in placed.values()),
                distribution=law,
                correlation_length=length,
                correlation=item.correlation,
                factor=item.factor,
            )
        )
    return fields_read


def read_law_of_temperature(parsed: ParsedStudy, record: StudyRecord) -> TemperatureLaw | None:
    """Read the effect of temperature; needed if temperature varies."""
    given = record.temperature_law
    varies = any(item.key == TEMPERATURE_KEY for item in parsed.variables.values())
    if given is None:
        if varies:
            text = ": temperature varies, so say what it does in a table [temperature_law]"
            parsed.add_problem("temperature_law", text)
        return None
    where = "temperature_law"
    if not varies:
        parsed.add_problem(where, ': needs a variable with key = "temperature"')
    try:
        if not parsed.panel.values_at(given.key) or value_kind(parsed.panel, given.key) is str:
            parsed.add_problem(where, f'.key = "{given.key}": has no number that can be multiplied')
    except (ValueError, PanelError):
        parsed.add_problem(where, f'.key = "{given.key}": matches nothing in this panel')
    linear = given.reference is not None and given.coefficient is not None
    table = given.temperature is not None and given.factor is not None
    if linear == table:
        parsed.add_problem(
            where, ": needs either reference and coefficient, or temperature and factor"
        )
        return None
    if linear:
        reference = read_quantity(parsed, f"{where}.reference", given.reference, TEMPERATURE)
        slope = read_quantity(
            parsed, f"{where}.coefficient", given.coefficient, TEMPERATURE_COEFFICIENT
        )
        if reference is None or slope is None:
            return None
        return TemperatureLaw(key=given.key, reference=reference, coefficient=slope)
    read = [
        read_quantity(parsed, f"{where}.temperature", t, TEMPERATURE)
        for t in given.temperature or []
    ]
    temperatures = [item for item in read if item is not None]
    factors = [float(item) for item in given.factor or []]
    if any(a >= b for a, b in zip(temperatures, temperatures[1:], strict=False)):
        parsed.add_problem(f"{where}.temperature", ": must rise")
    if len(read) != len(factors):
        parsed.add_problem(
            f"{where}.factor", f": has {len(factors)} values for {len(read)} temperatures"
        )
    return TemperatureLaw(key=given.key, temperatures=tuple(temperatures), factors=tuple(factors))


def sampling_faults(method: str, count: int, drawn: int, with_fields: bool) -> list[str]:
    """Return the faults in method and count of the draws."""
    where, faults = f"sampling.count = {count}", []
    if count < 1:
        faults.append(f"{where}: must be at least 1, or there is no scenario")
    elif method in ("sobol", "saltelli") and count & (count - 1):
        near = 1 << round(math.log2(count))
        faults.append(f"{where}: must be a power of 2 for '{method}'; near is {near}")
    if count > MOST_SCENARIOS:
        faults.append(f"{where}: at most {MOST_SCENARIOS}")
    if method == "saltelli" and with_fields:
        faults.append(
            'sampling.method = "saltelli": it cannot sample random fields; leave them out'
        )
    if method != "random" and not drawn:
        faults.append(f"sampling.method = \"{method}\": no variable is drawn; use 'random'")
    return faults


def read_pairs(
    parsed: ParsedStudy, record: StudyRecord, names: list[str]
) -> list[tuple[str, str, float]]:
    """Read the pairs of correlated variables: two names and their rank correlation."""
    pairs: list[tuple[str, str, float]] = []
    for number, item in enumerate(record.correlation, 1):
        where = f"correlation {number}.between"
        unknown = [name for name in item.between if name not in names]
        for name in unknown:
            text = f": is not a drawn variable{nearest(name, names)}; there are {choices(names)}"
            parsed.add_problem(where, f' = "{name}"{text}')
        first, second = item.between
        if first == second:
            parsed.add_problem(where, f' = "{first}": twice the same')
        elif any({first, second} == {a, b} for a, b, _ in pairs):
            parsed.add_problem(where, f': "{first}" and "{second}" are there already')
        elif not unknown:
            pairs.append((first, second, item.rank_correlation))
    return pairs
