"""Output paths, looked at before a long run so that nothing is lost after it."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from turnout.errors import FileError

FIGURES = (".png", ".pdf", ".svg")


def check_outputs(paths: Mapping[str, Path | None], suffixes: Mapping[str, Sequence[str]]) -> None:
    """Refuse every output path that could not be written, all at once.

    Parameters
    ----------
    paths : mapping of option to path
        None where the option was not given.
    suffixes : mapping of option to suffixes
        What each option can write.

    Raises
    ------
    FileError
        Naming option, path and remedy for each.
    """
    problems = []
    seen: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        problem = _problem(path, suffixes[option])
        if problem:
            problems.append(f"{option} {path}: {problem}")
        resolved = path.resolve()
        if resolved in seen:
            problems.append(f"{option} {path}: is also the file of {seen[resolved]}; name another")
        seen[resolved] = option
    if problems:
        raise FileError("\n".join(problems))


def _problem(path: Path, suffixes: Sequence[str]) -> str | None:
    if path.is_dir():
        return "is a folder; name a file inside it"
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join(suffixes)
        return f"the name must end in {allowed}"
    # A link is written through, so it is the folder of its target that counts.
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.exists():
        return f"there is no folder {folder}; create it first"
    if not folder.is_dir():
        return f"{folder} is no folder"
    if not os.access(folder, os.W_OK):
        return f"folder {folder} is not writable; choose another or change its permissions"
    if path.exists() and not os.access(path, os.W_OK):
        return "exists and may not be written; choose another name or change its permissions"
    return _refused(folder)


def _refused(folder: Path) -> str | None:
    """Try to make a file: root may write where permissions forbid it, but not everywhere."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return f"no file can be made in {folder} ({error.strerror}); choose another folder"


def write_told(path: Path, content: str | bytes) -> None:
    """Write a file, completely or not at all, and say so."""
    import typer

    from turnout.files.atomic import write_atomic

    write_atomic(path, content)
    typer.echo(f"{path}: written")


def tell_schema(schema: dict[str, Any], out: Path | None) -> None:
    """Show a JSON schema, or write it to a file."""
    import json

    import typer

    text = json.dumps(schema, indent=2)
    if out is None:
        typer.echo(text)
        return
    write_told(out, text + "\n")


def made_folder(option: str, folder: Path) -> Path:
    """Make a folder for files unless it is there; refuse what is none."""
    try:
        folder.mkdir(exist_ok=True)
    except FileNotFoundError:
        message = f"{option} {folder}: there is no folder {folder.parent}; create it first"
        raise FileError(message) from None
    except OSError as error:
        message = f"{option} {folder}: cannot be made a folder ({error.strerror}); name another"
        raise FileError(message) from None
    if not os.access(folder, os.W_OK):
        message = f"{option} {folder}: is not writable; choose another or change its permissions"
        raise FileError(message)
    return folder
