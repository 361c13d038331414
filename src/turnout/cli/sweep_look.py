"""The commands `turnout sweep map` and `turnout sweep effects`, which look at results."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.outputs import FIGURES, check_outputs, write_told

if TYPE_CHECKING:
    import xarray as xr

    from turnout.metric.effects import Decided, Index

FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep.")]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="Write a figure (.png, .pdf or .svg)."),
]


def map_command(
    folder: FolderArgument,
    out: OutOption = None,
    x: Annotated[str, typer.Option("--x", help="Input across.")] = "object.size",
    y: Annotated[
        str | None, typer.Option("--y", help="Input along; default object.at, or object.x.")
    ] = None,
) -> None:
    """Tell how the throws of a sweep ended, and draw forces, gaps and ends over two inputs."""
    check_outputs({"--out": out}, {"--out": FIGURES})
    from turnout.metric.sweep_map import STATES, end_state, sweep_map
    from turnout.study.sweep_read import read_labels

    labels = read_labels(folder)
    _tell_missing(labels)
    along = y or ("object.at" if "object.at" in labels.coords else "object.x")
    cells = sweep_map(labels, x=x, y=along)
    state = end_state(labels).to_numpy()
    for number, name in enumerate(STATES):
        count = int((state == number).sum())
        if count:
            typer.echo(f"{count:>8}  {name}")
    if out is not None:
        from turnout.plot.style import rendered
        from turnout.plot.sweep_map import plot_sweep_map

        write_told(out, rendered(plot_sweep_map(cells), out.suffix))


def effects_command(
    folder: FolderArgument,
    out: OutOption = None,
    feature: Annotated[
        list[str],
        typer.Option("--feature", metavar="NAME", help="Label or feature; repeatable."),
    ] = [],  # noqa: B006 - typer copies it
) -> None:
    """Tell what share of each output its inputs decide over, and draw main effects."""
    check_outputs({"--out": out}, {"--out": FIGURES})
    from turnout.study.sweep_effects import sweep_effects
    from turnout.study.sweep_read import read_labels

    labels = read_labels(folder)
    _tell_missing(labels)
    found = sweep_effects(labels, names=tuple(feature) or None)
    for item in found:
        _tell(item)
    skipped = int((labels["outcome"].astype(str) == "skipped").sum())
    if skipped:
        typer.echo(
            f"note: {skipped} throws were left out once a drive had slipped, so means over large "
            "values are those of places where none slips; drop the rule to compare fairly"
        )
    if out is not None:
        from turnout.plot.style import rendered
        from turnout.plot.sweep_effects import plot_sweep_effects

        figure = plot_sweep_effects(found, title=str(labels.attrs["name"]))
        write_told(out, rendered(figure, out.suffix))


def _tell_missing(labels: "xr.Dataset") -> None:
    missing = int(labels.attrs["missing"])
    if missing:
        typer.echo(f"note: {missing} scenarios are not thrown yet; `turnout sweep run` goes on")


def _tell(item: "Decided") -> None:
    """List inputs from the one that decides most."""
    typer.echo(item.output.name)
    width = max(len(index.name) for index in item.indices) + 2
    for index in sorted(item.indices, key=_weight, reverse=True):
        text = f"{index.first:6.3f} ± {index.first_confidence:.3f} first"
        if index.total == index.total:
            text += f"   {index.total:6.3f} ± {index.total_confidence:.3f} total"
        typer.echo(f"  {index.name:<{width}}{text}")


def _weight(index: "Index") -> float:
    return index.total if index.total == index.total else index.first
