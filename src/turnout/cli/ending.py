"""The exit code that a throw ends a command with."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

INCOMPLETE, INTERRUPTED = 3, 130
"""Exit codes where a throw did not converge or is inaccurate, and where it was interrupted."""


def end_code(dataset: "xr.Dataset") -> int:
    """Return the exit code that a throw ends a command with, 0 where it is complete."""
    if dataset.attrs["complete"]:
        return 0
    return INTERRUPTED if dataset.attrs["outcome"] == "interrupted" else INCOMPLETE
