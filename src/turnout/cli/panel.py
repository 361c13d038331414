"""The commands `turnout panel ...`."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.match import match_command
from turnout.cli.options import (
    DEFAULT_PANEL,
    FIGURES,
    SCHEMA,
    File,
    GivenPanelOptions,
    PanelOptions,
    argument,
    check_outputs,
    end_code,
    first_sentence,
    gives,
    made_folder,
    option,
)
from turnout.cli.output import (
    FINDINGS,
    Output,
    coloured,
    note,
    picked,
    print_library,
    print_schema,
    refuse,
)

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import xarray as xr

    from turnout.metric.stability import FrictionStability
    from turnout.panel.load import LoadedPanel

app = typer.Typer(
    help="Switch panels: list, show, new, check, match, sections, modes, export, schema.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("list")
@gives("panel list")
def panel_list_command(output: Output) -> None:
    """List the library panels."""
    from turnout.panel.load import library_names, load_panel

    found = {name: first_sentence(load_panel(name).description) for name in library_names()}
    print_library(output, "panels", found)


@app.command("show", short_help="Show plan, gaps, margins, test piece and assumptions.")
@gives("panel show", plot=File("--plot FILE", "Draw the plan (.png, .pdf or .svg).", FIGURES))
def panel_show_command(
    output: Output,
    panel: PanelOptions,
    throw: bool = option("--throw", "Simulate throws for gaps, force margins and the test piece."),
    values: bool = option("--values", "List every value with its origin."),
) -> None:
    """Show a panel: plan, closed gap, force margins, test piece, assumptions."""
    from turnout.calibration.load_study import case_name, shown_name
    from turnout.cli.show import PANEL_UNITS, check_throws, panel_lines, panel_record
    from turnout.figures.plan import plot_plan

    opened = panel.opened()
    found = check_throws(opened) if throw else None
    name = shown_name(opened, panel.panel)
    output.lines(panel_lines(opened, name=name, thrown=found, values=values))
    output.figure(output["plot"], plot_plan, opened, dataset=found.dataset if found else None)
    output.json(panel_record, opened, found, case_name(panel.panel), units=PANEL_UNITS)
    if found and (code := end_code(found.dataset)):
        raise typer.Exit(code)


@app.command("new", short_help="Write a panel file to edit, with every key explained.")
@gives("panel new")
def new_command(
    output: Output,
    file: Path = argument("FILE", "Panel file to write (.toml); must not exist."),
    source: str = option(
        "--from PANEL", "Library panel or panel file to start from.", default=DEFAULT_PANEL
    ),
) -> None:
    """Write a panel file to edit: another panel's values and origins, each key explained.

    Optional keys stand there as comments with their defaults. The name of the panel is that of the
    file.
    """
    check_outputs({"FILE.toml": file}, {"FILE.toml": (".toml",)})
    if file.exists():
        refuse(f"{file}: exists already, nothing was written; name another file")
    from turnout.panel.new_panel import new_panel_text

    output.write(file, lambda: new_panel_text(source, target=file))
    output.json(lambda: {"panel": file.stem, "source": source})


@app.command("check", short_help="Check a panel file, and warn about small margins.")
@gives("panel check")
def panel_check_command(
    output: Output,
    given: GivenPanelOptions,
    throw: Annotated[
        bool,
        typer.Option(help="Also simulate a throw and warn about small margins."),
    ] = True,
    strict: bool = option("--strict", "Exit code 1 if there are warnings."),
) -> None:
    """Check a panel file, report all errors, then simulate throws for margins and test pieces.

    Exit code 3 if the throw does not converge or is inaccurate.
    """
    panel, file = given.opened(), given.panel
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
    output.json(
        lambda: {
            "file": file,
            "panel": panel.name,
            "panel_hash": panel.hash,
            "warnings": found,
            "thrown": dataset is not None,
            "complete": None if dataset is None else bool(dataset.attrs["complete"]),
            "outcome": None if dataset is None else dataset.attrs["outcome"],
            "lock_rule": panel.lock.rule,
            "test_pieces": pieces,
        },
        units={"size": "m", "largest": "m"},
    )
    lines = concern_lines(panel, found) if throw or found else ()
    output.show(*(coloured(line, "look" if found else "good") for line in lines))
    output.show(*piece_lines(pieces))
    if dataset is not None and (code := end_code(dataset)):
        raise typer.Exit(code)
    if found and strict:
        raise typer.Exit(FINDINGS)


app.command("match", short_help="Collect panels whose throws meet facts.")(match_command)


@app.command("sections")
@gives("panel sections", plot=File("--plot FILE", "Draw them (.png, .pdf or .svg).", FIGURES))
def sections_command(output: Output, panel: PanelOptions) -> None:
    """Show the cross-sections along each rail."""
    from turnout.metric.panel_check import planing_concerns

    opened = panel.opened()
    output.lines(section_lines(opened))
    for concern in [] if output.silent else planing_concerns(opened):
        note(f"warning: {concern.text}")
    output.figure(output["plot"], section_figure, opened, opened.instrumented_rail)
    output.json(section_record, opened)


@app.command("export", short_help="Write the matrices of every rail (.mat).")
@gives("panel export", json=False)
def panel_export_command(
    output: Output,
    panel: GivenPanelOptions,
    out: Path = option("--out -o FOLDER", "Folder for the files; created if missing.", default=...),
) -> None:
    """Write the full and reduced matrices of every rail for other programs (.mat)."""
    from turnout.metric.export import export_matrices

    opened = panel.opened()
    folder = made_folder("--out", out)
    for name, content in export_matrices(opened).items():
        output.write(folder / name, content)


@app.command("schema")
@gives("schema", json=False, out=SCHEMA)
def panel_schema_command(output: Output) -> None:
    """Print the JSON schema of panel files, for editors."""
    from turnout.panel.schema import panel_schema

    print_schema(output, panel_schema())


HEADING = (
    f"{'':>4}{'Hz':>9}{'damping':>10}{'lateral':>9}{'vertical':>9}{'torsion':>9}   largest motion"
)


@app.command("modes", short_help="Show natural frequencies, modes and flutter stability.")
@gives(
    "panel modes",
    out=File("--out -o FILE.nc", "Write frequencies and shapes (netCDF)."),
    plot=File("--plot FILE", "Draw the shapes of the panel (.png, .pdf or .svg).", FIGURES),
)
def modes_command(
    output: Output,
    panel: PanelOptions,
    count: int = option("--count N", "Modes of each system.", default=6, min=1),
    system: str | None = option(
        "--system HEADING",
        "What --plot draws: a heading of the tables, such as 'stock rail curved'.",
    ),
    reduction: bool = option("--reduction", "Also show the error of the reduction of each rail."),
) -> None:
    """Show natural frequencies and modes of rails and panel, and their flutter stability."""
    if system is not None and output["plot"] is None:
        refuse(f"--system {system}: selects the modes of the figure; name its file with --plot")
    loaded = panel.opened()
    from turnout.figures.modes import plot_modes
    from turnout.metric.modes import modes, reduction_texts
    from turnout.metric.stability import FACTORS, friction_stability

    dataset = modes(loaded, count=count)
    sliding = FACTORS if loaded.movement and loaded.chair else ()
    stability = [friction_stability(loaded, friction_factor=factor) for factor in sliding]
    figure = None if output["plot"] is None else plot_modes(dataset, system=system)
    output.lines(mode_lines(dataset), stability_lines(stability))
    if reduction and not output.silent:
        texts = reduction_texts(loaded).items()
        output.show(*(f"\nreduction of rail {name}\n{text}" for name, text in texts))
    output.dataset(output["out"], dataset)
    output.figure(output["plot"], lambda: figure)
    output.json(mode_record, dataset, stability, units=MODE_UNITS)


def mode_lines(dataset: "xr.Dataset") -> Iterator[str]:
    """Yield the table of modes, one system after the other."""
    systems = list(dict.fromkeys(dataset["system"].values.tolist()))
    for system in systems:
        yield str(system)
        yield HEADING
        chosen = dataset.isel(mode=dataset["system"].values == system)
        for at in range(chosen.sizes["mode"]):
            mode = chosen.isel(mode=at)
            share = {
                kind: 100.0 * float(mode["motion_share"].sel(motion=kind))
                for kind in ("lateral", "vertical", "torsion")
            }
            damping = 100.0 * float(mode["damping_ratio"])
            yield (
                f"{int(mode['number']):>4}{float(mode['frequency']):>9.2f}"
                + (f"{damping:>8.1f} %" if damping == damping else f"{'rigid':>10}")
                + "".join(f"{value:>7.0f} %" for value in share.values())
                + f"   {mode['largest_rail'].item()}, x = {float(mode['largest_x']):.2f} m"
            )
        yield ""


def stability_lines(stability: Sequence["FrictionStability"]) -> Iterator[str]:
    """Yield the stability of steady sliding, at the panel's friction and at 1.25 times it."""
    for found in stability:
        yield f"{'stable' if found.stable else 'warning'}: {found}"
    if stability:
        cutoff = stability[0].superelement_cutoff
        yield f"flutter near or above the cut-off of {cutoff:g} Hz cannot be seen"


def section_figure(panel: "LoadedPanel", rail: str) -> Any:
    """Draw the section of a switch rail along it.

    Parameters
    ----------
    panel : LoadedPanel
        Its rails have outlines or tabulated sections.
    rail : str
        Name of a switch rail.

    Returns
    -------
    matplotlib.figure.Figure
        The outline at each station with the stock rail beside it, the running edge, centroid and
        shear centre; for a section that is a table, its properties along the rail.
    """
    from turnout.mechanism.rail_sections import rail_stations, section_values

    section = panel.rail[rail].section
    if section in panel.outline_section or section in panel.planed_section:
        return _outlines(panel, rail)
    from turnout.figures.sections import plot_section_values

    x = rail_stations(panel, rail)
    title = f"{panel.name}: section '{section}' of rail {rail}"
    return plot_section_values(x, section_values(panel, rail, x), title=title)


def _outlines(panel: "LoadedPanel", rail: str) -> Any:
    from turnout.figures.sections import plot_section_outlines
    from turnout.mechanism.rail_sections import in_panel_axes, section_outlines, station_columns

    section = panel.rail[rail].section
    pairs = section_outlines(panel, section)
    beside = [stock for _, stock in pairs if stock is not None]
    figure = plot_section_outlines(
        [outline for outline, _ in pairs],
        titles=_titles(panel, rail),
        # In outlines y is positive away from the stock rail, in columns towards it.
        properties=in_panel_axes(station_columns(panel, section), side=-1.0),
        behind=beside if len(beside) == len(pairs) else (),
    )
    title = f"{panel.name}: section '{section}' of rail {rail}, y positive away from the stock rail"
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _titles(panel: "LoadedPanel", rail: str) -> list[str]:
    """Name each station by the offset of the running edges, and by its place along the rail."""
    from turnout.panel.profile import running_edge_position

    record = panel.rail[rail]
    planed = panel.planed_section.get(record.section)
    if planed is None:
        return ["all along"]
    titles = []
    for offset in planed.running_edge_offset:
        text = f"w = {1e3 * offset:g} mm"
        if record.running_edge is not None:
            x = running_edge_position(record.running_edge, offset)
            text += f", x = {x:.2f} m" if x >= record.start else ", ahead of the toe"
        titles.append(text)
    return titles


# Column of the section table: heading, size of its unit in SI, format.
COLUMNS: dict[str, tuple[str, float, str]] = {
    "area": ("A cm2", 1e-4, "8.2f"),
    "second_moment_vertical": ("Iy cm4", 1e-8, "8.0f"),
    "second_moment_lateral": ("Iz cm4", 1e-8, "8.0f"),
    "product_moment": ("Iyz cm4", 1e-8, "8.0f"),
    "torsion_constant": ("J cm4", 1e-8, "8.0f"),
    "centroid_height": ("zc mm", 1e-3, "8.1f"),
    "centroid_offset": ("yc mm", 1e-3, "8.1f"),
    "shear_centre_height": ("zs mm", 1e-3, "8.1f"),
    "shear_centre_offset": ("ys mm", 1e-3, "8.1f"),
    "shear_factor_vertical": ("kz", 1.0, "8.2f"),
    "shear_factor_lateral": ("ky", 1.0, "8.2f"),
    "foot_edge_stock": ("foot mm", 1e-3, "8.1f"),
    "foot_edge_track": ("to mm", 1e-3, "8.1f"),
}


SI_UNITS = {"cm2": "m^2", "cm4": "m^4", "mm": "m"}


def section_lines(panel: "LoadedPanel") -> Iterator[str]:
    """Yield the lines of `turnout panel sections`: a row per station, linear between them."""
    shown: dict[tuple[str, ...], str] = {}
    for heading, rows in _tables(panel):
        rail, _, _ = heading.partition(",")
        first = shown.setdefault(rows, rail)
        if first == rail:
            yield heading
            yield from rows
        else:
            yield f"{heading}: as {first}"
    yield (
        "y positive towards the rail's own stock rail, for a stock rail away from its switch rail; "
        "z from the foot; k: shear area over area"
    )


def section_record(panel: "LoadedPanel") -> "tuple[dict[str, Any], dict[str, str]]":
    """Return section properties along each switch rail and of each stock rail, with SI units."""
    from turnout.mechanism.rail_sections import rail_stations, section_values, station_columns

    rails = {
        name: {"section": rail.section, "x": x, **section_values(panel, name, x)}
        for name, rail in panel.rail.items()
        for x in [rail_stations(panel, name)]
    }
    stocks = {
        name: {
            "section": item.section,
            **{key: v[0] for key, v in station_columns(panel, item.section).items()},
        }
        for name, item in panel.stock_rail.items()
    }
    units = {
        "x": "m",
        **{
            key: SI_UNITS[heading.split()[-1]]
            for key, (heading, _, _) in COLUMNS.items()
            if heading.split()[-1] in SI_UNITS
        },
    }
    return {"panel": panel.name, "rails": rails, "stock_rails": stocks}, units


def _tables(panel: "LoadedPanel") -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield heading and rows for every switch rail, then for every flexible stock rail."""
    from turnout.mechanism.rail_sections import rail_stations, section_values, station_columns

    for name, rail in panel.rail.items():
        x = rail_stations(panel, name)
        rows = _rows(x, section_values(panel, name, x), density=panel.material.density)
        yield f"rail {name}, section {rail.section}", rows
    for name, stock in panel.stock_rail.items():
        values = {key: column[:1] for key, column in station_columns(panel, stock.section).items()}
        rows = _rows([stock.start], values, density=panel.material.density)
        yield f"stock rail {name}, section {stock.section}, the same all along", rows


def _rows(
    x: "npt.ArrayLike", values: "dict[str, npt.NDArray[np.float64]]", *, density: float
) -> tuple[str, ...]:
    """Write the headings and a row a place."""
    import numpy as np

    columns = {key: column for key, column in COLUMNS.items() if key in values}
    headings = [heading for heading, _, _ in columns.values()]
    rows = [f"{'x m':>8}{'kg/m':>8}" + "".join(f"{heading:>8}" for heading in headings)]
    for row, place in enumerate(np.asarray(x, dtype=float)):
        cells = [
            f"{values[column][row] / factor:{form}}"
            for column, (_, factor, form) in columns.items()
        ]
        rows.append(f"{place:8.3f}{density * values['area'][row]:8.1f}" + "".join(cells))
    return tuple(rows)


MODE_UNITS = {"frequency": "Hz", "growth_rate": "1/s", "superelement_cutoff": "Hz"}
MODE_UNITS |= {"largest_x": "m"}


def mode_record(dataset: "xr.Dataset", stability: Sequence["FrictionStability"]) -> dict[str, Any]:
    """Return frequencies and motions of every mode, and the stability of sliding."""
    plain = ("system", "number", "frequency", "damping_ratio", "largest_rail", "largest_x")
    modes = (dataset.isel(mode=at) for at in range(dataset.sizes["mode"]))
    kinds = dataset["motion"].values.tolist()
    return {
        "modes": [
            {name: mode[name].item() for name in plain}
            | {"motion_share": dict(zip(kinds, mode["motion_share"].values, strict=True))}
            for mode in modes
        ],
        "stability": [
            picked(item, "friction_factor", "stable", "worst", "superelement_cutoff")
            for item in stability
        ],
    }
