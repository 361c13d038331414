"""Read regular files only; write a file completely or not at all."""

import errno
import os
import re
import signal
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from turnout.core.errors import FileError

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_TEMPORARY = re.compile(r"\.(.+)\.[a-z0-9_]{8}(\.[^.]+)")


@contextmanager
def atomic_path(target: Path | str, *, durable: bool = True) -> Iterator[Path]:
    """Give a temporary path to write to, which becomes the target when the block succeeds.

    The temporary file is in the target's folder and has its suffix; it is removed whatever goes
    wrong, also on Ctrl-C. An existing target is replaced only by a complete new one. Where the
    target is a symbolic link, the file that it points to is written, and the link stays.

    Parameters
    ----------
    target : Path or str
        File to write, in a folder that exists.
    durable : bool
        Whether to wait until the data are on the disk; not needed for files that can be made again.

    Yields
    ------
    Path
        Where to write.

    Raises
    ------
    FileError
        When the file cannot be written; the text names the path and the remedy.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with atomic_path(folder / "run.txt") as temporary:
    ...     _ = temporary.write_text("done")
    >>> (folder / "run.txt").read_text()
    'done'
    """
    path = Path(os.path.realpath(target)) if Path(target).is_symlink() else Path(target)
    _refuse_early(path)
    _ignore_size_signal()
    temporary = _temporary(path)
    try:
        yield temporary
        if durable:
            _flush(temporary)
        _adopt_mode(temporary, path)
        os.replace(temporary, path)
        if durable:
            _flush_folder(path.parent)
    except OSError as error:
        raise FileError(write_fault(path, error)) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_atomic(
    target: Path | str, content: str | bytes | memoryview, *, durable: bool = True
) -> None:
    """Write a text (as UTF-8) or bytes to a file, completely or not at all."""
    data = content.encode() if isinstance(content, str) else content
    with atomic_path(target, durable=durable) as temporary:
        temporary.write_bytes(data)


def is_leftover(path: Path, *, of: re.Pattern[str]) -> bool:
    """Return True if a file is a temporary one that an interrupted `atomic_path` left behind.

    Parameters
    ----------
    path : Path
        Any path; need not exist.
    of : pattern
        Matches the whole name of a target, suffix included.

    Examples
    --------
    >>> is_leftover(Path(".env.local"), of=re.compile("sweep.json"))
    False
    """
    match = _TEMPORARY.fullmatch(path.name)
    if match is None or of.fullmatch(match[1] + match[2]) is None:
        return False
    return path.is_file() and not path.is_symlink()


def write_fault(path: Path, error: OSError) -> str:
    """Return the cause of a failed write and its remedy, as a message."""
    if error.errno in _NO_SPACE:
        return f"{path}: cannot be written, no space left; free some, or choose another folder"
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return f"{path}: is not writable; choose another folder or change its permissions"
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        return f"{path}: no such folder '{path.parent}'; create it first"
    if error.errno == errno.EISDIR:
        return f"{path}: is a folder; name a file inside it"
    return f"{path}: cannot be written ({error.strerror or error})"


def _refuse_early(path: Path) -> None:
    try:
        if path.is_dir():
            raise FileError(write_fault(path, OSError(errno.EISDIR, "")))
        if not path.parent.is_dir():
            raise FileError(write_fault(path, OSError(errno.ENOENT, "")))
        if path.exists() and not os.access(path, os.W_OK):
            raise FileError(write_fault(path, OSError(errno.EACCES, "")))
    except (OSError, ValueError) as error:
        fault = error if isinstance(error, OSError) else OSError(errno.EINVAL, str(error))
        raise FileError(write_fault(path, fault)) from None


def _temporary(path: Path) -> Path:
    prefix = f".{path.stem[:100]}."
    try:
        handle, name = tempfile.mkstemp(prefix=prefix, suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise FileError(write_fault(path, error)) from None
    return Path(name)


def _ignore_size_signal() -> None:
    """Turn an exceeded file-size limit into an OSError instead of a killed process."""
    size_signal = getattr(signal, "SIGXFSZ", None)
    # Only the main thread may set a handler; Python itself ignores the signal at start.
    if size_signal is not None:
        with suppress(ValueError):
            signal.signal(size_signal, signal.SIG_IGN)


def make_durable(paths: Iterable[Path]) -> None:
    """Wait until files that were written without waiting are on the disk, and so are their names.

    Raises
    ------
    FileError
        When one cannot be; the text names the path and the remedy.
    """
    folders = set[Path]()
    for path in paths:
        try:
            _flush(path)
        except FileNotFoundError:
            message = f"{path}: was removed while it was in use; run the same command again"
            raise FileError(message) from None
        except OSError as error:
            raise FileError(write_fault(path, error)) from error
        folders.add(path.parent)
    for folder in folders:
        _flush_folder(folder)


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _adopt_mode(temporary: Path, target: Path) -> None:
    """Give the file the permissions of the one it replaces, or those of any new file."""
    if target.exists():
        mode = target.stat().st_mode & 0o777
    else:
        mask = os.umask(0)
        os.umask(mask)
        mode = 0o666 & ~mask
    temporary.chmod(mode)


def _flush_folder(folder: Path) -> None:
    """Make the rename itself durable if the system allows a folder to be opened."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


_KINDS = (
    (stat.S_ISDIR, "is a folder, not a file; name a file inside it"),
    (stat.S_ISFIFO, "is a pipe, not a file; save its content as a file and name that"),
    (stat.S_ISSOCK, "is a socket, not a file; save its content as a file and name that"),
    (stat.S_ISCHR, "is a device, not a file; save its content as a file and name that"),
    (stat.S_ISBLK, "is a device, not a file; save its content as a file and name that"),
)


def require_regular_file(path: Path | str) -> None:
    """Raise for a path that is not a regular file or a link to one, without opening it.

    Parameters
    ----------
    path : Path or str
        Path of the file to read.

    Raises
    ------
    FileError
        When it is missing, not accessible, or a folder, a pipe, a socket or a device; the text
        names the path and the remedy.

    Examples
    --------
    >>> require_regular_file(__file__)
    >>> require_regular_file(Path(__file__).parent)
    Traceback (most recent call last):
        ...
    turnout.core.errors.FileError: ...core: is a folder, not a file; name a file inside it
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
    """Return a path with `~` expanded; that of an unknown user stays as it is.

    Examples
    --------
    >>> user_path("~no-user-of-that-name/panel.toml").name
    'panel.toml'
    """
    with suppress(RuntimeError):
        return Path(text).expanduser()
    return Path(text)


def read_fault(path: Path | str, error: OSError | ValueError) -> str:
    """Return the cause of a failed read and its remedy, as a message."""
    if isinstance(error, FileNotFoundError):
        return f"{path}: no such file; check the path (the current folder is {Path.cwd()})"
    if isinstance(error, PermissionError):
        return f"{path}: is not readable; check its permissions"
    return f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"


def refuse_file(folder: Path) -> None:
    """Refuse a file in place of a folder."""
    if folder.exists() and not folder.is_dir():
        message = f"{folder}: is a file; name a folder"
        raise FileError(message)


def make_folder(folder: Path) -> None:
    """Make a folder, with those above it, unless it is there.

    Raises
    ------
    FileError
        When it is a file, or cannot be made.
    """
    refuse_file(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"{folder}: cannot be made ({error.strerror}); name another folder"
        raise FileError(message) from None
