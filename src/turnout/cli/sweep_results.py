"""The commands `turnout sweep map` and `turnout sweep effects`: results of a sweep."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import FIGURES, argument, check_outputs, option
from turnout.cli.output import FINDINGS, JsonOption, Output

if TYPE_CHECKING:
    import xarray as xr

    from turnout.metric.sensitivity import OutputEffects, SobolIndex

FolderArgument = Annotated[Path, argument("DIR", "Folder of a sweep.")]
OutOption = Annotated[Path | None, option("--out -o FILE", "Write a figure (.png, .pdf or .svg).")]


def map_command(
    folder: FolderArgument,
    out: OutOption = None,
    x: Annotated[str, option("--x INPUT", "Input across.")] = "object.size",
    y: Annotated[
        str | None, option("--y INPUT", "Input along; default object.at, or object.x.")
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
    output = Output("sweep map", as_json=as_json)
    counts = {name: int((state == number).sum()) for number, name in enumerate(STATES)}
    output.show(*_missing(labels), *(f"{n:>8}  {name}" for name, n in counts.items() if n))
    output.show(*filter(None, [break_note(labels)]))
    if out is not None:
        from turnout.figures.sweep import plot_sweep_map

        output.figure(out, lambda: plot_sweep_map(cells))
    if as_json:
        from turnout.cli.json_records import map_record

        record, units = map_record(labels, cells)
        output.json(record, units=units)


def effects_command(
    folder: FolderArgument,
    out: OutOption = None,
    feature: Annotated[list[str], option("--feature NAME", "Label or feature; repeatable.")] = [],  # noqa: B006 - typer copies it
    strict: Annotated[
        bool, option("--strict", "Exit code 1 if an output has no sensitivity.")
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
    output = Output("sweep effects", as_json=as_json)
    output.show(*effect_lines(labels, found, notes))
    if out is not None:
        from turnout.figures.sweep import plot_sweep_effects

        output.figure(out, lambda: plot_sweep_effects(found, title=str(labels.attrs["name"])))
    if as_json:
        from turnout.cli.json_records import effects_record

        output.json(effects_record(labels, found, notes=notes))
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


def effect_lines(
    labels: "xr.Dataset", found: "Sequence[OutputEffects]", notes: "Mapping[str, str]"
) -> Iterator[str]:
    """Yield the inputs of each output by sensitivity, the strongest first."""
    yield from _missing(labels)
    for item in found:
        if item.output.name not in notes:
            yield from _effects(item)
    for text in dict.fromkeys(notes.values()):
        yield f"{', '.join(notes)}: {text}"
    skipped = int((labels["outcome"].astype(str) == "skipped").sum())
    if skipped:
        yield (
            f"note: {skipped} throws were skipped after a drive slipped, so means at large values "
            "cover only places without slip; remove the skip rule for a fair comparison"
        )


def _missing(labels: "xr.Dataset") -> Iterator[str]:
    missing = int(labels.attrs["missing"])
    if missing:
        yield f"note: {missing} scenarios are missing; `turnout sweep run` continues"


def _effects(item: "OutputEffects") -> Iterator[str]:
    yield item.output.name
    width = max(len(index.name) for index in item.indices) + 2
    for index in sorted(item.indices, key=_weight, reverse=True):
        text = f"{index.first:6.3f} ± {index.first_confidence:.3f} first"
        if index.first != index.first:
            text = "unknown: each value occurs in one throw only"
        if index.total == index.total:
            text += f"   {index.total:6.3f} ± {index.total_confidence:.3f} total"
        yield f"  {index.name:<{width}}{text}"


def _weight(index: "SobolIndex") -> float:
    return index.total if index.total == index.total else index.first
