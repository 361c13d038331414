"""Whether a run must first compile the kernels, and where they cannot be kept."""

import os
from pathlib import Path

from turnout.files.cache_folder import why_private
from turnout.integrate import march

# Set when the kernels are imported; the time loop is compiled last, after all that it calls.
CACHE_VARIABLE = "NUMBA_CACHE_DIR"

# Folders in which kernels were found; looking through one takes a third of a millisecond.
_found: set[str] = set()


def must_compile() -> bool:
    """Return whether the next run compiles the kernels, which takes a minute or two."""
    folder = os.environ.get(CACHE_VARIABLE)
    if folder is None:
        return True
    if folder not in _found:
        pattern = f"{Path(march.__file__).stem}.{march.march.__name__}-*.nbi"
        if any(Path(folder).rglob(pattern)):
            _found.add(folder)
    return folder not in _found


def cache_fault() -> str:
    """Say why compiled kernels are not kept for the next run; empty where they are."""
    reason = why_private()
    return reason and (
        f"{reason}, so the kernels are compiled again in each run; set TURNOUT_CACHE_DIR to a "
        "folder that only you can write"
    )
