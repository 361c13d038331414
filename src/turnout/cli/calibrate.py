"""The command `turnout calibrate`: friction and drive values from a campaign, with uncertainty."""

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from turnout.cli.campaign import OutsideOption, opened_campaign
from turnout.cli.options import (
    DEFAULT_PANEL,
    File,
    PanelOptions,
    SetOption,
    argument,
    gives,
    made_folder,
    option,
)
from turnout.cli.output import FINDINGS, INTERRUPTED, Output, coloured, refuse, resumable
from turnout.cli.watch import ProgressBar
from turnout.core.problems import choices
from turnout.core.value_text import count_text, duration_text, value_text
from turnout.measurement.campaign.campaign_folder import throw_store

if TYPE_CHECKING:
    import xarray as xr

    from turnout.calibration.calibrate import CalibrationProgress
    from turnout.calibration.result import Calibration
    from turnout.calibration.starts import GridSearch

SECONDS_BETWEEN_LINES = 2.0
CAUSES = ("all", "none")
GIVEN = "the panel as stated: fastenings, gaps, sections and weight of its rails"
"""Conditions of the intervals, beside the fitted values."""
LEAST_LEFT, LEAST_THROWS = 5.0, 10
"""Below this time [s], and before so many throws, the time left is not estimated."""


@gives(
    "calibrate",
    quiet=True,
    out=File("--out -o FILE.toml", "Where the result goes.", default=Path("calibration.toml")),
)
def calibrate_command(
    output: Output,
    source: Path = argument("CAMPAIGN", "Folder of a campaign, or its dataset (.nc)."),
    panel: str = option("--panel PANEL", "Library panel or panel file.", default=DEFAULT_PANEL),
    settings: SetOption = [],  # noqa: B006 - typer copies it
    free: list[str] = option("--free KEY", "Fit this key of the panel too. Repeat.", default=[]),
    fix: list[str] = option("--fix KEY", "Keep the panel's value of this key. Repeat.", default=[]),
    exclude: list[str] = option(
        "--exclude MOVEMENT", "Leave this movement out. Repeat.", default=[]
    ),
    most: int = option("--most N", "Movements of the last stage; 0: all.", default=20, min=0),
    figures: Path | None = option(
        "--figures DIR", "Draw each sweep, intervals, correlations, and each movement as fitted."
    ),
    advise: bool = option(
        "--advise", "Print parameter correlations and the test that would separate them."
    ),
    causes: str = option(
        "--causes WHICH", "all: look for what the panel does not follow; none.", default="all"
    ),
    limit: float | None = option(
        "--limit SECONDS", "Give what is known after this time. Default: no limit.", min=1.0
    ),
    panel_uncertainty: list[str] = option(
        "--panel-uncertainty KEY=SHARE",
        "Intervals hold this uncertainty of the panel: 'material.density=3 %'. Repeat.",
        default=[],
    ),
    strict: bool = option("--strict", "Exit code 1 if the result is not trustworthy."),
    allow_outside: OutsideOption = False,
    workers: int = option("--workers N", "Processes.", default=2, min=1),
) -> None:
    """Fit friction, drive stiffness and slip levels to a measured campaign.

    First friction from movements without an object, then each drive from an object at it, then all
    from at most 20 movements of every kind; `turnout validate` uses the others. Throws are
    cached beside the campaign: after Ctrl-C run the same command to continue. Ctrl-C after the
    first fit writes what is known.
    """
    out, quiet = Path(str(output["out"])), output.quiet
    if causes not in CAUSES:
        refuse(f"--causes {causes}: must be {choices(CAUSES)}")
    if figures is not None:
        made_folder("--figures", figures)
    loaded = PanelOptions(panel, settings).opened()
    from turnout.calibration.advice import stated_shares
    from turnout.calibration.stages import default_plan

    shares = stated_shares(panel_uncertainty)
    plan = default_plan(loaded, free=free, fixed=fix, most=most)
    from turnout.calibration.evaluate import throw_processes

    kept = "throws so far are cached, run the same command to continue"
    log = ProgressBar(quiet=quiet, every=SECONDS_BETWEEN_LINES)
    # Processes load while the campaign is read.
    with resumable(kept), throw_processes(loaded, workers, throw_store(source)) as processes:
        dataset = opened_campaign(source, None, out=out, allow_outside=allow_outside, quiet=quiet)
        from turnout.calibration.calibrate import CTRL_C, calibrate

        outcome = calibrate(
            dataset,
            loaded,
            plan=plan,
            exclude=exclude,
            folder=throw_store(source),
            workers=processes,
            advise=advise,
            causes=causes != "none",
            limit=float("inf") if limit is None else limit,
            panel_shares=shares,
            report=None if quiet else _Said(log),
        )
    from turnout.calibration.result_entries import save_signals, signals_path

    calibration = outcome.calibration
    calibration.save(out)
    signals = save_signals(outcome.final, calibration, out)
    if not output.silent or (calibration.distrust and not output.as_json):
        level, lines = "bad" if calibration.distrust else "good", trust_lines(calibration)
        for line in lines:
            typer.echo(coloured(line, level) if line.startswith("verdict") else line)
    output.show(*result_lines(calibration))
    if figures is not None:
        _draw(output, calibration, outcome.sweeps, signals, figures)
    output.wrote(out)
    output.written.append(signals_path(out))
    output.json(calibration_record, calibration)
    if outcome.ended == CTRL_C:
        raise typer.Exit(INTERRUPTED)
    if strict and calibration.distrust:
        raise typer.Exit(FINDINGS)


class _Said:
    """Says how far a calibration is, and the verdict on its first fit as soon as there is one."""

    def __init__(self, log: ProgressBar) -> None:
        self._log, self._verdict = log, ""

    def __call__(self, state: "CalibrationProgress") -> None:
        if state.verdict != self._verdict:
            self._verdict = state.verdict
            typer.echo(state.verdict, err=True)
        self._log.say(stage_line(state))


def stage_line(state: "CalibrationProgress") -> str:
    """Return stage, throws, misfit and time of a calibration under way in one line."""
    misfit = "" if state.misfit != state.misfit else f", misfit {state.misfit:.2f}"
    throws = count_text(state.evaluations, "throw")
    # What the first throws take says nothing of the others.
    left = f", {_left(state.left)} left" if state.evaluations >= LEAST_THROWS else ""
    return (
        f"stage {state.stage} ({state.number} of {state.stages}): {throws}{misfit}, "
        f"{state.seconds:.0f} s{left}"
    )


def _left(seconds: float) -> str:
    """Return a time that is estimated roughly, in words.

    Examples
    --------
    >>> _left(2.0), _left(42.0), _left(200.0)
    ('less than 5 s', 'about 42 s', 'about 3.3 min')
    """
    less = seconds < LEAST_LEFT
    return f"less than {LEAST_LEFT:g} s" if less else f"about {duration_text(seconds)}"


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
        how = ", with what is named as its cause" if calibration.causes else ""
        return [
            f"{'verdict':<12}the model follows the measurement{how}; check it with `turnout "
            "validate`",
            f"{'given':<12}{calibration.about.get('given', GIVEN)}",
        ]
    return [
        f"{'verdict':<12}NOT TRUSTWORTHY",
        *(f"{'reason':<12}{text}" for text in calibration.distrust),
    ]


def _draw(
    output: Output,
    calibration: "Calibration",
    sweeps: "Sequence[GridSearch]",
    signals: "xr.Dataset",
    folder: Path,
) -> None:
    """Draw grid searches, intervals, correlations and each movement as fitted."""
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
    with ProgressBar("drawing", quiet=output.silent) as watch:
        for number, (name, draw) in enumerate(made.items(), 1):
            path = folder / f"{name}.png"
            write_atomic(path, rendered(draw(), ".png"))
            output.written.append(path)
            watch.report(number, len(made))
    output.show(f"{folder} ({count_text(len(made), 'figure')})", heading="written")


def calibration_record(calibration: "Calibration") -> tuple[dict[str, Any], dict[str, str]]:
    """Return a calibration, and the unit of each parameter."""
    names = (
        *("panel", "panel_hash", "data", "movements", "parameters", "covariance", "stages"),
        *("scatter", "findings", "warnings", "causes", "fitted_causes", "sensors"),
        *("chain", "effects", "objects"),
    )
    record = {name: getattr(calibration, name) for name in names}
    record |= {"trustworthy": not calibration.distrust, "reasons": calibration.distrust}
    return record, {item.name: item.unit for item in calibration.parameters}
