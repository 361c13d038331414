"""The command `turnout calibrate`: friction and drive values from a campaign, with uncertainty."""

import re
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.campaign import OutsideOption, opened_campaign
from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import (
    DEFAULT_PANEL,
    FINDINGS,
    INTERRUPTED,
    QuietOption,
    SetOption,
    check_outputs,
    made_folder,
    opened_panel,
)
from turnout.core.value_text import count_text, value_text
from turnout.measurement.campaign.campaign_folder import throw_store

if TYPE_CHECKING:
    import xarray as xr

    from turnout.calibration.grid_search import GridSearch
    from turnout.calibration.result import Calibration
    from turnout.calibration.stage_progress import CalibrationProgress

SECONDS_BETWEEN_LINES = 2.0
LEAST_LEFT, LEAST_THROWS = 5.0, 10
"""Below this time [s], and before so many throws, the time left is not estimated."""


def calibrate_command(
    source: Annotated[
        Path, typer.Argument(metavar="CAMPAIGN", help="Folder of a campaign, or its dataset (.nc).")
    ],
    panel: Annotated[
        str, typer.Option("--panel", metavar="PANEL", help="Library panel or panel file.")
    ] = DEFAULT_PANEL,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FILE.toml", help="Where the result goes.")
    ] = Path("calibration.toml"),
    free: Annotated[
        list[str],
        typer.Option("--free", metavar="KEY", help="Fit this key of the panel too. Repeat."),
    ] = [],  # noqa: B006 - typer copies it
    fix: Annotated[
        list[str],
        typer.Option("--fix", metavar="KEY", help="Keep the panel's value of this key. Repeat."),
    ] = [],  # noqa: B006 - typer copies it
    exclude: Annotated[
        list[str],
        typer.Option("--exclude", metavar="MOVEMENT", help="Leave this movement out. Repeat."),
    ] = [],  # noqa: B006 - typer copies it
    most: Annotated[
        int,
        typer.Option("--most", min=0, metavar="N", help="Movements of the last stage; 0: all."),
    ] = 20,
    figures: Annotated[
        Path | None,
        typer.Option(
            "--figures",
            metavar="DIR",
            help="Draw each sweep, intervals, correlations, and each movement as fitted.",
        ),
    ] = None,
    posterior: Annotated[
        bool,
        typer.Option("--posterior", help="Sample the posterior, with profile likelihoods."),
    ] = False,
    advise: Annotated[
        bool,
        typer.Option(
            "--advise", help="Print parameter correlations and the test that would separate them."
        ),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit code 1 if the result is not trustworthy."),
    ] = False,
    allow_outside: OutsideOption = False,
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Processes.")] = 2,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Fit friction, drive stiffness and slip levels to a measured campaign.

    First friction from movements without an object, then each drive from an object at it, then all
    from at most 20 movements of every kind; `turnout validate` uses the others. Throws are
    cached beside the campaign: after Ctrl-C run the same command to continue.
    """
    check_outputs({"--out": out}, {"--out": (".toml",)})
    if figures is not None:
        made_folder("--figures", figures)
    loaded = opened_panel(panel, settings)
    from turnout.calibration.stages import default_plan

    plan = default_plan(loaded, free=free, fixed=fix, most=most)
    from turnout.calibration.evaluate import throw_processes

    try:
        # Processes load while the campaign is read.
        with throw_processes(loaded, workers, throw_store(source)) as pool:
            dataset = opened_campaign(
                source, None, out=out, allow_outside=allow_outside, quiet=quiet
            )
            from turnout.calibration.calibrate import calibrate

            outcome = calibrate(
                dataset,
                loaded,
                plan=plan,
                exclude=exclude,
                folder=throw_store(source),
                workers=workers,
                pool=pool,
                posterior=posterior,
                advise=advise,
                report=None if quiet else _ProgressLog().report,
            )
    except KeyboardInterrupt:
        typer.echo(
            "turnout: interrupted; throws so far are cached, run the same command to continue",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None
    from turnout.calibration.fitted_file import save_signals, signals_path

    calibration = outcome.calibration
    calibration.save(out)
    signals = save_signals(outcome.final, calibration, out)
    written = [out, signals_path(out)]
    if not quiet and not as_json:
        for line in result_lines(calibration):
            typer.echo(line)
    if figures is not None:
        silent = quiet or as_json
        written += _draw(calibration, outcome.sweeps, signals, figures, quiet=silent)
    if as_json:
        from turnout.cli.json_records import calibration_record

        record, units = calibration_record(calibration)
        print_json("calibrate", record, units=units, written=written)
    else:
        _print_verdict(calibration, out, quiet=quiet)
    if strict and calibration.distrust:
        raise typer.Exit(FINDINGS)


def _print_verdict(calibration: "Calibration", out: Path, *, quiet: bool) -> None:
    if not quiet:
        typer.echo(f"{'written':<12}{out}")
    from turnout.cli.colour import coloured

    level = "bad" if calibration.distrust else "good"
    for line in trust_lines(calibration):
        if not quiet or calibration.distrust:
            typer.echo(coloured(line, level) if line.startswith("verdict") else line)


class _ProgressLog:
    """Calibration progress as lines on stderr."""

    def __init__(self) -> None:
        self._due = time.monotonic() + SECONDS_BETWEEN_LINES

    def report(self, state: "CalibrationProgress") -> None:
        """Show stage, throws, misfit and time, if a line is due."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + SECONDS_BETWEEN_LINES
        misfit = "" if state.misfit != state.misfit else f", misfit {state.misfit:.2f}"
        throws = count_text(state.evaluations, "throw")
        # What the first throws take says nothing of the others.
        left = f", {_left(state.left)} left" if state.evaluations >= LEAST_THROWS else ""
        print(
            f"stage {state.stage} ({state.number} of {state.stages}): {throws}{misfit}, "
            f"{state.seconds:.0f} s{left}",
            file=sys.stderr,
            flush=True,
        )


def _left(seconds: float) -> str:
    """Return a time that is estimated roughly, in words.

    Examples
    --------
    >>> _left(2.0), _left(42.0), _left(200.0)
    ('less than 5 s', 'about 42 s', 'about 3 min')
    """
    if seconds < LEAST_LEFT:
        return f"less than {LEAST_LEFT:g} s"
    return f"about {seconds:.0f} s" if seconds < 100.0 else f"about {seconds / 60.0:.0f} min"


def result_lines(calibration: "Calibration") -> list[str]:
    """Return values with uncertainty, findings and warnings as lines."""
    lines = [f"{'panel':<12}{calibration.panel}", f"{'campaign':<12}{calibration.data}"]
    for stage in calibration.stages:
        count = len(stage.movements)
        throws = count_text(stage.evaluations, "throw")
        text = f"{count_text(count, 'movement')}, {throws}, {stage.message}"
        lines.append(f"{'stage':<12}{stage.name}: {text}; misfit {stage.misfit:.2f}")
    for item in calibration.parameters:
        sure = ""
        if item.state == "fitted":
            reach = value_text(*item.interval, unit=item.unit)
            size = f"{100 * item.deviation / abs(item.value):.2g} %; " if item.value else ""
            sure = f" ({size}95 %: {reach})"
        state = item.state + " " * max(12 - len(item.state), 2)
        lines.append(f"{state}{item.name} = {value_text(item.value, unit=item.unit)}{sure}")
    lines += _posterior_lines(calibration)
    for name, share in calibration.scatter.items():
        lines.append(f"{'scatter':<12}{name}: {100 * share:.1f} % from movement to movement")
    lines += [f"{'sensor':<12}{text}" for text in calibration.sensors]
    lines += [f"{'cause':<12}{text}" for text in calibration.causes]
    lines += [f"{'finding':<12}{text}" for text in calibration.findings]
    lines += [f"{'warning':<12}{text}" for text in calibration.warnings]
    return lines


def trust_lines(calibration: "Calibration") -> list[str]:
    """Return the verdict on a calibration, with the reasons if it is not trustworthy."""
    if not calibration.distrust:
        how = ", with what is fitted as its cause" if calibration.fitted_causes else ""
        return [
            f"{'verdict':<12}the model follows the measurement{how}; check it with `turnout "
            "validate`"
        ]
    return [
        f"{'verdict':<12}NOT TRUSTWORTHY",
        *(f"{'reason':<12}{text}" for text in calibration.distrust),
    ]


def _posterior_lines(calibration: "Calibration") -> list[str]:
    found = calibration.posterior
    if not found:
        return []
    lines = [
        f"{'posterior':<12}{found['method']}, {found['effective_samples']:.0f} effective samples; "
        f"emulator error {found['emulator_error']:.1g} standard deviations "
        f"over {count_text(found['emulator_points'], 'throw')}"
    ]
    units = {item.name: item.unit for item in calibration.parameters}
    for name, bounds in zip(found["names"], found["interval_95"], strict=True):
        lines.append(f"{'':<12}{name}: 95 %: {value_text(*bounds, unit=units[name])}")
    return lines


def _draw(
    calibration: "Calibration",
    sweeps: "Sequence[GridSearch]",
    signals: "xr.Dataset",
    folder: Path,
    *,
    quiet: bool,
) -> list[Path]:
    """Draw grid searches, intervals, correlations and each movement as fitted."""
    from turnout.cli.watch import ProgressBar
    from turnout.core.files import write_atomic
    from turnout.figures.calibration import plot_correlations, plot_fit, plot_sweep
    from turnout.figures.draw import draw_sheet
    from turnout.figures.report.calibration import interval_sheet
    from turnout.figures.style import rendered

    made: dict[str, Callable[[], Any]] = {}
    for number, item in enumerate(sweeps, 1):
        name = item.parameter.name.replace(".", "-")
        made[f"sweep-{number}-{name}"] = partial(plot_sweep, item.curves)
    if calibration.fitted:
        made["intervals"] = partial(draw_sheet, interval_sheet(calibration))
        names = [item.name for item in calibration.fitted]
        made["correlations"] = partial(plot_correlations, names, calibration.correlation)
    for number, name in enumerate(signals["movement"].values, 1):
        plain = re.sub(r"[^\w.-]+", "-", str(name))
        made[f"fit-{number:02d}-{plain}"] = partial(plot_fit, signals, str(name))
    written = []
    with ProgressBar("drawing", compiling=False, quiet=quiet) as watch:
        for number, (name, draw) in enumerate(made.items(), 1):
            path = folder / f"{name}.png"
            write_atomic(path, rendered(draw(), ".png"))
            written.append(path)
            watch.report(number, len(made))
    if not quiet:
        typer.echo(f"{'written':<12}{folder} ({len(written)} figures)")
    return written
