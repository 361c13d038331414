"""Outlines and machines of the library that a panel names, as members of the panel.

They become part of the panel: hash, origins and overrides cover them as if the file held them. An
outline is taken where the panel lacks it. A panel's own `[machine.NAME]` with the name of a library
machine need give only what differs; limit contacts of a library machine stand where its own example
has its ends, in a panel they follow from the drive, unless the panel gives them.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Any

from turnout.core.library import names_in_library, text_in_library
from turnout.core.toml import ORIGIN_KINDS, Origin, TomlFile, decode, parse_toml
from turnout.panel.document import Document

_USERS = {"outline_section": ("outline",), "planed_section": ("outline", "stock_outline")}
_KEYS = ("points", "symmetric", "running_edge")
MACHINES = "turnout.machine"
"""Package whose library has the machines."""
_OF_THE_EXAMPLE = ("limit_closing", "limit_opening")


def add_library_members(document: Document) -> Document:
    """Add the outlines and machines of the library that the document names.

    Parameters
    ----------
    document : Document
        The expanded document.

    Returns
    -------
    Document
        A new one where something was added.
    """
    return _with_machines(_with_outlines(document))


@cache
def library_outline_names() -> tuple[str, ...]:
    """List the outlines that come with the program.

    Examples
    --------
    >>> library_outline_names()
    ('60E1', '60E1A1')
    """
    names = (item.name for item in _folder().iterdir())
    return tuple(sorted(n.removesuffix(".toml") for n in names if n.endswith(".toml")))


def _with_outlines(document: Document) -> Document:
    """Add the outlines that sections name and that only the library has."""
    own = document.tree.get("outline", {})
    if not isinstance(own, dict):
        return document
    library = library_outline_names()
    wanted = [name for name in dict.fromkeys(_named(document.tree)) if name not in own]
    added = {name: _outline(name) for name in wanted if name in library}
    if not added:
        return document
    origins = dict(document.origins)
    for name, file in added.items():
        for key in _KEYS:
            origins[f"outline.{name}.{key}"] = _origin(file, name, key)
    members = {name: _of_outline(file.data) for name, file in added.items()}
    return replace(document, tree=document.tree | {"outline": own | members}, origins=origins)


def _named(tree: dict[str, Any]) -> Iterator[str]:
    """Yield the names of outlines that sections use, valid or not."""
    for family, keys in _USERS.items():
        members = tree.get(family, {})
        for member in members.values() if isinstance(members, dict) else ():
            for key in keys:
                if isinstance(member, dict) and isinstance(member.get(key), str):
                    yield member[key].strip()


def _folder() -> Any:
    return resources.files("turnout").joinpath("beam", "outlines")


def _outline(name: str) -> TomlFile:
    content = _folder().joinpath(f"{name}.toml").read_bytes()
    return parse_toml(decode(content, source=name), source=name)


def _of_outline(data: dict[str, Any]) -> dict[str, Any]:
    """Turn a library file, with one unit for all its lengths, into a member as a panel has it."""
    unit = data["unit"]
    return {
        "points": {"unit": unit, "values": data["points"]},
        "symmetric": data["symmetric"],
        "running_edge": f"{data['running_edge']} {unit}",
    }


def _origin(file: TomlFile, name: str, key: str) -> Origin:
    found = file.origins.get((key,))
    return found or Origin(ORIGIN_KINDS[1], f"outline {name} of the library")


def _with_machines(document: Document) -> Document:
    """Add the machines of the library that drives name."""
    own, drives = document.tree.get("machine", {}), document.tree.get("drive", {})
    if not isinstance(own, dict) or not isinstance(drives, dict):
        return document
    named = [drive.get("machine") for drive in drives.values() if isinstance(drive, dict)]
    wanted = dict.fromkeys(name.strip() for name in named if isinstance(name, str))
    if not wanted:
        return document
    members, origins = dict(own), dict(document.origins)
    for name in wanted:
        if name not in names_in_library(MACHINES):
            continue
        member = _joined(_of_machine(name), own.get(name, {}))
        if member == own.get(name):
            continue
        members[name] = member
        for path, origin in _machine_file(name).origins.items():
            if path[:2] == ("machine", name):
                origins.setdefault(".".join(path), origin)
    if members == own:
        return document
    return replace(document, tree=document.tree | {"machine": members}, origins=origins)


@cache
def _machine_file(name: str) -> TomlFile:
    return parse_toml(text_in_library(MACHINES, name, kind="machine"), source=name)


def _of_machine(name: str) -> dict[str, Any]:
    """Return a library machine without the limit contacts of its example."""
    found: dict[str, Any] = dict(_machine_file(name).data["machine"][name])
    found["circuit"] = {k: v for k, v in found["circuit"].items() if k not in _OF_THE_EXAMPLE}
    return found


def _joined(library: dict[str, Any], own: Any) -> Any:
    """Return the library's values with the panel's own in their place, table by table."""
    if not isinstance(own, dict):
        return own
    return library | {
        key: _joined(library[key], value) if isinstance(library.get(key), dict) else value
        for key, value in own.items()
    }
