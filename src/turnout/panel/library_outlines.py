"""The library's outlines as members of a panel, wherever a section names one that it lacks.

They become part of the panel: its hash, its origins and its overrides cover them as if the file
had held their points.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Any

from turnout.core.toml import ORIGIN_KINDS, Origin, TomlFile, decode, parse_toml
from turnout.panel.document import Document

_USERS = {"outline_section": ("outline",), "planed_section": ("outline", "stock_outline")}
_KEYS = ("points", "symmetric", "running_edge")


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


def add_library_outlines(document: Document) -> Document:
    """Give the document the outlines that its sections name and that only the library has.

    Parameters
    ----------
    document : Document
        The expanded document.

    Returns
    -------
    Document
        A new one where something was added.
    """
    own = document.tree.get("outline", {})
    if not isinstance(own, dict):
        return document
    library = library_outline_names()
    wanted = [name for name in dict.fromkeys(_named(document.tree)) if name not in own]
    added = {name: _read(name) for name in wanted if name in library}
    if not added:
        return document
    origins = dict(document.origins)
    for name, file in added.items():
        for key in _KEYS:
            origins[f"outline.{name}.{key}"] = _origin(file, name, key)
    members = {name: _member(file.data) for name, file in added.items()}
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
    return resources.files("turnout").joinpath("section", "outlines")


def _read(name: str) -> TomlFile:
    content = _folder().joinpath(f"{name}.toml").read_bytes()
    return parse_toml(decode(content, source=name), source=name)


def _member(data: dict[str, Any]) -> dict[str, Any]:
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
