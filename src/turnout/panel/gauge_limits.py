"""Limits of track gauge by line speed, from a file, and as a part of a panel that names them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError

from turnout.core.errors import FileError, PanelError
from turnout.core.files import user_path
from turnout.core.library import names_a_file, open_toml
from turnout.core.problems import Problem, show_value, validation_problems
from turnout.core.quantity import Record
from turnout.core.units import SI
from turnout.panel.check_rails import rising_fault
from turnout.panel.document import Document
from turnout.panel.model import GaugeClass, TrackGauge

DEFAULT_LIMITS = "immediate-action"
"""Limits of the library that are taken unless others are named."""
LIBRARY = "turnout.metric"
"""Package whose library has the limits."""
_KEYS = ("schema_version", "name", "class", "up_to", "narrowing")
_NO_CLASSES = ("class: is missing", "class = []: ")
_ONE_CLASS = (
    '; give a table [[class]] for each, with up_to = "80 km/h", the line speed up to which it '
    'holds, and narrowing = "10 mm", what it allows below the nominal gauge'
)


@dataclass(frozen=True, slots=True)
class GaugeLimits:
    """Limits of gauge by line speed: a name, and classes whose speeds rise."""

    name: str
    classes: tuple[GaugeClass, ...]

    def highest_speed(self, narrowing: float) -> float:
        """Return the speed up to which a narrowing is allowed [m/s]; 0 if no class allows it.

        Examples
        --------
        >>> limits = load_gauge_limits("immediate-action")
        >>> [round(3.6 * limits.highest_speed(narrowing)) for narrowing in (1.435 - 1.428, 0.01)]
        [230, 0]
        """
        allowed = [c.up_to for c in self.classes if round(narrowing, 9) <= c.narrowing]
        return max(allowed, default=0.0)


def limits_of(attributes: Mapping[str, Any]) -> GaugeLimits:
    """Return the limits of the panel of a dataset; default those of immediate action.

    Parameters
    ----------
    attributes : mapping of str to object
        Of the dataset, with the `gauge_classes` of its panel.

    Examples
    --------
    >>> limits_of({}).name, limits_of({"gauge_classes": "[[20.0, 0.01]]"}).name
    ('immediate action', 'the panel')
    """
    default = default_limits()
    pairs = json.loads(str(attributes.get("gauge_classes", "[]")))
    own = tuple(GaugeClass(up_to=SI(top), narrowing=SI(value)) for top, value in pairs)
    return default if own in ((), default.classes) else GaugeLimits("the panel", own)


def allowed_speed(attributes: Mapping[str, Any], least: float) -> tuple[str, str]:
    """Return the line speed that a least gauge [m] allows, empty for none, and by which limits.

    Parameters
    ----------
    attributes : mapping of str to object
        Of a dataset with gauges.
    least : float
        Least gauge [m].

    Examples
    --------
    >>> allowed_speed({"gauge_nominal": 1.435}, 1.4268)
    ('up to 120 km/h', 'by the limits of immediate action')
    """
    limits = limits_of(attributes)
    speed = 3.6 * limits.highest_speed(float(attributes["gauge_nominal"]) - least)
    return f"up to {speed:.0f} km/h" if speed else "", f"by the limits of {limits.name}"


def load_gauge_limits(name_or_path: str | Path) -> GaugeLimits:
    """Load limits of gauge by line speed, of the library or a file.

    Parameters
    ----------
    name_or_path : str or Path
        "immediate-action", or the path of a TOML file with ``schema_version = 1``, a `name`, and a
        table ``[[class]]`` for each class with `up_to`, a speed, and `narrowing`, a length.

    Raises
    ------
    FileError
        When the file cannot be read or is not TOML.
    PanelError
        When it has no classes or other faults; with all of them at once.

    Examples
    --------
    >>> [item.narrowing for item in load_gauge_limits("immediate-action").classes]
    [0.009, 0.008, 0.007]
    """
    file = open_toml(LIBRARY, name_or_path, kind="table of limits")
    try:
        found = _LimitsFile.model_validate(file.data)
    except ValidationError as error:
        problems = [
            problem + _ONE_CLASS * problem.startswith(_NO_CLASSES)
            for problem in validation_problems(error.errors(), allowed=lambda _: _KEYS)
        ]
        raise PanelError(problems, source=f"limits of gauge {file.source}") from None
    return GaugeLimits(found.name, tuple(found.classes))


@cache
def default_limits() -> GaugeLimits:
    """Return the limits that are taken unless others are named, read once."""
    return load_gauge_limits(DEFAULT_LIMITS)


def has_default_limits(gauge: TrackGauge | None) -> bool:
    """Return True if the limits of a panel are the default ones."""
    return gauge is not None and gauge.limits == [*default_limits().classes]


def _rising(classes: list[GaugeClass]) -> list[GaugeClass]:
    if fault := rising_fault([round(3.6 * item.up_to, 6) for item in classes], unit="km/h"):
        message = f"the speeds `up_to` {fault}"
        raise ValueError(message)
    for slower, faster in pairwise(classes):
        if faster.narrowing > slower.narrowing:
            more = f"{1e3 * faster.narrowing:g} mm up to {3.6 * faster.up_to:g} km/h"
            less = f"{1e3 * slower.narrowing:g} mm up to {3.6 * slower.up_to:g} km/h"
            message = f"a faster class must not allow more, but {more} comes after {less}"
            raise ValueError(message)
    return classes


class _LimitsFile(Record):
    """A file of limits."""

    schema_version: Literal[1]
    name: str = Field(min_length=1)
    classes: Annotated[list[GaugeClass], AfterValidator(_rising)] = Field(
        alias="class", min_length=1
    )


def with_gauge_limits(document: Document, *, folder: Path | None) -> tuple[Document, list[Problem]]:
    """Put the classes of the limits that a panel names, or the default ones, in their place.

    They become part of the panel, so that it does not need the file any more.

    Parameters
    ----------
    document : Document
        The expanded document.
    folder : Path or None
        Folder of the panel file, from which relative paths start.

    Returns
    -------
    document : Document
        A new one where something was put in place.
    problems : list of Problem
        Of a file that cannot be read, or is wrong.
    """
    gauge = document.tree.get("gauge")
    if not isinstance(gauge, dict):
        return document, []
    given = gauge.get("limits", DEFAULT_LIMITS)
    if not isinstance(given, str):
        return document, []
    path = (folder or Path()) / user_path(given) if names_a_file(given) else given
    try:
        found = load_gauge_limits(path)
    except (FileError, PanelError) as error:
        told = error.problems if isinstance(error, PanelError) else [str(error)]
        text = f" = {show_value(given)}: "
        return document, [Problem(("gauge", "limits"), text + problem) for problem in told]
    classes = [{"up_to": SI(item.up_to), "narrowing": SI(item.narrowing)} for item in found.classes]
    tree = document.tree | {"gauge": gauge | {"limits": classes}}
    return replace(document, tree=tree), []
