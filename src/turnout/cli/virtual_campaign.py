"""The command `turnout campaign virtual`: simulated throws as a recorder would have kept them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.machine_monitor import TogetherOption
from turnout.cli.options import (
    INTERRUPTED,
    CalibrationOption,
    PanelOption,
    QuietOption,
    SetOption,
    opened_panel,
)
from turnout.core.value_text import count_text

if TYPE_CHECKING:
    from turnout.measurement.chain.monitoring import Monitoring
    from turnout.panel.load import LoadedPanel
    from turnout.study.virtual.campaign_plan import CampaignPlan


def virtual_command(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to fill.")],
    panel: PanelOption = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="Seed of the random numbers.")
    ] = 0,
    places: Annotated[
        list[str],
        typer.Option("--place", metavar="PLACE", help="Default all sleepers and drives. Repeat."),
    ] = [],  # noqa: B006 - typer copies it
    sizes: Annotated[
        list[str],
        typer.Option("--size", metavar="SIZE", help="Default 5 ... 31 mm, until slip. Repeat."),
    ] = [],  # noqa: B006 - typer copies it
    repeats: Annotated[
        int,
        typer.Option(
            "--repeats", metavar="N", min=0, help="Throws without an object, each direction."
        ),
    ] = 5,
    formats: Annotated[
        list[str],
        typer.Option(
            "--format", metavar="FORMAT", help="csv, mat or h5, in turn by place. Repeat."
        ),
    ] = ["csv", "mat"],  # noqa: B006 - typer copies it
    worn_clutch: Annotated[
        bool, typer.Option("--worn-clutch", help="Drive 2 slips above its level, and scatters.")
    ] = False,
    soft_build_up: Annotated[
        bool, typer.Option("--soft-build-up", help="Drive 2 builds up softly after contact.")
    ] = False,
    finer: Annotated[
        bool,
        typer.Option(
            "--finer", help="Compute the true responses with a finer, different discretisation."
        ),
    ] = False,
    mistype: Annotated[
        int,
        typer.Option(
            "--mistype",
            metavar="N",
            min=0,
            help="Number of typing errors to put into the run sheet.",
        ),
    ] = 0,
    monitoring: Annotated[
        str | None,
        typer.Option(
            "--monitoring",
            metavar="RATE",
            help="Write currents and powers as a monitoring system stores them too, such as "
            "'25 Hz': folder monitoring, a CSV file for each throw.",
        ),
    ] = None,
    together: TogetherOption = [],  # noqa: B006 - typer copies it
    recorded_filter: Annotated[
        str | None,
        typer.Option(
            "--recorded-filter",
            metavar="CORNER",
            help="Low-pass of the recorder: '6 Hz' (Butterworth, two poles), or a table as in a "
            "channel map.",
        ),
    ] = None,
    recorded_average: Annotated[
        str | None,
        typer.Option(
            "--recorded-average", metavar="TIME", help="It averages over the time before a sample."
        ),
    ] = None,
    recorded_rate: Annotated[
        str | None,
        typer.Option("--recorded-rate", metavar="RATE", help="It takes so few samples: '20 Hz'."),
    ] = None,
    hide_recorder: Annotated[
        bool,
        typer.Option(
            "--hide-recorder", help="Leave filter, average and rate out of the channel map."
        ),
    ] = False,
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Processes.")] = 2,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make a campaign of simulated throws in the formats of a data acquisition system."""
    from turnout.measurement.chain.typed_recorder import typed_recorder
    from turnout.study.virtual.campaign_plan import virtual_plan
    from turnout.study.virtual.record_throw import finer_panel, finer_scheme

    recorder = typed_recorder(
        average=recorded_average, low_pass=recorded_filter, rate=recorded_rate
    )
    if hide_recorder and not recorder:
        from turnout.core.errors import FileError

        message = "--hide-recorder: there is nothing to hide; give --recorded-average, for example"
        raise FileError(message)
    loaded = opened_panel(panel, settings, calibration)
    if finer:
        loaded = finer_panel(loaded)
    defects = {"clutch": worn_clutch, "soft build-up": soft_build_up}
    plan = virtual_plan(
        loaded,
        places=places,
        sizes=sizes,
        formats=formats,
        object_free=repeats,
        mistyped=mistype,
        seed=seed,
        defects=[name for name, wanted in defects.items() if wanted],
        scheme=finer_scheme() if finer else None,
        monitoring=_monitoring(monitoring, together),
        recorder=recorder,
        recorder_stated=not hide_recorder,
    )
    _make(loaded, out, plan, workers=workers, as_json=as_json, quiet=quiet)


def _monitoring(rate: str | None, together: list[str]) -> "Monitoring | None":
    from turnout.core.errors import FileError
    from turnout.measurement.chain.monitoring import monitoring_of

    if rate is None:
        if together:
            message = "--together: is of a monitoring system; give its rate, --monitoring '25 Hz'"
            raise FileError(message)
        return None
    return monitoring_of(rate=rate, together=together)


def _make(
    panel: "LoadedPanel",
    out: Path,
    plan: "CampaignPlan",
    *,
    workers: int,
    as_json: bool,
    quiet: bool,
) -> None:
    from turnout.cli.watch import ProgressBar
    from turnout.core.scheme import Scheme
    from turnout.study.virtual.make_campaign import make_virtual_campaign
    from turnout.throw.compilation import must_compile

    text = f"throwing {panel.name}"
    try:
        with ProgressBar(text, compiling=must_compile(), quiet=quiet) as watch:
            made = make_virtual_campaign(
                panel, out, plan=plan, workers=workers, report=watch.report
            )
    except KeyboardInterrupt:
        typer.echo(
            f"turnout: interrupted; throws so far are in {out}, run the same command to continue",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None
    for failure in made.failures:
        typer.echo(f"turnout: {failure}; its series ends there", err=True)
    slips = sum(item.slipped for item in made.thrown)
    coarse = "a test of `turnout calibrate` needs throws made with --finer"
    remarks = [coarse] if plan.scheme == Scheme() else []
    if as_json:
        record = {
            "panel": panel.name,
            "panel_hash": panel.hash,
            "movements": len(made.thrown),
            "slips": slips,
            "mistakes": made.mistakes,
            "oversized": made.oversized,
            "failures": made.failures,
            "remarks": remarks,
        }
        print_json("campaign virtual", record, written=[out])
    elif not quiet:
        movements = count_text(len(made.thrown), "movement")
        typer.echo(f"{'thrown':<12}{movements}, {slips} of them with slip")
        if made.oversized:
            typer.echo(f"{'left out':<12}no room for {', '.join(made.oversized)}")
        for mistake in made.mistakes:
            typer.echo(f"{'mistyped':<12}{mistake}")
        typer.echo(
            f"{'written':<12}{out} (run sheet runs.csv, true values truth.nc; all synthetic)"
        )
        if plan.recorder:
            stated = "as channels.toml states" if plan.recorder_stated else "not in channels.toml"
            typer.echo(f"{'recorder':<12}{plan.recorder.text}; {stated}")
        for remark in remarks:
            typer.echo(f"{'remark':<12}{remark}")
