"""Options that several commands share, and numbers with units from the command line."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from turnout.errors import FileError, TurnoutError

if TYPE_CHECKING:
    from turnout.panel.load import LoadedPanel
    from turnout.study.calibration.record import Calibration

A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")

DEFAULT_PANEL = "uic60-760-1-15"

PanelArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="PANEL",
        help="Library panel, or path of a panel file (.toml). Default that of --calibration, or "
        f"{DEFAULT_PANEL}.",
        show_default=False,
    ),
]
PanelOption = Annotated[
    str | None,
    typer.Option(
        "--panel",
        metavar="PANEL",
        help=f"Library panel or panel file. Default that of --calibration, or {DEFAULT_PANEL}.",
        show_default=False,
    ),
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
        help="Values from `turnout calibrate`; what is set besides goes on top of them.",
    ),
]
DatasetOption = Annotated[
    Path | None, typer.Option("--out", metavar="FILE.nc", help="Write the dataset (netCDF).")
]
FigureOption = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Write a figure (.png, .pdf or .svg)."),
]


def opened_panel(
    name: str | None, settings: list[str], calibration: Path | None = None
) -> "LoadedPanel":
    """Load a panel, apply a calibration, and the settings of a command line on top.

    Parameters
    ----------
    name : str or None
        Library panel or panel file; default that of the calibration, or the default panel.
    settings : list of str
        As KEY=VALUE.
    calibration : Path, optional
        From `turnout calibrate`. That it is of another panel is said on stderr; that the panel
        lacks what was calibrated is an error.
    """
    from turnout.panel.load import load_panel

    if calibration is None:
        panel = load_panel(name if name is not None else DEFAULT_PANEL)
        return panel.with_settings(settings) if settings else panel
    from turnout.study.calibration.belongs import doubts_on
    from turnout.study.calibration.record import load_calibration

    known = load_calibration(calibration)
    panel = load_panel(name) if name is not None else calibrated_panel(known, calibration)
    changed = panel.with_settings(settings) if settings else panel
    for text in doubts_on(known, panel, changed):
        typer.echo(f"turnout: {calibration}: {text}", err=True)
    found = known.apply(panel)
    return found.with_settings(settings) if settings else found


def calibrated_panel(calibration: "Calibration", source: Path) -> "LoadedPanel":
    """Load the panel that was calibrated, which is at hand only where it is of the library."""
    from turnout.panel.load import library_names, load_panel

    if calibration.panel not in library_names():
        message = f"{source}: is of panel '{calibration.panel}'; name the file of that panel"
        raise FileError(message)
    return load_panel(calibration.panel)


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
