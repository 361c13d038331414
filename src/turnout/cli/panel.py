"""The commands `turnout panel ...`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import DEFAULT_PANEL, PanelArgument, SetOption, opened_panel
from turnout.cli.outputs import check_outputs

if TYPE_CHECKING:
    from turnout.panel.load import LoadedPanel

app = typer.Typer(
    help="Look at switch panels: list, show, check, sections, schema.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("list")
def list_command() -> None:
    """List the panels that come with the program."""
    from turnout.panel.load import library_names, load_panel

    for name in library_names():
        first = " ".join(load_panel(name).description.split()).split(". ")[0].rstrip(".")
        typer.echo(f"{name:<18}{first}")


@app.command("show")
def show_command(
    panel: PanelArgument = DEFAULT_PANEL,
    settings: SetOption = [],  # noqa: B006 - typer copies it
) -> None:
    """Show a panel: every value with its unit and where it comes from."""
    from turnout.cli.show import panel_lines

    for line in panel_lines(opened_panel(panel, settings)):
        typer.echo(line)


@app.command("check")
def check_command(
    file: Annotated[str, typer.Argument(metavar="FILE", help="Panel file (.toml).")],
    settings: SetOption = [],  # noqa: B006 - typer copies it
    throw: Annotated[
        bool,
        typer.Option(
            "--throw", help="Throw it as well, and warn of drives that come near to slipping."
        ),
    ] = False,
) -> None:
    """Check a panel file: OK, or all that is wrong with it."""
    panel = opened_panel(file, settings)
    typer.echo(f"{file}: OK ({panel.name}, hash {panel.hash[:12]})")
    if throw:
        _warn_of_slip(panel)


def _warn_of_slip(panel: "LoadedPanel") -> None:
    """Throw a panel; say which drives have less than a tenth of their force left."""
    from turnout.cli.watch import Watch
    from turnout.metric.movement import margins
    from turnout.response.compilation import must_compile
    from turnout.response.simulate import simulate

    with Watch(f"throwing {panel.name}", compiling=must_compile(), quiet=False) as watch:
        dataset = simulate(panel, report=watch.report)
    tight = [margin for margin in margins(dataset) if margin.tight]
    for margin in tight:
        left = f"{margin.force / 1e3:.2f} kN" if margin.force > 0 else "nothing"
        typer.echo(
            f"warning: drive {margin.drive} has {left} left before it slips when "
            f"{margin.direction}, less than 10 %; such a slip is no trapped object"
        )
    if not tight:
        typer.echo("every drive keeps at least 10 % of its force")


@app.command("sections")
def sections_command(
    panel: PanelArgument = DEFAULT_PANEL,
    settings: SetOption = [],  # noqa: B006 - typer copies it
) -> None:
    """Show the cross-sections along each rail."""
    from turnout.cli.sections import section_lines

    for line in section_lines(opened_panel(panel, settings)):
        typer.echo(line)


@app.command("schema")
def schema_command(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.json", help="Write it to a file.")
    ] = None,
) -> None:
    """Give the JSON schema of panel files, for editors."""
    import json

    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.panel.schema import panel_schema

    text = json.dumps(panel_schema(), indent=2)
    if out is None:
        typer.echo(text)
        return
    from turnout.files.atomic import write_atomic

    write_atomic(out, text + "\n")
    typer.echo(f"{out}: written")
