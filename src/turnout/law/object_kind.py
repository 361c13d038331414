r"""Kinds of objects between two rails, one class each: values, force over compression, rest.

Each curve is a polyline through zero that `turnout.law.obstruction` gives a memory, and stands in
series with the stiffness of the contacts. With the area :math:`A` (length along the rail times
depth), the size :math:`s` and the compression :math:`e`:

- stone splits along the line of load at :math:`F = \sigma s^2`;
- ice is crushed at :math:`F = p A` until its first layer flakes off, from then on at the mean force
  of the cycles in which layer after layer fails;
- snow is compacted, :math:`F = p_{ice} A (\varrho / \varrho_{ice})^n` at the density
  :math:`\varrho = \varrho_0 s / (s - e_p)` with the lasting compression :math:`e_p`;
- wood across the grain and metal yield at :math:`F = \sigma A` and harden.

A class of `OBJECT_KINDS` is all there is to a kind. Sources, ranges and assumptions:
docs/use/objects.md.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from turnout.core.problems import choices, nearest, show_value
from turnout.core.units import DENSITY, LENGTH, MELTING, PRESSURE, TEMPERATURE, Dimension
from turnout.law.obstruction import CRUMBLES, NEVER, SPLITS
from turnout.law.table import Floats

ICE_PRESSURE, ICE_PRESSURE_RISE = 5e6, 0.5e6
"""Crushing pressure of ice at its melting point [Pa], and its rise with frost [Pa/K]."""
ICE_MODULUS, ICE_DENSITY = 9e9, 917.0
"""Young's modulus of ice [Pa], and its density [kg/m3]."""
ICE_CYCLE, LEAST_CYCLE, ICE_CRUSHED = 0.1, 0.5e-3, 0.3
"""Depth of one cycle of crushing over the size [-] and at least [m], and the share of it in which
ice is crushed before the rest flakes off [-]."""
SNOW_EXPONENT, SNOW_POINTS = 4.5, 12
"""Exponent of the strength of snow over its density [-], and number of points of its curve."""
WOOD_MODULUS, WOOD_PLATEAU, WOOD_DENSE = 0.4e9, (0.5, 2.0), (0.65, 10.0)
"""Across the grain: Young's modulus [Pa]; lasting strain and multiple of the strength at the
beginning and the end of compacting its cells."""
METAL_MODULUS, METAL_HARDENING = 210e9, 2e9
"""Young's modulus of steel and modulus of its hardening [Pa]."""
LEAST_PIECE = 1e-3
"""A smaller piece of stone falls out [m]."""


@dataclass(frozen=True, slots=True)
class ObjectParameter:
    """Parameter of a kind of object beyond place, size and stiffness of its contacts.

    Attributes
    ----------
    default : float or None
        None: the size for lengths; ice: the strength that follows from the temperature.
    least, most : float
        Range [SI].
    origin : str
        "source", "assumption" or "definition", with what it refers to.
    """

    default: float | None
    least: float
    most: float
    origin: str


ALONG = ObjectParameter(None, 1e-3, 10.0, "definition: as long as it is wide")
UPRIGHT = ObjectParameter(None, 1e-3, 0.2, "definition: as deep as it is wide")
FROST = (233.15, 273.15)
DIMENSIONS: Mapping[str, Dimension] = MappingProxyType(
    {
        "length": LENGTH,
        "depth": LENGTH,
        "strength": PRESSURE,
        "density": DENSITY,
        "temperature": TEMPERATURE,
    }
)
"""Of the parameters; a piece is a plain number."""
PARAMETERS = (*DIMENSIONS, "piece")


@dataclass(frozen=True, slots=True, eq=False)
class Compression:
    """A curve of force over compression, with its failure.

    Attributes
    ----------
    breakpoints : ndarray, shape (n,)
        Rising compressions between the segments, the first of them 0 [m].
    slopes : ndarray, shape (n + 1,)
        Of the segments; the first is free [N/m].
    breaks : int
        See `turnout.law.obstruction`.
    piece, limit, crushed, least : float
        See `turnout.law.obstruction.Obstructions`.
    """

    breakpoints: Floats
    slopes: Floats
    breaks: int = NEVER
    piece: float = 0.0
    limit: float = 0.0
    crushed: float = 0.0
    least: float = 0.0

    @property
    def unloading(self) -> float:
        """Stiffness on the way back [N/m]."""
        return float(self.slopes[1])

    def lasting(self, deepest: float) -> float:
        """Return the compression that a deepest one leaves without force [m]."""
        if deepest <= 0.0:
            return 0.0
        lengths = np.diff(np.minimum(np.append(self.breakpoints, np.inf), deepest))
        return max(0.0, deepest - float(lengths @ self.slopes[1:]) / self.unloading)


def ice_pressure(temperature: float) -> float:
    """Return the crushing pressure of ice [Pa] at a temperature [K].

    Examples
    --------
    >>> ice_pressure(263.15) / 1e6
    10.0
    """
    return ICE_PRESSURE + ICE_PRESSURE_RISE * max(MELTING - temperature, 0.0)


def snow_pressure(density: float | Floats, temperature: float) -> Floats:
    """Return the pressure that compacts snow [Pa] at a density [kg/m3] and a temperature [K].

    Examples
    --------
    >>> round(float(snow_pressure(400.0, 268.15)) / 1e6, 3)
    0.179
    """
    return np.asarray(ice_pressure(temperature) * (density / ICE_DENSITY) ** SNOW_EXPONENT)


def in_series(*stiffness: float) -> float:
    """Return the stiffness of springs in series [N/m]."""
    return 1.0 / sum(1.0 / k for k in stiffness)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trapped:
    """An object between two rails wherever it is, in SI.

    Parameters
    ----------
    kind : str
        Of `OBJECT_KINDS`.
    size : float
        Extent across the gap [m].
    stiffness : float
        In compression only [N/m].
    length, depth, strength, density, temperature, piece : float
        Parameters of its kind, 0 for those that it does not have [SI].
    lost, deepest : float
        Size that broke off before, and the largest compression of the rest [m].
    broken : int
        How often it broke before.
    """

    kind: str = "spring"
    size: float
    stiffness: float
    length: float = 0.0
    depth: float = 0.0
    strength: float = 0.0
    density: float = 0.0
    temperature: float = 0.0
    piece: float = 0.0
    lost: float = 0.0
    deepest: float = 0.0
    broken: int = 0

    @property
    def of_kind(self) -> "ObjectKind":
        """Class of its kind, with force over compression and rest."""
        return OBJECT_KINDS[self.kind]


class ObjectKind:
    """A kind of object; elastic for ever, as in the paper, unless it says otherwise.

    Attributes
    ----------
    parameters : mapping of str to ObjectParameter
        Its values beyond place, size and stiffness of its contacts.
    remembers : bool
        Whether it dents or breaks.
    breaks : bool
        Whether it breaks.
    breaks_late : bool
        Whether it yields at its strength and breaks after some more compression.
    breaks_again : bool
        Whether it leaves a piece that may break too, mostly on a blow.
    learned : bool
        Whether a detector learns it beside objects that stay as they are.
    growth : str
        Value of a drift that says what it gains after a throw in frost, and that it melts; or none.
    """

    parameters: Mapping[str, ObjectParameter] = MappingProxyType({})
    remembers = True
    breaks = False
    breaks_late = breaks_again = False
    learned = False
    growth = ""

    def strength(self, item: Trapped) -> float:
        """Return the strength of an object [Pa]."""
        return item.strength

    def curve(self, item: Trapped) -> Compression:
        """Return force over compression, of the size without the part that broke off before."""
        return Compression(np.zeros(1), np.array([0.0, item.stiffness]))

    def left(
        self,
        item: Trapped,
        *,
        lost: float,
        deepest: float,
        dent: float,
        changes: bool,
        broke: bool,
    ) -> dict[str, float]:
        """Return the changes of an object by a throw.

        Parameters
        ----------
        item : Trapped
            Before the throw.
        lost, deepest, dent : float
            Size that is gone, largest compression, and lasting dent [m].
        changes : bool
            Whether the weather changes it until the next throw.
        broke : bool
            Whether it broke, now or before.
        """
        del item, dent, changes, broke
        return {"lost": lost, "deepest": deepest}

    def grown(self, item: Trapped, change: float, fresh: float) -> dict[str, float]:
        """Return the changes by growth [m] of a density if fresh [kg/m3], or by melting."""
        del fresh
        return {"size": item.size + change}


class Spring(ObjectKind):
    """Elastic for ever, as in the paper."""

    remembers = False


class Stone(ObjectKind):
    """Elastic, then it splits and leaves a piece of its size."""

    parameters = MappingProxyType(
        {
            "strength": ObjectParameter(
                20e6, 1e6, 200e6, "source: granite 10-45 MPa, doi.org/10.1617/s11527-019-1380-7"
            ),
            "piece": ObjectParameter(
                0.5, 0.0, 0.95, "assumption: one half stays, the other falls out"
            ),
        }
    )
    breaks = breaks_again = learned = True

    def curve(self, item: Trapped) -> Compression:
        """Return force over compression; its strength is splitting force over size squared.

        Examples
        --------
        >>> item = Trapped(kind="stone", size=0.02, stiffness=40e6, strength=20e6, piece=0.5)
        >>> curve = item.of_kind.curve(item)
        >>> float(curve.breakpoints[1] * curve.slopes[1])  # splits at 8 kN
        8000.0
        """
        contact, size = item.stiffness, item.size - item.lost
        limit = item.strength * size**2 / contact
        slopes = np.array([0.0, contact, 0.0])
        return Compression(np.array([0.0, limit]), slopes, SPLITS, item.piece, least=LEAST_PIECE)


class Ice(ObjectKind):
    """Elastic, crushed at its strength until a layer flakes off, then at the mean force."""

    parameters = MappingProxyType(
        {
            "length": ALONG,
            "depth": UPRIGHT,
            "temperature": ObjectParameter(263.15, *FROST, "assumption: frost of -10 degC"),
            "strength": ObjectParameter(
                None, 0.5e6, 100e6, "assumption: 5 MPa and 0.5 MPa more for each kelvin of frost"
            ),
            "piece": ObjectParameter(
                0.2, 0.0, 0.95, "assumption: crushed ice that is not pressed out"
            ),
        }
    )
    breaks = breaks_late = learned = True
    growth = "ice_growth"

    def strength(self, item: Trapped) -> float:
        """Return the crushing pressure [Pa], which may follow from the temperature."""
        return item.strength or ice_pressure(item.temperature)

    def curve(self, item: Trapped) -> Compression:
        """Return force over compression; the cycle stays that of the whole size.

        Examples
        --------
        >>> given = {"size": 0.02, "length": 0.02, "depth": 0.02, "strength": 10e6, "piece": 0.2}
        >>> item = Trapped(kind="ice", stiffness=40e6, **given)
        >>> round(item.of_kind.curve(item).crushed), round(item.of_kind.curve(item).limit, 6)
        (1322, 0.000722)
        """
        size, area = item.size, item.length * item.depth
        stiffness = in_series(item.stiffness, ICE_MODULUS * area / size)
        force, cycle = self.strength(item) * area, max(ICE_CYCLE * size, LEAST_CYCLE)
        mean = mean_force(force, stiffness=stiffness, cycle=cycle)
        depth, first = (1.0 - item.piece) * size - item.lost, ICE_CRUSHED * cycle
        broken = item.broken > 0
        if broken:
            force = mean
        if depth <= 0.0:
            return Compression(np.zeros(1), np.array([0.0, stiffness]))
        reach = force / stiffness
        return Compression(
            np.array([0.0, reach, reach + depth]),
            np.array([0.0, stiffness, 0.0, stiffness]),
            NEVER if broken or depth <= first else CRUMBLES,
            limit=reach + first,
            crushed=mean,
            least=item.piece * size,
        )

    def left(
        self,
        item: Trapped,
        *,
        lost: float,
        deepest: float,
        dent: float,
        changes: bool,
        broke: bool,
    ) -> dict[str, float]:
        """Return its changes by a throw: crushed ice is gone."""
        if changes or broke:
            return {"lost": lost + dent, "deepest": 0.0}
        return {"lost": lost, "deepest": deepest}


class Snow(ObjectKind):
    """Compacted up to the density of ice, since it cannot get away."""

    parameters = MappingProxyType(
        {
            "length": ObjectParameter(0.2, 1e-3, 10.0, "assumption"),
            "depth": ObjectParameter(0.04, 1e-3, 0.2, "assumption: the height of the rail's head"),
            "temperature": ObjectParameter(268.15, *FROST, "assumption: frost of -5 degC"),
            "density": ObjectParameter(300.0, 50.0, 900.0, "assumption: settled snow"),
        }
    )
    learned = True
    growth = "snow_growth"

    def curve(self, item: Trapped) -> Compression:
        """Return force over compression."""
        size, area = item.size - item.lost, item.length * item.depth
        stiffness = in_series(item.stiffness, ICE_MODULUS * area / size)
        densities = np.geomspace(min(item.density, ICE_DENSITY - 1.0), ICE_DENSITY, SNOW_POINTS)
        force = snow_pressure(densities, item.temperature) * area
        return hardening(size * (1.0 - densities[0] / densities), force, stiffness)

    def left(
        self,
        item: Trapped,
        *,
        lost: float,
        deepest: float,
        dent: float,
        changes: bool,
        broke: bool,
    ) -> dict[str, float]:
        """Return its changes by a throw.

        With its imprint it is thinner and denser snow, whose strength goes on about where it was.
        """
        del broke
        if changes:
            size = item.size - dent
            return {"size": size, "density": item.density * item.size / size, "deepest": 0.0}
        return {"lost": lost, "deepest": deepest}

    def grown(self, item: Trapped, change: float, fresh: float) -> dict[str, float]:
        """Return size and density after snow has fallen, or melted."""
        size = item.size + change
        if change <= 0.0:
            return {"size": size}
        return {"size": size, "density": (item.density * item.size + fresh * change) / size}


class Wood(ObjectKind):
    """Across the grain: its cells give way, then are compacted."""

    parameters = MappingProxyType(
        {
            "length": ALONG,
            "depth": UPRIGHT,
            "strength": ObjectParameter(5e6, 0.5e6, 100e6, "assumption: softwood across the grain"),
        }
    )
    learned = True

    def curve(self, item: Trapped) -> Compression:
        """Return force over compression."""
        size, area = item.size - item.lost, item.length * item.depth
        stiffness = in_series(item.stiffness, WOOD_MODULUS * area / size)
        strain, multiple = np.array([(0.0, 1.0), WOOD_PLATEAU, WOOD_DENSE]).T
        return hardening(strain * size, multiple * item.strength * area, stiffness)


class Metal(ObjectKind):
    """Elastic, then it yields and hardens, up to half of its size, which no drive reaches."""

    parameters = MappingProxyType(
        {
            "length": ALONG,
            "depth": UPRIGHT,
            "strength": ObjectParameter(
                235e6, 10e6, 2000e6, "definition: yield point of steel S235"
            ),
        }
    )

    def curve(self, item: Trapped) -> Compression:
        """Return force over compression."""
        size, area = item.size - item.lost, item.length * item.depth
        stiffness = in_series(item.stiffness, METAL_MODULUS * area / size)
        strain = np.array([0.0, 0.5])
        force = item.strength * area + METAL_HARDENING * area * strain
        return hardening(strain * size, force, stiffness)


OBJECT_KINDS: dict[str, ObjectKind] = {
    "spring": Spring(),
    "stone": Stone(),
    "ice": Ice(),
    "snow": Snow(),
    "wood": Wood(),
    "metal": Metal(),
}


def mean_force(force: float, *, stiffness: float, cycle: float) -> float:
    """Return the mean force of ice over a cycle of a saw-tooth [N].

    Parameters
    ----------
    force : float
        At which it is crushed over a share of the cycle [N].
    stiffness : float
        Elastic; a layer that has flaked off relieves it by the rest of the cycle [N/m].
    cycle : float
        Thickness of a layer [m].
    """
    left = max(force - stiffness * (1.0 - ICE_CRUSHED) * cycle, 0.0)
    return ICE_CRUSHED * force + (force**2 - left**2) / (2.0 * stiffness * cycle)


def hardening(lasting: Floats, force: Floats, stiffness: float) -> Compression:
    """Return a curve through forces [N] at lasting compressions [m], elastic beyond the last.

    Parameters
    ----------
    lasting, force : ndarray, shape (n,)
        Both rising; the first lasting compression is 0.
    stiffness : float
        Elastic [N/m].

    Examples
    --------
    >>> curve = hardening(np.array([0.0, 0.01]), np.array([100.0, 300.0]), 1e5)
    >>> curve.breakpoints.round(9).tolist(), curve.slopes.round().tolist()
    ([0.0, 0.001, 0.013], [0.0, 100000.0, 16667.0, 100000.0])
    """
    compression = lasting + force / stiffness
    inner = np.diff(force) / np.diff(compression)
    return Compression(
        np.concatenate(([0.0], compression)),
        np.concatenate(([0.0, stiffness], inner, [stiffness])),
    )


def kind_faults(kind: str, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Find the faults of the kind of an object and its parameters: key and text of each.

    Parameters
    ----------
    kind : str
        Its kind.
    given : mapping
        Parameters by name, in SI; None where one is left out.
    """
    if kind not in OBJECT_KINDS:
        text = f" = {show_value(kind)}: there is no such kind; there are {choices(OBJECT_KINDS)}"
        yield "kind", text + nearest(kind, OBJECT_KINDS)
        return
    known = OBJECT_KINDS[kind].parameters
    for name, value in given.items():
        if value is None:
            continue
        if name not in known:
            has = f"it has {choices(known)}" if known else "it has size and stiffness alone"
            owners = choices(
                [other for other, its in OBJECT_KINDS.items() if name in its.parameters]
            )
            yield name, f": an object of kind '{kind}' has none, {has}; for {owners}"
            continue
        limits, unit = known[name], DIMENSIONS[name].unit if name in DIMENSIONS else ""
        scale, unit = (1e6, "MPa") if unit == PRESSURE.unit else (1.0, unit)
        if not limits.least <= value <= limits.most:
            text = f"must be {limits.least / scale:g} to {limits.most / scale:g} {unit}".rstrip()
            yield name, f" = {value / scale:g} {unit}".rstrip() + f": {text}"


def filled_parameters(kind: str, given: Mapping[str, Any], *, size: float) -> dict[str, float]:
    """Return all parameters of a known kind; zero for those that it does not have.

    Examples
    --------
    >>> filled_parameters("stone", {"piece": 0.0}, size=0.02)["strength"]
    20000000.0
    """
    found = dict.fromkeys(PARAMETERS, 0.0)
    for name, parameter in OBJECT_KINDS[kind].parameters.items():
        value = given.get(name)
        if value is None:
            value = parameter.default
        if value is None:
            value = size if DIMENSIONS[name] is LENGTH else 0.0
        found[name] = float(value)
    return found
