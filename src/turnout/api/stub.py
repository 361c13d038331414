"""Stubs of the public packages, which type checkers and editors read instead of their tables.

``python -m turnout.api.stub`` writes them; a test compares.
"""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from turnout.core.lazy import home_of

PACKAGES = ("turnout", "turnout.figures", "turnout.detection")


def stub_text(package: str) -> str:
    """Return the stub of a package, read by type checkers and editors instead of its table.

    Examples
    --------
    >>> "from turnout.core.errors import PanelError as PanelError" in stub_text("turnout")
    True
    """
    table: Mapping[str, str] = import_module(package).NAMES
    homes = {name: home_of(name, place) for name, place in table.items()}
    lines = sorted(
        f"from {package} import {name} as {name}"
        if module == f"{package}.{name}"
        else f"from {module} import {attribute} as {name}"
        for name, (module, attribute) in homes.items()
    )
    listed = [f'    "{name}",' for name in sorted(table)]
    heading = '"""Written by `python -m turnout.api.stub` from the table in __init__.py."""'
    return "\n".join([heading, "", *lines, "", "__all__ = [", *listed, "]", ""])


def stub_path(package: str) -> Path:
    """Return the path of the stub of a package."""
    return Path(str(import_module(package).__file__)).with_suffix(".pyi")


if __name__ == "__main__":
    for each in PACKAGES:
        stub_path(each).write_text(stub_text(each), encoding="utf-8")
        print(stub_path(each))
