"""The commands `turnout sweep run` and `turnout sweep export`."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import CalibrationOption
from turnout.cli.watch import FIRST_LINE_AFTER, SECONDS_BETWEEN_LINES

if TYPE_CHECKING:
    from rich.progress import Progress

    from turnout.study.sweep_cluster import Cluster
    from turnout.study.sweep_run import Finished, State

INTERRUPTED = 130

FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep.")]
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
    from turnout.study.sweep_folder import check_folder
    from turnout.study.sweep_run import run_sweep

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
        _tell(finished, out)


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
    from turnout.cli.outputs import check_outputs
    from turnout.errors import FileError

    paths = {"--parquet": parquet, "--csv": csv, "--mat": mat}
    check_outputs(paths, {option: (f".{option.strip('-')}",) for option in paths})
    if not any(paths.values()):
        message = "sweep export: name at least one of --parquet, --csv, --mat with a file"
        raise FileError(message)
    from turnout.study.sweep_export import export_bytes, table_of

    table = table_of(folder)
    for path in paths.values():
        if path is None:
            continue
        from turnout.files.atomic import write_atomic

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
    from turnout.study.sweep_cluster import scheduler_cluster, slurm_cluster

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


def _tell(finished: "Finished", out: Path) -> None:
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
