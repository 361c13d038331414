"""Packages that only some formats need: loaded when one turns up, named when they are missing."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from turnout.errors import FileError


def require(package: str, *, extra: str, purpose: str, load: bool = True) -> Any:
    """Load an optional package, or say how to install it.

    Parameters
    ----------
    package : str
        Name of the module.
    extra : str
        Extra of turnout that brings it.
    purpose : str
        What cannot be read without it.
    load : bool
        False only looks whether it is there, for a process that will load it.

    Raises
    ------
    FileError
        When it is missing or cannot be loaded.

    Examples
    --------
    >>> require("no_such_package", extra="daq", purpose="TDMS files")
    Traceback (most recent call last):
    turnout.errors.FileError: TDMS files need no_such_package; pip install 'turnout[daq]'
    """
    if find_spec(package) is None:
        message = f"{purpose} need {package}; pip install 'turnout[{extra}]'"
        raise FileError(message)
    if not load:
        return None
    try:
        return import_module(package)
    except (ImportError, OSError) as error:
        message = f"{purpose} need {package}, which cannot be loaded here ({error})"
        raise FileError(message) from None
