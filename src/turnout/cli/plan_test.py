"""The command `turnout plan-test`: objects to throw, by place, on a day on the track."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from turnout.cli.options import (
    CalibrationOption,
    PanelArgument,
    QuietOption,
    SetOption,
    check_outputs,
    given_panel,
    option,
)
from turnout.cli.output import JsonOption, Output
from turnout.cli.watch import watched

if TYPE_CHECKING:
    from turnout.detection.limit.day_plan import Candidates, Knowledge

LENGTHS = dict.fromkeys(("size", "a90", "a90_95", "grid_a90_95"), "m")


def plan_test_command(
    panel: PanelArgument = None,
    calibration: CalibrationOption = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    throws: int = option("--throws N", "Throws of the day.", default=60, min=1),
    discrepancy: float = option(
        "--discrepancy SHARE", "Of model and switch, share of the peak force.", default=0.05
    ),
    out: Path | None = option("--out -o FILE.csv", "Write the plan."),
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Plan a day of tests: objects, places and order that determine the switch and a90 best."""
    check_outputs({"--out": out}, {"--out": (".csv",)})
    from turnout.cli.limit import conditions_of_options
    from turnout.detection.limit.day_plan import candidates, full_grid, known_after, ordered, plan

    conditions = conditions_of_options(discrepancy=discrepancy)
    given = given_panel(panel, settings, calibration)
    with watched("simulating the throws to choose from", quiet=quiet) as watch:
        found = candidates(given, conditions=conditions, report=watch.report)
    with watched("choosing throws", quiet=quiet) as watch:
        chosen = ordered(found, plan(found, throws, report=watch.report))
    grid = full_grid(found)
    known, of_grid = known_after(found, chosen), known_after(found, grid)
    rows = [
        {"throw": number, "place": found.place[row], "size": float(found.size[row]),
         "slips": bool(found.slips[row])}
        for number, row in enumerate(chosen, 1)
    ]  # fmt: skip
    output = Output("plan-test", as_json=as_json, quiet=quiet)
    lines = ["throw,place,size [mm],slips"]
    lines += [
        f"{row['throw']},{row['place']},{1e3 * float(str(row['size'])):g},"
        f"{'yes' if row['slips'] else 'no'}"
        for row in rows
    ]
    output.write(out, "\n".join(lines) + "\n")
    if as_json:
        record = {
            "throws": len(chosen),
            "grid_throws": len(grid),
            "plan": rows,
            "parameters": _parameter_rows(found, known, of_grid),
            "places": _place_rows(known, of_grid),
        }
        output.json(record, units=LENGTHS)
    elif not quiet:
        _print(found, chosen, grid, known, of_grid)


def _parameter_rows(
    found: "Candidates", known: "Knowledge", of_grid: "Knowledge"
) -> list[dict[str, object]]:
    return [
        {"parameter": item.name, "before": item.deviation, "is_share": item.share,
         "after": item.deviation * float(after), "after_grid": item.deviation * float(grid)}
        for item, after, grid in zip(
            found.parameters, known.deviations, of_grid.deviations, strict=True
        )
    ]  # fmt: skip


def _place_rows(known: "Knowledge", of_grid: "Knowledge") -> list[dict[str, object]]:
    return [
        {"place": place, "a90": size, "a90_95": high, "grid_a90_95": of_grid.a90[place][1]}
        for place, (size, high) in known.a90.items()
    ]


def _print(
    found: "Candidates",
    chosen: list[int],
    grid: list[int],
    known: "Knowledge",
    of_grid: "Knowledge",
) -> None:
    from itertools import groupby

    from turnout.detection.conditions import SIMULATED

    typer.echo(f"{len(chosen)} throws, in this order (* a drive slips):")
    for place, rows in groupby(chosen, key=lambda row: found.place[row]):
        sizes = [f"{1e3 * found.size[row]:g}{'*' if found.slips[row] else ''}" for row in rows]
        what = f"{len(sizes)} sound" if place == "none" else ", ".join(sizes) + " mm"
        typer.echo(f"  {'no object' if place == 'none' else place:<12}{what}")
    wide = max(34, *(len(item.name) + 1 for item in found.parameters))
    typer.echo(
        f"\n{'standard deviation of':<{wide}}{'before':>10}{'this day':>10}"
        f"{f'grid of {len(grid)}':>14}"
    )
    for row in _parameter_rows(found, known, of_grid):
        cells = [
            _deviation(
                row[key], share=bool(row["is_share"]), length="travel" in str(row["parameter"])
            )
            for key in ("before", "after", "after_grid")
        ]
        typer.echo(f"{row['parameter']:<{wide}}{cells[0]:>10}{cells[1]:>10}{cells[2]:>14}")
    typer.echo(f"\n{'bound at':<14}{'a90 [mm]':>10}{'a90/95, this day':>18}{'grid':>10}")
    for row in _place_rows(known, of_grid):
        cells = [f"{1e3 * float(str(row[key])):.1f}" for key in ("a90", "a90_95", "grid_a90_95")]
        typer.echo(f"{row['place']:<14}{cells[0]:>10}{cells[1]:>18}{cells[2]:>10}")
    typer.echo(SIMULATED)


def _deviation(value: object, *, share: bool, length: bool) -> str:
    number = float(str(value))
    if share:
        return f"{100 * number:.2f} %"
    return f"{1e3 * number:.3f} mm" if length else f"{number:.4f}"
