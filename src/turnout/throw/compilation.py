"""Checks for a pending compilation of the kernels and for a fault of the kernel cache."""

from typing import Any

from turnout.core.cache_folder import why_private
from turnout.solver import march

WITH_MACHINES: Any = march.march_with_machines
"""Time loop of rails that machines move."""


def must_compile(kernel: Any = march.march) -> bool:
    """Return True if the next run compiles the kernels, which takes half a minute or more.

    Parameters
    ----------
    kernel : compiled function
        The last to be compiled; by default that of the rails' time loop.
    """
    return not kernel.is_kept()


def cache_fault() -> str:
    """Return the reason for compiling again in each run; empty if kernels are kept."""
    reason = why_private()
    return reason and (
        f"{reason}, so the kernels are compiled again in each run; set TURNOUT_CACHE_DIR to a "
        "folder that only you can write"
    )
