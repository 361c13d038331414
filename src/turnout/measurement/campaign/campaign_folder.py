"""Files that a folder from elsewhere may name: its own, unless more is permitted.

A run sheet can name `../x.csv` or `/etc/passwd`, and a link in the folder can lead anywhere: to
files that are then read, or to files that are then replaced.
"""

import os
from pathlib import Path

from turnout.core.errors import FileError

# What is kept beside the recordings of a campaign: cut pieces and throws.
STORE = ".turnout"
PERMIT = "permit it by --allow-outside (in Python allow_outside=True)"


def campaign_folder(source: Path) -> Path:
    """Return the folder of a campaign, given as that folder or as the dataset (.nc) in it.

    Examples
    --------
    >>> campaign_folder(Path("autumn/campaign.nc")).name
    'autumn'
    """
    return source if source.is_dir() else source.parent


def throw_store(source: Path) -> Path:
    """Return the folder in which throws for a campaign are kept, from its folder or dataset."""
    return campaign_folder(source) / STORE / "throws"


def is_outside(path: Path, folder: Path) -> bool:
    """Return True if a path, with every link in it followed, is not within a folder.

    Examples
    --------
    >>> is_outside(Path("campaign/../x.csv"), Path("campaign"))
    True
    >>> is_outside(Path("campaign/x.csv"), Path("campaign"))
    False
    """
    return not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def refuse_outside(path: Path, folder: Path) -> None:
    """Refuse to read a file of a folder that lies elsewhere.

    Raises
    ------
    FileError
        Naming the file and where it leads.
    """
    if is_outside(path, folder):
        message = f"{path}: {describe_target(path, folder)}; move it there, or {PERMIT}"
        raise FileError(message)


def refuse_to_write_outside(path: Path, folder: Path) -> None:
    """Refuse to write through a link of a folder to a place outside.

    A path that is not in the folder by its own name is the user's to choose, and passes.

    Raises
    ------
    FileError
        Naming the path and where it leads.
    """
    named = Path(os.path.abspath(path)).is_relative_to(os.path.abspath(folder))
    stands = Path(os.path.realpath(path.parent)).is_relative_to(os.path.realpath(folder))
    if (named or stands) and is_outside(path, folder):
        message = (
            f"{path}: a link leads to {os.path.realpath(path)}, outside {folder}, and is not "
            "written through; remove the link, or name another file"
        )
        raise FileError(message)


def refuse_links_outside(store: Path, folder: Path) -> None:
    """Refuse a store in a folder that a link, itself or within it, takes outside.

    Raises
    ------
    FileError
        Naming the link.
    """
    refuse_to_write_outside(store, folder)
    for path in store.rglob("*"):
        if path.is_symlink():
            refuse_to_write_outside(path, folder)


def describe_target(path: Path, folder: Path) -> str:
    """Return the text for a path that is not within a folder, with its target."""
    target = os.path.realpath(path)
    shown = "" if target == os.path.abspath(path) else f" (it leads to {target})"
    return f"lies outside {folder}{shown}"
