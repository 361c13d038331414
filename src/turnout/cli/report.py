"""The command `turnout report`."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from turnout.cli.campaign import ChannelsOption, built_campaign, reasons_to_exclude, usable_dataset
from turnout.cli.options import (
    File,
    PanelOptions,
    argument,
    gives,
    made_folder,
    option,
)
from turnout.cli.output import Output, refuse

if TYPE_CHECKING:
    import xarray as xr

    from turnout.figures.report.page import Page
    from turnout.panel.load import LoadedPanel

FORMS = (".pdf", ".png", ".svg")
Draw = Callable[..., Mapping[str, bytes]] | None
"""Function that draws the further figures of a page, as files by name."""
# In the folder that `turnout validate -o` fills.
VALIDATION = "validation.nc"


@gives(
    "report",
    json=False,
    quiet=True,
    out=File("--out -o FILE.html", "The report.", default=Path("report.html")),
)
def report_command(
    output: Output,
    source: Path = argument(
        "SOURCE",
        "A run, a sequence of throws, a campaign, a validation or a map of `turnout limit` "
        "(.nc), a calibration (.toml), the folder of a campaign, a sweep or a validation.",
    ),
    figures: Path | None = option("--figures DIR", "Write each figure as PDF, PNG and SVG."),
    panel: str | None = option(
        "--panel PANEL", "Panel file of a run, to list the origin of each value."
    ),
    channels: ChannelsOption = None,
) -> None:
    """Write a self-contained HTML report about a result; it opens offline in any browser."""
    folder = made_folder("--figures", figures) if figures is not None else None
    forms = FORMS if folder is not None else FORMS[:1]
    draw: Draw = None
    if source.suffix.lower() == ".toml" and not source.is_dir():
        page = _calibration_page(source, panel, forms)
    elif (source / "sweep.json").exists():
        page, draw = _sweep_page(source, forms)
    elif (source / VALIDATION).exists():
        page, draw = _file_page(source / VALIDATION, panel, forms)
    elif source.is_dir():
        campaign = built_campaign(source, channels, strict=False, quiet=output.quiet)
        page, draw = _campaign_page(
            usable_dataset(campaign, source),
            forms,
            excluded=reasons_to_exclude(campaign),
            remarks=campaign.remarks,
        )
    else:
        page, draw = _file_page(source, panel, forms)
    from turnout.core.files import write_atomic
    from turnout.figures.report.page import page_html

    if folder is not None:
        for name, content in {**_pictures(page), **(draw(suffixes=FORMS) if draw else {})}.items():
            write_atomic(folder / name, content)
    output.write(output["out"], page_html(page))


def _pictures(page: "Page") -> dict[str, bytes]:
    """Return the figures of a page as files by name."""
    return {
        f"{picture.sheet.name}{suffix}": content
        for section in page.sections
        for picture in section.pictures
        for suffix, content in picture.files.items()
    }


def _sweep_page(source: Path, forms: tuple[str, ...]) -> "tuple[Page, Draw]":
    """Return the page of a sweep's folder, with sensitivities if the sampling allows them."""
    from turnout.core.errors import ResponseError
    from turnout.figures.report.sweep import sweep_figures, sweep_page
    from turnout.study.sweep.effects import sweep_effects
    from turnout.study.sweep.read import read_labels

    labels = read_labels(source)
    try:
        # Without its design a sweep has no sensitivity indices.
        decided = sweep_effects(labels) if "design" in labels.attrs else []
    except ResponseError:  # no input varies, or no force was stored
        decided = []
    return sweep_page(labels, decided=decided, suffixes=forms), partial(sweep_figures, labels)


def _campaign_page(
    dataset: "xr.Dataset", forms: tuple[str, ...], **found: Any
) -> "tuple[Page, Draw]":
    """Return the page of a campaign, with exclusions and reasons if these are known."""
    from turnout.figures.report.campaign import campaign_figures, campaign_page

    return campaign_page(dataset, suffixes=forms, **found), partial(campaign_figures, dataset)


def _calibration_page(source: Path, panel: str | None, forms: tuple[str, ...]) -> "Page":
    """Return the page of a calibration, with the inputs of its panel if that can be loaded."""
    from turnout.calibration.result import load_calibration
    from turnout.calibration.result_entries import load_signals
    from turnout.core.errors import FileError, PanelError
    from turnout.figures.report.calibration import calibration_page
    from turnout.panel.load import load_panel

    calibration = load_calibration(source)
    used: LoadedPanel | None = None
    try:
        used = load_panel(panel if panel is not None else calibration.panel)
    except (FileError, PanelError):
        if panel is not None:
            raise
    if panel is not None and used is not None and used.hash != calibration.panel_hash:
        _refuse_panel(panel, source, calibration.panel)
    signals = load_signals(calibration, source)
    return calibration_page(calibration, panel=used, signals=signals, suffixes=forms)


def _file_page(source: Path, panel: str | None, forms: tuple[str, ...]) -> "tuple[Page, Draw]":
    """Return the page of a dataset: one run, a campaign or a validation."""
    from turnout.throw.store import open_response

    dataset = open_response(source)
    if dataset.attrs.get("kind") == "validation":
        from turnout.figures.report.validation import validation_figures, validation_page

        return validation_page(dataset, suffixes=forms), partial(validation_figures, dataset)
    if "throw" in dataset.dims:
        from turnout.figures.report.sequence import sequence_page

        return sequence_page(dataset), None
    if dataset.attrs.get("kind") == "limit":
        from turnout.figures.report.blind_zones import blind_zone_page

        return blind_zone_page(dataset, suffixes=forms), None
    if dataset.attrs.get("kind") == "wheel":
        from turnout.figures.gauge import gauge_page

        return gauge_page(dataset, suffixes=forms), None
    if "movement" not in dataset.dims:
        return _run_page(dataset, source, panel), None
    return _campaign_page(dataset, forms)


def _run_page(dataset: "xr.Dataset", source: Path, panel: str | None) -> "Page":
    from turnout.figures.report.inputs import panel_of_result
    from turnout.figures.report.run import run_page

    given = PanelOptions(panel).opened() if panel is not None else None
    used = panel_of_result(dataset.attrs, panel=given)
    if given is not None and used is None:
        _refuse_panel(str(panel), source, dataset.attrs.get("panel", "not stated"))
    return run_page(dataset, panel=used)


def _refuse_panel(panel: str, source: Path, known: str) -> NoReturn:
    refuse(
        f"--panel {panel}: is not the panel of {source}, which is '{known}' with other values; "
        "name that one"
    )
