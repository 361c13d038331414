"""The command `turnout campaign virtual`: simulated throws as a recorder would have kept them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from turnout.cli.machine_monitor import TogetherOption
from turnout.cli.options import (
    CalibrationOption,
    PanelOption,
    QuietOption,
    SetOption,
    opened_panel,
    option,
)
from turnout.cli.output import JsonOption, Output, note, refuse, resumable
from turnout.core.value_text import count_text

if TYPE_CHECKING:
    from turnout.measurement.chain.monitoring import Monitoring
    from turnout.panel.load import LoadedPanel
    from turnout.study.virtual.campaign_plan import CampaignPlan


def virtual_command(
    out: Annotated[Path, option("--out -o DIR", "Folder to fill.")],
    panel: PanelOption = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    seed: Annotated[int, option("--seed N", "Seed of the random numbers.", min=0)] = 0,
    places: Annotated[
        list[str], option("--place PLACE", "Default all sleepers and drives. Repeat.")
    ] = [],  # noqa: B006 - typer copies it
    sizes: Annotated[
        list[str], option("--size SIZE", "Default 5 ... 31 mm, until slip. Repeat.")
    ] = [],  # noqa: B006 - typer copies it
    repeats: Annotated[
        int, option("--repeats N", "Throws without an object, each direction.", min=0)
    ] = 5,
    formats: Annotated[
        list[str], option("--format FORMAT", "csv, mat or h5, in turn by place. Repeat.")
    ] = ["csv", "mat"],  # noqa: B006 - typer copies it
    worn_clutch: Annotated[
        bool, option("--worn-clutch", "Drive 2 slips above its level, and scatters.")
    ] = False,
    soft_build_up: Annotated[
        bool, option("--soft-build-up", "Drive 2 builds up softly after contact.")
    ] = False,
    finer: Annotated[
        bool,
        option("--finer", "Compute the true responses with a finer, different discretisation."),
    ] = False,
    mistype: Annotated[
        int, option("--mistype N", "Number of typing errors to put into the run sheet.", min=0)
    ] = 0,
    monitoring: Annotated[
        str | None,
        option(
            "--monitoring RATE",
            "Write currents and powers as a monitoring system stores them too, such as '25 Hz': "
            "folder monitoring, a CSV file for each throw.",
        ),
    ] = None,
    together: TogetherOption = [],  # noqa: B006 - typer copies it
    recorded_filter: Annotated[
        str | None,
        option(
            "--recorded-filter CORNER",
            "Low-pass of the recorder: '6 Hz' (Butterworth, two poles), or a table as in a channel "
            "map.",
        ),
    ] = None,
    recorded_average: Annotated[
        str | None, option("--recorded-average TIME", "It averages over the time before a sample.")
    ] = None,
    recorded_rate: Annotated[
        str | None, option("--recorded-rate RATE", "It takes so few samples: '20 Hz'.")
    ] = None,
    hide_recorder: Annotated[
        bool, option("--hide-recorder", "Leave filter, average and rate out of the channel map.")
    ] = False,
    workers: Annotated[int, option("--workers N", "Processes.", min=1)] = 2,
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
        refuse("--hide-recorder: there is nothing to hide; give --recorded-average, for example")
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
    from turnout.measurement.chain.monitoring import monitoring_of

    if rate is None:
        if together:
            refuse("--together: is of a monitoring system; give its rate, --monitoring '25 Hz'")
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
    from turnout.cli.watch import watched
    from turnout.core.scheme import Scheme
    from turnout.study.virtual.make_campaign import make_virtual_campaign

    kept = f"throws so far are in {out}, run the same command to continue"
    with resumable(kept), watched(f"throwing {panel.name}", quiet=quiet) as watch:
        made = make_virtual_campaign(panel, out, plan=plan, workers=workers, report=watch.report)
    for failure in made.failures:
        note(f"{failure}; its series ends there")
    slips = sum(item.slipped for item in made.thrown)
    coarse = "a test of `turnout calibrate` needs throws made with --finer"
    remarks = [coarse] if plan.scheme == Scheme() else []
    output = Output("campaign virtual", as_json=as_json, quiet=quiet)
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
        output.written.append(out)
        output.json(record)
    movements = count_text(len(made.thrown), "movement")
    output.show(f"{movements}, {slips} of them with slip", heading="thrown")
    if made.oversized:
        output.show(f"no room for {', '.join(made.oversized)}", heading="left out")
    output.rows("mistyped", made.mistakes)
    contents = "run sheet runs.csv, true values truth.nc; all synthetic"
    output.show(f"{out} ({contents})", heading="written")
    if plan.recorder:
        stated = "as channels.toml states" if plan.recorder_stated else "not in channels.toml"
        output.show(f"{plan.recorder.text}; {stated}", heading="recorder")
    output.rows("remark", remarks)
