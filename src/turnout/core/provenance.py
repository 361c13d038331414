"""Provenance of a result: version, Python, platform, and the content hash of its input."""

import hashlib
import json
import platform
from functools import cache
from importlib import metadata


@cache
def version() -> str:
    """Return the version of the installed program, or "unknown" if it is not installed."""
    try:
        return metadata.version("turnout")
    except metadata.PackageNotFoundError:
        return "unknown"


def provenance() -> dict[str, str]:
    """Return the entries of a result file about the program that wrote it.

    Examples
    --------
    >>> sorted(provenance())
    ['platform', 'python', 'version']
    """
    return {
        "version": version(),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


def content_hash(content: object) -> str:
    """Hash nested plain data by its canonical JSON: sorted keys, shortest exact numbers.

    Parameters
    ----------
    content : object
        Dicts, lists, tuples, texts, finite numbers, booleans and None.

    Returns
    -------
    str
        SHA-256 as 64 hexadecimal digits.

    Examples
    --------
    >>> content_hash({"a": 1.0, "b": 2.0}) == content_hash({"b": 2.0, "a": 1.0})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
