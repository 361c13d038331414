"""The commands `turnout campaign check`, `build`, `plot` and `virtual`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.machine_monitor import TogetherOption
from turnout.cli.options import (
    FINDINGS,
    CalibrationOption,
    PanelOption,
    QuietOption,
    SetOption,
    check_outputs,
    opened_panel,
)

if TYPE_CHECKING:
    import xarray as xr

    from turnout.measurement.campaign.build_campaign import BuiltCampaign
    from turnout.measurement.chain.monitoring import Monitoring
    from turnout.panel.load import LoadedPanel
    from turnout.virtual.campaign_plan import CampaignPlan

FIGURES = (".png", ".pdf", ".svg")
INTERRUPTED = 130
MOST_REMARKS = 20
MOST_NAMES = 4

app = typer.Typer(
    name="campaign",
    help="Measured movements: check, build and draw a campaign, or make a virtual one.",
    no_args_is_help=True,
)

FolderArgument = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder with a run sheet and recordings.")
]
ChannelsOption = Annotated[
    str | None,
    typer.Option(
        "--channels", metavar="MAP", help="Channel map (.toml); default channels.toml in DIR."
    ),
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="Exit code 2 if a movement must be excluded.")
]
OutsideOption = Annotated[
    bool,
    typer.Option(
        "--allow-outside", help="Read files that lie outside DIR, or that a recording refers to."
    ),
]


@app.command("check", short_help="Check a run sheet and the quality of every movement.")
def check_command(
    folder: FolderArgument,
    channels: ChannelsOption = None,
    strict: StrictOption = False,
    allow_outside: OutsideOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check a run sheet against its files, and the quality of every movement.

    Exit code 1 if no movement is usable.
    """
    campaign = built_campaign(
        folder, channels, strict=strict, allow_outside=allow_outside, quiet=quiet
    )
    if as_json:
        from turnout.cli.json_records import campaign_record

        print_json("campaign check", campaign_record(campaign))
    elif not quiet:
        _print_campaign(campaign, remarks=True)
    if campaign.dataset is None:
        raise typer.Exit(FINDINGS)


@app.command("build", short_help="Build one dataset of all usable movements.")
def build_command(
    folder: FolderArgument,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE.nc", help="Default campaign.nc in DIR."),
    ] = None,
    channels: ChannelsOption = None,
    strict: StrictOption = False,
    allow_outside: OutsideOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Build one dataset of all usable movements; unchanged recordings are not read again."""
    if out is not None:
        check_outputs({"--out": out}, {"--out": (".nc",)})
    from turnout.measurement.campaign.campaign_folder import refuse_to_write_outside

    target = out if out is not None else folder / "campaign.nc"
    refuse_to_write_outside(target, folder)
    campaign = built_campaign(
        folder, channels, strict=strict, allow_outside=allow_outside, quiet=quiet
    )
    if not quiet and not as_json:
        _print_campaign(campaign, remarks=False)
    from turnout.response.store import save_response

    save_response(usable_dataset(campaign, folder), target)
    if as_json:
        from turnout.cli.json_records import campaign_record

        print_json("campaign build", campaign_record(campaign), written=[target])
    elif not quiet:
        typer.echo(f"{'written':<12}{target} ({round(target.stat().st_size / 1e6)} MB)")


@app.command("plot", short_help="Draw channels by object size, or places against sizes.")
def plot_command(
    source: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a campaign, or its dataset (.nc).")
    ],
    place: Annotated[
        str | None,
        typer.Option(
            "--place",
            metavar="PLACE",
            help="Channels by size at a place; without it, the overview.",
        ),
    ] = None,
    direction: Annotated[
        str, typer.Option("--direction", metavar="WAY", help="closing or opening.")
    ] = "closing",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Figure (.png, .pdf, .svg); default campaign.png."
        ),
    ] = None,
    channels: ChannelsOption = None,
    allow_outside: OutsideOption = False,
    quiet: QuietOption = False,
) -> None:
    """Draw channels by object size at one place, or places against sizes."""
    target = out if out is not None else Path("campaign.png")
    check_outputs({"--out": target}, {"--out": FIGURES})
    if direction not in ("closing", "opening"):
        from turnout.errors import FileError

        message = f"--direction {direction}: must be closing or opening"
        raise FileError(message)
    place = None if place is None else _place(place)
    dataset = dataset_of(source, channels, out=target, allow_outside=allow_outside, quiet=quiet)
    from turnout.core.files import write_atomic
    from turnout.plot.campaign import plot_overview, plot_stacked
    from turnout.plot.style import rendered

    if place is None:
        figure = plot_overview(dataset, direction=direction)
    else:
        figure = plot_stacked(dataset, place=place, direction=direction)
    write_atomic(target, rendered(figure, target.suffix))
    if not quiet:
        typer.echo(f"{'written':<12}{target}")


@app.command("virtual", short_help="Make a campaign of simulated throws.")
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
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Processes.")] = 2,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make a campaign of simulated throws in the formats of a data acquisition system."""
    from turnout.virtual.campaign_plan import virtual_plan
    from turnout.virtual.record_throw import finer_panel, finer_scheme

    loaded = opened_panel(panel, settings, calibration)
    if finer:
        loaded = finer_panel(loaded)
    plan = virtual_plan(
        loaded,
        places=places,
        sizes=sizes,
        formats=formats,
        object_free=repeats,
        mistyped=mistype,
        seed=seed,
        worn_clutch=worn_clutch,
        soft_build_up=soft_build_up,
        scheme=finer_scheme() if finer else None,
        monitoring=_monitoring(monitoring, together),
    )
    _make(loaded, out, plan, workers=workers, as_json=as_json, quiet=quiet)


def _monitoring(rate: str | None, together: list[str]) -> "Monitoring | None":
    from turnout.errors import FileError
    from turnout.measurement.chain.monitoring import monitoring_of

    if rate is None:
        if together:
            message = "--together: is of a monitoring system; give its rate, --monitoring '25 Hz'"
            raise FileError(message)
        return None
    return monitoring_of(rate=rate, together=together)


def _place(text: str) -> str:
    from turnout.errors import FileError
    from turnout.measurement.campaign.run_sheet import normal_place

    try:
        return normal_place(text)
    except ValueError as error:
        message = f"--place {text}: {error}"
        raise FileError(message) from None


def _make(
    panel: "LoadedPanel",
    out: Path,
    plan: "CampaignPlan",
    *,
    workers: int,
    as_json: bool,
    quiet: bool,
) -> None:
    from turnout.cli.watch import Watch
    from turnout.response.compilation import must_compile
    from turnout.scheme import Scheme
    from turnout.virtual.make_campaign import make_virtual_campaign

    text = f"throwing {panel.name}"
    try:
        with Watch(text, compiling=must_compile(), quiet=quiet) as watch:
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
    if as_json:
        record = {
            "panel": panel.name,
            "panel_hash": panel.hash,
            "movements": len(made.thrown),
            "slips": slips,
            "mistakes": made.mistakes,
            "oversized": made.oversized,
            "failures": made.failures,
        }
        print_json("campaign virtual", record, written=[out])
    elif not quiet:
        typer.echo(f"{'thrown':<12}{len(made.thrown)} movements, {slips} of them with slip")
        if made.oversized:
            typer.echo(f"{'left out':<12}no room for {', '.join(made.oversized)}")
        for mistake in made.mistakes:
            typer.echo(f"{'mistyped':<12}{mistake}")
        typer.echo(
            f"{'written':<12}{out} (run sheet runs.csv, true values truth.nc; all synthetic)"
        )
        if plan.scheme == Scheme():
            typer.echo(
                f"{'remark':<12}a test of `turnout calibrate` needs throws made with --finer"
            )


def built_campaign(
    folder: Path,
    channels: str | None,
    *,
    strict: bool,
    allow_outside: bool = False,
    quiet: bool,
) -> "BuiltCampaign":
    """Read a campaign's folder with its progress shown; Ctrl-C loses nothing."""
    from turnout.cli.watch import Watch
    from turnout.measurement.campaign.build_campaign import build_campaign

    try:
        with Watch(f"reading {folder.name or folder}", compiling=False, quiet=quiet) as watch:
            return build_campaign(
                folder,
                channels=channels,
                strict=strict,
                allow_outside=allow_outside,
                report=watch.report,
            )
    except KeyboardInterrupt:
        typer.echo(
            "turnout: interrupted; movements read so far are cached, "
            "run the same command to continue",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


def dataset_of(
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
        from turnout.response.store import open_response

        dataset = open_response(source)
        if "movement" not in dataset.dims:
            from turnout.errors import FileError

            message = f"{source}: holds one run, not a campaign; `turnout simulate --plot` draws it"
            raise FileError(message)
        return dataset
    campaign = built_campaign(
        source, channels, strict=False, allow_outside=allow_outside, quiet=quiet
    )
    dataset = usable_dataset(campaign, source)
    for who, reasons in [] if quiet else excluded_movements(campaign):
        typer.echo(f"turnout: excluded {who}: {'; '.join(reasons)}", err=True)
    return dataset


def usable_dataset(campaign: "BuiltCampaign", source: Path) -> "xr.Dataset":
    """Return the dataset of a campaign, which must have a usable movement."""
    if campaign.dataset is None:
        from turnout.errors import MeasurementError

        problems = [f"{who}: {'; '.join(reasons)}" for who, reasons in excluded_movements(campaign)]
        raise MeasurementError(problems, source=f"{source}: no movement is usable")
    return campaign.dataset


def _print_campaign(campaign: "BuiltCampaign", *, remarks: bool) -> None:
    """Print the movements, the excluded ones with reasons, and the remarks."""
    sheet = campaign.sheet
    usable = len(sheet.runs) - len(campaign.excluded)
    typer.echo(f"{'campaign':<12}{sheet.title}{' (synthetic)' if sheet.synthetic else ''}")
    typer.echo(f"{'movements':<12}{len(sheet.runs)} in the sheet, {usable} usable")
    if campaign.reused:
        typer.echo(f"{'':<12}{campaign.reused} taken from the cache")
    if campaign.recorder:
        typer.echo(f"{'recorder':<12}{campaign.recorder}; applied to simulated forces too")
    shown = campaign.remarks if remarks else campaign.remarks[:MOST_REMARKS]
    for number, text in enumerate(shown):
        typer.echo(f"{'remarks' if number == 0 else '':<12}{text}")
    if len(shown) < len(campaign.remarks):
        more = len(campaign.remarks) - len(shown)
        typer.echo(f"{'':<12}and {more} more; `turnout campaign check` shows all")
    for who, reasons in excluded_movements(campaign):
        for number, reason in enumerate(reasons):
            typer.echo(f"{'excluded' if number == 0 else '':<12}{who}: {reason}")


def excluded_movements(campaign: "BuiltCampaign") -> list[tuple[str, tuple[str, ...]]]:
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
