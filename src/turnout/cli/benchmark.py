"""The commands `turnout benchmark ...`: make the benchmark, compare methods, score verdicts."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import QuietOption

if TYPE_CHECKING:
    from turnout.open_benchmark.run_methods import Conditions

app = typer.Typer(
    help="Open benchmark of foreign-object detection: make it, compare methods, score verdicts.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
SCORE_UNITS = {
    **{"a90": "m", "a90_95": "m", "mid_span": "m", "equal_mid_span": "m", "excess": "m"},
    **{"median": "m", "ninety": "m", "coverage": "1", "value": "1", "low": "1", "high": "1"},
    **{"macro_f1": "1", "unknown_auroc": "1", "calibration": "1", "milliseconds": "ms"},
    **{"tuning_time": "s", "own": "m", "other": "m", "ahead": "1"},
}
FolderArgument = Annotated[
    Path,
    typer.Argument(metavar="DIR", help="Folder of the benchmark; an interrupted run continues."),
]
HistoryOption = Annotated[
    int, typer.Option("--history", metavar="N", min=0, help="Sound throws known of each switch.")
]
DiscrepancyOption = Annotated[
    float,
    typer.Option(
        "--discrepancy", metavar="SHARE", help="Between model and switch: 0.03, 0.05, 0.1."
    ),
]
ChannelsOption = Annotated[
    str, typer.Option("--channels", metavar="NAME", help="force, current or power.")
]
TrackOption = Annotated[
    str, typer.Option("--track", metavar="NAME", help="markers, or machines for current and power.")
]


@app.command("detection", short_help="Make the throws, run all methods, write the tables.")
def detection_command(
    folder: FolderArgument,
    size: Annotated[
        str, typer.Option("--size", metavar="NAME", help="full, reduced or small.")
    ] = "full",
    only: Annotated[
        list[str] | None,
        typer.Option("--method", metavar="NAME", help="Run this method only; may be repeated."),
    ] = None,
    throws_only: Annotated[
        bool, typer.Option("--throws", help="Make the throws and their data card only.")
    ] = False,
    main_only: Annotated[
        bool,
        typer.Option("--main", help="No other discrepancies, channels or histories than 0 and 20."),
    ] = False,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=0, help="Processes; default one a core.")
    ] = 0,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make the benchmark and compare methods; the same command continues an interrupted run."""
    from turnout.cli.sweep import cores
    from turnout.core.errors import StudyError
    from turnout.core.problems import choices
    from turnout.open_benchmark.data_card import write_card
    from turnout.open_benchmark.definition import PRESETS
    from turnout.open_benchmark.make_throws import make_throws
    from turnout.open_benchmark.run_methods import (
        MAIN,
        conditions_for,
        numbers_digest,
        run_methods,
    )
    from turnout.open_benchmark.tables import write_table

    if size not in PRESETS:
        message = f'--size "{size}": allowed are {choices(PRESETS)}'
        raise StudyError([message], source="benchmark")
    counts = PRESETS[size]

    def thrown(done: int, total: int) -> None:
        if not quiet:
            typer.echo(f"throws: {done} of {total} switches", err=True)

    def ran(what: str, done: int, total: int) -> None:
        if not quiet:
            typer.echo(f"methods: {done} of {total} done, last {what}", err=True)

    made = make_throws(folder, counts, workers=workers or cores(), report=thrown)
    written = [made, write_card(folder)]
    found: dict[str, Any] = {"results": {}}
    lines: list[str] = []
    if not throws_only:
        wanted = MAIN if main_only else conditions_for(counts.known)
        results = run_methods(
            folder, wanted, only=only or (), workers=workers or cores(), report=ran
        )
        margins, order, lines = _order(folder, wanted, results)
        digest = numbers_digest(folder, results)
        found = {"results": results, "margins": margins, "numbers": digest}
        written += [write_table(folder, order, results)]
        written += _figures(folder, wanted[0], results)
        lines.append(f"numbers         {digest}")
    if as_json:
        print_json("benchmark detection", found, units=SCORE_UNITS, written=written)
        return
    for line in [*lines, *(f"wrote           {path}" for path in written)]:
        typer.echo(line)


def _order(
    folder: Path, wanted: "tuple[Conditions, ...]", results: dict[str, Any]
) -> tuple[dict[str, Any], str, list[str]]:
    """Return the margins, the table of who is first, and that in words."""
    from turnout.open_benchmark.order import margins_of, order_changes, order_table

    margins = {own.name: margins_of(folder, own, results[own.name]) for own in wanted}
    if not any("best" in found for found in margins.values()):
        return margins, "", []
    changes = order_changes(wanted, margins)
    table = order_table(wanted, results, margins)
    listed = "\n".join(f"- {text}" for text in changes)
    return margins, f"{table}\n\n{listed}", [f"order           {text}" for text in changes]


def _figures(folder: Path, conditions: "Conditions", results: dict[str, Any]) -> list[Path]:
    from turnout.figures.benchmark import plot_benchmark_pod, plot_benchmark_roc
    from turnout.open_benchmark.curves import benchmark_curves, bound_mid_span
    from turnout.open_benchmark.run_methods import RESULTS

    own = results[conditions.name]
    place = folder / RESULTS / conditions.name
    roc, size, pod = benchmark_curves(own, conditions.judged(folder), place)
    text = f"{conditions.history} sound throws known, discrepancy {conditions.discrepancy:.0%}"
    figures = {
        "roc.png": plot_benchmark_roc(roc, title=f"Objects anywhere: {text}"),
        "pod.png": plot_benchmark_pod(
            size, pod, title=f"Stones and metal at sleepers 4 to 8: {text}",
            bound=bound_mid_span(conditions.history),
        ),
    }  # fmt: skip
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=120)
    return [folder / name for name in figures]


@app.command("score", short_help="Score the verdicts of any method.")
def score_command(
    folder: FolderArgument,
    verdicts: Annotated[
        Path, typer.Argument(metavar="VERDICTS", help="Table (.csv, .parquet), a row a throw.")
    ],
    history: HistoryOption = 20,
    discrepancy: DiscrepancyOption = 0.05,
    channels: ChannelsOption = "force",
    track: TrackOption = "markers",
    as_json: JsonOption = False,
) -> None:
    """Score a verdict file on the test throws of the benchmark."""
    from turnout.open_benchmark.run_methods import Conditions, score_file
    from turnout.open_benchmark.tables import millimetres

    conditions = Conditions(
        history=history, discrepancy=discrepancy, channels=channels, track=track
    )
    score = score_file(verdicts, folder, conditions)
    if as_json:
        print_json("benchmark score", {"score": score}, units=SCORE_UNITS)
        return
    alarms = score["false_alarms"]
    typer.echo(
        f"false alarms    {1e3 * alarms['value']:.2f} in 1,000 sound throws "
        f"({1e3 * alarms['low']:.2f} to {1e3 * alarms['high']:.2f}; {alarms['hits']} of "
        f"{alarms['count']}, {alarms['switches']} switches)"
    )
    for name, found in score["place"].items():
        typer.echo(
            f"a90             {millimetres(found['a90'])} mm at {name} "
            f"(a90/95 {millimetres(found['a90_95'])}; {found['hits']} of {found['throws']} called)"
        )
    typer.echo(f"sleepers 4-8    {millimetres(score['mid_span'])} mm on average")
    typer.echo(
        f"at equal rate   {millimetres(score['equal_mid_span'])} mm, where 1 in 1,000 of these "
        "sound throws is called"
    )
    for name, text in (
        ("macro_f1", "causes, macro-F1"), ("unknown_auroc", "unknown, AUROC"),
        ("calibration", "calibration error"),
    ):  # fmt: skip
        if score[name] is not None:
            typer.echo(f"{text:<20}{score[name]:.2f}")
