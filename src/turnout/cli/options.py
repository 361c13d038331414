"""Options that several commands share, and numbers with units from the command line."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from turnout.errors import FileError, TurnoutError

if TYPE_CHECKING:
    from turnout.panel.load import LoadedPanel

A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")

DEFAULT_PANEL = "uic60-760-1-15"

PanelArgument = Annotated[
    str, typer.Argument(metavar="PANEL", help="Library panel, or path of a panel file (.toml).")
]
SetOption = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value of the panel, with its unit: drive.2.stiffness='81 kN/m'. Repeatable.",
    ),
]
CalibrationOption = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="Values from `turnout calibrate`; --set goes on top of them.",
    ),
]
DatasetOption = Annotated[
    Path | None, typer.Option("--out", metavar="FILE.nc", help="Write the dataset (netCDF).")
]
FigureOption = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Write a figure (.png, .pdf or .svg)."),
]


def opened_panel(name: str, settings: list[str], calibration: Path | None = None) -> "LoadedPanel":
    """Load a panel, apply a calibration, and the settings of a command line on top."""
    from turnout.panel.load import load_panel

    panel = load_panel(name)
    if calibration is not None:
        from turnout.study.calibration.record import load_calibration

        panel = load_calibration(calibration).apply(panel)
    return panel.with_settings(settings) if settings else panel


def all_told(
    first: Callable[[], A], second: Callable[[], B], third: Callable[[], C]
) -> tuple[A, B, C]:
    """Read three parts of a command line that do not need each other.

    Parameters
    ----------
    first, second, third : callable
        Each returns its part or raises a `TurnoutError`.

    Raises
    ------
    TurnoutError
        The only one there is, or one `FileError` with the texts of all.

    Examples
    --------
    >>> all_told(lambda: 1, lambda: "two", lambda: None)
    (1, 'two', None)
    """
    errors: list[TurnoutError] = []
    found: list[Any] = []
    for part in (first, second, third):
        try:
            found.append(part())
        except TurnoutError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise FileError("\n".join(str(error) for error in errors))
    return found[0], found[1], found[2]
