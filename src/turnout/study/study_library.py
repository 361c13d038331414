"""Studies that come with the program, and where the panel of a study is looked for."""

from importlib import resources
from pathlib import Path

from turnout.errors import FileError
from turnout.files.problems import choices, nearest
from turnout.files.toml import TomlFile, decode, parse_toml, read_toml
from turnout.panel.load import LoadedPanel, load_panel


def study_names() -> tuple[str, ...]:
    """List the studies that come with the program.

    Examples
    --------
    >>> "paper-campaign" in study_names()
    True
    """
    folder = resources.files("turnout.study").joinpath("library")
    names = (item.name for item in folder.iterdir() if item.name.endswith(".toml"))
    return tuple(sorted(name.removesuffix(".toml") for name in names))


def study_text(name: str) -> str:
    """Give the TOML text of a library study, to start an own study file from.

    Raises
    ------
    FileError
        When there is no such study; the text lists those there are.
    """
    names = study_names()
    if name not in names:
        message = (
            f"no library study is called '{name}'{nearest(name, names)}; "
            f"there are {choices(names)}; a file needs its .toml"
        )
        raise FileError(message)
    folder = resources.files("turnout.study").joinpath("library")
    return decode(folder.joinpath(f"{name}.toml").read_bytes(), source=name)


def open_study(name_or_path: str | Path) -> TomlFile:
    """Read a study of the library by its name, or a study file by its path."""
    name = str(name_or_path).strip()
    if isinstance(name_or_path, Path) or name.endswith(".toml") or "/" in name or "\\" in name:
        return read_toml(Path(name).expanduser())
    return parse_toml(study_text(name), source=name)


def named_panel(name: str, file: TomlFile) -> LoadedPanel:
    """Load the panel that a study names; a path starts at the folder of the study."""
    path = Path(name).expanduser()
    if name.endswith(".toml") and file.folder is not None and not path.is_absolute():
        return load_panel(file.folder / path)
    return load_panel(name)
