"""TOML files that come with a package, in its folder `library`, by name."""

from functools import cache
from importlib import resources
from pathlib import Path

from turnout.core.errors import FileError
from turnout.core.files import user_path
from turnout.core.problems import choices, nearest
from turnout.core.toml import TomlFile, decode, parse_toml, read_toml


def names_a_file(name_or_path: str | Path) -> bool:
    """Return True if a file is meant: a path, or a text with ".toml" or a path separator.

    Examples
    --------
    >>> names_a_file("sb1"), names_a_file("sb1.toml"), names_a_file(Path("sb1"))
    (False, True, True)
    """
    text = str(name_or_path)
    return isinstance(name_or_path, Path) or text.endswith(".toml") or "/" in text or "\\" in text


@cache
def names_in_library(package: str) -> tuple[str, ...]:
    """List the files in the library of a package, without their ending.

    Examples
    --------
    >>> "sb1" in names_in_library("turnout.panel")
    True
    """
    folder = resources.files(package).joinpath("library")
    names = (item.name for item in folder.iterdir() if item.name.endswith(".toml"))
    return tuple(sorted(name.removesuffix(".toml") for name in names))


def text_in_library(package: str, name: str, *, kind: str) -> str:
    """Return the TOML text of a file in the library of a package.

    Parameters
    ----------
    package : str
        Such as "turnout.panel".
    name : str
        Name of a library file without its suffix.
    kind : str
        Subject of the file, for the message: "panel".

    Raises
    ------
    FileError
        When there is no such file; the text lists those there are.

    Examples
    --------
    >>> "[drive." in text_in_library("turnout.panel", "sb1", kind="panel")
    True
    """
    names = names_in_library(package)
    if name not in names:
        message = (
            f"no library {kind} is called '{name}'{nearest(name, names)}; "
            f"there are {choices(names)}; a file needs its .toml"
        )
        raise FileError(message)
    folder = resources.files(package).joinpath("library")
    return decode(folder.joinpath(f"{name}.toml").read_bytes(), source=name)


def open_toml(package: str, name_or_path: str | Path, *, kind: str) -> TomlFile:
    """Read a file of the library of a package by its name, or any file by its path.

    Parameters
    ----------
    package, kind : str
        As of `text_in_library`.
    name_or_path : str or Path
        A library name, or a path; see `names_a_file`.

    Raises
    ------
    FileError
        When the file cannot be read, is not TOML, or is not in the library.

    Examples
    --------
    >>> open_toml("turnout.panel", "sb1", kind="panel").data["name"]
    'sb1'
    """
    name = str(name_or_path).strip()
    if isinstance(name_or_path, Path) or names_a_file(name):
        return read_toml(user_path(name))
    return parse_toml(text_in_library(package, name, kind=kind), source=name)
