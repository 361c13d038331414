"""The command `turnout panel modes`: frequencies, damping, kinds of motion, flutter."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from turnout.cli.options import (
    FIGURES,
    CalibrationOption,
    PanelArgument,
    SetOption,
    check_outputs,
    opened_panel,
    option,
)
from turnout.cli.output import JsonOption, Output, refuse

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
    count: Annotated[int, option("--count N", "Modes of each system.", min=1)] = 6,
    out: Annotated[
        Path | None, option("--out -o FILE.nc", "Write frequencies and shapes (netCDF).")
    ] = None,
    plot: Annotated[
        Path | None, option("--plot FILE", "Draw the shapes of the panel (.png, .pdf or .svg).")
    ] = None,
    system: Annotated[
        str | None,
        option(
            "--system HEADING",
            "What --plot draws: a heading of the tables, such as 'stock rail curved'.",
        ),
    ] = None,
    reduction: Annotated[
        bool, option("--reduction", "Also show the error of the reduction of each rail.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show natural frequencies and modes of rails and panel, and their flutter stability."""
    check_outputs({"--out": out, "--plot": plot}, {"--out": (".nc",), "--plot": FIGURES})
    if system is not None and plot is None:
        refuse(f"--system {system}: selects the modes of the figure; name its file with --plot")
    loaded = opened_panel(panel, settings, calibration)

    from turnout.metric.modes import modes

    dataset = modes(loaded, count=count)
    output, figure = Output("panel modes", as_json=as_json), None
    if plot is not None:
        from turnout.figures.modes import plot_modes

        figure = plot_modes(dataset, system=system)
    if not as_json:
        output.show(*mode_lines(dataset), *stability_lines(loaded))
    if reduction and not as_json:
        from turnout.metric.modes import reduction_texts

        texts = reduction_texts(loaded).items()
        output.show(*(f"\nreduction of rail {name}\n{text}" for name, text in texts))
    output.dataset(out, dataset)
    output.figure(plot, lambda: figure)
    if as_json:
        from turnout.cli.json_records import MODE_UNITS, mode_record

        output.json(mode_record(dataset, loaded, FACTORS), units=MODE_UNITS)


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
