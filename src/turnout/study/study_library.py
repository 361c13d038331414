"""Studies that come with the program, and where the panel of a study is looked for."""

from pathlib import Path

from turnout.files.library import names_in_library, text_in_library
from turnout.files.regular import user_path
from turnout.files.toml import TomlFile, parse_toml, read_toml
from turnout.panel.load import LoadedPanel, load_panel


def study_names() -> tuple[str, ...]:
    """List the studies that come with the program.

    Examples
    --------
    >>> "paper-campaign" in study_names()
    True
    """
    return names_in_library("turnout.study")


def study_text(name: str) -> str:
    """Give the TOML text of a library study, to start an own study file from.

    Raises
    ------
    FileError
        When there is no such study; the text lists those there are.
    """
    return text_in_library("turnout.study", name, kind="study")


def open_study(name_or_path: str | Path) -> TomlFile:
    """Read a study of the library by its name, or a study file by its path."""
    name = str(name_or_path).strip()
    if isinstance(name_or_path, Path) or name.endswith(".toml") or "/" in name or "\\" in name:
        return read_toml(user_path(name))
    return parse_toml(study_text(name), source=name)


def named_panel(name: str, file: TomlFile) -> LoadedPanel:
    """Load the panel that a study names; a path starts at the folder of the study."""
    return load_panel(path_from(name, file) if name.endswith(".toml") else name)


def path_from(name: str, file: TomlFile) -> Path:
    """Return a path that a study names; one that is not absolute starts at the study's folder."""
    path = user_path(name)
    return path if path.is_absolute() or file.folder is None else file.folder / path
