"""The commands `turnout panel ...`."""

from pathlib import Path
from typing import Annotated

import typer

from turnout.cli.match import match_command
from turnout.cli.modes import modes_command
from turnout.cli.options import (
    DEFAULT_PANEL,
    FIGURES,
    CalibrationOption,
    PanelArgument,
    SetOption,
    StrictOption,
    argument,
    check_outputs,
    end_code,
    first_sentence,
    made_folder,
    opened_panel,
    option,
)
from turnout.cli.output import (
    FINDINGS,
    JsonOption,
    Output,
    coloured,
    note,
    print_library,
    print_schema,
    refuse,
)

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
        Path | None, option("--plot FILE", "Draw the plan (.png, .pdf or .svg).")
    ] = None,
    throw: Annotated[
        bool, option("--throw", "Simulate throws for gaps, force margins and the test piece.")
    ] = False,
    values: Annotated[bool, option("--values", "List every value with its origin.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Show a panel: plan, closed gap, force margins, test piece, assumptions."""
    check_outputs({"--plot": plot}, {"--plot": FIGURES})
    from turnout.calibration.case import case_of
    from turnout.cli.show import check_throws, panel_lines

    opened = opened_panel(panel, settings, calibration)
    found = check_throws(opened) if throw else None
    output = Output("panel show", as_json=as_json)
    if not as_json:
        output.show(*panel_lines(opened, case=case_of(panel), thrown=found, values=values))
    if plot is not None:
        from turnout.figures.plan import plot_plan

        output.figure(plot, lambda: plot_plan(opened, dataset=found.dataset if found else None))
    if as_json:
        from turnout.cli.json_records import PANEL_UNITS, panel_record

        output.json(panel_record(opened, found), units=PANEL_UNITS)
    if found and (code := end_code(found.dataset)):
        raise typer.Exit(code)


@app.command("new", short_help="Write a panel file to edit, with every key explained.")
def new_command(
    file: Annotated[Path, argument("FILE", "Panel file to write (.toml); must not exist.")],
    source: Annotated[
        str, option("--from PANEL", "Library panel or panel file to start from.")
    ] = DEFAULT_PANEL,
    as_json: JsonOption = False,
) -> None:
    """Write a panel file to edit: another panel's values and origins, each key explained.

    Optional keys stand there as comments with their defaults. The name of the panel is that of the
    file.
    """
    check_outputs({"FILE.toml": file}, {"FILE.toml": (".toml",)})
    if file.exists():
        refuse(f"{file}: exists already, nothing was written; name another file")
    from turnout.panel.new_panel import new_panel_text

    output = Output("panel new", as_json=as_json)
    output.write(file, lambda: new_panel_text(source, target=file))
    if as_json:
        output.json({"panel": file.stem, "source": source})


@app.command("check", short_help="Check a panel file, and warn about small margins.")
def panel_check_command(
    file: Annotated[
        str, argument("FILE", "Panel file (.toml), library panel, or case N of a study (STUDY:N).")
    ],
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    throw: Annotated[
        bool,
        typer.Option(help="Also simulate a throw and warn about small margins."),
    ] = True,
    strict: StrictOption = False,
    as_json: JsonOption = False,
) -> None:
    """Check a panel file, report all errors, then simulate throws for margins and test pieces.

    Exit code 3 if the throw does not converge or is inaccurate.
    """
    panel = opened_panel(file, settings, calibration)
    output = Output("panel check", as_json=as_json)
    output.show(f"{file}: OK ({panel.name}, hash {panel.hash[:12]})")
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

        output.json(check_record(file, panel, found, dataset, pieces), units=CHECK_UNITS)
    lines = concern_lines(panel, found) if throw or found else ()
    output.show(*(coloured(line, "look" if found else "good") for line in lines))
    output.show(*piece_lines(pieces))
    if dataset is not None and (code := end_code(dataset)):
        raise typer.Exit(code)
    if found and strict:
        raise typer.Exit(FINDINGS)


@app.command("sections")
def sections_command(
    panel: PanelArgument = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw them (.png, .pdf or .svg).")] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the cross-sections along each rail."""
    check_outputs({"--plot": plot}, {"--plot": FIGURES})
    from turnout.cli.sections import section_figure, section_lines, section_record

    opened = opened_panel(panel, settings, calibration)
    output = Output("panel sections", as_json=as_json)
    if not as_json:
        from turnout.metric.panel_check import planing_concerns

        output.show(*section_lines(opened))
        for concern in planing_concerns(opened):
            note(f"warning: {concern.text}")
    output.figure(plot, lambda: section_figure(opened, opened.instrumented_rail))
    if as_json:
        record, units = section_record(opened)
        output.json(record, units=units)


@app.command("export", short_help="Write the matrices of every rail (.mat).")
def panel_export_command(
    panel: Annotated[
        str, argument("PANEL", "Library panel, panel file (.toml), or case N of a study (STUDY:N).")
    ],
    out: Annotated[Path, option("--out -o FOLDER", "Folder for the files; created if missing.")],
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
) -> None:
    """Write the full and reduced matrices of every rail for other programs (.mat)."""
    from turnout.metric.export import export_matrices

    opened = opened_panel(panel, settings, calibration)
    folder, output = made_folder("--out", out), Output("panel export")
    for name, content in export_matrices(opened).items():
        output.write(folder / name, content)


@app.command("schema")
def panel_schema_command(
    out: Annotated[Path | None, option("--out -o FILE.json", "Write it to a file.")] = None,
) -> None:
    """Print the JSON schema of panel files, for editors."""
    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.panel.schema import panel_schema

    print_schema(panel_schema(), out)
