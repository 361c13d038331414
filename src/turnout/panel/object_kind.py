"""Kinds of foreign objects: the parameters of each, with defaults, ranges and their origin."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from turnout.core.problems import choices, nearest, show_value
from turnout.core.units import DENSITY, LENGTH, PRESSURE, TEMPERATURE, Dimension


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

KINDS: Mapping[str, Mapping[str, ObjectParameter]] = MappingProxyType(
    {
        "spring": {},
        "stone": {
            "strength": ObjectParameter(
                20e6, 1e6, 200e6, "source: granite 10-45 MPa, doi.org/10.1617/s11527-019-1380-7"
            ),
            "piece": ObjectParameter(
                0.5, 0.0, 0.95, "assumption: one half stays, the other falls out"
            ),
        },
        "ice": {
            "length": ALONG,
            "depth": UPRIGHT,
            "temperature": ObjectParameter(263.15, *FROST, "assumption: frost of -10 degC"),
            "strength": ObjectParameter(
                None, 0.5e6, 100e6, "assumption: 5 MPa and 0.5 MPa more for each kelvin of frost"
            ),
            "piece": ObjectParameter(
                0.2, 0.0, 0.95, "assumption: crushed ice that is not pressed out"
            ),
        },
        "snow": {
            "length": ObjectParameter(0.2, 1e-3, 10.0, "assumption"),
            "depth": ObjectParameter(0.04, 1e-3, 0.2, "assumption: the height of the rail's head"),
            "temperature": ObjectParameter(268.15, *FROST, "assumption: frost of -5 degC"),
            "density": ObjectParameter(300.0, 50.0, 900.0, "assumption: settled snow"),
        },
        "wood": {
            "length": ALONG,
            "depth": UPRIGHT,
            "strength": ObjectParameter(5e6, 0.5e6, 100e6, "assumption: softwood across the grain"),
        },
        "metal": {
            "length": ALONG,
            "depth": UPRIGHT,
            "strength": ObjectParameter(
                235e6, 10e6, 2000e6, "definition: yield point of steel S235"
            ),
        },
    }
)
"""Parameters of each kind; "spring" is elastic for ever, as in the paper."""

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


def kind_faults(kind: str, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Find the faults of the kind of an object and its parameters: key and text of each.

    Parameters
    ----------
    kind : str
        Its kind.
    given : mapping
        Parameters by name, in SI; None where one is left out.
    """
    known = KINDS.get(kind)
    if known is None:
        text = f" = {show_value(kind)}: there is no such kind; there are {choices(KINDS)}"
        yield "kind", text + nearest(kind, KINDS)
        return
    for name, value in given.items():
        if value is None:
            continue
        if name not in known:
            has = f"it has {choices(known)}" if known else "it has size and stiffness alone"
            owners = choices([other for other, names in KINDS.items() if name in names])
            yield name, f": an object of kind '{kind}' has none, {has}; for {owners}"
            continue
        limits, unit = known[name], DIMENSIONS[name].unit if name in DIMENSIONS else ""
        if not limits.least <= value <= limits.most:
            text = f"must be {limits.least:g} to {limits.most:g} {unit}".rstrip()
            yield name, f" = {value:g} {unit}".rstrip() + f": {text}"


def filled_parameters(kind: str, given: Mapping[str, Any], *, size: float) -> dict[str, float]:
    """Return all parameters of a known kind; zero for those that it does not have.

    Examples
    --------
    >>> filled_parameters("stone", {"piece": 0.0}, size=0.02)["strength"]
    20000000.0
    """
    found = dict.fromkeys(PARAMETERS, 0.0)
    for name, parameter in KINDS[kind].items():
        value = given.get(name)
        if value is None:
            value = parameter.default
        if value is None:
            value = size if DIMENSIONS[name] is LENGTH else 0.0
        found[name] = float(value)
    return found
