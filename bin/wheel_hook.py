"""Make the wheel one for this platform if kernels were built ahead (`bin/wheel.py`)."""

import platform
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

BUILT = "src/turnout/kernels/built"


def platform_tag() -> str:
    """Return the tag of wheels with machine code that calls the C library alone."""
    machine = platform.machine().lower()
    if sys.platform == "darwin":
        return f"macosx_11_0_{machine}"
    if sys.platform == "win32":
        return f"win_{machine}"
    return f"manylinux_2_17_{machine}"


class PlatformWheel(BuildHookInterface):  # type: ignore[misc]
    """Takes kernels that were built ahead into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Set the tag, and name files that version control ignores."""
        if version == "standard" and any((Path(self.root) / BUILT).glob("*.kernel")):
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{platform_tag()}"
            build_data["artifacts"].append(f"/{BUILT}/*.kernel")
