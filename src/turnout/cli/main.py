"""The program `turnout`: commands, and what becomes of errors."""

import sys
from typing import Annotated

import typer

from turnout.cli import (
    calibrate,
    campaign,
    limit,
    machine,
    panel,
    recording,
    report,
    simulate,
    studio,
    sweep,
    validate,
)
from turnout.errors import TurnoutError

BAD_INPUT, INTERRUPTED = 2, 130

app = typer.Typer(
    name="turnout",
    help="Simulate how a railway switch is thrown, with or without a trapped foreign object.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("simulate")(simulate.simulate_command)
app.command("import")(recording.import_command)
app.command("report")(report.report_command)
app.command("calibrate")(calibrate.calibrate_command)
app.command("validate")(validate.validate_command)
app.command("limit")(limit.limit_command)
app.command("studio")(studio.studio_command)
app.add_typer(panel.app, name="panel")
app.add_typer(machine.app, name="machine")
app.add_typer(campaign.app, name="campaign")
app.add_typer(sweep.app, name="sweep")


def _show_version(wanted: bool) -> None:
    if wanted:
        from turnout.core.provenance import version

        typer.echo(f"turnout {version()}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Simulate how a railway switch is thrown, with or without a trapped foreign object."""


def main() -> None:
    """Run the program; every error of its own becomes one message and exit code 2."""
    try:
        app()
    except TurnoutError as error:
        typer.echo(f"turnout: {error}", err=True)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        typer.echo("turnout: interrupted", err=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
