"""The command `turnout validate`: predict measured movements and judge the errors."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from turnout.cli.campaign import OutsideOption, opened_campaign
from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import (
    FINDINGS,
    INTERRUPTED,
    SetOption,
    calibrated_panel,
    made_folder,
    opened_panel,
    write_and_report,
)
from turnout.measurement.campaign.campaign_folder import throw_store

if TYPE_CHECKING:
    import xarray as xr

    from turnout.calibration.drive_law.compare import LawComparison
    from turnout.calibration.result import Calibration
    from turnout.calibration.validation.acceptance import Acceptance
    from turnout.panel.load import LoadedPanel

PAGE, TABLE, DATASET = "validation.md", "movements.csv", "validation.nc"
MAP, COMPARISON = "errors.png", "comparison.png"


def validate_command(
    source: Annotated[
        Path, typer.Argument(metavar="CAMPAIGN", help="Folder of a campaign, or its dataset (.nc).")
    ],
    calibration: Annotated[
        Path, typer.Option("--calibration", metavar="FILE", help="From `turnout calibrate`.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="DIR", help="Write page, table, dataset and figures."),
    ] = None,
    panel: Annotated[
        str | None,
        typer.Option("--panel", metavar="PANEL", help="Default: the calibrated panel."),
    ] = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    place: Annotated[
        str | None,
        typer.Option(
            "--place",
            metavar="PLACE",
            help="Place whose movements are drawn; default the middle one.",
        ),
    ] = None,
    laws: Annotated[
        str | None,
        typer.Option(
            "--drive-laws", metavar="DRIVE", help="Also compare drive laws for this drive."
        ),
    ] = None,
    allow_outside: OutsideOption = False,
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Processes.")] = 2,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 if the calibration is not valid.")
    ] = False,
    as_json: JsonOption = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show only the verdict.")] = False,
) -> None:
    """Predict every movement of a campaign and judge those not used in the fit."""
    from turnout.calibration.requirements import check_provenance
    from turnout.calibration.result import load_calibration

    known = load_calibration(calibration)
    given = opened_panel(panel, []) if panel is not None else calibrated_panel(known, calibration)
    loaded = given.with_settings(settings) if settings else given
    if out is not None:
        made_folder("--out", out)
    written = None if out is None else out / PAGE
    dataset = opened_campaign(source, None, out=written, allow_outside=allow_outside, quiet=quiet)
    if place is not None:
        _check_place(dataset, place)
    if laws is not None:
        from turnout.calibration.drive_law.candidates import drive_laws

        drive_laws(loaded, laws)
    for text in check_provenance(known, loaded):
        typer.echo(f"turnout: {calibration}: {text}", err=True)
    from turnout.calibration.validation.acceptance import judge
    from turnout.calibration.validation.verdict_text import acceptance_lines, notes

    found = _validated(source, dataset, loaded, known, workers=workers, quiet=quiet)
    verdict = judge(found)
    for line in () if quiet or as_json else (*acceptance_lines(verdict), *notes(found)):
        typer.echo(line)
    files = [] if out is None else _write(out, found, verdict, place=place, quiet=as_json)
    if not as_json:
        from turnout.cli.colour import coloured

        level = "good" if verdict.accepted else "bad" if verdict.reasons else "look"
        typer.echo(coloured(verdict.text, level))
    compared = None
    if laws is not None:
        compared = _compared_laws(
            source, dataset, loaded, known, laws, workers=workers, quiet=quiet
        )
    _print_laws(compared, as_json=as_json)
    if as_json:
        from turnout.cli.json_records import VALIDATION_UNITS, validation_record

        record = validation_record(verdict, notes(found), compared)
        print_json("validate", record, units=VALIDATION_UNITS, written=files)
    if strict and not verdict.accepted:
        raise typer.Exit(FINDINGS)


def _print_laws(compared: "LawComparison | None", *, as_json: bool) -> None:
    from turnout.calibration.drive_law.compare import law_lines

    for line in () if compared is None or as_json else law_lines(compared):
        typer.echo(line)


def _check_place(dataset: "xr.Dataset", place: str) -> None:
    """Refuse a place without movements before anything is thrown."""
    from turnout.core.errors import FileError
    from turnout.core.problems import choices
    from turnout.metric.campaign_statistics import object_places

    known = object_places(dataset)
    if place not in known:
        message = f"--place: no closing movement with an object at '{place}'; there are "
        raise FileError(message + choices(known))


def _validated(
    source: Path,
    dataset: "xr.Dataset",
    panel: "LoadedPanel",
    known: "Calibration",
    *,
    workers: int,
    quiet: bool,
) -> "xr.Dataset":
    from turnout.calibration.evaluate import Evaluator
    from turnout.calibration.validation.validate import validate
    from turnout.cli.watch import watched

    try:
        with (
            watched(panel.name, quiet=quiet) as watch,
            Evaluator(panel, folder=throw_store(source), workers=workers) as evaluator,
        ):

            def report(stage: str, done: int, total: int) -> None:
                watch.report(done, total, text=f"{panel.name}: {stage}")

            return validate(dataset, panel, known, evaluator=evaluator, report=report)
    except KeyboardInterrupt:
        _interrupted()


def _compared_laws(
    source: Path,
    dataset: "xr.Dataset",
    panel: "LoadedPanel",
    known: "Calibration",
    drive: str,
    *,
    workers: int,
    quiet: bool,
) -> "LawComparison":
    from turnout.calibration.drive_law.compare import compare_laws
    from turnout.calibration.evaluate import Evaluator
    from turnout.cli.watch import watched

    try:
        with (
            watched(f"fitting laws of drive {drive}", quiet=quiet) as watch,
            Evaluator(panel, folder=throw_store(source), workers=workers) as evaluator,
        ):
            return compare_laws(
                dataset, panel, known, drive=drive, evaluator=evaluator, report=watch.report
            )
    except KeyboardInterrupt:
        _interrupted()


def _interrupted() -> NoReturn:
    typer.echo(
        "turnout: interrupted; throws so far are cached, run the same command to continue", err=True
    )
    raise typer.Exit(INTERRUPTED) from None


def _write(
    out: Path, found: "xr.Dataset", verdict: "Acceptance", *, place: str | None, quiet: bool
) -> list[Path]:
    from turnout.calibration.validation.verdict_text import page_text, table_text
    from turnout.figures.style import rendered
    from turnout.figures.validation import plot_comparison, plot_error_map
    from turnout.metric.campaign_statistics import object_places
    from turnout.throw.store import save_response

    figures = [MAP]
    write_and_report(out / MAP, rendered(plot_error_map(found), ".png"), quiet=quiet)
    places = object_places(found)
    if places:
        chosen = place if place is not None else _middle(places)
        figure = plot_comparison(found, place=chosen)
        write_and_report(out / COMPARISON, rendered(figure, ".png"), quiet=quiet)
        figures.append(COMPARISON)
    write_and_report(out / TABLE, table_text(found), quiet=quiet)
    save_response(found, out / DATASET)
    if not quiet:
        typer.echo(f"{out / DATASET}: written")
    write_and_report(out / PAGE, page_text(found, verdict, figures=figures), quiet=quiet)
    return [out / name for name in (*figures, TABLE, DATASET, PAGE)]


def _middle(places: list[str]) -> str:
    """Return the place of the published validation if it was thrown, else the middle one."""
    return "sleeper 6" if "sleeper 6" in places else places[len(places) // 2]
