"""Limits of track gauge by line speed, from a file, and as a part of a panel that names them."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from turnout.core.errors import FileError, PanelError
from turnout.core.files import user_path
from turnout.core.library import names_a_file, open_toml
from turnout.core.problems import Problem, choices, nearest, show_value
from turnout.core.units import LENGTH, SI, SPEED, parse_quantity
from turnout.panel.document import Document
from turnout.panel.model import GaugeClass

DEFAULT_LIMITS = "immediate-action"
"""Limits of the library that are taken unless others are named."""
LIBRARY = "turnout.metric"
"""Package whose library has the limits."""
_TOP, _OF_CLASS = ("schema_version", "name", "class"), ("up_to", "narrowing")


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
        >>> [round(3.6 * limits.highest_speed(narrowing)) for narrowing in (7e-3, 8.2e-3, 0.01)]
        [230, 120, 0]
        """
        allowed = [item.up_to for item in self.classes if narrowing <= item.narrowing]
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
    default = load_gauge_limits(DEFAULT_LIMITS)
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
    problems: list[str] = []
    found = list(_classes(file.data.get("class"), problems))
    problems += [
        f"{key}: unknown key{nearest(key, _TOP)}; there are {choices(_TOP)}"
        for key in file.data
        if key not in _TOP
    ]
    if file.data.get("schema_version") != 1:
        problems.append("schema_version: must be 1")
    speeds = [item.up_to for item in found]
    if any(after <= before for before, after in zip(speeds, speeds[1:], strict=False)):
        problems.append("class: the speeds `up_to` must rise from class to class")
    if problems:
        raise PanelError(problems, source=f"limits of gauge {file.source}")
    return GaugeLimits(str(file.data.get("name", file.source)), tuple(found))


def _classes(given: Any, problems: list[str]) -> Iterator[GaugeClass]:
    """Yield the valid classes of a file, and list its faults."""
    example = '[[class]] with up_to = "120 km/h" and narrowing = "9 mm"'
    if not isinstance(given, list) or not given:
        problems.append(f"has no classes; give at least one {example}")
        return
    for number, item in enumerate(given, 1):
        if not isinstance(item, dict) or sorted(item) != sorted(_OF_CLASS):
            problems.append(f"class {number}: must have {' and '.join(_OF_CLASS)}, as {example}")
            continue
        values = []
        for key, dimension in zip(_OF_CLASS, (SPEED, LENGTH), strict=True):
            try:
                values.append(parse_quantity(item[key], dimension))
            except ValueError as error:
                problems.append(f"class {number}: {key} = {show_value(item[key])}: {error}")
                continue
            if values[-1] <= 0.0:
                text = f"class {number}: {key} = {show_value(item[key])}: must be more than 0"
                problems.append(text)
        if len(values) == len(_OF_CLASS) and min(values) > 0.0:
            yield GaugeClass(up_to=SI(values[0]), narrowing=SI(values[1]))


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
