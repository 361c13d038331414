"""Load machines from the library or a file, and change them by keys.

A key names a field of the file's tables: `rail.mass`, `throw.duration`,
`machine.NAME.motor.voltage`. `machine.motor.voltage`, or `motor.voltage` for short, sets it for all
machines of the file.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import PrivateAttr, ValidationError

from turnout.core.errors import MachineError
from turnout.core.keys import mark_si, origin_at, put
from turnout.core.library import names_in_library, open_toml, text_in_library
from turnout.core.problems import choices, nearest, show_value, validation_problems
from turnout.core.toml import Origin
from turnout.machine.components import MACHINE_KEYS, Machine, MachineFile

PACKAGE = "turnout.machine"


class LoadedMachines(MachineFile):
    """A valid file of machines that knows where its values come from and can be changed."""

    _tree: dict[str, Any] = PrivateAttr(default_factory=dict)
    _origins: dict[str, Origin] = PrivateAttr(default_factory=dict)
    _source: str = PrivateAttr(default="machine")
    _overrides: dict[str, object] = PrivateAttr(default_factory=dict)

    @property
    def origins(self) -> Mapping[str, Origin]:
        """Origin of each value by key; an override has the kind "override"."""
        return self._origins

    @property
    def source(self) -> str:
        """The library name or file that it was loaded from."""
        return self._source

    @property
    def overrides(self) -> Mapping[str, object]:
        """The overrides that made it, by key."""
        return self._overrides

    def origin_text(self, key: str) -> str:
        """Return where a value comes from in words, for lists of values."""
        origin = origin_at(self._origins, key)
        if origin is not None:
            return f"{origin.kind}: {origin.text}"
        table: Any = self._tree
        for part in key.split("."):
            table = table.get(part) if isinstance(table, Mapping) else None
        return "default" if table is None else "not stated in the file"

    def unit_of(self, key: str) -> str:
        """Return the SI unit of a value, empty where it has none."""
        found = MACHINE_KEYS.find(key)
        return found.unit if found else ""

    def pick(self, name: str | None = None) -> tuple[str, Machine]:
        """Return name and record of a machine; the name may be left out where there is one.

        Raises
        ------
        MachineError
            When there is no such machine, or there are several and none is named.
        """
        if name is None and len(self.machine) == 1:
            name = next(iter(self.machine))
        if name is None:
            text = f"has several machines, name one: {choices(self.machine)}"
            raise MachineError([text], source=self.source)
        if name not in self.machine:
            text = (
                f"no machine is called '{name}'{nearest(name, self.machine)}; "
                f"there are {choices(self.machine)}"
            )
            raise MachineError([text], source=self.source)
        return name, self.machine[name]

    def with_overrides(self, overrides: Mapping[str, object], *, si: bool = True) -> Self:
        """Return a copy with changed values.

        Parameters
        ----------
        overrides : mapping of str to object
            Value by key: `{"motor.voltage": 176.0, "rail.object_size": "13 mm"}`; None takes an
            optional value away.
        si : bool
            Whether bare numbers are SI (from Python) or refused for dimensional keys (from text).

        Raises
        ------
        MachineError
            With all problems at once.

        Examples
        --------
        >>> machines = load_machines("sb3").with_overrides({"gear.efficiency": 0.8})
        >>> machines.machine["sb3"].gear.efficiency
        0.8
        """
        tree, origins = dict(self._tree), dict(self._origins)
        problems, own = [], set[tuple[str, ...]]()
        for key, value in overrides.items():
            places = MACHINE_KEYS.places(tree, key)
            if not places:
                problems.append(MACHINE_KEYS.no_match(key, tree))
            for place in places:
                table = put(tree, place, mark_si(value) if si else value, own)
                if value is None:
                    del table[place[-1]]
                origins[".".join(place)] = Origin("override", show_value(value))
        changed = type(self)._build(
            tree, source=self.source, origins=origins, problems=problems, heading="overrides"
        )
        changed._overrides = dict(self._overrides) | dict(overrides)
        return changed

    def with_settings(self, settings: Iterable[str]) -> Self:
        """Return a copy changed by texts "KEY=VALUE" of a command line; units are required.

        Examples
        --------
        >>> load_machines("sb3").with_settings(["rail.mass=500 kg"]).rail.mass
        500.0
        """
        overrides, problems = MACHINE_KEYS.settings(settings)
        if problems:
            raise MachineError(problems, source="settings")
        return self.with_overrides(overrides, si=False)

    @classmethod
    def _build(
        cls,
        tree: dict[str, Any],
        *,
        source: str,
        origins: dict[str, Origin],
        problems: list[str],
        heading: str,
    ) -> Self:
        try:
            loaded = cls.model_validate(tree)
        except ValidationError as error:
            problems += validation_problems(error.errors(), allowed=MACHINE_KEYS.field_names)
        if problems:
            raise MachineError(list(dict.fromkeys(problems)), source=heading)
        loaded._tree, loaded._origins, loaded._source = tree, origins, source
        return loaded


def machine_names() -> tuple[str, ...]:
    """List the machines that come with the program.

    Examples
    --------
    >>> "sb3" in machine_names()
    True
    """
    return names_in_library(PACKAGE)


def machine_text(name: str) -> str:
    """Return the TOML text of a library machine, to start an own file from.

    Raises
    ------
    FileError
        When there is no such machine; the text lists those there are.
    """
    return text_in_library(PACKAGE, name, kind="machine")


def load_machines(
    name_or_path: str | Path, *, overrides: Mapping[str, object] | None = None
) -> LoadedMachines:
    """Load a machine of the library by its name, or a file of machines by its path.

    Parameters
    ----------
    name_or_path : str or Path
        A library name, or a path; a text with ".toml" or a path separator is a path.
    overrides : mapping, optional
        Changes, as for `LoadedMachines.with_overrides`.

    Raises
    ------
    FileError
        When the file cannot be read or is not TOML.
    MachineError
        When what it says is not valid; with all problems at once.

    Examples
    --------
    >>> load_machines("sb3").machine["sb3"].motor.voltage
    220.0
    """
    file = open_toml(PACKAGE, name_or_path, kind="machine")
    origins = {".".join(path): origin for path, origin in file.origins.items()}
    loaded = LoadedMachines._build(
        file.data, source=file.source, origins=origins, problems=[], heading=file.source
    )
    return loaded.with_overrides(overrides) if overrides else loaded
