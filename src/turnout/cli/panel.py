"""The commands `turnout panel ...`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.modes import modes_command
from turnout.cli.options import (
    FIGURES,
    CalibrationOption,
    PanelArgument,
    SetOption,
    check_outputs,
    end_code,
    opened_panel,
    print_schema,
    write_and_report,
)

if TYPE_CHECKING:
    pass

BAD_INPUT = 2

app = typer.Typer(
    help="Look at switch panels: list, show, check, sections, modes, export, schema.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.command("modes")(modes_command)


@app.command("list")
def list_command() -> None:
    """List the panels that come with the program."""
    from turnout.panel.load import library_names, load_panel

    names = library_names()
    width = max(len(name) for name in names) + 2
    for name in names:
        first = " ".join(load_panel(name).description.split()).split(". ")[0].rstrip(".")
        typer.echo(f"{name:<{width}}{first}")


@app.command("show")
def show_command(
    panel: PanelArgument = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the plan (.png, .pdf or .svg)."),
    ] = None,
    throw: Annotated[
        bool,
        typer.Option("--throw", help="Throw it, for gaps, force margins and the test piece."),
    ] = False,
    values: Annotated[
        bool, typer.Option("--values", help="List every value with where it comes from.")
    ] = False,
) -> None:
    """Show a panel: plan, closed gap, force margins, test piece, and what is assumed."""
    check_outputs({"--plot": plot}, {"--plot": FIGURES})
    from turnout.cli.show import panel_lines, thrown

    opened = opened_panel(panel, settings, calibration)
    found = thrown(opened) if throw else None
    for line in panel_lines(opened, thrown=found, values=values):
        typer.echo(line)
    if plot is not None:
        from turnout.plot.plan import plot_plan
        from turnout.plot.style import rendered

        figure = plot_plan(opened, dataset=found.dataset if found else None)
        write_and_report(plot, rendered(figure, plot.suffix))
    if found and (code := end_code(found.dataset)):
        raise typer.Exit(code)


@app.command("check")
def check_command(
    file: Annotated[str, typer.Argument(metavar="FILE", help="Panel file (.toml).")],
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    throw: Annotated[
        bool,
        typer.Option(help="Throw it as well, and warn of what a switch should not do."),
    ] = True,
    strict: Annotated[
        bool, typer.Option("--strict", help="End with exit code 2 where there are warnings.")
    ] = False,
) -> None:
    """Check a panel file: all that is wrong with it; then throw it, and warn of what comes near.

    Ends with exit code 3 where its throw does not converge or is inaccurate.
    """
    panel = opened_panel(file, settings, calibration)
    typer.echo(f"{file}: OK ({panel.name}, hash {panel.hash[:12]})")
    from turnout.analysis.panel_check import concern_lines, panel_concerns, unusual_concerns
    from turnout.cli.show import thrown_alone

    dataset = thrown_alone(panel) if throw else None
    found = unusual_concerns(panel) if dataset is None else panel_concerns(panel, dataset)
    for line in concern_lines(panel, found) if throw or found else ():
        typer.echo(line)
    if dataset is not None and (code := end_code(dataset)):
        raise typer.Exit(code)
    if found and strict:
        raise typer.Exit(BAD_INPUT)


@app.command("sections")
def sections_command(
    panel: PanelArgument = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw them (.png, .pdf or .svg)."),
    ] = None,
) -> None:
    """Show the cross-sections along each rail."""
    check_outputs({"--plot": plot}, {"--plot": FIGURES})
    from turnout.cli.sections import section_lines

    opened = opened_panel(panel, settings, calibration)
    for line in section_lines(opened):
        typer.echo(line)
    if plot is not None:
        from turnout.cli.sections import section_figure
        from turnout.plot.style import rendered

        figure = section_figure(opened, opened.instrumented_rail)
        write_and_report(plot, rendered(figure, plot.suffix))


@app.command("export")
def export_command(
    panel: Annotated[
        str, typer.Argument(metavar="PANEL", help="Library panel, or path of a panel file (.toml).")
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="FOLDER", help="Where the files go; made if need be.")
    ],
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
) -> None:
    """Write the matrices of every rail, whole and reduced, for other programs (.mat)."""
    from turnout.analysis.export import export_matrices
    from turnout.cli.options import made_folder

    opened = opened_panel(panel, settings, calibration)
    folder = made_folder("--out", out)
    for name, content in export_matrices(opened).items():
        write_and_report(folder / name, content)


@app.command("schema")
def schema_command(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.json", help="Write it to a file.")
    ] = None,
) -> None:
    """Give the JSON schema of panel files, for editors."""
    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.panel.schema import panel_schema

    print_schema(panel_schema(), out)
