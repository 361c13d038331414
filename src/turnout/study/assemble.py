"""From values of variables to what a throw changes and traps."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.study.scenario import Value
from turnout.study.variable import Variable, values_at

_OBJECT_FIELDS = ("rail", "height", "stiffness", "appears", "disappears")


def multiplied(
    panel: LoadedPanel, values: Mapping[str, Value], factors: Sequence[tuple[str, float]]
) -> dict[str, Value]:
    """Multiply values of a panel that may have been set before.

    Parameters
    ----------
    panel : LoadedPanel
        Has the values that are not set.
    values : mapping of str to float, str or bool
        Set values by key, in SI; a key of one member goes before one of its family.
    factors : sequence of (str, float)
        Keys and what their values are multiplied by [-].

    Returns
    -------
    dict
        Overrides of the panel by key, in SI.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1")
    >>> multiplied(panel, {"drive.1.stiffness": 8e5}, [("drive.1.stiffness", 0.5)])
    {'drive.1.stiffness': 400000.0}
    >>> multiplied(panel, {"chair.friction_coefficient": 0.2}, [("chair.friction_coefficient", 2)])
    {'chair.friction_coefficient': 0.4}
    """
    result = dict(values)
    for key, factor in factors:
        if factor == 1.0:
            continue
        changed = {}
        for full, own in values_at(panel, key).items():
            family, _, *below = full.split(".")
            broad = result.get(".".join((family, *below)), own)
            changed[full] = float(result.get(full, broad)) * factor
        # One value for a whole family is written as one, unless a member has an own one already.
        alike = key not in changed and len(set(changed.values())) == 1
        if alike and not any(full in result for full in changed):
            changed = {key: next(iter(changed.values()))}
        result |= changed
    return result


def foreign_objects(by_key: Mapping[str, Value]) -> tuple[ForeignObject, ...]:
    """Return the object that a scenario traps, if any.

    Parameters
    ----------
    by_key : mapping of str to value
        Values in SI; those of `OBJECT_KEYS` count.

    Examples
    --------
    >>> foreign_objects({"object.size": 0.013, "object.x": 3.6})[0].at
    'x = 3.6 m'
    >>> foreign_objects({"object.size": 0.0, "object.at": "drive 1"})
    ()
    """
    size = float(by_key.get("object.size", 0.0))
    if size == 0.0 or not by_key.get("object.present", True):
        return ()
    at = f"x = {by_key['object.x']:.9g} m" if "object.x" in by_key else str(by_key["object.at"])
    item = ForeignObject(size, at)
    chosen = {
        name: by_key[f"object.{name}"] for name in _OBJECT_FIELDS if f"object.{name}" in by_key
    }
    return (replace(item, **chosen),)  # type: ignore[arg-type]


def shown(variable: Variable, value: Value) -> str:
    """Show a value as it is read: lengths in millimetres, other quantities in SI."""
    if isinstance(value, str):
        return value
    if variable.key == "object.size":
        return f"{1e3 * float(value):g} mm"
    return f"{variable.name} {value if isinstance(value, bool) else format(value, 'g')}"
