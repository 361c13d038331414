"""The commands `turnout limit` and `turnout plan-test`: detectable objects, and a day of tests."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turnout.cli.options import (
    FIGURE,
    File,
    PanelOptions,
    WorkersOption,
    gives,
    option,
)
from turnout.cli.output import Output, note, refuse, resumable, table
from turnout.cli.watch import cores, watched

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

    from turnout.core.progress import Pace
    from turnout.core.workers import Workers
    from turnout.detection.limit.bands import Member
    from turnout.detection.limit.day_plan import Candidates, Knowledge
    from turnout.detection.limit.what_if import Measure, Repeat
    from turnout.detection.reference import Conditions
    from turnout.detection.throws import Throws
    from turnout.panel.load import LoadedPanel

TEXTS = {
    "sound": "sound throws",
    "floor": "gaps",
    "objects": "throws with objects",
    "ends": "end positions",
    "readings": "readings of sensors",
    "readings-sound": "readings without an object",
}
END_STATES = 40
"""States thrown with objects at sensors and drives, at most."""


@gives("limit", quiet=True, out=File("--out -o FILE.nc", "Write the map (netCDF)."), plot=FIGURE)
def limit_command(
    output: Output,
    panel: PanelOptions,
    channels: str = option(
        "--channels NAME",
        "force, current, power (of drives that are machines) or all.",
        default="force",
    ),
    discrepancy: float = option(
        "--discrepancy SHARE", "Of model and switch, share of the peak force [-].", default=0.05
    ),
    machine_discrepancy: float = option(
        "--machine-discrepancy SHARE",
        "Of current and power for a given force, share of their peak [-].",
        default=0.02,
    ),
    far: float = option("--far RATE", "False-alarm rate, alarms a sound throw.", default=1e-3),
    history: int = option("--history N", "Sound throws known of the switch.", default=0),
    kernel: str = option(
        "--kernel NAME", "Of the discrepancy: exponential or 'matern 3/2'.", default="exponential"
    ),
    states: int = option(
        "--states N", "States thrown with objects at each place.", default=200, min=10
    ),
    sound: int = option("--sound N", "Sound throws of the population.", default=1500, min=100),
    rate: float = option("--rate HZ", "Samples a second of the recorder.", default=125.0),
    quick: bool = option(
        "--quick", "Estimate within minutes: at most 400 sound throws, two sizes at each place."
    ),
    panels: str | None = option(
        "--panels STUDY|DIR",
        "Bands over panels instead: those of a folder, or the scenarios of a study.",
    ),
    most: int | None = option("--most N", "Of --panels: so many of them, evenly chosen.", min=1),
    over_travel: bool = option(
        "--over-travel", "Bands over a closing over-travel of 0 to 5 mm instead."
    ),
    kind: str = option(
        "--kind NAME", "Of the objects, such as ice; an unknown one lists all.", default="spring"
    ),
    known_place: bool = option(
        "--known-place", "Add the bound of a detector that knows the place, but not size and state."
    ),
    ends: bool = option("--ends", "Add the end position: which gaps at sensors and drives show."),
    what_if: list[str] | None = option(
        "--what-if MEASURE",
        "Add what a measure gains: 'second throw', 'history 20', 'discrepancy 3 %', 'rate 1000 "
        "Hz', 'friction 0.2', 'closing force', 'position sensor at 3.6 m', 'contact sensor at "
        "3.6 m', 'force sensor at 3.6 m', 'drive at 3.6 m'. Repeatable.",
    ),
    advise: bool = option(
        "--advise", "Rank all these measures; sensors and drive where a90 is largest."
    ),
    folder: Path = option(
        "--folder DIR",
        "Keeps the throws; run the same command to continue.",
        default=Path("limit-throws"),
    ),
    workers: WorkersOption = 0,
) -> None:
    """Show the smallest object that the drive forces can reveal at each place, by any method."""
    from turnout.detection.limit.added_equipment import read_measures
    from turnout.detection.limit.bands import limit_bands
    from turnout.detection.limit.end_positions import end_position_map, throw_ends
    from turnout.detection.limit.limit_map import limit_map, too_few_sound
    from turnout.detection.limit.what_if import FORMS, check_measures
    from turnout.detection.throws import QUICK_SOUND, check_kind, closing_time, steps_of, throw_all

    conditions = conditions_of_options(
        discrepancy=discrepancy, machine_discrepancy=machine_discrepancy, false_alarm_rate=far,
        history=history, kernel=kernel, rate=rate,
    )  # fmt: skip
    check_kind(kind)
    measures = list(dict.fromkeys([*(what_if or []), *(FORMS if advise else ())]))
    check_measures(measures)
    given, quiet = panel.given(), output.quiet
    steps, least = steps_of(quick=quick), min(sound, QUICK_SOUND) if quick else sound
    if panels is not None or over_travel:
        _of_one_panel({"--known-place": known_place, "--ends": ends, "--what-if": bool(measures)})
        members = _members(panels, given, over_travel=over_travel, most=most)
        with _throwing(workers, quiet=quiet) as (processes, pace):
            bands = limit_bands(
                members, folder, conditions,
                states=states, sound=least, steps=steps, channels=channels, kind=kind,
                workers=processes, pace=pace,
            )  # fmt: skip
        write_bands(bands, output)
        return
    _check_population(given, channels, measures, quiet=quiet)
    closing = closing_time(given)
    with _throwing(workers, quiet=quiet) as (processes, pace):
        throws = throw_all(
            given, folder,
            sound=max(least, states), states=states, channels=channels, steps=steps, kind=kind,
            workers=processes, pace=pace,
        )  # fmt: skip
        _warn([too_few_sound(throws, closing=closing)], quiet=quiet)
        if ends:
            own = throw_ends(
                given, folder, throws,
                states=min(states, END_STATES), workers=processes, pace=pace,
            )  # fmt: skip
        read = read_measures(
            measures, given, folder, throws, conditions,
            advise=advise, steps=steps, workers=processes, pace=pace,
        )  # fmt: skip
    found = limit_map(throws, conditions, closing=closing)
    if known_place:
        known = _known_place(throws, conditions, closing, quiet=quiet)
        found = found.merge(known, combine_attrs="no_conflicts")
    if ends:
        positions = end_position_map(throws, own, conditions, closing=closing)
        found = found.merge(positions, combine_attrs="no_conflicts")
    advice = _advice(throws, conditions, read, closing) if read else None
    write_map(found, advice, output)


@contextmanager
def _throwing(workers: int, *, quiet: bool) -> "Iterator[tuple[Workers, Pace]]":
    """Give processes for all throws of the command, and what counts them."""
    from turnout.core.progress import Pace
    from turnout.study.sweep.run import sweep_workers

    with (
        resumable("the same command continues with the throws in --folder"),
        watched("throws", texts=TEXTS, quiet=quiet) as watch,
        sweep_workers(workers or cores()) as processes,
    ):
        yield processes, Pace(watch.sweep)


def conditions_of_options(**values: float | int | str) -> "Conditions":
    """Return conditions; refuse meaningless values by option, warn about an exact model."""
    from types import SimpleNamespace

    from turnout.core.errors import StudyError
    from turnout.detection.conditions import condition_faults
    from turnout.detection.reference import Conditions

    faults = condition_faults(SimpleNamespace(**values))
    if faults:
        names = {name: name.replace("_", "-") for name in faults} | {"false_alarm_rate": "far"}
        listed = [f"--{names[name]} {given}: {text}" for name, (given, text) in faults.items()]
        raise StudyError(listed, source="options")
    if values.get("discrepancy") == 0.0:
        note("--discrepancy 0: no model is exact; the result is far too good")
    return Conditions(**values)  # type: ignore[arg-type]


def _check_population(
    panel: "LoadedPanel | None", channels: str, measures: "Sequence[str]", *, quiet: bool
) -> None:
    """Refuse channels and measures that a panel cannot have; print remarks on its population."""
    from turnout.detection.drive_quantities import signals_of
    from turnout.detection.limit.added_equipment import check_equipment
    from turnout.detection.reference import reference_study

    population = reference_study(panel, count=1)
    signals_of(population.panel, channels)
    check_equipment(measures, population.panel)
    _warn(population.remarks, quiet=quiet)


def _warn(remarks: "Sequence[str]", *, quiet: bool) -> None:
    for remark in () if quiet else filter(None, remarks):
        note(remark)


def _advice(
    throws: "Throws", conditions: "Conditions", measures: "list[Measure]", closing: float
) -> "tuple[xr.Dataset, Repeat]":
    """Return the gains of the measures, and the false alarms of a second throw."""
    from turnout.detection.limit.what_if import gains, repeated_throw

    ranked = gains(throws, conditions, measures, closing=closing)
    return ranked, repeated_throw(throws, conditions, closing=closing)


def _members(
    panels: str | None, given: "LoadedPanel | None", *, over_travel: bool, most: int | None
) -> "list[Member]":
    """Return the panels that bands are wanted for."""
    from turnout.detection.limit.bands import over_travels, panels_of

    if panels is None:
        if most is not None:
            refuse("--most: chooses among the panels of --panels; leave it out")
        return over_travels(given)
    if over_travel or given is not None:
        refuse("--panels: takes its panels from there alone; leave PANEL and --over-travel out")
    return panels_of(panels, most=most)


def _of_one_panel(options: "Mapping[str, bool]") -> None:
    wanted = [name for name, given in options.items() if given]
    if wanted:
        refuse(f"{', '.join(wanted)}: of one panel only; leave out --panels and --over-travel")


def _known_place(
    throws: "Throws", conditions: "Conditions", closing: float, *, quiet: bool
) -> "xr.Dataset":
    from turnout.detection.limit.known_place_map import known_place_map

    with watched("bound at known places", quiet=quiet) as watch:
        return known_place_map(throws, conditions, closing=closing, report=watch.report)


LENGTHS = dict.fromkeys(
    (
        *("x", "touch_floor", "largest_size", "a90", "a90_low", "a90_high"),
        *("gap_limit", "revealed_gap"),
        *(name + end for name in ("gain", "gain_worst") for end in ("", "_low", "_high")),
        *("known_a90", "known_a90_low", "known_a90_high"),
    ),
    "m",
)
BANDS = {
    f"a90_{band}{end}": "m"
    for band in ("low", "middle", "high")
    for end in ("", "_interval_low", "_interval_high")
}


def write_bands(found: "xr.Dataset", output: Output) -> None:
    """Write files first, then print."""
    from turnout.detection.conditions import SIMULATED
    from turnout.detection.limit.bands import band_rows
    from turnout.figures.limit import plot_bands

    output.dataset(output["out"], found)
    output.figure(output["plot"], plot_bands, found)
    rows, panels = band_rows(found), found["panel"].to_numpy().tolist()
    output.json(lambda: {"panels": panels, "bands": rows}, units=LENGTHS | BANDS)
    output.show(
        f"a90 [mm] of the bound over {found.sizes['panel']} panels; in brackets the 95 % "
        f"interval over {found.attrs['states']} drawn states; {SIMULATED}"
    )
    bands = ("low", "middle", "high")
    cells = ([row["place"], *(_with_ends(row, f"a90_{band}") for band in bands)] for row in rows)
    output.lines(table({"place": -12, "5 %": 24, "middle": 28, "95 %": 28}, cells))


def _with_ends(row: "Mapping[str, float | str | None]", name: str) -> str:
    """Return a length and its interval in millimetres; one word where all is beyond."""
    low, high = (_millimetres(row[f"{name}_interval_{end}"]) for end in ("low", "high"))
    value = _millimetres(row[name])
    return value if value == low == high == BEYOND else f"{value} ({low} ... {high})"


def write_map(
    found: "xr.Dataset", advice: "tuple[xr.Dataset, Repeat] | None", output: Output
) -> None:
    """Write files first, then print."""
    from turnout.detection.limit.end_positions import end_rows
    from turnout.detection.limit.known_place_map import known_rows
    from turnout.detection.limit.limit_map import rows_of
    from turnout.detection.limit.what_if import gain_rows
    from turnout.figures.limit import plot_limit

    output.dataset(output["out"], found)
    output.figure(output["plot"], plot_limit, found)
    places = rows_of(found)
    known = known_rows(found) if "known_pod" in found else None
    ends = end_rows(found) if "end_pod" in found else None
    gained = gain_rows(advice[0]) if advice else None
    output.json(
        lambda: {
            "conditions": found.attrs,
            "places": places,
            "known_place": known,
            "end_positions": ends,
            "measures": gained,
            "second_throw": advice[1] if advice else None,
        },
        units=LENGTHS,
    )
    output.lines(_map_lines(found, places))
    if known is not None:
        output.lines(_known_lines(known, draws=int(found.attrs["known_draws"])))
    if ends is not None:
        output.lines(_end_lines(ends))
    if advice and gained is not None:
        output.lines(_advice_lines(gained, advice[1]))


def _map_lines(
    found: "xr.Dataset", rows: "Sequence[Mapping[str, float | str | None]]"
) -> "Iterator[str]":
    from turnout.detection.conditions import SIMULATED

    said = found.attrs
    yield (
        f"{said['quantities'].capitalize()} of the drives: smallest size that the bound detects "
        f"in 90 % of {said['states']} states "
        f"(discrepancy {100 * said['discrepancy']:g} %, {said['history']} sound throws known, "
        f"false-alarm rate {said['false_alarm_rate']:g}, objects: {said['object_kind']}); "
        f"optimistic: place and size are known; {SIMULATED}"
    )
    alone = [str(name) for name in found["channel"].to_numpy()[1:]]
    columns = {"place": -12, "x [m]": 7, "touch floor": 13, "a90 [mm]": 10, "95 %": 18}
    columns |= {f"{name} alone": 16 for name in alone}
    yield from table(
        columns,
        (
            [row["place"], f"{row['x']:.2f}", _millimetres(row["touch_floor"])]
            + _interval(row, "a90")
            + [_millimetres(row[f"a90, {name}"]) for name in alone]
            for row in rows
        ),
    )


def _interval(row: "Mapping[str, float | str | None]", name: str) -> list[str]:
    """Return a length and its interval, both in millimetres."""
    value, low, high = (_millimetres(row[name + end]) for end in ("", "_low", "_high"))
    return [value, f"{low} ... {high}"]


BEYOND = "beyond"
"""Text for a length above all sizes that were thrown."""


def _millimetres(value: object) -> str:
    return f"{1e3 * value:.1f}" if isinstance(value, float) else BEYOND


def _known_lines(
    rows: "Sequence[Mapping[str, float | str | None]]", *, draws: int
) -> "Iterator[str]":
    yield (
        f"\nif the place is known, size and state not ({draws} sound throws drawn): the limit lies "
        "between the two"
    )
    cells = ([row["place"], *_interval(row, "known_a90")] for row in rows)
    yield from table({"place": -12, "a90 [mm]": 10, "95 %": 18}, cells)


def _end_lines(rows: "Sequence[Mapping[str, float | str | None]]") -> "Iterator[str]":
    yield (
        f"\nend position: {'at':<10}{'limit [mm]':>11}{'shown at limit':>16}"
        f"{'shown in 90 % from [mm]':>25}  by"
    )
    for row in rows:
        limit, share = row["gap_limit"], row["end_pod_at_limit"]
        assert isinstance(limit, float)
        assert isinstance(share, float)
        yield (
            f"{'':<14}{row['position']:<10}{1e3 * limit:>11.1f}{100 * share:>14.1f} %"
            f"{_millimetres(row['revealed_gap']):>25}  {row['channel']}"
        )


def _advice_lines(rows: "Sequence[Mapping[str, float | str]]", repeat: "Repeat") -> "Iterator[str]":
    yield (
        f"\n{'measure':<26}{'gain of a90 [mm]':>17}{'95 %':>16}{'worst place [mm]':>18}{'95 %':>16}"
        "  meaning"
    )
    for row in rows:
        text = f"{row['measure']:<26}"
        for name, width in (("gain", 17), ("gain_worst", 18)):
            value, low, high = (1e3 * float(row[name + end]) for end in ("", "_low", "_high"))
            text += f"{value:>{width}.2f}{f'{low:.2f} ... {high:.2f}':>16}"
        yield f"{text}  {row['note']}"
    yield (
        f"false alarms a switch and year: {repeat.once_a_year:.3g}; {repeat.twice_a_year:.2g} if a "
        f"second throw must confirm (correlation {repeat.correlation:.2f}: independent throws "
        "would square the rate)"
    )


@gives("plan-test", quiet=True, out=File("--out -o FILE.csv", "Write the plan."))
def plan_test_command(
    output: Output,
    panel: PanelOptions,
    throws: int = option("--throws N", "Throws of the day.", default=60, min=1),
    discrepancy: float = option(
        "--discrepancy SHARE", "Of model and switch, share of the peak force.", default=0.05
    ),
    workers: WorkersOption = 0,
) -> None:
    """Plan a day of tests: objects, places and order that determine the switch and a90 best."""
    from turnout.core.progress import Pace
    from turnout.detection.limit.day_plan import candidates, full_grid, known_after, ordered, plan

    conditions = conditions_of_options(discrepancy=discrepancy)
    given, quiet = panel.given(), output.quiet
    with watched("simulating the throws to choose from", quiet=quiet) as watch:
        found = candidates(
            given, conditions=conditions, workers=workers or cores(), pace=Pace(watch.sweep)
        )
    with watched("choosing throws", quiet=quiet) as watch:
        chosen = ordered(found, plan(found, throws, report=watch.report))
    grid = full_grid(found)
    known, of_grid = known_after(found, chosen), known_after(found, grid)
    rows = [
        {"throw": number, "place": found.place[row], "size": float(found.size[row]),
         "slips": bool(found.slips[row])}
        for number, row in enumerate(chosen, 1)
    ]  # fmt: skip
    lines = ["throw,place,size [mm],slips"]
    lines += [
        f"{row['throw']},{row['place']},{1e3 * float(str(row['size'])):g},"
        f"{'yes' if row['slips'] else 'no'}"
        for row in rows
    ]
    output.write(output["out"], "\n".join(lines) + "\n")
    parameters, places = _parameter_rows(found, known, of_grid), _place_rows(known, of_grid)
    output.json(
        lambda: {
            "throws": len(chosen),
            "grid_throws": len(grid),
            "plan": rows,
            "parameters": parameters,
            "places": places,
        },
        units=dict.fromkeys(("size", "a90", "a90_95", "grid_a90_95"), "m"),
    )
    output.lines(_order_lines(found, chosen), _gain_lines(parameters, places, grid=len(grid)))


def _parameter_rows(
    found: "Candidates", known: "Knowledge", of_grid: "Knowledge"
) -> list[dict[str, Any]]:
    return [
        {"parameter": item.name, "before": item.deviation, "is_share": item.share,
         "after": item.deviation * float(after), "after_grid": item.deviation * float(grid)}
        for item, after, grid in zip(
            found.parameters, known.deviations, of_grid.deviations, strict=True
        )
    ]  # fmt: skip


def _place_rows(known: "Knowledge", of_grid: "Knowledge") -> list[dict[str, Any]]:
    return [
        {"place": place, "a90": size, "a90_95": high, "grid_a90_95": of_grid.a90[place][1]}
        for place, (size, high) in known.a90.items()
    ]


def _order_lines(found: "Candidates", chosen: list[int]) -> "Iterator[str]":
    """Yield the throws of a day, place by place."""
    from itertools import groupby

    yield f"{len(chosen)} throws, in this order (* a drive slips):"
    for place, rows in groupby(chosen, key=lambda row: found.place[row]):
        sizes = [f"{1e3 * found.size[row]:g}{'*' if found.slips[row] else ''}" for row in rows]
        what = f"{len(sizes)} sound" if place == "none" else ", ".join(sizes) + " mm"
        yield f"  {'no object' if place == 'none' else place:<12}{what}"


def _gain_lines(
    parameters: list[dict[str, Any]], places: list[dict[str, Any]], *, grid: int
) -> "Iterator[str]":
    """Yield deviations of parameters and bounds after a day of tests, beside those of a grid."""
    from turnout.detection.conditions import SIMULATED

    wide = max(34, *(len(row["parameter"]) + 1 for row in parameters))
    columns = {"standard deviation of": -wide, "before": 10, "this day": 10, f"grid of {grid}": 14}
    yield ""
    yield from table(
        columns,
        (
            [row["parameter"], *(_deviation(row, key) for key in ("before", "after", "after_grid"))]
            for row in parameters
        ),
    )
    yield ""
    yield from table(
        {"bound at": -14, "a90 [mm]": 10, "a90/95, this day": 18, "grid": 10},
        (
            [row["place"], *(f"{1e3 * row[key]:.1f}" for key in ("a90", "a90_95", "grid_a90_95"))]
            for row in places
        ),
    )
    yield SIMULATED


def _deviation(row: "Mapping[str, Any]", key: str) -> str:
    number = float(row[key])
    if row["is_share"]:
        return f"{100 * number:.2f} %"
    return f"{1e3 * number:.3f} mm" if "travel" in row["parameter"] else f"{number:.4f}"
