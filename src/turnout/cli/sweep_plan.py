"""The command `turnout sweep plan`: what a study comes to before anything is kept."""

import os
import shutil
from pathlib import Path
from typing import Annotated

import typer

from turnout.cli.options import CalibrationOption

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
    from turnout.study.forecast import forecast

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
