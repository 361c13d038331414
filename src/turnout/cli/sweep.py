"""The commands `turnout sweep ...`: studies and their runs."""

import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.options import (
    FIGURES,
    SCHEMA,
    CalibrationOption,
    File,
    WorkersOption,
    argument,
    first_sentence,
    gives,
    option,
)
from turnout.cli.output import FINDINGS, Output, note, print_schema, refuse, resumable
from turnout.cli.watch import cores, watched
from turnout.core.lean_imports import import_scipy
from turnout.core.value_text import count_text, duration_text, size_text

if TYPE_CHECKING:
    import xarray as xr

    from turnout.metric.sensitivity import OutputEffects, SobolIndex
    from turnout.study.study import Study
    from turnout.study.sweep.cluster import Cluster
    from turnout.study.sweep.forecast import Forecast

MOST_FAULTS = 5
"""Scenarios without results of which a run says why."""
app = typer.Typer(
    help="Many throws from one study file: list, show, plan, run, map, effects, export, schema.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
FolderArgument = Annotated[Path, argument("DIR", "Folder of a sweep.")]
FIGURE = File("--out -o FILE", "Write a figure (.png, .pdf or .svg).", FIGURES)
StudyArgument = Annotated[str, argument("STUDY", "Library study, or path of a study file (.toml).")]


@app.command("plan", short_help="Show inputs, number of throws, run time and disk space.")
@gives("sweep plan")
def plan_command(
    output: Output,
    study: StudyArgument,
    calibration: CalibrationOption = None,
    workers: WorkersOption = 0,
    trials: int = option("--trials N", "Throws to time; 0 for none.", default=3, min=0),
    quiet: bool = option("--quiet -q", "Show no progress."),
) -> None:
    """Show the inputs of a study, its number of throws, run time and disk space."""
    from turnout.figures.report.study import study_lines

    loaded = _study(study, calibration)
    output.lines(study_lines(loaded))
    used = workers or cores()
    busy = min(used, cores())
    found = _forecast(loaded, trials, quiet=quiet) if trials else None
    output.json(study_record, loaded, found, busy, units=PLAN_UNITS)
    if found is not None:
        output.lines(_forecast_lines(loaded, found, used=used, busy=busy))


def _study(name: str, calibration: Path | None) -> "Study":
    """Load a study; its remarks go to stderr."""
    from turnout.calibration.load_study import load_study

    loaded = load_study(name, calibration=calibration)
    for text in loaded.remarks:
        note(text)
    return loaded


def _forecast(loaded: "Study", trials: int, *, quiet: bool) -> "Forecast":
    from turnout.study.sweep.forecast import forecast

    with watched("throwing trials", quiet=quiet) as watch:
        return forecast(loaded, trials=trials, report=watch.report)


def _forecast_lines(loaded: "Study", found: "Forecast", *, used: int, busy: int) -> Iterator[str]:
    from turnout.figures.report.study import line

    bound = "at most " if loaded.rule is not None else ""
    total = duration_text(found.duration(loaded.count, workers=busy))
    each = duration_text(found.throw_time)
    yield line("time", f"{bound}{total} with {count_text(used, 'worker')}, {each} a throw")
    if used > busy:
        yield line("", f"this machine has {busy} cores; more workers do not help")
    whole, free = found.disk(loaded), shutil.disk_usage(Path.cwd()).free
    text = f"{bound}{size_text(whole)}, {size_text(whole / loaded.count)} a throw"
    yield line("disk", f"{text}; {size_text(free)} are free in this folder")
    if whole > free:
        yield line("", "NOT ENOUGH SPACE: store fewer channels, a lower rate, or use another disk")
    yield from (line("trial", f"failed: {fault}") for fault in found.faults)


@app.command("run", short_help="Run every scenario, or continue an interrupted run.")
@gives("sweep run", quiet=True)
def sweep_run_command(
    output: Output,
    study: StudyArgument,
    out: Path = option(
        "--out -o DIR", "Folder for the results; an interrupted run continues there.", default=...
    ),
    calibration: CalibrationOption = None,
    workers: WorkersOption = 0,
    scheduler: str | None = option("--scheduler ADDRESS", "Dask scheduler: tcp://HOST:PORT."),
    slurm: Path | None = option("--slurm PROFILE.toml", "Start workers as jobs of Slurm."),
) -> None:
    """Run every scenario of a study; the same command continues an interrupted run."""
    import_scipy()
    from turnout.study.sweep.folder import check_folder, study_identity
    from turnout.study.sweep.run import throw_study

    if scheduler is not None and slurm is not None:
        refuse("--scheduler and --slurm: use only one")
    loaded = _study(study, calibration)
    check_folder(out, study_identity(loaded))
    kept = f"the batches in {out} are complete, run the same command to continue"
    with (
        resumable(kept),
        _cluster(scheduler, slurm) as cluster,
        watched(loaded.name, quiet=output.quiet) as watch,
    ):
        finished = throw_study(
            loaded,
            out,
            workers=cluster.workers if cluster else workers or cores(),
            pool=cluster.pool if cluster else None,
            report=watch.sweep,
        )
    for path in finished.damaged:
        note(f"{path}: damaged batch, computed again")
    failed = sum(batch.failed for batch in finished.batches)
    faults = [text for batch in finished.batches for text in batch.faults][:MOST_FAULTS]
    lost = f"{failed} of {loaded.count} scenarios gave no results:\n  - " + "\n  - ".join(faults)
    if 0 < failed < loaded.count:
        note(lost)
    outcomes: Counter[str] = Counter()
    for batch in finished.batches:
        outcomes.update(batch.outcomes)
    retried = sum(batch.retried for batch in finished.batches)
    counts = ", ".join(f"{count} {name}" for name, count in outcomes.items())
    again = [f"{retried} needed a second attempt with half the step"] if retried else []
    output.rows("scenarios", [counts or "all were present", *again])
    output.show(f"{out} (description: README.md)", heading="written")
    output.written.append(out)
    output.json(
        lambda: {
            "study": loaded.name,
            "scenarios": loaded.count,
            "computed": outcomes,
            "retried": retried,
            "damaged": [str(path) for path in finished.damaged],
        }
    )
    if failed == loaded.count:
        refuse(lost)


@app.command("map", short_help="Count end states, and draw maps over two inputs.")
@gives("sweep map", out=FIGURE)
def map_command(
    output: Output,
    folder: FolderArgument,
    x: str = option("--x INPUT", "Input across.", default="object.size"),
    y: str | None = option("--y INPUT", "Input along; default object.at, or object.x."),
) -> None:
    """Count the end states of a sweep, and draw forces, gaps and end states over two inputs."""
    from turnout.figures.sweep import plot_sweep_map
    from turnout.metric.sweep_map import sweep_map
    from turnout.study.sweep.read import read_labels

    labels = read_labels(folder)
    along = y or ("object.at" if "object.at" in labels.coords else "object.x")
    cells = sweep_map(labels, x=x, y=along)
    found = map_record(labels, cells)
    counts = found[0]["states"].items()
    output.show(*_missing(labels), *(f"{n:>8}  {name}" for name, n in counts if n))
    output.show(*filter(None, [found[0].get("break_note")]))
    output.figure(output["out"], plot_sweep_map, cells)
    output.json(lambda: found)


@app.command("effects", short_help="Show Sobol indices, and draw main effects.")
@gives("sweep effects", out=FIGURE)
def effects_command(
    output: Output,
    folder: FolderArgument,
    feature: list[str] = option("--feature NAME", "Label or feature; repeatable.", default=[]),
    strict: bool = option("--strict", "Exit code 1 if an output has no sensitivity."),
) -> None:
    """Show the sensitivity of each output (Sobol indices), and draw main effects."""
    from turnout.figures.sweep import plot_sweep_effects
    from turnout.study.sweep.effects import sweep_effects
    from turnout.study.sweep.read import read_labels

    labels = read_labels(folder)
    found = sweep_effects(labels, names=tuple(feature) or None)
    notes = {item.output.name: UNKNOWN_INDICES for item in found if has_no_indices(item)}
    output.lines(effect_lines(labels, found, notes))
    output.figure(output["out"], plot_sweep_effects, found, title=str(labels.attrs["name"]))
    output.json(effects_record, labels, found, notes)
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


@app.command("export", short_help="Write a table with one row per scenario.")
@gives(
    "sweep export",
    json=False,
    quiet=True,
    parquet=File("--parquet FILE", "Table (.parquet).", (".parquet",)),
    csv=File("--csv FILE", "Table (.csv).", (".csv",)),
    mat=File("--mat FILE", "For MATLAB (.mat).", (".mat",)),
)
def sweep_export_command(output: Output, folder: FolderArgument) -> None:
    """Write inputs, outcomes, labels and features, one row per scenario."""
    paths = [path for name in ("parquet", "csv", "mat") if (path := output[name])]
    if not paths:
        refuse("sweep export: name at least one of --parquet, --csv, --mat with a file")
    from turnout.study.sweep.export import export_bytes, sweep_table

    table = sweep_table(folder)
    count, columns = table.shape
    output.show(f"{count} scenarios, {columns} columns", heading="table")
    for path in paths:
        output.write(path, export_bytes(table, path.suffix.lower()))


@contextmanager
def _cluster(scheduler: str | None, slurm: Path | None) -> Iterator["Cluster | None"]:
    """Return the requested cluster, None for local processes."""
    if scheduler is None and slurm is None:
        yield None
        return
    from turnout.study.sweep.cluster import scheduler_cluster, slurm_cluster

    if slurm is not None:
        with slurm_cluster(slurm) as cluster:
            yield cluster
    elif scheduler is not None:
        with scheduler_cluster(scheduler) as cluster:
            yield cluster


@app.command("list")
@gives("sweep list")
def sweep_list_command(output: Output) -> None:
    """List the library studies."""
    from turnout.calibration.load_study import load_study, study_names

    rows = [
        {"name": name, "throws": item.count, "description": first_sentence(item.description)}
        for name, item in ((name, load_study(name)) for name in study_names())
    ]
    width = max(len(str(row["name"])) for row in rows) + 2
    for row in rows:
        output.show(f"{row['name']:<{width}}{row['throws']:>7} throws  {row['description']}")
    output.json(lambda: {"studies": rows})


@app.command("show")
def sweep_show_command(study: StudyArgument) -> None:
    """Print the file of a library study, as a template."""
    from turnout.calibration.load_study import study_text

    typer.echo(study_text(study).rstrip())


@app.command("schema")
@gives("schema", json=False, out=SCHEMA)
def sweep_schema_command(output: Output) -> None:
    """Print the JSON schema of study files, for editors."""
    from turnout.study.read_study import study_schema

    print_schema(output, study_schema())


PLAN_UNITS = {"throw_time": "s", "duration": "s", "disk": "byte", "disk_free": "byte"}


def study_record(study: "Study", found: "Forecast | None", workers: int) -> dict[str, Any]:
    """Return the size of a study and, after trial throws, its time and disk space."""
    return {
        "study": study.name,
        "seed": study.seed,
        "panel": study.panel.name,
        "panel_hash": study.panel.hash,
        "scenarios": study.count,
        "inputs": [*study.variables, *(field.name for field in study.fields)],
        "channels": study.output.channels,
        "workers": workers,
        "throw_time": found.throw_time if found else None,
        "duration": found.duration(study.count, workers=workers) if found else None,
        "disk": found.disk(study) if found else None,
        "faults": found.faults if found else [],
        "disk_free": shutil.disk_usage(Path.cwd()).free,
    }


def map_record(labels: "xr.Dataset", cells: "xr.Dataset") -> tuple[dict[str, Any], dict[str, str]]:
    """Return end states of a sweep and its map over two inputs."""
    from turnout.metric.sweep_map import STATES, end_state
    from turnout.throw.verdict import break_note

    state, note = end_state(labels).to_numpy(), break_note(labels)
    quantities = [str(name) for name in cells.data_vars if name != "state"]
    units = {name: str(cells[name].attrs.get("units", "")) for name in (*quantities, "x", "y")}
    record = {
        "sweep": labels.attrs.get("name"),
        "missing": int(labels.attrs["missing"]),
        "states": {name: int((state == number).sum()) for number, name in enumerate(STATES)},
        **({"break_note": note} if note else {}),
        "x_input": cells.attrs["x_input"],
        "y_input": cells.attrs["y_input"],
        "x": cells["x"].values,
        "y": cells["y"].values,
        "state": [[STATES[item] for item in row] for row in cells["state"].values],
        **{name: cells[name].values for name in quantities},
    }
    return record, {name: unit for name, unit in units.items() if unit not in ("", "1")}


def effects_record(
    labels: "xr.Dataset", found: "Sequence[OutputEffects]", notes: Mapping[str, str]
) -> dict[str, Any]:
    """Return Sobol indices and main effects of each output."""
    return {
        "sweep": labels.attrs.get("name"),
        "missing": int(labels.attrs["missing"]),
        "outputs": [
            {
                "name": item.output.name,
                "unit": item.output.units,
                "indices": item.indices,
                "effects": item.effects,
                "note": notes.get(item.output.name),
            }
            for item in found
        ],
    }
