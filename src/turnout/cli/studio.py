"""The command `turnout studio`."""

import gc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import NamedPanelOptions, gives, option
from turnout.cli.output import INTERRUPTED, Output, note

if TYPE_CHECKING:
    from turnout.web.studio import Opened


@gives("studio", json=False)
def studio_command(
    output: Output,
    panel: NamedPanelOptions,
    campaign: Path | None = option(
        "--campaign DIR", "Measured campaign to overlay on simulated throws."
    ),
    port: int = option("--port N", "Default: a free port.", default=0, min=0, max=65535),
    browser: Annotated[
        bool, typer.Option(help="Open the page in the browser; the address is printed in any case.")
    ] = True,
) -> None:
    """Open an interactive page in the browser; it runs locally."""
    loaded = panel.opened()
    opened = _opened(campaign) if campaign is not None else None
    from turnout.web.serve import serve
    from turnout.web.studio import Studio

    try:
        serve(Studio(loaded, opened), port=port, browser=browser, announce=output.show)
    except KeyboardInterrupt:
        note("the studio has ended")
        raise typer.Exit(INTERRUPTED) from None
    finally:
        # Skips the final garbage collection over all libraries, which takes a second or more.
        gc.freeze()


def _opened(folder: Path) -> "Opened":
    """Read a campaign as `turnout campaign build` does."""
    from turnout.cli.campaign import built_campaign
    from turnout.web.studio import Opened

    return Opened(folder, built_campaign(folder, None, strict=False, quiet=False))
