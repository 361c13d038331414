"""The commands `turnout sweep ...`: studies and their runs."""

import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import (
    INTERRUPTED,
    CalibrationOption,
    QuietOption,
    check_outputs,
    first_sentence,
    print_schema,
)
from turnout.cli.sweep_results import FolderArgument, effects_command, map_command
from turnout.cli.watch import FIRST_LINE_AFTER, SECONDS_BETWEEN_LINES
from turnout.core.lean_imports import import_scipy

if TYPE_CHECKING:
    from rich.progress import Progress

    from turnout.study.study import Study
    from turnout.study.sweep.cluster import Cluster
    from turnout.study.sweep.forecast import Forecast
    from turnout.study.sweep.run import SweepProgress, SweepResult


StudyArgument = Annotated[
    str, typer.Argument(metavar="STUDY", help="Library study, or path of a study file (.toml).")
]


def plan_command(
    study: StudyArgument,
    calibration: CalibrationOption = None,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=0, help="Processes; default one a core.")
    ] = 0,
    trials: Annotated[
        int, typer.Option("--trials", metavar="N", min=0, help="Throws to time; 0 for none.")
    ] = 3,
    as_json: JsonOption = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
) -> None:
    """Show the inputs of a study, its number of throws, run time and disk space."""
    from turnout.calibration.load_study import load_study
    from turnout.figures.report.study import study_lines

    loaded = load_study(study, calibration=calibration)
    for text in loaded.remarks:
        typer.echo(f"turnout: {text}", err=True)
    for text in () if as_json else study_lines(loaded):
        typer.echo(text)
    used = workers or cores()
    busy = min(used, cores())
    found = _forecast(loaded, trials, quiet=quiet) if trials else None
    if as_json:
        from turnout.cli.json_records import PLAN_UNITS, study_record

        record = study_record(loaded, found, workers=busy)
        free = shutil.disk_usage(Path.cwd()).free
        print_json("sweep plan", {**record, "disk_free": free}, units=PLAN_UNITS)
    elif found is not None:
        _print_forecast(loaded, found, used=used, busy=busy)


def _forecast(loaded: "Study", trials: int, *, quiet: bool) -> "Forecast":
    from turnout.cli.watch import watched
    from turnout.study.sweep.forecast import forecast

    with watched("throwing trials", quiet=quiet) as watch:
        return forecast(loaded, trials=trials, report=watch.report)


def _print_forecast(loaded: "Study", found: "Forecast", *, used: int, busy: int) -> None:
    from turnout.figures.report.study import duration_text, line, size_text

    bound = "at most " if loaded.rule is not None else ""
    total = duration_text(found.duration(loaded.count, workers=busy))
    each = duration_text(found.throw_time)
    typer.echo(line("time", f"{bound}{total} with {used} worker{'s' * (used > 1)}, {each} a throw"))
    if used > busy:
        typer.echo(line("", f"this machine has {busy} cores; more workers do not help"))
    whole, free = found.disk(loaded), shutil.disk_usage(Path.cwd()).free
    text = f"{bound}{size_text(whole)}, {size_text(whole / loaded.count)} a throw"
    typer.echo(line("disk", f"{text}; {size_text(free)} are free in this folder"))
    if whole > free:
        typer.echo(
            line("", "NOT ENOUGH SPACE: store fewer channels, a lower rate, or use another disk")
        )
    for fault in found.faults:
        typer.echo(line("trial", f"failed: {fault}"))


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def sweep_run_command(
    study: Annotated[
        str, typer.Argument(metavar="STUDY", help="Library study, or study file (.toml).")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder for the results; an interrupted run continues there.",
        ),
    ],
    calibration: CalibrationOption = None,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=0, help="Processes; default one a core.")
    ] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler: tcp://HOST:PORT."),
    ] = None,
    slurm: Annotated[
        Path | None,
        typer.Option("--slurm", metavar="PROFILE.toml", help="Start workers as jobs of Slurm."),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run every scenario of a study; the same command continues an interrupted run."""
    import_scipy()
    from turnout.calibration.load_study import load_study
    from turnout.core.errors import FileError
    from turnout.study.sweep.folder import check_folder
    from turnout.study.sweep.run import throw_study

    if scheduler is not None and slurm is not None:
        message = "--scheduler and --slurm: use only one"
        raise FileError(message)
    loaded = load_study(study, calibration=calibration)
    for text in loaded.remarks:
        typer.echo(f"turnout: {text}", err=True)
    check_folder(out, loaded)
    watch = SweepWatch(loaded.name, quiet=quiet)
    try:
        with _cluster(scheduler, slurm) as cluster, watch:
            finished = throw_study(
                loaded,
                out,
                workers=cluster.workers if cluster else workers or cores(),
                pool=cluster.pool if cluster else None,
                report=watch.report,
            )
    except KeyboardInterrupt:
        typer.echo(
            f"turnout: interrupted; the batches in {out} are complete, "
            "run the same command to continue",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None
    for path in finished.damaged:
        typer.echo(f"turnout: {path}: damaged batch, computed again", err=True)
    if as_json:
        record = {
            "study": loaded.name,
            "scenarios": loaded.count,
            "computed": _outcomes(finished),
            "retried": sum(batch.retried for batch in finished.batches),
            "damaged": [str(path) for path in finished.damaged],
        }
        print_json("sweep run", record, written=[out])
    elif not quiet:
        _print_finished(finished, out)


def sweep_export_command(
    folder: FolderArgument,
    parquet: Annotated[
        Path | None, typer.Option("--parquet", metavar="FILE", help="Table (.parquet).")
    ] = None,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Table (.csv).")] = None,
    mat: Annotated[
        Path | None, typer.Option("--mat", metavar="FILE", help="For MATLAB (.mat).")
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Write inputs, outcomes, labels and features, one row per scenario."""
    from turnout.cli.options import check_outputs
    from turnout.core.errors import FileError

    paths = {"--parquet": parquet, "--csv": csv, "--mat": mat}
    check_outputs(paths, {option: (f".{option.strip('-')}",) for option in paths})
    if not any(paths.values()):
        message = "sweep export: name at least one of --parquet, --csv, --mat with a file"
        raise FileError(message)
    from turnout.study.sweep.export import export_bytes, sweep_table

    table = sweep_table(folder)
    for path in paths.values():
        if path is None:
            continue
        from turnout.core.files import write_atomic

        write_atomic(path, export_bytes(table, path.suffix.lower()))
        if not quiet:
            count, columns = table.shape
            typer.echo(f"{'written':<12}{path} ({count} scenarios, {columns} columns)")


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


def _outcomes(finished: "SweepResult") -> dict[str, int]:
    """Return the number of computed scenarios by outcome."""
    outcomes: dict[str, int] = {}
    for batch in finished.batches:
        for name, count in batch.outcomes.items():
            outcomes[name] = outcomes.get(name, 0) + count
    return outcomes


def _print_finished(finished: "SweepResult", out: Path) -> None:
    outcomes = _outcomes(finished)
    text = ", ".join(f"{count} {name}" for name, count in outcomes.items()) or "all were present"
    typer.echo(f"{'scenarios':<12}{text}")
    retried = sum(batch.retried for batch in finished.batches)
    if retried:
        typer.echo(f"{'':<12}{retried} needed a second attempt with half the step")
    typer.echo(f"{'written':<12}{out} (description: README.md)")


class SweepWatch:
    """Shows done, failed, rate and time left: a bar on a terminal, plain lines elsewhere."""

    def __init__(self, text: str, *, quiet: bool) -> None:
        self._text, self._quiet = text, quiet
        self._bar: Progress | None = None
        self._due = 0.0

    def __enter__(self) -> "SweepWatch":
        """Stay silent for two seconds, but announce compilation at once."""
        from turnout.cli.watch import COMPILING
        from turnout.throw.compilation import must_compile

        self._due = time.monotonic() + FIRST_LINE_AFTER
        if must_compile() and not self._quiet:
            print(COMPILING, file=sys.stderr, flush=True)
        return self

    def __exit__(self, *given: object) -> None:
        """Take the bar off the screen."""
        if self._bar is not None:
            self._bar.stop()

    def report(self, state: "SweepProgress") -> None:
        """Show the progress of a sweep."""
        now = time.monotonic()
        if self._quiet or (self._bar is None and now < self._due):
            return
        if sys.stderr.isatty():
            self._show_bar(state)
        elif now >= self._due:
            self._due = now + SECONDS_BETWEEN_LINES
            print(f"{self._text}: {progress_line(state)}", file=sys.stderr, flush=True)

    def _show_bar(self, state: "SweepProgress") -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.fields[s]}"),
            )
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._bar.add_task(self._text, total=state.total, s="")
        self._bar.update(self._bar.task_ids[0], completed=state.done, s=progress_line(state))


def progress_line(state: "SweepProgress") -> str:
    """Return the progress of a sweep in one line."""
    text = f"{state.done} of {state.total} done"
    if state.failed:
        text += f", {state.failed} failed"
    if state.rate:
        text += f", {state.rate:.3g} a second, {duration(state.left)} left"
    return text


def duration(seconds: float) -> str:
    """Return a duration in readable units.

    Examples
    --------
    >>> duration(42.0), duration(3725.0)
    ('42 s', '1 h 02 min')
    """
    whole = round(seconds)
    if whole < 100:
        return f"{whole} s"
    minutes = round(whole / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


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
    if as_json:
        print_json("sweep list", {"studies": rows})
        return
    width = max(len(str(row["name"])) for row in rows) + 2
    for row in rows:
        typer.echo(f"{row['name']:<{width}}{row['throws']:>7} throws  {row['description']}")


@app.command("show")
def sweep_show_command(study: StudyArgument) -> None:
    """Print the file of a library study, as a template."""
    from turnout.calibration.load_study import study_text

    typer.echo(study_text(study).rstrip())


@app.command("schema")
def sweep_schema_command(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE.json", help="Write it to a file.")
    ] = None,
) -> None:
    """Print the JSON schema of study files, for editors."""
    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.study.read_study import study_schema

    print_schema(study_schema(), out)
