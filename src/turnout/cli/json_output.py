"""The option `--json` and the one renderer behind it."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

JSON_VERSION = 1
"""Raised when a documented key changes its meaning or disappears."""

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, in SI units; see docs.")
]


def print_json(
    command: str,
    record: Mapping[str, Any],
    *,
    units: Mapping[str, str] | None = None,
    written: Iterable[Path] = (),
) -> None:
    """Print a result on stdout as one JSON object.

    Parameters
    ----------
    command : str
        Such as "sweep map".
    record : mapping of str to object
        Its keys; dataclasses and arrays become objects and lists, NaN and infinity null.
    units : mapping of str to str, optional
        SI unit of every key of `record`, at any depth, that has one.
    written : iterable of Path
        Files that the command wrote.
    """
    typer.echo(json_text(command, record, units=units, written=written))


def json_text(
    command: str,
    record: Mapping[str, Any],
    *,
    units: Mapping[str, str] | None = None,
    written: Iterable[Path] = (),
) -> str:
    """Return the text that `print_json` prints.

    Examples
    --------
    >>> print(json_text("demo", {"size": float("nan")}, units={"size": "m"}))
    {
      "command": "demo",
      "json_version": 1,
      "size": null,
      "units": {
        "size": "m"
      },
      "written": []
    }
    """
    import json

    from turnout.core.json_files import to_plain

    origin = origin_of(command)
    whole = {
        "command": command,
        "json_version": JSON_VERSION,
        **({"origin": origin} if origin else {}),
        **record,
        "units": dict(units or {}),
        "written": [str(path) for path in written],
    }
    return json.dumps(to_plain(whole, nonfinite=lambda _: None), indent=2, allow_nan=False)


def origin_of(command: str) -> str:
    """Return the origin of the sizes and rates of a command on detection; empty for others.

    Examples
    --------
    >>> origin_of("limit")
    'all switches are simulated; no field recording was compared with these results'
    """
    from turnout.detection.conditions import CAMPAIGN, SIMULATED, TRAINED

    if command in ("limit", "plan-test", "detect train"):
        return SIMULATED
    return TRAINED if command.startswith("detect ") else CAMPAIGN if command == "pod" else ""


def print_library(command: str, family: str, found: Mapping[str, str], *, as_json: bool) -> None:
    """Print the names and descriptions of library members, such as panels.

    Parameters
    ----------
    command, family : str
        Such as "panel list" and "panels".
    found : mapping of str to str
        Description by name.
    as_json : bool
        Whether it is printed as JSON.
    """
    if as_json:
        rows = [{"name": name, "description": text} for name, text in found.items()]
        print_json(command, {family: rows})
        return
    width = max(map(len, found)) + 2
    for name, text in found.items():
        typer.echo(f"{name:<{width}}{text}")
