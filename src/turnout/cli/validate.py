"""The command `turnout validate`: predict measured movements and judge the errors."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from turnout.cli.campaign import OutsideOption, opened_campaign
from turnout.cli.options import (
    PanelOptions,
    SetOption,
    argument,
    calibrated_panel,
    gives,
    made_folder,
    option,
)
from turnout.cli.output import (
    FINDINGS,
    Output,
    coloured,
    note,
    picked,
    refuse,
    resumable,
)
from turnout.cli.watch import watched
from turnout.measurement.campaign.campaign_folder import throw_store

if TYPE_CHECKING:
    import xarray as xr

    from turnout.calibration.validation.acceptance import Acceptance

PAGE, TABLE, DATASET = "validation.md", "movements.csv", "validation.nc"
MAP, COMPARISON = "errors.png", "comparison.png"


@gives("validate")
def validate_command(
    output: Output,
    source: Path = argument("CAMPAIGN", "Folder of a campaign, or its dataset (.nc)."),
    calibration: Path = option("--calibration FILE", "From `turnout calibrate`.", default=...),
    out: Path | None = option("--out -o DIR", "Write page, table, dataset and figures."),
    panel: str | None = option("--panel PANEL", "Default: the calibrated panel."),
    settings: SetOption = [],  # noqa: B006 - typer copies it
    place: str | None = option(
        "--place PLACE", "Place whose movements are drawn; default the middle one."
    ),
    allow_outside: OutsideOption = False,
    workers: int = option("--workers N", "Processes.", default=2, min=1),
    strict: bool = option("--strict", "Exit code 1 if the calibration is not valid."),
    quiet: bool = option("--quiet -q", "Show only the verdict."),
) -> None:
    """Predict every movement of a campaign and judge those not used in the fit."""
    from turnout.calibration.result import check_provenance, load_calibration

    known = load_calibration(calibration)
    named = panel is not None
    given = PanelOptions(panel).opened() if named else calibrated_panel(known, calibration)
    loaded = given.with_settings(settings) if settings else given
    if out is not None:
        made_folder("--out", out)
    written = None if out is None else out / PAGE
    dataset = opened_campaign(source, None, out=written, allow_outside=allow_outside, quiet=quiet)
    if place is not None:
        _check_place(dataset, place)
    for text in check_provenance(known, loaded):
        note(f"{calibration}: {text}")
    from turnout.calibration.evaluate import Evaluator
    from turnout.calibration.validation.acceptance import judge, notes
    from turnout.calibration.validation.validate import validate

    with (
        resumable("throws so far are cached, run the same command to continue"),
        watched(loaded.name, quiet=quiet) as watch,
        Evaluator(loaded, folder=throw_store(source), workers=workers) as evaluator,
    ):

        def report(stage: str, done: int, total: int) -> None:
            watch.report(done, total, text=f"{loaded.name}: {stage}")

        found = validate(dataset, loaded, known, evaluator=evaluator, report=report)
    verdict = judge(found)
    if not (quiet or output.as_json):
        output.show(*verdict.lines, *notes(found))
    if out is not None:
        _write(output, out, found, verdict, place=place)
    level = "good" if verdict.accepted else "bad" if verdict.reasons else "look"
    output.show(coloured(verdict.text, level))
    output.json(validation_record, verdict, notes(found), units=VALIDATION_UNITS)
    if strict and not verdict.accepted:
        raise typer.Exit(FINDINGS)


def _check_place(dataset: "xr.Dataset", place: str) -> None:
    """Refuse a place without movements before anything is thrown."""
    from turnout.core.problems import choices
    from turnout.metric.campaign_statistics import object_places

    known = object_places(dataset)
    if place not in known:
        near = choices(known)
        refuse(f"--place: no closing movement with an object at '{place}'; there are {near}")


def _write(
    output: Output, out: Path, found: "xr.Dataset", verdict: "Acceptance", *, place: str | None
) -> None:
    from turnout.calibration.validation.acceptance import page_text, table_text
    from turnout.figures.validation import plot_comparison, plot_error_map
    from turnout.metric.campaign_statistics import object_places

    output.figure(out / MAP, lambda: plot_error_map(found))
    places = object_places(found)
    if places:
        chosen = place if place is not None else _middle(places)
        output.figure(out / COMPARISON, lambda: plot_comparison(found, place=chosen))
    figures = [path.name for path in output.written]
    output.write(out / TABLE, table_text(found))
    output.dataset(out / DATASET, found)
    output.write(out / PAGE, page_text(found, verdict, figures=figures))


def _middle(places: list[str]) -> str:
    """Return the place of the published validation if it was thrown, else the middle one."""
    return "sleeper 6" if "sleeper 6" in places else places[len(places) // 2]


VALIDATION_UNITS = {"rms": "N", "spread": "N", "contact": "s", "slope": "1", "peak": "N"}
VALIDATION_UNITS |= {"plateau": "N"}


def validation_record(verdict: "Acceptance", remarks: Sequence[str]) -> dict[str, Any]:
    """Return verdict and errors of each channel."""
    return {
        "valid": verdict.accepted,
        **picked(verdict, "text", "reasons", "judged", "used", "cover", "power"),
        "channels": [
            {**asdict(part), "spreads": part.spreads, "kind": part.kind}
            for part in verdict.channels
        ],
        "remarks": [*verdict.remarks, *remarks],
    }
