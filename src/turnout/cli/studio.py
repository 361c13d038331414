"""The command `turnout studio`."""

import gc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import CalibrationOption, PanelOption, SetOption, opened_panel

if TYPE_CHECKING:
    from turnout.web.studio import Opened

INTERRUPTED = 130


def studio_command(
    panel: PanelOption = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    campaign: Annotated[
        Path | None,
        typer.Option(
            "--campaign", metavar="DIR", help="Measured campaign to lay over simulated throws."
        ),
    ] = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Default any that is free.")
    ] = 0,
    browser: Annotated[
        bool, typer.Option(help="Open the page in the browser; its address is printed anyway.")
    ] = True,
) -> None:
    """Open a page on this machine: move an object along the rail and see the throw at once."""
    loaded = opened_panel(panel, settings, calibration)
    opened = _opened(campaign) if campaign is not None else None
    from turnout.web.serve import serve
    from turnout.web.studio import Studio

    try:
        serve(Studio(loaded, opened), port=port, browser=browser, tell=typer.echo)
    except KeyboardInterrupt:
        typer.echo("turnout: the studio has ended", err=True)
        raise typer.Exit(INTERRUPTED) from None
    finally:
        # Else the interpreter looks for garbage in all libraries, for a second or more, to end.
        gc.freeze()


def _opened(folder: Path) -> "Opened":
    """Read a campaign as `turnout campaign build` does."""
    from turnout.cli.campaign import built_campaign
    from turnout.web.studio import Opened

    return Opened(folder, built_campaign(folder, None, strict=False, quiet=False))
