"""The commands `turnout sweep map` and `turnout sweep effects`: results of a sweep."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import FIGURES, FINDINGS, check_outputs, write_and_report

if TYPE_CHECKING:
    import xarray as xr

    from turnout.metric.sensitivity import OutputEffects, SobolIndex

FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep.")]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="Write a figure (.png, .pdf or .svg)."),
]


def map_command(
    folder: FolderArgument,
    out: OutOption = None,
    x: Annotated[str, typer.Option("--x", metavar="INPUT", help="Input across.")] = "object.size",
    y: Annotated[
        str | None,
        typer.Option("--y", metavar="INPUT", help="Input along; default object.at, or object.x."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Count the end states of a sweep, and draw forces, gaps and end states over two inputs."""
    check_outputs({"--out": out}, {"--out": FIGURES})
    from turnout.metric.sweep_map import STATES, end_state, sweep_map
    from turnout.metric.verdict import break_note
    from turnout.study.sweep.read import read_labels

    labels = read_labels(folder)
    along = y or ("object.at" if "object.at" in labels.coords else "object.x")
    cells = sweep_map(labels, x=x, y=along)
    state = end_state(labels).to_numpy()
    if not as_json:
        _print_missing(labels)
        for number, name in enumerate(STATES):
            count = int((state == number).sum())
            if count:
                typer.echo(f"{count:>8}  {name}")
        if note := break_note(labels):
            typer.echo(note)
    if out is not None:
        from turnout.figures.style import rendered
        from turnout.figures.sweep import plot_sweep_map

        write_and_report(out, rendered(plot_sweep_map(cells), out.suffix), quiet=as_json)
    if as_json:
        from turnout.cli.json_records import map_record

        record, units = map_record(labels, cells)
        print_json("sweep map", record, units=units, written=[out] if out is not None else [])


def effects_command(
    folder: FolderArgument,
    out: OutOption = None,
    feature: Annotated[
        list[str],
        typer.Option("--feature", metavar="NAME", help="Label or feature; repeatable."),
    ] = [],  # noqa: B006 - typer copies it
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 if an output has no sensitivity.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show the sensitivity of each output (Sobol indices), and draw main effects."""
    check_outputs({"--out": out}, {"--out": FIGURES})
    from turnout.study.sweep.effects import sweep_effects
    from turnout.study.sweep.read import read_labels

    labels = read_labels(folder)
    found = sweep_effects(labels, names=tuple(feature) or None)
    notes = {item.output.name: UNKNOWN_INDICES for item in found if has_no_indices(item)}
    if not as_json:
        _print_all_effects(labels, found, notes)
    if out is not None:
        from turnout.figures.style import rendered
        from turnout.figures.sweep import plot_sweep_effects

        figure = plot_sweep_effects(found, title=str(labels.attrs["name"]))
        write_and_report(out, rendered(figure, out.suffix), quiet=as_json)
    if as_json:
        from turnout.cli.json_records import effects_record

        record = effects_record(labels, found, notes=notes)
        print_json("sweep effects", record, written=[out] if out is not None else [])
    if strict and notes:
        raise typer.Exit(FINDINGS)


# Said once for all outputs that it holds for.
UNKNOWN_INDICES = (
    "no sensitivity: each value of an input occurs in one throw only, so its effect cannot be "
    "separated from chance; vary several inputs with random sampling, such as method = 'saltelli'"
)


def has_no_indices(item: "OutputEffects") -> bool:
    """Return True if no first-order index of an output is known."""
    return all(index.first != index.first for index in item.indices)


def _print_all_effects(
    labels: "xr.Dataset", found: "Sequence[OutputEffects]", notes: "Mapping[str, str]"
) -> None:
    _print_missing(labels)
    for item in found:
        if item.output.name not in notes:
            _print_effects(item)
    for text in dict.fromkeys(notes.values()):
        typer.echo(f"{', '.join(notes)}: {text}")
    skipped = int((labels["outcome"].astype(str) == "skipped").sum())
    if skipped:
        typer.echo(
            f"note: {skipped} throws were skipped after a drive slipped, so means at large values "
            "cover only places without slip; remove the skip rule for a fair comparison"
        )


def _print_missing(labels: "xr.Dataset") -> None:
    missing = int(labels.attrs["missing"])
    if missing:
        typer.echo(f"note: {missing} scenarios are missing; `turnout sweep run` continues")


def _print_effects(item: "OutputEffects") -> None:
    """List inputs by sensitivity, the strongest first."""
    typer.echo(item.output.name)
    width = max(len(index.name) for index in item.indices) + 2
    for index in sorted(item.indices, key=_weight, reverse=True):
        text = f"{index.first:6.3f} ± {index.first_confidence:.3f} first"
        if index.first != index.first:
            text = "unknown: each value occurs in one throw only"
        if index.total == index.total:
            text += f"   {index.total:6.3f} ± {index.total_confidence:.3f} total"
        typer.echo(f"  {index.name:<{width}}{text}")


def _weight(index: "SobolIndex") -> float:
    return index.total if index.total == index.total else index.first
