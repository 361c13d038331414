"""Whether a run must first compile the kernels, so that a face can say so."""

import os
from pathlib import Path

from turnout.integrate import march

# Set when the kernels are imported; the time loop is compiled last, after all that it calls.
CACHE_VARIABLE = "NUMBA_CACHE_DIR"


def must_compile() -> bool:
    """Return whether the next run compiles the kernels, which takes about half a minute."""
    folder = os.environ.get(CACHE_VARIABLE)
    if folder is None:
        return True
    pattern = f"{Path(march.__file__).stem}.{march.march.__name__}-*.nbi"
    return not any(Path(folder).rglob(pattern))
