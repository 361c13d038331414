"""Whether a run must first compile the kernels, and where they cannot be kept."""

import os
from pathlib import Path

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
    folder = Path(os.environ.get(CACHE_VARIABLE, ""))
    # A folder of this process alone stands in where the user's cannot be written.
    if not folder.name.startswith(f"turnout-{os.getpid()}-"):
        return ""
    chosen = os.environ.get("TURNOUT_CACHE_DIR", "the user's cache folder")
    return (
        f"{chosen} is not writable, so the kernels are compiled again in each run; set "
        "TURNOUT_CACHE_DIR to a folder that is"
    )
