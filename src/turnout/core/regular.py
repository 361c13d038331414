"""Only regular files are read: a pipe waits for ever, and a device may never end."""

import os
import stat
from contextlib import suppress
from pathlib import Path

from turnout.errors import FileError

_KINDS = (
    (stat.S_ISDIR, "is a folder, not a file; name a file inside it"),
    (stat.S_ISFIFO, "is a pipe, not a file; save its content as a file and name that"),
    (stat.S_ISSOCK, "is a socket, not a file; save its content as a file and name that"),
    (stat.S_ISCHR, "is a device, not a file; save its content as a file and name that"),
    (stat.S_ISBLK, "is a device, not a file; save its content as a file and name that"),
)


def require_regular_file(path: Path | str) -> None:
    """Refuse what is not a regular file or a link to one, without opening it.

    Parameters
    ----------
    path : Path or str
        What a user named as the file to read.

    Raises
    ------
    FileError
        When it is missing, cannot be looked at, or is a folder, a pipe, a socket or a device; the
        text names the path and the remedy.

    Examples
    --------
    >>> require_regular_file(__file__)
    >>> require_regular_file(Path(__file__).parent)
    Traceback (most recent call last):
        ...
    turnout.errors.FileError: ...files: is a folder, not a file; name a file inside it
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError) as error:
        raise FileError(read_fault(path, error)) from None
    if stat.S_ISREG(mode):
        return
    kind = next((text for matches, text in _KINDS if matches(mode)), "is not a regular file")
    message = f"{path}: {kind}"
    raise FileError(message)


def user_path(text: Path | str) -> Path:
    """Return a path with the user's folder for `~`; that of a user nobody knows stays as it is.

    Examples
    --------
    >>> user_path("~nobody-of-that-name/panel.toml").name
    'panel.toml'
    """
    with suppress(RuntimeError):
        return Path(text).expanduser()
    return Path(text)


def read_fault(path: Path | str, error: OSError | ValueError) -> str:
    """Say why a file cannot be read and what to do about it."""
    if isinstance(error, FileNotFoundError):
        return f"{path}: no such file; check the path (the current folder is {Path.cwd()})"
    if isinstance(error, PermissionError):
        return f"{path}: may not be read; check its permissions"
    return f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
