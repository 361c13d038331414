"""The command `turnout calibrate`: a campaign's friction and drives, and how sure they are."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.campaign import INTERRUPTED, OutsideOption, dataset_of
from turnout.cli.options import (
    DEFAULT_PANEL,
    SetOption,
    check_outputs,
    made_folder,
    opened_panel,
    write_and_report,
)
from turnout.cli.validate import kept_throws

if TYPE_CHECKING:
    from turnout.calibration.calibrate import Outcome
    from turnout.calibration.progress import State
    from turnout.calibration.result import Calibration

SECONDS_BETWEEN_LINES = 2.0
NOT_TRUSTED = 1


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
        typer.Option("--figures", metavar="DIR", help="Draw what was swept, a figure a stage."),
    ] = None,
    posterior: Annotated[
        bool,
        typer.Option("--posterior", help="Sample what the data leave possible, with profiles."),
    ] = False,
    advise: Annotated[
        bool,
        typer.Option("--advise", help="Say what is mistaken for what, and what to measure next."),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit code 1 where the result is not to be trusted."),
    ] = False,
    allow_outside: OutsideOption = False,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes.")] = 2,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show nothing but errors.")] = False,
) -> None:
    """Fit friction, drive stiffness and slip levels to a measured campaign.

    First friction from movements without an object, then each drive from an object at it, then all
    from at most 20 movements of every kind; the others are left for `turnout validate`. Throws are
    kept beside the campaign: after Ctrl-C the same command goes on.
    """
    check_outputs({"--out": out}, {"--out": (".toml",)})
    if figures is not None:
        made_folder("--figures", figures)
    loaded = opened_panel(panel, settings)
    from turnout.calibration.stage import default_plan

    plan = default_plan(loaded, free=free, fixed=fix, most=most)
    dataset = dataset_of(source, None, out=out, allow_outside=allow_outside, quiet=quiet)
    from turnout.calibration.calibrate import calibrate

    try:
        outcome = calibrate(
            dataset,
            loaded,
            plan=plan,
            exclude=exclude,
            folder=kept_throws(source),
            workers=workers,
            posterior=posterior,
            advise=advise,
            report=None if quiet else _Teller().tell,
        )
    except KeyboardInterrupt:
        typer.echo("turnout: interrupted; the throws are kept, the same command goes on", err=True)
        raise typer.Exit(INTERRUPTED) from None
    outcome.calibration.save(out)
    if not quiet:
        for line in result_lines(outcome.calibration):
            typer.echo(line)
    if figures is not None:
        _draw(outcome, figures)
    if not quiet:
        typer.echo(f"{'written':<12}{out}")
    for line in verdict_lines(outcome.calibration):
        if not quiet or outcome.calibration.distrust:
            typer.echo(line)
    if strict and outcome.calibration.distrust:
        raise typer.Exit(NOT_TRUSTED)


class _Teller:
    """Writes a line on stderr now and then."""

    def __init__(self) -> None:
        self._due = time.monotonic() + SECONDS_BETWEEN_LINES

    def tell(self, state: "State") -> None:
        """Show stage, throws, misfit and time, where a line is due."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + SECONDS_BETWEEN_LINES
        misfit = "" if state.misfit != state.misfit else f", misfit {state.misfit:.2f}"
        print(
            f"stage {state.stage} ({state.number} of {state.stages}): {state.evaluations} throws"
            f"{misfit}, {state.seconds:.0f} s, about {state.left:.0f} s left",
            file=sys.stderr,
            flush=True,
        )


def result_lines(calibration: "Calibration") -> list[str]:
    """Say what came out: values, how sure they are, and what to look at."""
    lines = [f"{'panel':<12}{calibration.panel}", f"{'campaign':<12}{calibration.data}"]
    for stage in calibration.stages:
        text = f"{len(stage.movements)} movements, {stage.evaluations} throws, {stage.message}"
        lines.append(f"{'stage':<12}{stage.name}: {text}; misfit {stage.misfit:.2f}")
    for item in calibration.parameters:
        unit = "" if item.unit == "1" else f" {item.unit}"
        sure = ""
        if item.state == "fitted":
            low, high = item.interval
            sure = (
                f" ({100 * item.deviation / abs(item.value):.2g} %; 95 %: {low:.5g} ... {high:.5g})"
            )
        lines.append(f"{item.state:<12}{item.name} = {item.value:.5g}{unit}{sure}")
    lines += _posterior_lines(calibration)
    for name, share in calibration.scatter.items():
        lines.append(f"{'scatter':<12}{name}: {100 * share:.1f} % from movement to movement")
    lines += [f"{'finding':<12}{text}" for text in calibration.findings]
    lines += [f"{'warning':<12}{text}" for text in calibration.warnings]
    return lines


def verdict_lines(calibration: "Calibration") -> list[str]:
    """Say whether a calibration is to be trusted, and why not."""
    if not calibration.distrust:
        return [f"{'verdict':<12}the model follows what was measured; `turnout validate` judges it"]
    return [
        f"{'verdict':<12}NOT TO BE TRUSTED",
        *(f"{'because':<12}{text}" for text in calibration.distrust),
    ]


def _posterior_lines(calibration: "Calibration") -> list[str]:
    found = calibration.posterior
    if not found:
        return []
    lines = [
        f"{'posterior':<12}{found['method']}, {found['effective_samples']:.0f} effective samples; "
        f"the emulator misses {found['emulator_points']} throws by {found['emulator_error']:.1g} "
        "standard deviations"
    ]
    for name, (low, high) in zip(found["names"], found["interval_95"], strict=True):
        lines.append(f"{'':<12}{name}: 95 %: {low:.5g} ... {high:.5g}")
    return lines


def _draw(outcome: "Outcome", folder: Path) -> None:
    from turnout.plot.calibration import plot_sweep
    from turnout.plot.style import rendered

    for number, item in enumerate(outcome.sweeps, 1):
        name = item.parameter.name.replace(".", "-")
        figure = plot_sweep(item.curves)
        write_and_report(folder / f"sweep-{number}-{name}.png", rendered(figure, ".png"))
