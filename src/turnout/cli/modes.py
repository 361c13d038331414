"""The command `turnout panel modes`: frequencies, damping, kinds of motion, flutter."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import (
    FIGURES,
    CalibrationOption,
    PanelArgument,
    SetOption,
    check_outputs,
    opened_panel,
    write_and_report,
)
from turnout.core.errors import FileError

if TYPE_CHECKING:
    import xarray as xr

    from turnout.panel.load import LoadedPanel

HEADING = (
    f"{'':>4}{'Hz':>9}{'damping':>10}{'lateral':>9}{'vertical':>9}{'torsion':>9}   largest motion"
)
FACTORS = (1.0, 1.25)


def modes_command(
    panel: PanelArgument = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    count: Annotated[
        int, typer.Option("--count", metavar="N", min=1, help="Modes of each system.")
    ] = 6,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE.nc", help="Write frequencies and shapes (netCDF)."
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot", metavar="FILE", help="Draw the shapes of the panel (.png, .pdf or .svg)."
        ),
    ] = None,
    system: Annotated[
        str | None,
        typer.Option(
            "--system",
            metavar="HEADING",
            help="What --plot draws: a heading of the tables, such as 'stock rail curved'.",
        ),
    ] = None,
    reduction: Annotated[
        bool,
        typer.Option("--reduction", help="Also show the error of the reduction of each rail."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show natural frequencies and modes of rails and panel, and their flutter stability."""
    check_outputs({"--out": out, "--plot": plot}, {"--out": (".nc",), "--plot": FIGURES})
    if system is not None and plot is None:
        message = f"--system {system}: selects the modes of the figure; name its file with --plot"
        raise FileError(message)
    loaded = opened_panel(panel, settings, calibration)

    from turnout.metric.modes import modes

    dataset = modes(loaded, count=count)
    figure = b""
    if plot is not None:
        from turnout.figures.modes import plot_modes
        from turnout.figures.style import rendered

        figure = rendered(plot_modes(dataset, system=system), plot.suffix)
    if not as_json:
        _print_modes(loaded, dataset, reduction=reduction)
    if out is not None:
        from turnout.throw.store import save_response

        save_response(dataset, out)
        if not as_json:
            typer.echo(f"{out}: written")
    if plot is not None:
        write_and_report(plot, figure, quiet=as_json)
    if as_json:
        from turnout.cli.json_records import MODE_UNITS, mode_record

        record = mode_record(dataset, loaded, FACTORS)
        written = [path for path in (out, plot) if path is not None]
        print_json("panel modes", record, units=MODE_UNITS, written=written)


def _print_modes(panel: "LoadedPanel", dataset: "xr.Dataset", *, reduction: bool) -> None:
    for line in (*mode_lines(dataset), *stability_lines(panel)):
        typer.echo(line)
    if reduction:
        from turnout.metric.modes import reduction_texts

        for name, text in reduction_texts(panel).items():
            typer.echo(f"\nreduction of rail {name}\n{text}")


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


def stability_lines(panel: "LoadedPanel") -> Iterator[str]:
    """Yield the stability of steady sliding, at the panel's friction and at 1.25 times it."""
    from turnout.metric.stability import friction_stability

    if not panel.movement or not panel.chair:
        return
    for factor in FACTORS:
        found = friction_stability(panel, friction_factor=factor)
        yield f"{'stable' if found.stable else 'warning'}: {found}"
    cutoff = panel.discretisation.superelement_cutoff
    yield f"flutter near or above the cut-off of {cutoff:g} Hz cannot be seen"
