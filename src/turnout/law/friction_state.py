"""States of a slide chair by name: friction in motion and at rest, and its course over speed.

Rows of `FRICTION_STATES` are data: a new state is a new row. Levels count against that of a sound
chair, whose coefficient a panel gives, so that a calibrated coefficient scales all states alike.
Only few values are measured on slide chairs; each row says what it rests on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType

SOUND = 0.4
"""Coefficient of a sound chair in motion that the levels refer to: the paper's, from 0.1 to 0.5."""


FASTEST = 1.0
"""Speed from which on a coefficient stays as it is [m/s]; feet slide at 0.1 m/s at most."""
STRIBECK_SPEED = 0.005
"""Speed at which half of the excess at rest is left, unless given [m/s]."""


@dataclass(frozen=True, slots=True)
class FrictionCurve:
    """Friction coefficient over speed; see `turnout.law.friction.FrictionCourses.over_speed`.

    Attributes
    ----------
    level : float
        Coefficient in motion, or a factor of it [-].
    static_ratio : float
        Coefficient at rest over that in motion [-].
    stribeck_speed : float
        Speed at which half of the excess at rest is left [m/s].
    rise : float
        Share by which the coefficient rises per speed [s/m].
    """

    level: float
    static_ratio: float = 1.0
    stribeck_speed: float = STRIBECK_SPEED
    rise: float = 0.0

    @property
    def is_constant(self) -> bool:
        """True if speed changes nothing."""
        return self.static_ratio == 1.0 and self.rise == 0.0

    @property
    def largest(self) -> float:
        """Bound of the curve: its value at rest or at `FASTEST`, whichever is more [-].

        Examples
        --------
        >>> FrictionCurve(0.4, static_ratio=1.5, rise=2.0).largest
        1.2
        """
        return round(self.level * max(self.static_ratio, 1.0 + self.rise * FASTEST), 12)


@dataclass(frozen=True, slots=True)
class FrictionState:
    """Named state of a chair.

    Attributes
    ----------
    curve : FrictionCurve
        Its coefficients.
    least, most : float
        Range of the level [-].
    origin : str
        What level, range and curve rest on.
    """

    curve: FrictionCurve
    least: float
    most: float
    origin: str

    @property
    def factor(self) -> float:
        """Level over that of a sound chair [-].

        Examples
        --------
        >>> FRICTION_STATES["dry"].factor
        1.25
        """
        return self.curve.level / SOUND


FRICTION_STATES: Mapping[str, FrictionState] = MappingProxyType(
    {
        "sound": FrictionState(
            FrictionCurve(0.4, static_ratio=1.1, stribeck_speed=0.005),
            least=0.2,
            most=0.5,
            origin="level: paper, calibrated among 0.1 to 0.5; curve: assumption, oil in pores",
        ),
        "dry": FrictionState(
            FrictionCurve(0.5, static_ratio=1.3, stribeck_speed=0.01),
            least=0.4,
            most=0.6,
            origin="level and ratio: Serway's table, steel on steel 0.57 in motion, 0.74 at rest; "
            "speed: assumption",
        ),
        "rain": FrictionState(
            FrictionCurve(0.3, static_ratio=1.15, stribeck_speed=0.01),
            least=0.2,
            most=0.4,
            origin="level: falls with humidity, Olofsson and Sundvall 2004, by how much on a chair "
            "is an assumption; curve: assumption",
        ),
        "rust": FrictionState(
            FrictionCurve(0.6, static_ratio=1.4, stribeck_speed=0.01),
            least=0.5,
            most=0.8,
            origin="assumption: above dry steel, and more so at rest",
        ),
        "greased": FrictionState(
            FrictionCurve(0.12, static_ratio=1.05, stribeck_speed=0.01, rise=1.0),
            least=0.06,
            most=0.2,
            origin="level: Serway's table, lubricated metal 0.06 in motion, 0.15 at rest; curve: "
            "assumption, a boundary film whose friction hardly falls with speed",
        ),
    }
)
"""States by the name that a panel uses."""


@lru_cache(maxsize=256)
def curves_along(
    factors: tuple[float, ...], states: tuple[str, ...], own: tuple[float | None, ...]
) -> tuple[FrictionCurve, ...]:
    """Return curves along the stroke, their levels as factors of a sound chair's coefficient.

    Parameters
    ----------
    factors : tuple of float
        Further factor at each opening [-].
    states : tuple of str
        State at each opening, one for all of them, or none for a constant coefficient.
    own : tuple of (float or None)
        Static ratio [-], Stribeck speed [m/s] and rise [s/m] in place of those of the states.

    Examples
    --------
    >>> [curve.level for curve in curves_along((1.0, 2.0), ("dry",), (None, None, None))]
    [1.25, 2.5]
    """
    named = [
        replace(state.curve, level=state.factor)
        for state in map(FRICTION_STATES.__getitem__, states)
    ]
    if len(named) < 2:
        named = (named or [FrictionCurve(1.0)]) * len(factors)
    keys = ("static_ratio", "stribeck_speed", "rise")
    given = {key: value for key, value in zip(keys, own, strict=True) if value is not None}
    return tuple(
        replace(curve, level=curve.level * factor, **given)
        for curve, factor in zip(named, factors, strict=True)
    )
