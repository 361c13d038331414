"""Random scenarios: library panels changed by overrides, and small panels written as TOML.

One builder draws from anything that can choose: a seeded numpy Generator for the long job, so that
an index is a scenario for ever, or hypothesis, which can also make a failing scenario smaller.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np
from tests.verification.robustness_panels import small_panel

from turnout.core.scheme import Scheme
from turnout.core.toml import parse_toml
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.layout import largest_opening
from turnout.panel.load import LoadedPanel, load_panel, panel_from_file
from turnout.panel.model import Panel

T = TypeVar("T")
SEED = 20240607
LIFTED = 5.0
"""Clearance under every chair that no sag of a rail reaches [m]."""


class Chooser(Protocol):
    """Where a scenario gets its numbers from."""

    def integer(self, low: int, high: int) -> int:
        """Return an integer, both bounds included."""

    def number(self, low: float, high: float) -> float:
        """Return a number between the bounds."""


class Seeded:
    """Choices of a seeded generator."""

    def __init__(self, index: int) -> None:
        self._rng = np.random.default_rng([SEED, index])

    def integer(self, low: int, high: int) -> int:
        return int(self._rng.integers(low, high, endpoint=True))

    def number(self, low: float, high: float) -> float:
        return float(self._rng.uniform(low, high))


@dataclass(frozen=True, slots=True)
class Scenario:
    """A panel, its overrides, what is trapped, and the numerical choices.

    `source` is a library name or the text of a panel file; `special` names what is extreme.
    """

    source: str
    overrides: dict[str, float | None]
    objects: tuple[dict[str, Any], ...]
    step: float
    cutoff_frequency: float
    spectral_radius: float
    special: str

    def panel(self) -> LoadedPanel:
        """Return the checked panel."""
        written = "\n" in self.source
        panel = (
            panel_from_file(parse_toml(self.source, source="small panel"))
            if written
            else load_panel(self.source)
        )
        return panel.with_overrides(self.overrides)

    def foreign_objects(self) -> tuple[ForeignObject, ...]:
        """Return what is trapped."""
        return tuple(ForeignObject(**item) for item in self.objects)

    def scheme(self, *, step: float | None = None) -> Scheme:
        """Return the scheme, with another step if one is given."""
        scheme = Scheme(step=step or self.step, cutoff_frequency=self.cutoff_frequency)
        return replace(scheme, spectral_radius=self.spectral_radius)

    @property
    def kind(self) -> str:
        """Library name, or "small panel"."""
        return "small panel" if "\n" in self.source else self.source


def pick(choose: Chooser, options: Sequence[T]) -> T:
    """Return one of the options; the first is the plainest."""
    return options[choose.integer(0, len(options) - 1)]


def chance(choose: Chooser, share: float) -> bool:
    """Return true in about this share of cases."""
    return choose.integer(0, 99) >= round(100 * (1 - share))


def decades(choose: Chooser, centre: float, *, to_each_side: float = 3.0) -> float:
    """Return a positive number within so many decades to each side, as short as it is written."""
    return float(f"{centre * 10 ** choose.number(-to_each_side, to_each_side):.3g}")


def rounded(choose: Chooser, low: float, high: float) -> float:
    """Return a number with four digits between the bounds."""
    return min(max(float(f"{choose.number(low, high):.4g}"), low), high)


def numbered_scenario(index: int) -> Scenario:
    """Return the scenario of an index, the same on every machine."""
    return scenario(Seeded(index))


def scenario(choose: Chooser) -> Scenario:
    """Draw a scenario.

    Examples
    --------
    >>> numbered_scenario(7) == numbered_scenario(7)
    True
    """
    source = pick(choose, ("uic60-760-1-15", "sb1", "sb2", "small", "small"))
    special = pick(choose, ("plain", "plain", "plain", "lifted", "sticking", "slippery", "uneven"))
    overrides: dict[str, float | None] = {}
    if source == "small":
        source = small_panel(choose)
    else:
        overrides |= _times(choose, source)
        overrides |= _stiffnesses(choose, load_panel(source))
    plain = Scenario(source, overrides, (), 1e-3, 300.0, 0.5, special)
    plain = replace(plain, overrides=overrides | _supports(choose, plain.panel(), special))
    return replace(
        plain,
        objects=_objects(choose, plain.panel()),
        step=pick(choose, (1e-3, 1e-3, 2e-3, 5e-4, 4e-3)),
        cutoff_frequency=pick(choose, (300.0, 300.0, 100.0, 1000.0, 1e5)),
        spectral_radius=pick(choose, (0.5, 0.5, 0.0, 0.9, 1.0)),
    )


def _times(choose: Chooser, source: str) -> dict[str, float | None]:
    """Shorten the schedule; rests may have no length, and the return may start at once."""
    first = pick(choose, (0.0, 0.1))
    there, back = rounded(choose, 0.3, 1.2), rounded(choose, 0.3, 1.2)
    extra = pick(choose, (0.2, 0.0))
    turn = first + there + pick(choose, (0.0, 0.0, 0.2))
    found: dict[str, float | None] = {
        "movement.throw.start": first,
        "movement.throw.duration": there,
        "movement.return.start": turn,
        "movement.return.duration": back,
        "movement.return.extra_time.2": extra,
        "schedule.end": turn + back + extra + pick(choose, (0.0, 0.3)),
    }
    if source == "sb1":
        return found | {"object_defaults.appears": None, "object_defaults.disappears": None}
    return found | {"movement.ramp": pick(choose, (0.1, 0.0))}


def _stiffnesses(choose: Chooser, panel: Panel) -> dict[str, float | None]:
    """Spread stiffnesses over six decades around their defaults, some of them or all."""
    found: dict[str, float | None] = {}
    keys = {
        "chair.normal_stiffness": 1e7,
        "chair.stick_stiffness": 5e6,
        "stop.stiffness": 2e8,
        "object_defaults.stiffness": 4e7,
    }
    if panel.link:
        keys["link.stiffness"] = 5e7
        keys["stud.stiffness"] = 2e8
    share = pick(choose, (0.3, 0.0, 1.0))
    for key, centre in keys.items():
        if chance(choose, share):
            found[key] = decades(choose, centre)
    for name in panel.drive:
        if chance(choose, share):
            found[f"drive.{name}.stiffness"] = decades(choose, 1e6)
            found[f"drive.{name}.saturated_stiffness"] = pick(choose, (1e3, 0.0))
            found[f"drive.{name}.saturation_force"] = rounded(choose, 1e3, 2e4)
    if len(panel.rail) == 2 and not panel.stock_rail and chance(choose, 0.15):
        other, record = list(panel.rail.items())[1]
        found[f"rail.{other}.{'stock_rail_gap' if record.fit_gap is None else 'fit_gap'}"] = None
    return found


def _supports(choose: Chooser, panel: Panel, special: str) -> dict[str, float | None]:
    """Give all chairs a friction and a height, or each its own."""
    if special == "lifted":
        return {"chair.clearance": LIFTED, "chair.friction_coefficient": 0.4}
    if special == "sticking":
        return {"chair.friction_coefficient": 2.0}
    if special == "slippery":
        return {"chair.friction_coefficient": 0.0}
    found: dict[str, float | None] = {"chair.friction_coefficient": rounded(choose, 0.0, 1.0)}
    if special == "uneven":
        for name in panel.chair:
            found[f"chair.{name}.friction_coefficient"] = rounded(choose, 0.0, 1.0)
            found[f"chair.{name}.clearance"] = rounded(choose, -0.003, 0.006)
    return found


def _objects(choose: Chooser, panel: Panel) -> tuple[dict[str, Any], ...]:
    """Trap up to three objects, each at a station or anywhere, from 1 mm to the opening."""
    count = pick(choose, (1, 0, 2, 3))
    found = [_object(choose, panel) for _ in range(count)]
    return tuple(item for item in found if item is not None)


def _object(choose: Chooser, panel: Panel) -> dict[str, Any] | None:
    rails = [name for name, rail in panel.rail.items() if rail.has_stock_rail]
    if not rails:
        return None
    rail = pick(choose, rails)
    at, x = _place(choose, panel, rail)
    opening = largest_opening(panel, rail, x)
    if opening is None or opening < 1e-3:
        return None
    end = panel.schedule.end
    times: Mapping[str, float] = pick(
        choose,
        ({}, {"appears": 0.0}, {"appears": 0.0, "disappears": end / 2}, {"appears": end / 3}),
    )
    own = {"stiffness": decades(choose, 4e7)} if chance(choose, 0.3) else {}
    height = {"height": rounded(choose, 0.0, 0.15)} if chance(choose, 0.3) else {}
    size = rounded(choose, 1e-3, opening)
    return {"size": size, "at": at, "rail": rail, **times, **own, **height}


def _place(choose: Chooser, panel: Panel, rail: str) -> tuple[str, float]:
    families = ("sleeper", "drive", "sensor", "chair")
    stations = [
        (f"{family} {name}", item.x)
        for family in families
        for name, item in getattr(panel, family).items()
    ]
    if stations and chance(choose, 0.7):
        return pick(choose, stations)
    x = rounded(choose, panel.rail[rail].start, 0.8 * panel.rail[rail].end)
    return f"x = {x!r} m", x
