"""Options that several commands share, and numbers with units from the command line."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from turnout.panel.load import LoadedPanel

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


def opened_panel(name: str, settings: list[str]) -> "LoadedPanel":
    """Load a panel and apply the settings of a command line."""
    from turnout.panel.load import load_panel

    panel = load_panel(name)
    return panel.with_settings(settings) if settings else panel
