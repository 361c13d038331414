"""The commands `turnout panel ...`."""

from pathlib import Path
from typing import Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json, print_library
from turnout.cli.match import match_command
from turnout.cli.modes import modes_command
from turnout.cli.options import (
    DEFAULT_PANEL,
    FIGURES,
    FINDINGS,
    CalibrationOption,
    PanelArgument,
    SetOption,
    check_outputs,
    end_code,
    first_sentence,
    opened_panel,
    print_schema,
    write_and_report,
)
from turnout.core.errors import FileError

app = typer.Typer(
    help="Switch panels: list, show, new, check, match, sections, modes, export, schema.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.command("modes", short_help="Show natural frequencies, modes and flutter stability.")(
    modes_command
)
app.command("match", short_help="Collect panels whose throws meet facts.")(match_command)


@app.command("list")
def panel_list_command(as_json: JsonOption = False) -> None:
    """List the library panels."""
    from turnout.panel.load import library_names, load_panel

    found = {name: first_sentence(load_panel(name).description) for name in library_names()}
    print_library("panel list", "panels", found, as_json=as_json)


@app.command("show", short_help="Show plan, gaps, margins, test piece and assumptions.")
def panel_show_command(
    panel: PanelArgument = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the plan (.png, .pdf or .svg)."),
    ] = None,
    throw: Annotated[
        bool,
        typer.Option("--throw", help="Simulate throws for gaps, force margins and the test piece."),
    ] = False,
    values: Annotated[
        bool, typer.Option("--values", help="List every value with its origin.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show a panel: plan, closed gap, force margins, test piece, assumptions."""
    check_outputs({"--plot": plot}, {"--plot": FIGURES})
    from turnout.calibration.case import case_of
    from turnout.cli.show import check_throws, panel_lines

    opened = opened_panel(panel, settings, calibration)
    found = check_throws(opened) if throw else None
    if not as_json:
        for line in panel_lines(opened, case=case_of(panel), thrown=found, values=values):
            typer.echo(line)
    if plot is not None:
        from turnout.figures.plan import plot_plan
        from turnout.figures.style import rendered

        figure = plot_plan(opened, dataset=found.dataset if found else None)
        write_and_report(plot, rendered(figure, plot.suffix), quiet=as_json)
    if as_json:
        from turnout.cli.json_records import PANEL_UNITS, panel_record

        written = [plot] if plot is not None else []
        record = panel_record(opened, found)
        print_json("panel show", record, units=PANEL_UNITS, written=written)
    if found and (code := end_code(found.dataset)):
        raise typer.Exit(code)


@app.command("new", short_help="Write a panel file to edit, with every key explained.")
def new_command(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Panel file to write (.toml); must not exist.")
    ],
    source: Annotated[
        str,
        typer.Option("--from", metavar="PANEL", help="Library panel or panel file to start from."),
    ] = DEFAULT_PANEL,
    as_json: JsonOption = False,
) -> None:
    """Write a panel file to edit: another panel's values and origins, each key explained.

    Optional keys stand there as comments with their defaults. The name of the panel is that of the
    file.
    """
    check_outputs({"FILE.toml": file}, {"FILE.toml": (".toml",)})
    if file.exists():
        message = f"{file}: exists already, nothing was written; name another file"
        raise FileError(message)
    from turnout.panel.new_panel import new_panel_text

    write_and_report(file, new_panel_text(source, target=file), quiet=as_json)
    if as_json:
        print_json("panel new", {"panel": file.stem, "source": source}, written=[file])


@app.command("check", short_help="Check a panel file, and warn about small margins.")
def panel_check_command(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="Panel file (.toml), library panel, or case N of a study (STUDY:N).",
        ),
    ],
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    throw: Annotated[
        bool,
        typer.Option(help="Also simulate a throw and warn about small margins."),
    ] = True,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 if there are warnings.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check a panel file, report all errors, then simulate throws for margins and test pieces.

    Exit code 3 if the throw does not converge or is inaccurate.
    """
    panel = opened_panel(file, settings, calibration)
    if not as_json:
        typer.echo(f"{file}: OK ({panel.name}, hash {panel.hash[:12]})")
    from turnout.cli.show import least_pieces, thrown_alone
    from turnout.metric.panel_check import (
        concern_lines,
        file_concerns,
        panel_concerns,
        piece_concerns,
        piece_lines,
    )

    dataset = thrown_alone(panel) if throw else None
    found = file_concerns(panel) if dataset is None else panel_concerns(panel, dataset)
    pieces = least_pieces(panel) if dataset is not None and dataset.attrs["complete"] else []
    found += piece_concerns(panel, pieces)
    if as_json:
        from turnout.cli.json_records import CHECK_UNITS, check_record

        record = check_record(file, panel, found, dataset, pieces)
        print_json("panel check", record, units=CHECK_UNITS)
    else:
        from turnout.cli.colour import coloured

        for line in concern_lines(panel, found) if throw or found else ():
            typer.echo(coloured(line, "look" if found else "good"))
        for line in piece_lines(pieces):
            typer.echo(line)
    if dataset is not None and (code := end_code(dataset)):
        raise typer.Exit(code)
    if found and strict:
        raise typer.Exit(FINDINGS)


@app.command("sections")
def sections_command(
    panel: PanelArgument = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw them (.png, .pdf or .svg)."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the cross-sections along each rail."""
    check_outputs({"--plot": plot}, {"--plot": FIGURES})
    from turnout.cli.sections import section_lines, section_record

    opened = opened_panel(panel, settings, calibration)
    if not as_json:
        from turnout.metric.panel_check import planing_concerns

        for line in section_lines(opened):
            typer.echo(line)
        for concern in planing_concerns(opened):
            typer.echo(f"turnout: warning: {concern.text}", err=True)
    if plot is not None:
        from turnout.cli.sections import section_figure
        from turnout.figures.style import rendered

        figure = section_figure(opened, opened.instrumented_rail)
        write_and_report(plot, rendered(figure, plot.suffix), quiet=as_json)
    if as_json:
        record, units = section_record(opened)
        written = [plot] if plot is not None else []
        print_json("panel sections", record, units=units, written=written)


@app.command("export", short_help="Write the matrices of every rail (.mat).")
def panel_export_command(
    panel: Annotated[
        str,
        typer.Argument(
            metavar="PANEL",
            help="Library panel, panel file (.toml), or case N of a study (STUDY:N).",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FOLDER", help="Folder for the files; created if missing."
        ),
    ],
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
) -> None:
    """Write the full and reduced matrices of every rail for other programs (.mat)."""
    from turnout.cli.options import made_folder
    from turnout.metric.export import export_matrices

    opened = opened_panel(panel, settings, calibration)
    folder = made_folder("--out", out)
    for name, content in export_matrices(opened).items():
        write_and_report(folder / name, content)


@app.command("schema")
def panel_schema_command(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE.json", help="Write it to a file.")
    ] = None,
) -> None:
    """Print the JSON schema of panel files, for editors."""
    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.panel.schema import panel_schema

    print_schema(panel_schema(), out)
