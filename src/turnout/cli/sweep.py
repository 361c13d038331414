"""The commands `turnout sweep ...`; those that look at studies before anything is thrown."""

from pathlib import Path
from typing import Annotated

import typer

from turnout.cli.outputs import check_outputs, tell_schema
from turnout.cli.sweep_look import effects_command, map_command
from turnout.cli.sweep_plan import StudyArgument, plan_command
from turnout.cli.sweep_run import export_command, run_command

app = typer.Typer(
    help="Many throws from one study file: list, show, plan, run, map, effects, export, schema.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

app.command("plan")(plan_command)
app.command("run")(run_command)
app.command("map")(map_command)
app.command("effects")(effects_command)
app.command("export")(export_command)


@app.command("list")
def list_command() -> None:
    """List the studies that come with the program."""
    from turnout.study.study import load_study
    from turnout.study.study_library import study_names

    names = study_names()
    width = max(len(name) for name in names) + 2
    for name in names:
        study = load_study(name)
        first = " ".join(study.description.split()).split(". ")[0].rstrip(".")
        typer.echo(f"{name:<{width}}{study.count:>7} throws  {first}")


@app.command("show")
def show_command(study: StudyArgument) -> None:
    """Show the text of a library study, to start an own one from."""
    from turnout.study.study_library import study_text

    typer.echo(study_text(study).rstrip())


@app.command("schema")
def schema_command(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.json", help="Write it to a file.")
    ] = None,
) -> None:
    """Give the JSON schema of study files, for editors."""
    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.study.study_schema import study_schema

    tell_schema(study_schema(), out)
