"""Whether a run must first compile the kernels, and where they cannot be kept."""

import os
from pathlib import Path
from typing import Any

from turnout.core.cache_folder import why_private
from turnout.integrate import march

# Set when the kernels are imported; the time loop is compiled last, after all that it calls.
CACHE_VARIABLE = "NUMBA_CACHE_DIR"

# Kernels that were found, with their folder; looking through one takes a third of a millisecond.
_found: set[tuple[str, str]] = set()


def must_compile(kernel: Any = march.march) -> bool:
    """Return whether the next run compiles the kernels, which takes half a minute or more.

    Parameters
    ----------
    kernel : compiled function
        The last to be compiled; by default that of the rails' time loop.
    """
    folder = os.environ.get(CACHE_VARIABLE)
    if folder is None:
        return True
    pattern = f"{Path(kernel.py_func.__code__.co_filename).stem}.{kernel.__name__}-*.nbi"
    if (folder, pattern) not in _found and any(Path(folder).rglob(pattern)):
        _found.add((folder, pattern))
    return (folder, pattern) not in _found


def cache_fault() -> str:
    """Say why compiled kernels are not kept for the next run; empty where they are."""
    reason = why_private()
    return reason and (
        f"{reason}, so the kernels are compiled again in each run; set TURNOUT_CACHE_DIR to a "
        "folder that only you can write"
    )
