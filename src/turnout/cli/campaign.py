"""The commands `turnout campaign check`, `build` and `plot`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.options import (
    FIGURES,
    File,
    NamedPanelOptions,
    PanelOptions,
    TogetherOption,
    argument,
    gives,
    option,
)
from turnout.cli.output import FINDINGS, Output, note, refuse, resumable
from turnout.cli.watch import ProgressBar, watched
from turnout.core.value_text import count_text

if TYPE_CHECKING:
    import xarray as xr

    from turnout.measurement.campaign.build_campaign import BuiltCampaign
    from turnout.measurement.chain.monitoring import Monitoring
    from turnout.panel.load import LoadedPanel
    from turnout.study.virtual.campaign_plan import CampaignPlan

MOST_REMARKS = 20
MOST_NAMES = 4

app = typer.Typer(
    name="campaign",
    help="Measured movements: check, build and draw a campaign, or make a virtual one.",
    no_args_is_help=True,
)

FolderArgument = Annotated[Path, argument("DIR", "Folder with a run sheet and recordings.")]
ChannelsOption = Annotated[
    str | None,
    option("--channels MAP", "Channel map (.toml); default channels.toml in DIR.", default=...),
]
StrictOption = Annotated[
    bool, option("--strict", "Exit code 2 if a movement must be excluded.", default=...)
]
OutsideOption = Annotated[
    bool,
    option(
        "--allow-outside",
        "Read files that lie outside DIR, or that a recording refers to.",
        default=...,
    ),
]


@app.command("check", short_help="Check a run sheet and the quality of every movement.")
@gives("campaign check", quiet=True)
def campaign_check_command(
    output: Output,
    folder: FolderArgument,
    channels: ChannelsOption = None,
    panel: str | None = option(
        "--panel PANEL", "Switch that was measured: finds exchanged rods from objects at any place."
    ),
    strict: StrictOption = False,
    allow_outside: OutsideOption = False,
) -> None:
    """Check a run sheet against its files, and the quality of every movement.

    Exit code 1 if no movement is usable, or columns of the channel map are exchanged.
    """
    loaded = None if panel is None else PanelOptions(panel).opened()
    campaign = built_campaign(
        folder, channels, strict=strict, allow_outside=allow_outside, quiet=output.quiet
    )
    if loaded is not None:
        campaign = _with_panel(campaign, loaded)
    _show_campaign(output, campaign, remarks=True)
    output.json(campaign_record, campaign)
    if campaign.dataset is None or _is_exchanged(campaign):
        raise typer.Exit(FINDINGS)


def _is_exchanged(campaign: "BuiltCampaign") -> bool:
    from turnout.measurement.campaign.sheet_checks import EXCHANGED

    return any(text.startswith(EXCHANGED) for text in campaign.remarks)


def _with_panel(campaign: "BuiltCampaign", panel: "LoadedPanel") -> "BuiltCampaign":
    """Return a campaign with the panel's remarks on its rods in place of the unchecked one."""
    from turnout.calibration.requirements import rod_remarks
    from turnout.measurement.campaign.sheet_checks import UNCHECKED

    if campaign.dataset is None or UNCHECKED not in campaign.remarks:
        return campaign
    others = [text for text in campaign.remarks if text != UNCHECKED]
    return replace(campaign, remarks=(*rod_remarks(campaign.dataset, panel), *others))


@app.command("build", short_help="Build one dataset of all usable movements.")
@gives("campaign build", quiet=True, out=File("--out -o FILE.nc", "Default campaign.nc in DIR."))
def build_command(
    output: Output,
    folder: FolderArgument,
    channels: ChannelsOption = None,
    strict: StrictOption = False,
    allow_outside: OutsideOption = False,
) -> None:
    """Build one dataset of all usable movements; unchanged recordings are not read again."""
    from turnout.measurement.campaign.campaign_folder import refuse_to_write_outside

    target = output["out"] or folder / "campaign.nc"
    refuse_to_write_outside(target, folder)
    campaign = built_campaign(
        folder, channels, strict=strict, allow_outside=allow_outside, quiet=output.quiet
    )
    _show_campaign(output, campaign, remarks=False)
    output.dataset(target, usable_dataset(campaign, folder))
    output.json(campaign_record, campaign)


@app.command("plot", short_help="Draw channels by object size, or places against sizes.")
@gives(
    "campaign plot",
    json=False,
    quiet=True,
    out=File(
        "--out -o FILE",
        "Figure (.png, .pdf or .svg).",
        FIGURES,
        Path("campaign.png"),
    ),
)
def plot_command(
    output: Output,
    source: Path = argument("DIR", "Folder of a campaign, or its dataset (.nc)."),
    place: str | None = option(
        "--place PLACE", "Channels by size at a place; without it, the overview."
    ),
    direction: str = option("--direction WAY", "closing or opening.", default="closing"),
    channels: ChannelsOption = None,
    allow_outside: OutsideOption = False,
) -> None:
    """Draw channels by object size at one place, or places against sizes."""
    if direction not in ("closing", "opening"):
        refuse(f"--direction {direction}: must be closing or opening")
    place = None if place is None else _place(place)
    dataset = opened_campaign(
        source, channels, out=output["out"], allow_outside=allow_outside, quiet=output.quiet
    )
    from turnout.figures.campaign import plot_overview, plot_stacked

    if place is None:
        output.figure(output["out"], plot_overview, dataset, direction=direction)
    else:
        output.figure(output["out"], plot_stacked, dataset, place=place, direction=direction)


def _place(text: str) -> str:
    from turnout.measurement.campaign.run_sheet import normal_place

    try:
        return normal_place(text)
    except ValueError as error:
        refuse(f"--place {text}: {error}")


def built_campaign(
    folder: Path,
    channels: str | None,
    *,
    strict: bool,
    allow_outside: bool = False,
    quiet: bool,
) -> "BuiltCampaign":
    """Read a campaign's folder with its progress shown; Ctrl-C loses nothing."""
    from turnout.measurement.campaign.build_campaign import build_campaign_dataset

    kept = "movements read so far are cached, run the same command to continue"
    with (
        resumable(kept),
        ProgressBar(f"reading {folder.name or folder}", quiet=quiet) as watch,
    ):
        return build_campaign_dataset(
            folder,
            channels=channels,
            strict=strict,
            allow_outside=allow_outside,
            report=watch.report,
        )


def opened_campaign(
    source: Path,
    channels: str | None,
    *,
    out: Path | None = None,
    allow_outside: bool = False,
    quiet: bool,
) -> "xr.Dataset":
    """Return the dataset of a campaign from its file, or built from its folder.

    What is to be written, `out`, must not leave the folder by a link in it.
    """
    from turnout.measurement.campaign.campaign_folder import (
        STORE,
        campaign_folder,
        refuse_links_outside,
        refuse_to_write_outside,
    )

    received = campaign_folder(source)
    refuse_links_outside(received / STORE, received)
    if out is not None:
        refuse_to_write_outside(out, received)
    if source.suffix.lower() == ".nc":
        from turnout.throw.store import open_response

        dataset = open_response(source)
        if "movement" not in dataset.dims:
            refuse(f"{source}: holds one run, not a campaign; `turnout simulate --plot` draws it")
        return dataset
    campaign = built_campaign(
        source, channels, strict=False, allow_outside=allow_outside, quiet=quiet
    )
    dataset = usable_dataset(campaign, source)
    for who, reasons in [] if quiet else reasons_to_exclude(campaign):
        note(f"excluded {who}: {'; '.join(reasons)}")
    return dataset


def usable_dataset(campaign: "BuiltCampaign", source: Path) -> "xr.Dataset":
    """Return the dataset of a campaign, which must have a usable movement."""
    if campaign.dataset is None:
        from turnout.core.errors import MeasurementError

        problems = [f"{who}: {'; '.join(reasons)}" for who, reasons in reasons_to_exclude(campaign)]
        raise MeasurementError(problems, source=f"{source}: no movement is usable")
    return campaign.dataset


def _show_campaign(output: Output, campaign: "BuiltCampaign", *, remarks: bool) -> None:
    """Print the movements, the excluded ones with reasons, and the remarks."""
    sheet = campaign.sheet
    usable = len(sheet.runs) - len(campaign.excluded)
    output.show(f"{sheet.title}{' (synthetic)' if sheet.synthetic else ''}", heading="campaign")
    once = " once columns are exchanged" if _is_exchanged(campaign) else ""
    reused = [f"{campaign.reused} taken from the cache"] if campaign.reused else []
    counts = f"{len(sheet.runs)} in the sheet, {usable} usable{once}"
    output.rows("movements", [counts, *reused])
    if campaign.recorder:
        output.show(f"{campaign.recorder}; applied to simulated forces too", heading="recorder")
    shown = campaign.remarks if remarks else campaign.remarks[:MOST_REMARKS]
    more = len(campaign.remarks) - len(shown)
    rest = [f"and {more} more; `turnout campaign check` shows all"] if more else []
    output.rows("remarks", [*shown, *rest])
    for who, reasons in reasons_to_exclude(campaign):
        output.rows("excluded", (f"{who}: {reason}" for reason in reasons))


def reasons_to_exclude(campaign: "BuiltCampaign") -> list[tuple[str, tuple[str, ...]]]:
    """Return the reasons to leave movements out, each with the names that it holds for."""
    same: dict[tuple[str, ...], list[str]] = {}
    for item in campaign.excluded:
        same.setdefault(item.reasons, []).append(item.run.name)
    return [
        (
            ", ".join(names[:MOST_NAMES])
            + f" and {len(names) - MOST_NAMES} more" * (len(names) > MOST_NAMES),
            reasons,
        )
        for reasons, names in same.items()
    ]


@app.command("virtual", short_help="Make a campaign of simulated throws.")
@gives("campaign virtual", quiet=True)
def virtual_command(
    output: Output,
    panel: NamedPanelOptions,
    out: Path = option("--out -o DIR", "Folder to fill.", default=...),
    seed: int = option("--seed N", "Seed of the random numbers.", default=0, min=0),
    places: list[str] = option(
        "--place PLACE", "Default all sleepers and drives. Repeat.", default=[]
    ),
    sizes: list[str] = option(
        "--size SIZE", "Default 5 ... 31 mm, until slip. Repeat.", default=[]
    ),
    repeats: int = option(
        "--repeats N", "Throws without an object, each direction.", default=5, min=0
    ),
    formats: list[str] = option(
        "--format FORMAT", "csv, mat or h5, in turn by place. Repeat.", default=["csv", "mat"]
    ),
    worn_clutch: bool = option("--worn-clutch", "Drive 2 slips above its level, and scatters."),
    soft_build_up: bool = option("--soft-build-up", "Drive 2 builds up softly after contact."),
    finer: bool = option(
        "--finer", "Compute the true responses with a finer, different discretisation."
    ),
    mistype: int = option(
        "--mistype N", "Number of typing errors to put into the run sheet.", default=0, min=0
    ),
    monitoring: str | None = option(
        "--monitoring RATE",
        "Write currents, voltages and powers as a monitoring system stores them too, such as "
        "'25 Hz' or 'zyj7': folder monitoring, a campaign of CSV files.",
    ),
    together: TogetherOption = [],  # noqa: B006 - typer copies it
    recorded_filter: str | None = option(
        "--recorded-filter CORNER",
        "Low-pass of the recorder: '6 Hz' (Butterworth, two poles), or a table as in a channel "
        "map.",
    ),
    recorded_average: str | None = option(
        "--recorded-average TIME", "It averages over the time before a sample."
    ),
    recorded_rate: str | None = option("--recorded-rate RATE", "It takes so few samples: '20 Hz'."),
    hide_recorder: bool = option(
        "--hide-recorder", "Leave filter, average and rate out of the channel map."
    ),
    workers: int = option("--workers N", "Processes.", default=2, min=1),
) -> None:
    """Make a campaign of simulated throws in the formats of a data acquisition system."""
    from turnout.measurement.chain.channel_map import typed_recorder
    from turnout.study.virtual.campaign_plan import virtual_plan
    from turnout.study.virtual.record_throw import finer_panel, finer_scheme

    recorder = typed_recorder(
        average=recorded_average, low_pass=recorded_filter, rate=recorded_rate
    )
    if hide_recorder and not recorder:
        refuse("--hide-recorder: there is nothing to hide; give --recorded-average, for example")
    loaded = panel.opened()
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
    _make(loaded, out, plan, output, workers=workers)


def _monitoring(rate: str | None, together: list[str]) -> "Monitoring | None":
    from turnout.measurement.chain.monitoring import monitoring_of

    if rate is None:
        if together:
            refuse("--together: is of a monitoring system; give its rate, --monitoring '25 Hz'")
        return None
    return monitoring_of(rate=rate, together=together)


def _make(
    panel: "LoadedPanel", out: Path, plan: "CampaignPlan", output: Output, *, workers: int
) -> None:
    from turnout.core.scheme import Scheme
    from turnout.study.virtual.make_campaign import make_virtual_campaign

    kept = f"throws so far are in {out}, run the same command to continue"
    with resumable(kept), watched(f"throwing {panel.name}", quiet=output.quiet) as watch:
        made = make_virtual_campaign(panel, out, plan=plan, workers=workers, report=watch.report)
    for failure in made.failures:
        note(f"{failure}; its series ends there")
    slips = sum(item.slipped for item in made.thrown)
    coarse = "a test of `turnout calibrate` needs throws made with --finer"
    remarks = [coarse] if plan.scheme == Scheme() else []
    output.written.append(out)
    output.json(
        lambda: {
            "panel": panel.name,
            "panel_hash": panel.hash,
            "movements": len(made.thrown),
            "slips": slips,
            "mistakes": made.mistakes,
            "oversized": made.oversized,
            "failures": made.failures,
            "remarks": remarks,
        }
    )
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


def campaign_record(campaign: "BuiltCampaign") -> dict[str, Any]:
    """Return movements, exclusions with reasons, and remarks of a campaign."""
    sheet = campaign.sheet
    return {
        "title": sheet.title,
        "recorder": campaign.recorder,
        "synthetic": bool(sheet.synthetic),
        "movements": len(sheet.runs),
        "usable": len(sheet.runs) - len(campaign.excluded),
        "from_cache": campaign.reused,
        "excluded": [
            {"movement": item.run.name, "reasons": item.reasons} for item in campaign.excluded
        ],
        "remarks": campaign.remarks,
    }
