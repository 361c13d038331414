"""The program `turnout`: its commands and its exit codes."""

import os
import re
import sys
from typing import Annotated

import typer
from typer.core import TyperCommand

from turnout.cli import (
    benchmark,
    calibrate,
    campaign,
    detect,
    limit,
    machine,
    panel,
    plan_test,
    pod,
    recording,
    report,
    simulate,
    studio,
    sweep,
    validate,
)
from turnout.cli.options import INTERRUPTED
from turnout.errors import TurnoutError

BAD_INPUT = 2

app = typer.Typer(
    name="turnout",
    help="Simulate how a railway switch is thrown, with or without a trapped foreign object.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("simulate", short_help="Simulate a throw, with or without trapped objects.")(
    simulate.simulate_command
)
app.command("import", short_help="Read a measurement, or convert it to forces and currents.")(
    recording.import_command
)
app.command("report", short_help="Write an HTML report about a result.")(report.report_command)
app.command("calibrate", short_help="Fit friction and drives to a measured campaign.")(
    calibrate.calibrate_command
)
app.command("validate", short_help="Predict a campaign and judge the errors.")(
    validate.validate_command
)
app.command("limit", short_help="Show what the drives can detect: places, sizes, blind zones.")(
    limit.limit_command
)
app.command("pod", short_help="Estimate probability of detection, a90 and a90/95 of a campaign.")(
    pod.pod_command
)
app.command("plan-test", short_help="Plan a day of tests on the track: objects, places, order.")(
    plan_test.plan_test_command
)
app.command("studio", short_help="Open an interactive page that runs locally.")(
    studio.studio_command
)
app.add_typer(
    panel.app, name="panel", short_help="Switch panels: list, show, check, sections, modes, export."
)
app.add_typer(machine.app, name="machine", short_help="Point machines: list, show, run, fit.")
app.add_typer(
    campaign.app, name="campaign", short_help="Measured movements: check, build, plot, virtual."
)
app.add_typer(
    sweep.app, name="sweep", short_help="Studies of many throws: plan, run, map, effects, export."
)
app.add_typer(
    detect.app, name="detect", short_help="Detect objects from drive forces: train, learn, run."
)
app.add_typer(
    benchmark.app, name="benchmark", short_help="Open benchmark of detection: make, compare, score."
)
# The type that typer writes behind the name of an argument.
_ARGUMENT_TYPE = re.compile(r"(?<=[A-Z]) <[a-z\[\] ]+>")


class _Command(TyperCommand):
    """A command whose help names its arguments without their Python types."""

    def get_help(self, ctx: typer.Context) -> str:  # type: ignore[override]
        return _ARGUMENT_TYPE.sub("", super().get_help(ctx))


_GROUPS = (panel.app, machine.app, campaign.app, sweep.app, detect.app, benchmark.app)
for _group in (app, *_GROUPS):
    for _info in _group.registered_commands:
        _info.cls = _Command


def _show_version(wanted: bool) -> None:
    if wanted:
        from turnout.core.provenance import version

        typer.echo(f"turnout {version()}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Simulate how a railway switch is thrown, with or without a trapped foreign object."""
    if os.environ.get("NO_COLOR"):
        context.color = False


def main() -> None:
    """Run the program; every error of its own becomes one message and exit code 2."""
    colour = False if os.environ.get("NO_COLOR") else None  # None: if it is a terminal
    name = typer.style("turnout:", fg=typer.colors.RED, bold=True)
    try:
        app()
    except TurnoutError as error:
        typer.echo(f"{name} {error}", err=True, color=colour)
        sys.exit(BAD_INPUT)
    except MemoryError:
        text = "memory ran out; give less (coarser elements, a shorter schedule, fewer values kept)"
        typer.echo(f"turnout: {text}, or let it have more", err=True)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        typer.echo("turnout: interrupted", err=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
