"""Panels whose members may differ from known ones in the same fields, made when they are needed.

A study mostly changes a value of all chairs, and a throw needs no more of them than numbers in a
row, which are quicker to take than two dozen records are to make.
"""

from collections.abc import Collection, Mapping, Sequence
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PrivateAttr

from turnout.core.lru_cache import LRUCache
from turnout.panel.model import FAMILIES, Panel
from turnout.panel.validate import with_values

MOST_KEPT = 64
"""Families whose numbers are kept in memory, the latest used."""

# Families are shared by many panels. They are named by identity, and kept beside so that nothing
# else takes their place.
_numbers = LRUCache[tuple[NDArray[np.float64], object]](MOST_KEPT)
_lock = Lock()
_own_values = vars(BaseModel)["__dict__"]


class PendingMembers(NamedTuple):
    """Members of a family that are copies of known ones with other values of some fields.

    `given` are these values by field, one for each member in the order of the known ones.
    """

    known: Mapping[str, BaseModel]
    given: Mapping[str, Sequence[Any]]

    def made(self) -> dict[str, BaseModel]:
        """Return the records."""
        of_each = zip(*self.given.values(), strict=True)
        return {
            name: with_values(known, known.__dict__ | dict(zip(self.given, values, strict=True)))
            for (name, known), values in zip(self.known.items(), of_each, strict=True)
        }


class PendingPanel(Panel):
    """A panel that makes families of members when they are needed.

    It differs from other panels in nothing else: its families are attributes, and its values are
    complete wherever they are read as a whole, such as for a copy.
    """

    _pending: Mapping[str, PendingMembers] = PrivateAttr(default_factory=dict)

    if not TYPE_CHECKING:  # else any name would be an attribute

        def __getattr__(self, name: str) -> Any:
            """Return a pending family, or an attribute that is no field."""
            if name in FAMILIES:
                self._make([name])
                values = _own_values.__get__(self)  # perhaps of another thread
                if name in values:
                    return values[name]
            return super().__getattr__(name)

        @property
        def __dict__(self) -> dict[str, Any]:
            """All values by field."""
            self._make(_pending_of(self))
            return _own_values.__get__(self)

        @__dict__.setter
        def __dict__(self, values: dict[str, Any]) -> None:
            _own_values.__set__(self, values)

    def _make(self, names: Collection[str]) -> None:
        """Make some of the families that are pending."""
        if not names:
            return
        with _lock:
            pending, values = dict(_pending_of(self)), _own_values.__get__(self)
            made = {name: pending.pop(name).made() for name in names if name in pending}
            if not made:  # by another thread, or never there
                return
            values = values | made
            in_order = {name: values[name] for name in Panel.model_fields if name in values}
            _own_values.__set__(self, in_order)
            self._pending = pending


def _pending_of(panel: Panel) -> Mapping[str, PendingMembers]:
    """Return the pending members, far quicker than by the name of the attribute."""
    private = panel.__pydantic_private__
    found: Mapping[str, PendingMembers] = private.get("_pending", {}) if private else {}
    return found


def named_places(panel: Panel) -> Mapping[str, Any]:
    """Return the families of a panel by name, of whose members names and places count alone."""
    pending = _pending_of(panel)
    if not pending or any("x" in members.given for members in pending.values()):
        return panel.__dict__
    known = {family: members.known for family, members in pending.items()}
    found: dict[str, Any] = _own_values.__get__(panel) | known
    return found


def member_numbers(panel: Panel, family: str, fields: Sequence[str]) -> NDArray[np.float64]:
    """Return some numbers of the members of a family, in their order, not to be changed.

    Returns
    -------
    ndarray, shape (n_fields, n_members)

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> member_numbers(load_panel("sb1"), "drive", ["stiffness", "x"]).tolist()
    [[750000.0, 810000.0], [0.3, 6.9]]
    """
    pending = _pending_of(panel).get(family)
    if pending is None:
        return _numbers_of(getattr(panel, family), fields)
    found = _numbers_of(pending.known, fields).copy()
    for field, values in pending.given.items():
        if field in fields:
            found[fields.index(field)] = values
    return found


def all_lack(panel: Panel, family: str, field: str) -> bool:
    """Return True if a field is None in all members of a family."""
    pending = _pending_of(panel).get(family)
    if pending is not None and field in pending.given:
        return all(value is None for value in pending.given[field])
    members = getattr(panel, family) if pending is None else pending.known
    return all(getattr(member, field) is None for member in members.values())


def _numbers_of(members: Mapping[str, BaseModel], fields: Sequence[str]) -> NDArray[np.float64]:
    key = (id(members), *fields)
    kept = _numbers.get(key)
    if kept is None:
        values = [[getattr(member, field) for member in members.values()] for field in fields]
        numbers = np.array(values, dtype=float).reshape(len(fields), -1)
        numbers.flags.writeable = False
        kept = _numbers.put(key, (numbers, members))
    return kept[0]
