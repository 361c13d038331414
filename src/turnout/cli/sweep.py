"""The commands `turnout sweep ...`.

The command `turnout sweep plan`: what a study comes to before anything is kept. The commands
`turnout sweep map` and `turnout sweep effects`, which look at results. The commands `turnout sweep
run` and `turnout sweep export`. The commands `turnout sweep ...`; those that look at studies before
anything is thrown.
"""

import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import (
    FIGURES,
    CalibrationOption,
    check_outputs,
    print_schema,
    write_and_report,
)
from turnout.cli.watch import FIRST_LINE_AFTER, SECONDS_BETWEEN_LINES

if TYPE_CHECKING:
    import xarray as xr
    from rich.progress import Progress

    from turnout.metric.effects import Decided, Index
    from turnout.sweep.cluster import Cluster
    from turnout.sweep.run import Finished, State


StudyArgument = Annotated[
    str, typer.Argument(metavar="STUDY", help="Library study, or path of a study file (.toml).")
]


def plan_command(
    study: StudyArgument,
    calibration: CalibrationOption = None,
    workers: Annotated[
        int, typer.Option("--workers", min=0, help="Processes; default one a core.")
    ] = 0,
    trials: Annotated[
        int, typer.Option("--trials", min=0, help="Throws to take the time of; 0 for none.")
    ] = 3,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
) -> None:
    """Tell what a study varies and how many throws, how long and how large it comes to."""
    from turnout.report.study import duration_text, line, size_text, study_lines
    from turnout.study.study import load_study

    loaded = load_study(study, calibration=calibration)
    for text in loaded.remarks:
        typer.echo(f"turnout: {text}", err=True)
    for text in study_lines(loaded):
        typer.echo(text)
    if not trials:
        return
    from turnout.cli.watch import watched
    from turnout.sweep.forecast import forecast

    with watched("throwing trials", quiet=quiet) as watch:
        found = forecast(loaded, trials=trials, report=watch.report)
    used = workers or cores()
    busy = min(used, cores())
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
        typer.echo(line("", "NOT ENOUGH: keep fewer channels, a lower rate, or take another disk"))
    for fault in found.faults:
        typer.echo(line("trial", f"did not come to an end, {fault}"))


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
    from turnout.sweep.read import read_labels

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
        from turnout.plot.sweep import plot_sweep_map

        write_and_report(out, rendered(plot_sweep_map(cells), out.suffix))


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
    from turnout.sweep.effects import sweep_effects
    from turnout.sweep.read import read_labels

    labels = read_labels(folder)
    _tell_missing(labels)
    found = sweep_effects(labels, names=tuple(feature) or None)
    for item in found:
        _print_effects(item)
    skipped = int((labels["outcome"].astype(str) == "skipped").sum())
    if skipped:
        typer.echo(
            f"note: {skipped} throws were left out once a drive had slipped, so means over large "
            "values are those of places where none slips; drop the rule to compare fairly"
        )
    if out is not None:
        from turnout.plot.style import rendered
        from turnout.plot.sweep import plot_sweep_effects

        figure = plot_sweep_effects(found, title=str(labels.attrs["name"]))
        write_and_report(out, rendered(figure, out.suffix))


def _tell_missing(labels: "xr.Dataset") -> None:
    missing = int(labels.attrs["missing"])
    if missing:
        typer.echo(f"note: {missing} scenarios are not thrown yet; `turnout sweep run` goes on")


def _print_effects(item: "Decided") -> None:
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


INTERRUPTED = 130

QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Show nothing but errors.")]


def run_command(
    study: Annotated[
        str, typer.Argument(metavar="STUDY", help="Library study, or study file (.toml).")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to fill, or to go on with.")
    ],
    calibration: CalibrationOption = None,
    workers: Annotated[
        int, typer.Option("--workers", min=0, help="Processes; default one a core.")
    ] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler: tcp://HOST:PORT."),
    ] = None,
    slurm: Annotated[
        Path | None,
        typer.Option("--slurm", metavar="PROFILE.toml", help="Start workers as jobs of Slurm."),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Throw every scenario of a study; the same command goes on where one was ended."""
    from turnout.errors import FileError
    from turnout.study.study import load_study
    from turnout.sweep.folder import check_folder
    from turnout.sweep.run import run_sweep

    if scheduler is not None and slurm is not None:
        message = "--scheduler and --slurm: take one of them"
        raise FileError(message)
    loaded = load_study(study, calibration=calibration)
    for text in loaded.remarks:
        typer.echo(f"turnout: {text}", err=True)
    check_folder(out, loaded)
    watch = SweepWatch(loaded.name, quiet=quiet)
    try:
        with _cluster(scheduler, slurm) as cluster, watch:
            finished = run_sweep(
                loaded,
                out,
                workers=cluster.workers if cluster else workers or _cores(),
                pool=cluster.pool if cluster else None,
                report=watch.report,
            )
    except KeyboardInterrupt:
        typer.echo(
            f"turnout: interrupted; the batches written to {out} stay, the same command goes on",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None
    for path in finished.damaged:
        typer.echo(f"turnout: {path}: was a damaged batch, which was thrown again", err=True)
    if not quiet:
        _print_finished(finished, out)


def export_command(
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
    """Write inputs, outcomes, labels and features, a row a scenario."""
    from turnout.cli.options import check_outputs
    from turnout.errors import FileError

    paths = {"--parquet": parquet, "--csv": csv, "--mat": mat}
    check_outputs(paths, {option: (f".{option.strip('-')}",) for option in paths})
    if not any(paths.values()):
        message = "sweep export: name at least one of --parquet, --csv, --mat with a file"
        raise FileError(message)
    from turnout.sweep.export import export_bytes, table_of

    table = table_of(folder)
    for path in paths.values():
        if path is None:
            continue
        from turnout.core.atomic import write_atomic

        write_atomic(path, export_bytes(table, path.suffix.lower()))
        if not quiet:
            count, columns = table.shape
            typer.echo(f"{'written':<12}{path} ({count} scenarios, {columns} columns)")


@contextmanager
def _cluster(scheduler: str | None, slurm: Path | None) -> Iterator["Cluster | None"]:
    """Give the cluster that was asked for, None for processes of this machine."""
    if scheduler is None and slurm is None:
        yield None
        return
    from turnout.sweep.cluster import scheduler_cluster, slurm_cluster

    if slurm is not None:
        with slurm_cluster(slurm) as cluster:
            yield cluster
    elif scheduler is not None:
        with scheduler_cluster(scheduler) as cluster:
            yield cluster


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _print_finished(finished: "Finished", out: Path) -> None:
    outcomes: dict[str, int] = {}
    for batch in finished.batches:
        for name, count in batch.outcomes.items():
            outcomes[name] = outcomes.get(name, 0) + count
    said = ", ".join(f"{count} {name}" for name, count in outcomes.items()) or "nothing was missing"
    typer.echo(f"{'scenarios':<12}{said}")
    retried = sum(batch.retried for batch in finished.batches)
    if retried:
        typer.echo(f"{'':<12}{retried} took a second attempt with half the step")
    typer.echo(f"{'written':<12}{out} (what it is: README.md)")


class SweepWatch:
    """Shows done, failed, rate and time left: a bar on a terminal, plain lines elsewhere."""

    def __init__(self, text: str, *, quiet: bool) -> None:
        self._text, self._quiet = text, quiet
        self._bar: Progress | None = None
        self._due = 0.0

    def __enter__(self) -> "SweepWatch":
        """Be silent for what takes two seconds; say at once when kernels must be compiled."""
        from turnout.cli.watch import COMPILING
        from turnout.response.compilation import must_compile

        self._due = time.monotonic() + FIRST_LINE_AFTER
        if must_compile() and not self._quiet:
            print(COMPILING, file=sys.stderr, flush=True)
        return self

    def __exit__(self, *given: object) -> None:
        """Take the bar off the screen."""
        if self._bar is not None:
            self._bar.stop()

    def report(self, state: "State") -> None:
        """Show how far a sweep is."""
        now = time.monotonic()
        if self._quiet or (self._bar is None and now < self._due):
            return
        if sys.stderr.isatty():
            self._show_bar(state)
        elif now >= self._due:
            self._due = now + SECONDS_BETWEEN_LINES
            print(f"{self._text}: {described(state)}", file=sys.stderr, flush=True)

    def _show_bar(self, state: "State") -> None:
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
        self._bar.update(self._bar.task_ids[0], completed=state.done, s=described(state))


def described(state: "State") -> str:
    """Say how far a sweep is, in one line."""
    text = f"{state.done} of {state.total} done"
    if state.failed:
        text += f", {state.failed} failed"
    if state.rate:
        text += f", {state.rate:.3g} a second, {duration(state.left)} left"
    return text


def duration(seconds: float) -> str:
    """Write a time as people say it.

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

app.command("plan")(plan_command)
app.command("run")(run_command)
app.command("map")(map_command)
app.command("effects")(effects_command)
app.command("export")(export_command)


@app.command("list")
def list_command() -> None:
    """List the studies that come with the program."""
    from turnout.study.read import study_names
    from turnout.study.study import load_study

    names = study_names()
    width = max(len(name) for name in names) + 2
    for name in names:
        study = load_study(name)
        first = " ".join(study.description.split()).split(". ")[0].rstrip(".")
        typer.echo(f"{name:<{width}}{study.count:>7} throws  {first}")


@app.command("show")
def show_command(study: StudyArgument) -> None:
    """Show the text of a library study, to start an own one from."""
    from turnout.study.read import study_text

    typer.echo(study_text(study).rstrip())


@app.command("schema")
def schema_command(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.json", help="Write it to a file.")
    ] = None,
) -> None:
    """Give the JSON schema of study files, for editors."""
    check_outputs({"--out": out}, {"--out": (".json",)})

    from turnout.study.schema import study_schema

    print_schema(study_schema(), out)
