r"""Force over compression of an object between two rails: stone, ice, snow, wood, metal.

Each is a polyline through zero that `turnout.law.obstruction` gives a memory, and stands in series
with the stiffness of the contacts. With the area :math:`A` (length along the rail times depth), the
size :math:`s` and the compression :math:`e`:

- stone splits along the line of load at :math:`F = \sigma s^2`;
- ice is crushed at :math:`F = p A` until its first layer flakes off, from then on at the mean force
  of the cycles in which layer after layer fails;
- snow is compacted, :math:`F = p_{ice} A (\varrho / \varrho_{ice})^n` at the density
  :math:`\varrho = \varrho_0 s / (s - e_p)` with the lasting compression :math:`e_p`;
- wood across the grain and metal yield at :math:`F = \sigma A` and harden.

Sources, ranges and assumptions: docs/use/objects.md.
"""

from dataclasses import dataclass

import numpy as np

from turnout.core.units import MELTING
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
"""Of the strength of snow over its density [-], and how many points of the curve are taken."""
WOOD_MODULUS, WOOD_PLATEAU, WOOD_DENSE = 0.4e9, (0.5, 2.0), (0.65, 10.0)
"""Across the grain: Young's modulus [Pa]; lasting strain and multiple of the strength at the
beginning and the end of compacting its cells."""
METAL_MODULUS, METAL_HARDENING = 210e9, 2e9
"""Young's modulus of steel and modulus of its hardening [Pa]."""
LEAST_PIECE = 1e-3
"""A smaller piece of stone falls out [m]."""


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


def stone(*, size: float, strength: float, contact: float, piece: float) -> Compression:
    """Return the curve of a stone: elastic, then it splits and leaves a `piece` of its size [-].

    Parameters
    ----------
    size : float
        [m].
    strength : float
        Splitting force over the square of the size [Pa].
    contact : float
        Stiffness of the contacts [N/m].

    Examples
    --------
    >>> curve = stone(size=0.02, strength=20e6, contact=40e6, piece=0.5)
    >>> float(curve.breakpoints[1] * curve.slopes[1])  # splits at 8 kN
    8000.0
    """
    limit = strength * size**2 / contact
    return Compression(
        np.array([0.0, limit]), np.array([0.0, contact, 0.0]), SPLITS, piece, least=LEAST_PIECE
    )


def ice(
    *,
    size: float,
    area: float,
    strength: float,
    contact: float,
    piece: float,
    lost: float = 0.0,
    broken: bool = False,
) -> Compression:
    """Return the curve of ice: elastic, crushed at its strength, then down to a `piece` of it [-].

    Parameters
    ----------
    lost : float
        Taken from the size before [m].
    broken : bool
        Whether its first layer has flaked off: it is then crushed at the mean force.

    Examples
    --------
    >>> curve = ice(size=0.02, area=4e-4, strength=10e6, contact=40e6, piece=0.2)
    >>> round(curve.crushed), round(curve.limit, 6)
    (1322, 0.000722)
    """
    stiffness = in_series(contact, ICE_MODULUS * area / size)
    force, cycle = strength * area, max(ICE_CYCLE * size, LEAST_CYCLE)
    mean = mean_force(force, stiffness=stiffness, cycle=cycle)
    depth, first = (1.0 - piece) * size - lost, ICE_CRUSHED * cycle
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
        least=piece * size,
    )


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


def snow(
    *, size: float, area: float, density: float, temperature: float, contact: float
) -> Compression:
    """Return the curve of snow that cannot get away: compacted up to the density of ice."""
    stiffness = in_series(contact, ICE_MODULUS * area / size)
    densities = np.geomspace(min(density, ICE_DENSITY - 1.0), ICE_DENSITY, SNOW_POINTS)
    force = snow_pressure(densities, temperature) * area
    return hardening(size * (1.0 - densities[0] / densities), force, stiffness)


def wood(*, size: float, area: float, strength: float, contact: float) -> Compression:
    """Return the curve of wood across the grain: cells give way, then are compacted."""
    stiffness = in_series(contact, WOOD_MODULUS * area / size)
    strain, multiple = np.array([(0.0, 1.0), WOOD_PLATEAU, WOOD_DENSE]).T
    return hardening(strain * size, multiple * strength * area, stiffness)


def metal(*, size: float, area: float, strength: float, contact: float) -> Compression:
    """Return the curve of metal: it yields and hardens, up to half of its size."""
    stiffness = in_series(contact, METAL_MODULUS * area / size)
    yields = strength * area
    strain = np.array([0.0, 0.5])
    return hardening(strain * size, yields + METAL_HARDENING * area * strain, stiffness)


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
