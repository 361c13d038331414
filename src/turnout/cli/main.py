"""The program `turnout`: its commands and its exit codes."""

import atexit
import gc
import os
import re
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from turnout.cli.options import option
from turnout.cli.output import INTERRUPTED, note
from turnout.core.errors import TurnoutError
from turnout.core.lean_imports import without_blas_threads, without_plugins

BAD_INPUT = 2

COMMANDS = {
    "simulate": ("simulate:simulate_command", "Simulate a throw, with or without trapped objects."),
    "gauge": (
        "gauge:gauge_command",
        "Show the track gauge beside a closed rail, at rest and under a wheel.",
    ),
    "import": (
        "recording:import_command",
        "Read a measurement, or convert it to forces and currents.",
    ),
    "report": ("report:report_command", "Write an HTML report about a result."),
    "calibrate": ("calibrate:calibrate_command", "Fit friction and drives to a measured campaign."),
    "validate": ("validate:validate_command", "Predict a campaign and judge the errors."),
    "limit": (
        "limit:limit_command",
        "Show what the drives can detect: places, sizes, blind zones.",
    ),
    "pod": (
        "pod:pod_command",
        "Estimate probability of detection, a90 and a90/95 of a campaign.",
    ),
    "plan-test": (
        "limit:plan_test_command",
        "Plan a day of tests on the track: objects, places, order.",
    ),
    "studio": ("studio:studio_command", "Open an interactive page that runs locally."),
    "panel": ("panel:app", "Switch panels: list, show, check, sections, modes, export."),
    "machine": ("machine:app", "Point machines: list, show, run, fit."),
    "campaign": ("campaign:app", "Measured movements: check, build, plot, virtual."),
    "sweep": ("sweep:app", "Studies of many throws: plan, run, map, effects, export."),
    "detect": ("detect:app", "Detect objects from drive forces: train, learn, run."),
}
"""Commands in the order of the help: a function or a group of commands, and its line there."""

# The type that typer writes behind the name of an argument.
_ARGUMENT_TYPE = re.compile(r"(?<=[A-Z]) <[a-z\[\] ]+>")


class _Command(TyperCommand):
    """A command whose help names its arguments without their Python types."""

    def get_help(self, ctx: typer.Context) -> str:  # type: ignore[override]
        return _ARGUMENT_TYPE.sub("", super().get_help(ctx))


class _Commands(Mapping[str, Any]):
    """The commands of the table, each loaded when it is looked up: most runs want one."""

    def __init__(self) -> None:
        self._loaded: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        place, help_line = COMMANDS[name]
        if name not in self._loaded:
            self._loaded[name] = _load(name, place, help_line)
        return self._loaded[name]

    def get(self, name: str, default: Any = None) -> Any:
        """Return a command; a KeyError while it loads is no unknown command."""
        return self[name] if name in COMMANDS else default

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


def _load(name: str, place: str, help_line: str) -> Any:
    """Return a command, or a group of commands, as typer makes it."""
    module, _, attribute = place.partition(":")
    found = getattr(import_module(f"turnout.cli.{module}"), attribute)
    holder = typer.Typer(
        add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None
    )
    holder.callback()(lambda: None)  # makes it a group, of however few commands
    if isinstance(found, typer.Typer):
        for info in found.registered_commands:
            info.cls = _Command
        holder.add_typer(found, name=name, short_help=help_line)
    else:
        holder.command(name, short_help=help_line, cls=_Command)(found)
    group: Any = typer.main.get_command(holder)
    return group.commands[name]


class _Group(TyperGroup):
    """The program, which loads the command that is named and no other."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands: Any = _Commands()


app = typer.Typer(
    name="turnout",
    cls=_Group,
    help="Simulate how a railway switch is thrown, with or without a trapped foreign object.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from turnout.core.provenance import version

        typer.echo(f"turnout {version()}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    _version: bool = option(
        "--version", "Show the version and exit.", callback=_show_version, is_eager=True
    ),
) -> None:
    """Simulate how a railway switch is thrown, with or without a trapped foreign object."""
    if os.environ.get("NO_COLOR"):
        context.color = False


def main() -> None:
    """Run the program; every error of its own becomes one message and exit code 2."""
    colour = False if os.environ.get("NO_COLOR") else None  # None: if it is a terminal
    name = typer.style("turnout:", fg=typer.colors.RED, bold=True)
    try:
        with without_blas_threads(), without_plugins():
            app()
    except TurnoutError as error:
        typer.echo(f"{name} {error}", err=True, color=colour)
        sys.exit(BAD_INPUT)
    except MemoryError:
        text = "memory ran out; give less (coarser elements, a shorter schedule, fewer values kept)"
        note(f"{text}, or let it have more")
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        note("interrupted")
        sys.exit(INTERRUPTED)
    finally:
        # At the end of the process Python would look through all that was loaded.
        atexit.register(gc.freeze)


if __name__ == "__main__":
    main()
