"""The command `turnout validate`: predictions of measured movements, and whether they hold."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from turnout.cli.campaign import INTERRUPTED, OutsideOption, dataset_of
from turnout.cli.options import (
    SetOption,
    calibrated_panel,
    made_folder,
    opened_panel,
    write_and_report,
)

if TYPE_CHECKING:
    import xarray as xr

    from turnout.calibration.result import Calibration
    from turnout.panel.load import LoadedPanel
    from turnout.validation.verdict import Verdict

NOT_VALID = 1
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
        typer.Option("--panel", metavar="PANEL", help="Default the one that was calibrated."),
    ] = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    place: Annotated[
        str | None,
        typer.Option("--place", help="Whose movements are drawn; default the middle one."),
    ] = None,
    laws: Annotated[
        str | None,
        typer.Option(
            "--drive-laws", metavar="DRIVE", help="Also ask which law this drive follows."
        ),
    ] = None,
    allow_outside: OutsideOption = False,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes.")] = 2,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show only the verdict.")] = False,
) -> None:
    """Predict every movement of a campaign and judge those that the fit has not seen.

    Exit code 1 where the calibration is not valid for the campaign.
    """
    from turnout.calibration.movements import check_provenance
    from turnout.calibration.result import load_calibration

    known = load_calibration(calibration)
    given = opened_panel(panel, []) if panel is not None else calibrated_panel(known, calibration)
    loaded = given.with_settings(settings) if settings else given
    if out is not None:
        made_folder("--out", out)
    written = None if out is None else out / PAGE
    dataset = dataset_of(source, None, out=written, allow_outside=allow_outside, quiet=quiet)
    if place is not None:
        _check_place(dataset, place)
    if laws is not None:
        from turnout.calibration.drive_law.candidates import drive_laws

        drive_laws(loaded, laws)
    for text in check_provenance(known, loaded):
        typer.echo(f"turnout: {calibration}: {text}", err=True)
    from turnout.validation.verdict import judge, verdict_lines

    found = _validated(source, dataset, loaded, known, workers=workers, quiet=quiet)
    verdict = judge(found)
    if not quiet:
        from turnout.validation.text import notes

        for line in (*verdict_lines(verdict), *notes(found)):
            typer.echo(line)
    if out is not None:
        _write(out, found, verdict, place=place)
    typer.echo(verdict.text)
    if laws is not None:
        _compare_laws(source, dataset, loaded, known, laws, workers=workers, quiet=quiet)
    if not verdict.accepted:
        raise typer.Exit(NOT_VALID)


def _check_place(dataset: "xr.Dataset", place: str) -> None:
    """Refuse a place without movements before anything is thrown."""
    from turnout.core.problems import choices
    from turnout.errors import FileError
    from turnout.metric.campaign import places_of

    known = places_of(dataset)
    if place not in known:
        message = f"--place: no closing movement with an object at '{place}'; there are "
        raise FileError(message + choices(known))


def kept_throws(source: Path) -> Path:
    """Return the folder in which the throws for a campaign are kept."""
    folder = source if source.is_dir() else source.parent
    return folder / ".turnout" / "throws"


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
    from turnout.cli.watch import watched
    from turnout.validation.validate import validate

    total = dataset.sizes["movement"] * (1 + len(known.fitted))
    try:
        with (
            watched(f"throwing {panel.name}", quiet=quiet) as watch,
            Evaluator(panel, folder=kept_throws(source), workers=workers) as evaluator,
        ):
            evaluator.told = lambda: watch.report(min(evaluator.made, total), total)
            return validate(dataset, panel, known, evaluator=evaluator)
    except KeyboardInterrupt:
        _interrupted()


def _compare_laws(
    source: Path,
    dataset: "xr.Dataset",
    panel: "LoadedPanel",
    known: "Calibration",
    drive: str,
    *,
    workers: int,
    quiet: bool,
) -> None:
    from turnout.calibration.drive_law.compare import compare_laws, law_lines
    from turnout.calibration.evaluate import Evaluator
    from turnout.cli.watch import watched

    try:
        with (
            watched(f"fitting laws of drive {drive}", quiet=quiet) as watch,
            Evaluator(panel, folder=kept_throws(source), workers=workers) as evaluator,
        ):
            found = compare_laws(
                dataset, panel, known, drive=drive, evaluator=evaluator, report=watch.report
            )
    except KeyboardInterrupt:
        _interrupted()
    for line in law_lines(found):
        typer.echo(line)


def _interrupted() -> NoReturn:
    typer.echo("turnout: interrupted; the throws are kept, the same command goes on", err=True)
    raise typer.Exit(INTERRUPTED) from None


def _write(out: Path, found: "xr.Dataset", verdict: "Verdict", *, place: str | None) -> None:
    from turnout.metric.campaign import places_of
    from turnout.plot.style import rendered
    from turnout.plot.validation import plot_comparison, plot_error_map
    from turnout.response.store import save_response
    from turnout.validation.text import page_text, table_text

    figures = [MAP]
    write_and_report(out / MAP, rendered(plot_error_map(found), ".png"))
    places = places_of(found)
    if places:
        chosen = place if place is not None else _middle(places)
        write_and_report(out / COMPARISON, rendered(plot_comparison(found, place=chosen), ".png"))
        figures.append(COMPARISON)
    write_and_report(out / TABLE, table_text(found))
    save_response(found, out / DATASET)
    typer.echo(f"{out / DATASET}: written")
    write_and_report(out / PAGE, page_text(found, verdict, figures=figures))


def _middle(places: list[str]) -> str:
    """Return the place of the published validation where it was thrown, else the middle one."""
    return "sleeper 6" if "sleeper 6" in places else places[len(places) // 2]
