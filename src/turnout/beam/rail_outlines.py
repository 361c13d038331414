"""The library of rail outlines: data files that come with turnout, and examples for others.

A file gives its vertices in one stated unit, from the frame drawn in its own comments; a rail that
is planed to fit another says how. Lengths are in metres once read.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from turnout.beam.outline import Outline, make_outline
from turnout.beam.section_taper import PlanedOutline, Planing, planed_sections
from turnout.core.errors import MechanicsError

_METRES = {"mm": 1e-3, "m": 1.0}
_FOLDER = "outlines"


@dataclass(frozen=True, slots=True, eq=False)
class RailOutline:
    """A rail of the library.

    Parameters
    ----------
    name, description : str
        Of the profile, such as "60E1", and one sentence on its source.
    outline : Outline
        In the frame that the file states [m].
    running_edge : float
        Lateral position of the running edge in that frame [m].
    planing : mapping
        Table `planing` of the file, lengths in metres; empty for a rail that is not planed.
    """

    name: str
    description: str
    outline: Outline
    running_edge: float
    planing: Mapping[str, Any]


def outline_names() -> list[str]:
    """Return the names of the library's outlines.

    Examples
    --------
    >>> outline_names()
    ['60E1', '60E1A1']
    """
    folder = files("turnout.beam") / _FOLDER
    names = [entry.name for entry in folder.iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def load_rail_outline(name: str) -> RailOutline:
    """Read one outline of the library.

    Parameters
    ----------
    name : str
        One of `outline_names`.

    Returns
    -------
    RailOutline
        Lengths in metres.

    Raises
    ------
    MechanicsError
        If there is no such outline.

    Examples
    --------
    >>> load_rail_outline("60E1").outline.points.max(axis=0).round(6).tolist()
    [0.075, 0.172]
    """
    if name not in outline_names():
        msg = f"there is no outline {name!r}; there are {', '.join(outline_names())}"
        raise MechanicsError(msg)
    text = (files("turnout.beam") / _FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    document = tomllib.loads(text)
    metres = _METRES[document["unit"]]
    points = np.array(document["points"], dtype=float) * metres
    if document["symmetric"]:
        inside = points[:, 0] > 0.0
        points = np.concatenate([points, points[inside][::-1] * [-1.0, 1.0]])
    return RailOutline(
        name=document["name"],
        description=document["description"],
        outline=make_outline(points),
        running_edge=document["running_edge"] * metres,
        planing={
            key: value if isinstance(value, str) else np.array(value, dtype=float) * metres
            for key, value in document.get("planing", {}).items()
        },
    )


def planed_rail(
    name: str, *, running_edge_offsets: npt.ArrayLike, least_thickness: float | None = None
) -> list[PlanedOutline]:
    """Cut a switch rail of the library beside the stock rail that its file names.

    Parameters
    ----------
    name : str
        An outline with a table `planing`.
    running_edge_offsets : array_like, shape (n,)
        Distances of the running edges [m].
    least_thickness : float, optional
        In place of the file's [m]; see `turnout.beam.section_taper.Planing`.

    Returns
    -------
    list of PlanedOutline, length n

    Raises
    ------
    MechanicsError
        If the file does not say how the rail is planed.

    Examples
    --------
    >>> (cut,) = planed_rail("60E1A1", running_edge_offsets=[0.02])
    >>> round(float(cut.outline.points[:, 1].max()), 6)  # 4 mm below 134 mm
    0.13
    """
    switch = load_rail_outline(name)
    if not switch.planing:
        msg = f"the outline {name!r} does not say how it is planed"
        raise MechanicsError(msg)
    plan = switch.planing
    stock = load_rail_outline(plan["stock_rail"])
    planing = Planing(
        running_edge_switch=switch.running_edge,
        running_edge_stock=stock.running_edge,
        seat_height=float(plan["seat_height"]),
        clearance=float(plan["clearance"]),
        lowering_offset=plan["lowering_offset"],
        lowering=plan["lowering"],
        least_thickness=float(
            plan["least_thickness"] if least_thickness is None else least_thickness
        ),
    )
    return planed_sections(
        switch.outline, stock.outline, running_edge_offsets=running_edge_offsets, planing=planing
    )
