"""The commands `turnout sweep ...`: studies and their runs."""

import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import (
    CalibrationOption,
    QuietOption,
    WorkersOption,
    argument,
    check_outputs,
    first_sentence,
    option,
)
from turnout.cli.output import JsonOption, Output, note, print_schema, refuse, resumable
from turnout.cli.sweep_results import FolderArgument, effects_command, map_command
from turnout.cli.watch import cores, watched
from turnout.core.lean_imports import import_scipy
from turnout.core.value_text import count_text, duration_text, size_text

if TYPE_CHECKING:
    from turnout.study.study import Study
    from turnout.study.sweep.cluster import Cluster
    from turnout.study.sweep.forecast import Forecast


StudyArgument = Annotated[str, argument("STUDY", "Library study, or path of a study file (.toml).")]


def plan_command(
    study: StudyArgument,
    calibration: CalibrationOption = None,
    workers: WorkersOption = 0,
    trials: Annotated[int, option("--trials N", "Throws to time; 0 for none.", min=0)] = 3,
    as_json: JsonOption = False,
    quiet: Annotated[bool, option("--quiet -q", "Show no progress.")] = False,
) -> None:
    """Show the inputs of a study, its number of throws, run time and disk space."""
    from turnout.figures.report.study import study_lines

    loaded, output = _study(study, calibration), Output("sweep plan", as_json=as_json)
    if not as_json:
        output.show(*study_lines(loaded))
    used = workers or cores()
    busy = min(used, cores())
    found = _forecast(loaded, trials, quiet=quiet) if trials else None
    if as_json:
        from turnout.cli.json_records import PLAN_UNITS, study_record

        record = study_record(loaded, found, workers=busy)
        free = shutil.disk_usage(Path.cwd()).free
        output.json({**record, "disk_free": free}, units=PLAN_UNITS)
    elif found is not None:
        output.show(*_forecast_lines(loaded, found, used=used, busy=busy))


def _study(name: str, calibration: Path | None) -> "Study":
    """Load a study; its remarks go to stderr."""
    from turnout.calibration.load_study import load_study

    loaded = load_study(name, calibration=calibration)
    for text in loaded.remarks:
        note(text)
    return loaded


def _forecast(loaded: "Study", trials: int, *, quiet: bool) -> "Forecast":
    from turnout.cli.watch import watched
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


def sweep_run_command(
    study: StudyArgument,
    out: Annotated[
        Path, option("--out -o DIR", "Folder for the results; an interrupted run continues there.")
    ],
    calibration: CalibrationOption = None,
    workers: WorkersOption = 0,
    scheduler: Annotated[
        str | None, option("--scheduler ADDRESS", "Dask scheduler: tcp://HOST:PORT.")
    ] = None,
    slurm: Annotated[
        Path | None, option("--slurm PROFILE.toml", "Start workers as jobs of Slurm.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run every scenario of a study; the same command continues an interrupted run."""
    import_scipy()
    from turnout.study.sweep.folder import check_folder
    from turnout.study.sweep.run import throw_study

    if scheduler is not None and slurm is not None:
        refuse("--scheduler and --slurm: use only one")
    loaded = _study(study, calibration)
    check_folder(out, loaded)
    kept = f"the batches in {out} are complete, run the same command to continue"
    with (
        resumable(kept),
        _cluster(scheduler, slurm) as cluster,
        watched(loaded.name, quiet=quiet) as watch,
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
    output = Output("sweep run", as_json=as_json, quiet=quiet)
    outcomes: Counter[str] = Counter()
    for batch in finished.batches:
        outcomes.update(batch.outcomes)
    retried = sum(batch.retried for batch in finished.batches)
    counts = ", ".join(f"{count} {name}" for name, count in outcomes.items())
    again = [f"{retried} needed a second attempt with half the step"] if retried else []
    output.rows("scenarios", [counts or "all were present", *again])
    output.show(f"{out} (description: README.md)", heading="written")
    if as_json:
        output.written.append(out)
        output.json(
            {
                "study": loaded.name,
                "scenarios": loaded.count,
                "computed": outcomes,
                "retried": retried,
                "damaged": [str(path) for path in finished.damaged],
            }
        )


def sweep_export_command(
    folder: FolderArgument,
    parquet: Annotated[Path | None, option("--parquet FILE", "Table (.parquet).")] = None,
    csv: Annotated[Path | None, option("--csv FILE", "Table (.csv).")] = None,
    mat: Annotated[Path | None, option("--mat FILE", "For MATLAB (.mat).")] = None,
    quiet: QuietOption = False,
) -> None:
    """Write inputs, outcomes, labels and features, one row per scenario."""
    paths = {"--parquet": parquet, "--csv": csv, "--mat": mat}
    check_outputs(paths, {option: (f".{option.strip('-')}",) for option in paths})
    if not any(paths.values()):
        refuse("sweep export: name at least one of --parquet, --csv, --mat with a file")
    from turnout.study.sweep.export import export_bytes, sweep_table

    table, output = sweep_table(folder), Output("sweep export", quiet=quiet)
    count, columns = table.shape
    output.show(f"{count} scenarios, {columns} columns", heading="table")
    for path in filter(None, paths.values()):
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


app = typer.Typer(
    help="Many throws from one study file: list, show, plan, run, map, effects, export, schema.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

app.command("plan", short_help="Show inputs, number of throws, run time and disk space.")(
    plan_command
)
app.command("run", short_help="Run every scenario, or continue an interrupted run.")(
    sweep_run_command
)
app.command("map", short_help="Count end states, and draw maps over two inputs.")(map_command)
app.command("effects", short_help="Show Sobol indices, and draw main effects.")(effects_command)
app.command("export", short_help="Write a table with one row per scenario.")(sweep_export_command)


@app.command("list")
def sweep_list_command(as_json: JsonOption = False) -> None:
    """List the library studies."""
    from turnout.calibration.load_study import load_study, study_names

    rows = [
        {"name": name, "throws": item.count, "description": first_sentence(item.description)}
        for name, item in ((name, load_study(name)) for name in study_names())
    ]
    output = Output("sweep list", as_json=as_json)
    width = max(len(str(row["name"])) for row in rows) + 2
    for row in rows:
        output.show(f"{row['name']:<{width}}{row['throws']:>7} throws  {row['description']}")
    if as_json:
        output.json({"studies": rows})


@app.command("show")
def sweep_show_command(study: StudyArgument) -> None:
    """Print the file of a library study, as a template."""
    from turnout.calibration.load_study import study_text

    typer.echo(study_text(study).rstrip())


@app.command("schema")
def sweep_schema_command(
    out: Annotated[Path | None, option("--out -o FILE.json", "Write it to a file.")] = None,
) -> None:
    """Print the JSON schema of study files, for editors."""
    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.study.read_study import study_schema

    print_schema(study_schema(), out)
