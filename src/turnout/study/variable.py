"""Variables of a study, and the overrides and foreign objects that their values stand for.

A variable is a key of the panel, of the foreign object (`OBJECT_KEYS`), of the recorder
(`RECORDER_KEYS`), or the temperature.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from turnout.core.errors import PanelError
from turnout.core.keys import VERSION, Key
from turnout.core.lru_cache import LRUCache
from turnout.core.problems import nearest
from turnout.core.units import (
    LENGTH,
    STIFFNESS,
    TEMPERATURE,
    TIME,
    Dimension,
    is_finite,
    parse_quantity,
)
from turnout.law.object_kind import DIMENSIONS, OBJECT_KINDS, PARAMETERS
from turnout.measurement.chain.recorder import ERRORS, Recorder
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import FAMILIES, PANEL_KEYS
from turnout.study.scenario import Value

TEMPERATURE_KEY = "temperature"
# Of the object that the study traps, beside any that the panel has itself.
OBJECT_KEYS: dict[str, Dimension | type] = {
    "object.size": LENGTH,
    "object.at": str,
    "object.x": LENGTH,
    "object.stiffness": STIFFNESS,
    "object.height": LENGTH,
    "object.rail": str,
    "object.appears": TIME,
    "object.disappears": TIME,
    "object.present": bool,
    "object.kind": str,
    **{f"object.{name}": dimension for name, dimension in DIMENSIONS.items()},
    "object.piece": float,
}
RECORDER_KEYS: dict[str, Dimension | type] = {
    f"recorder.{name}": error.kind for name, error in ERRORS.items()
}
"""Keys of the recorder; they change the kept forces and currents, not the throw."""
LABEL = "label."
"""Start of keys that change nothing: cause, place or size, to label a throw."""
CAUSE, _, _ = LABELS = tuple(f"{LABEL}{name}" for name in ("cause", "place", "size"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A quantity that varies from throw to throw.

    Attributes
    ----------
    name : str
        Name in the results.
    key : str
        Key that it sets: of the panel, of the object, or "temperature".
    kind : Dimension or type
        Dimension of its values, or float, str, bool.
    factor : bool
        Whether it multiplies the panel's values instead of replacing them.
    """

    name: str
    key: str
    kind: Dimension | type
    factor: bool = False

    @property
    def units(self) -> str:
        """SI unit of its values; empty for plain numbers and texts."""
        return "" if self.factor or not isinstance(self.kind, Dimension) else self.kind.unit

    def read(self, value: object) -> Value:
        """Read a value of a study file; ValueError states the requirement."""
        kind = float if self.factor else self.kind
        if isinstance(kind, Dimension):
            return parse_quantity(value, kind)
        if kind is float:
            return _read_number(value)
        if not isinstance(value, kind):
            message = "must be text in quotes" if kind is str else "must be true or false"
            raise ValueError(message)
        return bool(value) if kind is bool else str(value).strip()


def _read_number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not is_finite(value):
        message = "must be a finite plain number, without quotes or unit"
        raise ValueError(message)
    return float(value)


def value_kind(panel: LoadedPanel, key: str, *, factor: bool = False) -> Dimension | type:
    """Return the kind of the values of a key; ValueError if nothing of that name can vary.

    A list, such as the gaps of `rail.fit_gap.value`, can be multiplied as a whole by a factor, but
    not be set; each of its items can, by its number: `chair.friction_factor.2`.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> value_kind(load_panel("sb1"), "drive.1.stiffness").name
    'stiffness'
    """
    for special in (OBJECT_KEYS, RECORDER_KEYS):
        if key in special:
            return special[key]
    if key == TEMPERATURE_KEY:
        return TEMPERATURE
    if key.startswith(LABEL) and key != LABEL:
        return str
    found = PANEL_KEYS.find(key)
    kind = None
    if found is not None and found.item is not None:
        kind = None if factor else _kind_of_item(panel, found)
    elif found is not None and key != VERSION:  # a list is multiplied as a whole, but not set
        several = found.is_list and not found.takes_text
        kind = (found.dimension if factor else None) if several else found.kind
    if kind is None:
        names = [*OBJECT_KEYS, *RECORDER_KEYS, TEMPERATURE_KEY, *variable_keys(panel)]
        message = f"no value of this name can vary in panel {panel.name}{nearest(key, names)}"
        raise ValueError(message)
    return kind


def _kind_of_item(panel: LoadedPanel, key: Key) -> Dimension | type:
    """Return the kind of an item of a list; ValueError if the panel has no such list or item."""
    for full, items in panel.values_at(key.whole).items():
        known = items if isinstance(items, list | tuple) else ()
        if key.item is None or not 1 <= key.item <= len(known):
            has = f"has {len(known)} items" if known else "is not given"
            message = f"{full} {has}, so there is no item {key.item}; give the list under [set]"
            raise ValueError(message)
        if not isinstance(known[0], int | float):
            message = f"{full} is no list of numbers"
            raise ValueError(message)
    return key.dimension or float


def set_items(panel: LoadedPanel, values: Mapping[str, Value]) -> dict[str, Any]:
    """Return values by key in which items of lists have become the lists with these items.

    Parameters
    ----------
    panel : LoadedPanel
        Has the other items.
    values : mapping
        Values by key, in SI.
    """
    found: dict[str, Any] = {}
    for name, value in values.items():
        key = PANEL_KEYS.find(name)
        if key is None or key.item is None:
            found[name] = value
            continue
        for full, items in panel.values_at(key.whole).items():
            changed = list(found.get(full, items))
            changed[key.item - 1] = value
            found[full] = tuple(changed)
    return found


def variable_keys(panel: LoadedPanel) -> Iterable[str]:
    """List the keys of a panel that a study may vary, families first, then members."""
    return PANEL_KEYS.names({name: getattr(panel, name) for name in FAMILIES})


_OBJECT_FIELDS = ("rail", "height", "stiffness", "appears", "disappears", "kind")


def apply_factors(
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

    Raises
    ------
    PanelError
        When no member has a value to multiply; members without are left.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1")
    >>> apply_factors(panel, {"drive.1.stiffness": 8e5}, [("drive.1.stiffness", 0.5)])
    {'drive.1.stiffness': 400000.0}
    >>> key = "chair.friction_coefficient"
    >>> apply_factors(panel, {key: 0.2}, [(key, 2)])
    {'chair.friction_coefficient': 0.4}
    """
    result = dict(values)
    changing = [(key, factor) for key, factor in factors if factor != 1.0]
    known = _known_values(panel, tuple([key for key, _ in changing]))
    for key, factor in changing:
        changed = {}
        for full, broad, own in known[key]:
            before = result[full] if full in result else result.get(broad, own)
            if before is None:  # such as the roller of a chair without one
                continue
            changed[full] = before * factor if type(before) is float else _scaled(before, factor)
        if not changed:
            message = f'"{key}" has no value that a factor could multiply; give it under [set]'
            raise PanelError([message])
        # One value for a whole family is written as one, unless a member has an own one already.
        whole = key not in changed and len(changed) == len(known[key])
        alike = whole and len(set(changed.values())) == 1
        if alike and not any(full in result for full in changed):
            changed = {key: next(iter(changed.values()))}
        result |= changed
    return result


_Values = dict[str, list[tuple[str, str, Any]]]
_values = LRUCache[_Values](64)
"""Values of panels by keys; scenarios of a study ask for the same ones."""


def _known_values(panel: LoadedPanel, keys: tuple[str, ...]) -> _Values:
    """Return `values_at` of each key, found once, beside the key of the family of each."""
    known = _values.get((panel.hash, keys))
    return known or _values.put(
        (panel.hash, keys),
        {
            key: [(full, _of_family(full), own) for full, own in panel.values_at(key).items()]
            for key in keys
        },
    )


def _of_family(full: str) -> str:
    """Return the key that sets a value for a whole family, from that for one member."""
    family, _, *below = full.split(".")
    return ".".join((family, *below))


def _scaled(value: Any, factor: float) -> Any:
    """Multiply a number, or each of a list."""
    if isinstance(value, tuple):
        return tuple(float(item) * factor for item in value)
    return float(value) * factor


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
    kind = str(by_key.get("object.kind", ForeignObject.__dataclass_fields__["kind"].default))
    # what is drawn for other kinds does not matter
    known = OBJECT_KINDS[kind].parameters if kind in OBJECT_KINDS else PARAMETERS
    own = [name for name in PARAMETERS if name in known]
    chosen = {
        name: by_key[f"object.{name}"]
        for name in (*_OBJECT_FIELDS, *own)
        if f"object.{name}" in by_key
    }
    return (ForeignObject(size, at, **chosen),)  # type: ignore[arg-type]


def recorder_of(by_key: Mapping[str, Value]) -> Recorder:
    """Return the recorder of a scenario; perfect if no key of it varies.

    Examples
    --------
    >>> recorder_of({"recorder.clock_rate": 5e-5, "object.size": 0.013}).clock_rate
    5e-05
    """
    errors = {name: float(by_key[key]) for name in ERRORS if (key := f"recorder.{name}") in by_key}
    return Recorder(**errors)  # type: ignore[arg-type]


def format_value(variable: Variable, value: Value) -> str:
    """Show a value as it is read: lengths in millimetres, other quantities in SI."""
    if isinstance(value, str):
        return value
    if variable.key == "object.size":
        return f"{1e3 * float(value):g} mm"
    return f"{variable.name} {value if isinstance(value, bool) else format(value, 'g')}"
