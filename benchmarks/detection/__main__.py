"""Make the open benchmark of foreign-object detection, compare methods, score verdicts.

    python -m benchmarks.detection run DIR [--size reduced] [--method NAME] [--main] [--json]
    python -m benchmarks.detection score DIR VERDICTS [--history 20] [--track machines] [--json]
    python -m benchmarks.detection page DIR

The same command continues an interrupted run. docs/evidence/open-benchmark.md describes the data,
the table of verdicts and the keys of `--json`; `page` writes its tables.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from benchmarks.detection.definition import MARKERS, PRESETS
from benchmarks.detection.figures import (
    benchmark_curves,
    bound_mid_span,
    plot_benchmark_pod,
    plot_benchmark_roc,
)
from benchmarks.detection.make_throws import make_throws, write_card
from benchmarks.detection.order import margins_of, order_changes, order_table
from benchmarks.detection.page import write_page
from benchmarks.detection.run_methods import (
    MAIN,
    RESULTS,
    Conditions,
    conditions_for,
    numbers_digest,
    run_methods,
    score_file,
)
from benchmarks.detection.tables import millimetres, write_table
from turnout.cli.main import BAD_INPUT
from turnout.cli.output import INTERRUPTED, json_text
from turnout.cli.watch import cores
from turnout.core.errors import TurnoutError
from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import SIMULATED

SCORE_UNITS = {
    **{"a90": "m", "a90_95": "m", "mid_span": "m", "equal_mid_span": "m", "excess": "m"},
    **{"median": "m", "ninety": "m", "coverage": "1", "value": "1", "low": "1", "high": "1"},
    **{"macro_f1": "1", "unknown_auroc": "1", "calibration": "1", "milliseconds": "ms"},
    **{"tuning_time": "s", "own": "m", "other": "m", "ahead": "1"},
}


def parser() -> argparse.ArgumentParser:
    """Return the options of the commands."""
    found = argparse.ArgumentParser(
        prog="python -m benchmarks.detection", description=(__doc__ or "").partition("\n")[0]
    )
    commands = found.add_subparsers(required=True, metavar="run | score | page")

    run = commands.add_parser("run", help="make the throws, run all methods, write the tables")
    run.set_defaults(command=run_command)
    option = run.add_argument
    option("folder", metavar="DIR", type=Path, help="an interrupted run continues")
    option("--size", choices=PRESETS, default="full")
    option("--method", metavar="NAME", action="append", help="this method only; may be repeated")
    option("--throws", action="store_true", help="make the throws and their data card only")
    option("--main", action="store_true", help="0 and 20 throws known only, the main conditions")
    option("--workers", metavar="N", type=processes, default=cores(), help="default one per core")
    option("--quiet", action="store_true", help="show no progress")
    option("--json", action="store_true", help="print the result as JSON, in SI units")

    score = commands.add_parser("score", help="score the verdicts of any method")
    score.set_defaults(command=score_command)
    option = score.add_argument
    option("folder", metavar="DIR", type=Path, help="of the benchmark")
    option("verdicts", metavar="VERDICTS", type=Path, help=".csv or .parquet, one row per throw")
    option("--history", metavar="N", type=int, default=20, help="sound throws known of each switch")
    option("--discrepancy", metavar="SHARE", type=float, default=0.05, help="0.03, 0.05 or 0.1")
    option("--channels", metavar="NAME", default="force", help="force, current or power")
    option("--track", metavar="NAME", default=MARKERS, help="markers or machines")
    option("--json", action="store_true", help="print the result as JSON, in SI units")

    page = commands.add_parser("page", help="write the tables of docs/evidence/open-benchmark.md")
    page.set_defaults(command=lambda given: write_page(given.folder))
    page.add_argument("folder", metavar="DIR", type=Path, help="of a run that is complete")
    return found


def processes(text: str) -> int:
    """Return a number of processes."""
    if not text.isdecimal() or int(text) < 1:
        message = f"{text}: must be a whole number, 1 or more"
        raise argparse.ArgumentTypeError(message)
    return int(text)


def run_command(given: argparse.Namespace) -> None:
    """Make the benchmark and compare methods."""
    folder, counts = given.folder, PRESETS[given.size]

    def report(text: str) -> None:
        if not given.quiet:
            print(text, file=sys.stderr, flush=True)

    def ran(last: str, done: int, total: int) -> None:
        report(f"methods: {done} of {total} done, last {last}")

    made = make_throws(
        folder, counts, workers=given.workers,
        report=lambda done, total: report(f"throws: {done} of {total} switches"),
    )  # fmt: skip
    written = [made, write_card(folder)]
    found: dict[str, Any] = {"results": {}}
    lines: list[str] = []
    if not given.throws:
        wanted = MAIN if given.main else conditions_for(counts.known)
        results = run_methods(
            folder, wanted, only=given.method or (), workers=given.workers, report=ran
        )
        margins, order, lines = ordered(folder, wanted, results)
        digest = numbers_digest(folder, results)
        found = {"results": results, "margins": margins, "numbers": digest}
        written += [write_table(folder, order, results), *draw(folder, wanted[0], results)]
        lines += [f"numbers         {digest}", f"origin          {SIMULATED}"]
    if given.json:
        record = {"origin": SIMULATED, **found}
        print(json_text("benchmarks.detection run", record, units=SCORE_UNITS, written=written))
    else:
        print(*lines, *(f"wrote           {path}" for path in written), sep="\n")


def ordered(
    folder: Path, wanted: tuple[Conditions, ...], results: dict[str, Any]
) -> tuple[dict[str, Any], str, list[str]]:
    """Return the margins, the order of methods as a table, and its lines on the screen."""
    margins = {own.name: margins_of(folder, own, results[own.name]) for own in wanted}
    if not any("best" in found for found in margins.values()):
        return margins, "", []
    changes = order_changes(wanted, margins)
    table = order_table(wanted, results, margins)
    listed = "\n".join(f"- {text}" for text in changes)
    return margins, f"{table}\n\n{listed}", [f"order           {text}" for text in changes]


def draw(folder: Path, conditions: Conditions, results: dict[str, Any]) -> list[Path]:
    """Write the figures of one set of conditions."""
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


def score_command(given: argparse.Namespace) -> None:
    """Score a verdict file on the test throws of the benchmark."""
    conditions = Conditions(
        history=given.history, discrepancy=given.discrepancy,
        channels=given.channels, track=given.track,
    )  # fmt: skip
    score = score_file(given.verdicts, given.folder, conditions)
    if given.json:
        found = {"origin": SIMULATED, "score": score}
        print(json_text("benchmarks.detection score", found, units=SCORE_UNITS))
        return
    print(f"origin          {SIMULATED}")
    alarms = score["false_alarms"]
    print(
        f"false alarms    {1e3 * alarms['value']:.2f} in 1,000 sound throws "
        f"({1e3 * alarms['low']:.2f} to {1e3 * alarms['high']:.2f}; {alarms['hits']} of "
        f"{alarms['count']}, {alarms['switches']} switches)"
    )
    for name, found in score["place"].items():
        print(
            f"a90             {millimetres(found['a90'])} mm at {name} "
            f"(a90/95 {millimetres(found['a90_95'])}; {found['hits']} of {found['throws']} called)"
        )
    print(f"sleepers 4-8    {millimetres(score['mid_span'])} mm on average")
    print(
        f"at equal rate   {millimetres(score['equal_mid_span'])} mm, where 1 in 1,000 of these "
        "sound throws is called"
    )
    for name, text in (
        ("macro_f1", "causes, macro-F1"), ("unknown_auroc", "unknown, AUROC"),
        ("calibration", "calibration error"),
    ):  # fmt: skip
        if score[name] is not None:
            print(f"{text:<20}{score[name]:.2f}")


def main() -> None:
    """Run a command; bad input ends it with one message and exit code 2."""
    given = parser().parse_args()
    try:
        with one_blas_thread():
            given.command(given)
    except TurnoutError as error:
        print(f"benchmark: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        print("benchmark: interrupted; run the same command to continue", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
