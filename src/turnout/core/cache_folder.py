"""Cache folders: one that no other user can write, or a private one for this run.

Numba unpickles cached kernels, so anyone who can write to its folder can run code as the user. A
folder is used only if the folder itself, its content and all folders above belong to the user or
the system, and no other user may write there. Otherwise a new private folder takes its place; child
processes share it, and it is removed at the end.
"""

import atexit
import os
import re
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

PRIVATE_VARIABLE = "TURNOUT_PRIVATE_CACHE"
"""Environment variable with the private folder, for child processes."""

_DIGEST = re.compile("[0-9a-f]{16}")
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_SYSTEM = 0
_reasons: dict[Path, str] = {}


def user_cache_folder() -> Path:
    """Return the folder for turnout's caches, following the platform's custom.

    Returns
    -------
    pathlib.Path
        `$TURNOUT_CACHE_DIR` if set, else the platform's cache folder with `turnout` added.
    """
    if chosen := os.environ.get("TURNOUT_CACHE_DIR"):
        return Path(chosen)
    if sys.platform == "win32":
        root = Path(os.environ.get("LOCALAPPDATA", "~/AppData/Local"))
    elif sys.platform == "darwin":
        root = Path("~/Library/Caches")
    else:
        root = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    try:
        return root.expanduser() / "turnout"
    except RuntimeError:  # a user without a folder, as in some containers
        return Path(os.devnull) / "turnout"


@cache
def safe_folder(wanted: Path) -> Path | None:
    """Return an existing folder for a cache that no other user can write to.

    Parameters
    ----------
    wanted : Path
        Folder for the cache; created with access for the user only if it is missing.

    Returns
    -------
    Path or None
        The folder without symbolic links, a private one in its place, or None where neither is
        possible. The answer is the same throughout the process.
    """
    reason = _make(wanted) or why_unsafe(wanted)
    if not reason:
        return Path(os.path.realpath(wanted))
    _reasons[wanted] = reason
    private = private_folder()
    if private is None or _make(private / wanted.name):
        return None
    return private / wanted.name


MOST_FOLDERS = 32
"""Folders of a kind that stay: each change of the sources makes one of its own."""


def remove_outdated(folder: Path) -> None:
    """Remove the folders beside a new one that were not written to for longest.

    Parameters
    ----------
    folder : Path
        Of the present sources; its name is a kind and a digest, "models-0123456789abcdef". Beside
        it `MOST_FOLDERS` stay of each kind. What is removed costs time, never a result.
    """
    with suppress(OSError):
        written = {path: path.stat().st_mtime for path in folder.parent.glob("*-*")}
        for kind in {path.name.split("-")[0] for path in written}:
            own = [path for path in written if path.name.startswith(f"{kind}-") and path != folder]
            own = [path for path in own if _DIGEST.fullmatch(path.name.partition("-")[2])]
            for path in sorted(own, key=lambda path: -written[path])[MOST_FOLDERS:]:
                shutil.rmtree(path, ignore_errors=True)


def why_private() -> str:
    """Return the reason for using a private folder instead of the wanted one, or "" if none."""
    return next(iter(_reasons.values()), "")


def why_unsafe(folder: Path) -> str:
    """Return the reason for not trusting a folder with a cache, or "" if it is safe.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> why_unsafe(folder)
    ''
    >>> folder.chmod(0o777)
    >>> why_unsafe(folder).endswith("can be written by other users")
    True
    """
    if os.name != "posix":  # Windows protects a user profile by access lists
        return ""
    real = Path(os.path.realpath(folder))
    try:
        found = real.stat()
        if found.st_uid != os.geteuid():
            return f"{folder} belongs to another user"
        if found.st_mode & _OTHERS:
            return f"{folder} can be written by other users"
        for above in real.parents:
            if reason := _unsafe_parent(above):
                return f"{folder} lies in {above}, which {reason}"
        return _unsafe_content(real, closed=not found.st_mode & 0o077)
    except OSError as error:
        return f"{folder} cannot be used ({error.strerror})"


def _unsafe_parent(folder: Path) -> str:
    """Return the fault that lets others replace a folder inside this one, or "" if none."""
    found = folder.stat()
    if found.st_uid not in (_SYSTEM, os.geteuid()):
        return "belongs to another user"
    if found.st_mode & stat.S_ISVTX:  # users may move only what is theirs
        return ""
    others = found.st_mode & _OTHERS
    if others & stat.S_IWOTH:
        return "can be written by other users"
    if others and not _is_private_group(found.st_gid):
        return "can be written by its group"
    return ""


def _is_private_group(group: int) -> bool:
    """Return True if a group is the system's, or private with the user as only member."""
    if group == _SYSTEM:
        return True
    import grp
    import pwd

    try:
        user, entry = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return entry.gr_name == user.pw_name and set(entry.gr_mem) <= {user.pw_name}


def _unsafe_content(folder: Path, *, closed: bool) -> str:
    """Return the first unsafe entry inside: a link, another user's, or writable by others."""
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = os.path.join(place, name)
            with suppress(FileNotFoundError):  # another run may tidy up
                found = os.lstat(path)
                if stat.S_ISLNK(found.st_mode):
                    return f"{path} is a link"
                if found.st_uid != os.geteuid():
                    return f"{path} belongs to another user"
                if found.st_mode & _OTHERS and not closed:
                    return f"{path} can be written by other users"
    return ""


def _make(folder: Path) -> str:
    """Create a folder and its parents for the user only; return the error if it is not writable."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        for place in reversed(missing):
            place.mkdir(mode=0o700, exist_ok=True)
        if folder.is_dir() and os.access(folder, os.W_OK):
            return ""
    except OSError:
        pass
    return f"{folder} is not writable"


def private_folder() -> Path | None:
    """Return a folder for this process and its children, removed at its end.

    Returns
    -------
    Path or None
        None where no folder can be created that others cannot write to.
    """
    given = os.environ.get(PRIVATE_VARIABLE)
    if given and Path(given).is_dir() and not why_unsafe(Path(given)):
        return Path(given)
    try:
        folder = Path(tempfile.mkdtemp(prefix="turnout-")).resolve()
    except OSError:
        return None
    atexit.register(_remove, folder, os.getpid())
    if why_unsafe(folder):
        return None
    os.environ[PRIVATE_VARIABLE] = str(folder)
    return folder


def _remove(folder: Path, process: int) -> None:
    """Remove a private folder, only from the process that created it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)
