"""The command `turnout limit`: what can be seen of a trapped object from the drives, and where."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import (
    FIGURES,
    CalibrationOption,
    FigureOption,
    PanelArgument,
    QuietOption,
    SetOption,
    check_outputs,
    write_and_report,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import xarray as xr

    from turnout.detection.limit_bands import Member
    from turnout.detection.reference import Conditions
    from turnout.detection.throws import Throws
    from turnout.detection.what_if import Measure, Repeat
    from turnout.panel.load import LoadedPanel
    from turnout.sweep.run import SweepProgress

LENGTHS = dict.fromkeys(
    (
        *("x", "touch_floor", "largest_size", "a90", "a90_low", "a90_high"),
        *("gap_limit", "revealed_gap", "gain", "gain_worst"),
        *("known_a90", "known_a90_low", "known_a90_high"),
    ),
    "m",
)
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


def limit_command(
    panel: PanelArgument = None,
    calibration: CalibrationOption = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    channels: Annotated[
        str,
        typer.Option(
            "--channels",
            metavar="NAME",
            help="force, current, power (of drives that are machines) or all.",
        ),
    ] = "force",
    discrepancy: Annotated[
        float,
        typer.Option(
            "--discrepancy",
            metavar="SHARE",
            help="Of model and switch, share of the peak force [-].",
        ),
    ] = 0.05,
    far: Annotated[
        float, typer.Option("--far", metavar="RATE", help="False-alarm rate, alarms a sound throw.")
    ] = 1e-3,
    history: Annotated[
        int, typer.Option("--history", metavar="N", help="Sound throws known of the switch.")
    ] = 0,
    kernel: Annotated[
        str,
        typer.Option(
            "--kernel", metavar="NAME", help="Of the discrepancy: exponential or 'matern 3/2'."
        ),
    ] = "exponential",
    states: Annotated[
        int,
        typer.Option(
            "--states", metavar="N", min=10, help="States thrown with objects at each place."
        ),
    ] = 200,
    sound: Annotated[
        int, typer.Option("--sound", metavar="N", min=400, help="Sound throws of the population.")
    ] = 1500,
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Samples a second of the recorder.")
    ] = 125.0,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Estimate within minutes: 400 sound throws, and two sizes at each place.",
        ),
    ] = False,
    panels: Annotated[
        str | None,
        typer.Option(
            "--panels",
            metavar="STUDY|DIR",
            help="Bands over panels instead: those of a folder, or the scenarios of a study.",
        ),
    ] = None,
    over_travel: Annotated[
        bool,
        typer.Option(
            "--over-travel", help="Bands over a closing over-travel of 0 to 5 mm instead."
        ),
    ] = False,
    known_place: Annotated[
        bool,
        typer.Option(
            "--known-place",
            help="Add the bound of a detector that knows the place, but not size and state.",
        ),
    ] = False,
    ends: Annotated[
        bool,
        typer.Option("--ends", help="Add the end position: which gaps at sensors and drives show."),
    ] = False,
    what_if: Annotated[
        list[str] | None,
        typer.Option(
            "--what-if",
            metavar="MEASURE",
            help="Add what a measure gains: 'second throw', 'history 20', 'discrepancy 3 %', "
            "'rate 1000 Hz', 'friction 0.2', 'closing force', 'position sensor at 3.6 m', "
            "'contact sensor at 3.6 m', 'force sensor at 3.6 m', 'drive at 3.6 m'. Repeatable.",
        ),
    ] = None,
    advise: Annotated[
        bool,
        typer.Option(
            "--advise", help="Rank all these measures; sensors and drive where a90 is largest."
        ),
    ] = False,
    folder: Annotated[
        Path,
        typer.Option(
            "--folder", metavar="DIR", help="Keeps the throws; run the same command to continue."
        ),
    ] = Path("limit-throws"),
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE.nc", help="Write the map (netCDF).")
    ] = None,
    plot: FigureOption = None,
    as_json: JsonOption = False,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=0, help="Processes; default one a core.")
    ] = 0,
    quiet: QuietOption = False,
) -> None:
    """Show the smallest object that the drive forces can reveal at each place, by any method."""
    check_outputs({"--out": out, "--plot": plot}, {"--out": (".nc",), "--plot": FIGURES})
    from turnout.cli.options import opened_panel
    from turnout.cli.sweep import cores
    from turnout.detection.added_equipment import check_equipment, read_measures
    from turnout.detection.drive_quantities import signals_of
    from turnout.detection.end_positions import end_position_map, throw_ends
    from turnout.detection.limit import limit_map
    from turnout.detection.limit_bands import limit_bands
    from turnout.detection.reference import Conditions, reference_study
    from turnout.detection.throws import QUICK_SOUND, QUICK_STEPS, STEPS, closing_time, throw_all
    from turnout.detection.what_if import FORMS, check_measures

    conditions = Conditions(
        discrepancy=discrepancy, false_alarm_rate=far, history=history, kernel=kernel, rate=rate
    )
    measures = list(dict.fromkeys([*(what_if or []), *(FORMS if advise else ())]))
    check_measures(measures)
    _warn_of_exact_models(discrepancy)
    given = None
    if panel is not None or calibration is not None or settings:
        given = opened_panel(panel, settings, calibration)
    watch, count = _watching(quiet=quiet), workers or cores()
    steps, least = (QUICK_STEPS, QUICK_SOUND) if quick else (STEPS, sound)
    if panels is not None or over_travel:
        _of_one_panel({"--known-place": known_place, "--ends": ends, "--what-if": bool(measures)})
        members = _members(panels, given, over_travel=over_travel)
        bands = limit_bands(
            members, folder, conditions,
            states=states, sound=least, steps=steps, channels=channels, workers=count,
            report=lambda name, sweep: watch(sweep, f"{name}, "),
        )  # fmt: skip
        _write_bands(bands, out=out, plot=plot, as_json=as_json, quiet=quiet)
        return
    thrown = reference_study(given, count=1).panel
    signals_of(thrown, channels)
    check_equipment(measures, thrown)
    throws = throw_all(
        given, folder,
        sound=max(least, states), states=states, channels=channels, steps=steps,
        workers=count, report=watch,
    )  # fmt: skip
    closing = closing_time(given)
    found = limit_map(throws, conditions, closing=closing)
    if known_place:
        more = _known_place(throws, conditions, closing, quiet=quiet)
        found = found.merge(more, combine_attrs="no_conflicts")
    if ends:
        own = throw_ends(
            given, folder, throws,
            states=min(states, END_STATES), workers=count, report=watch("ends"),
        )  # fmt: skip
        more = end_position_map(throws, own, conditions, closing=closing)
        found = found.merge(more, combine_attrs="no_conflicts")
    read = read_measures(
        measures, given, folder, throws, conditions, advise=advise, workers=count, report=watch
    )
    advice = _advice(throws, conditions, read, closing) if read else None
    _write(found, advice, out=out, plot=plot, as_json=as_json, quiet=quiet)


def _warn_of_exact_models(discrepancy: float) -> None:
    if discrepancy == 0.0:
        text = "--discrepancy 0: no model is exact; the result is far too good"
        typer.echo(f"turnout: {text}", err=True)


def _advice(
    throws: "Throws", conditions: "Conditions", measures: "list[Measure]", closing: float
) -> "tuple[xr.Dataset, Repeat]":
    """Return what the measures gain, and the false alarms of a second throw."""
    from turnout.detection.what_if import gains, repeated_throw

    ranked = gains(throws, conditions, measures, closing=closing)
    return ranked, repeated_throw(throws, conditions, closing=closing)


def _members(
    panels: str | None, given: "LoadedPanel | None", *, over_travel: bool
) -> "list[Member]":
    """Return the panels that bands are wanted for."""
    from turnout.detection.limit_bands import over_travels, panels_of
    from turnout.errors import FileError

    if panels is None:
        return over_travels(given)
    if over_travel or given is not None:
        message = "--panels: takes its panels from there alone; leave PANEL and --over-travel out"
        raise FileError(message)
    return panels_of(panels)


def _of_one_panel(options: "Mapping[str, bool]") -> None:
    from turnout.errors import FileError

    wanted = [name for name, given in options.items() if given]
    if wanted:
        message = f"{', '.join(wanted)}: of one panel only; leave out --panels and --over-travel"
        raise FileError(message)


def _write_bands(
    found: "xr.Dataset", *, out: Path | None, plot: Path | None, as_json: bool, quiet: bool
) -> None:
    """Write files first, then print."""
    from turnout.detection.limit_bands import band_rows

    still = quiet or as_json
    if out is not None:
        from turnout.response.store import response_bytes

        write_and_report(out, response_bytes(found), quiet=still)
    if plot is not None:
        from turnout.plot.limit import plot_bands
        from turnout.plot.style import rendered

        write_and_report(plot, rendered(plot_bands(found), plot.suffix), quiet=still)
    rows = band_rows(found)
    if as_json:
        record = {"panels": found["panel"].to_numpy().tolist(), "bands": rows}
        written = [path for path in (out, plot) if path is not None]
        print_json("limit", record, units=LENGTHS | {"a90_middle": "m"}, written=written)
    elif not quiet:
        typer.echo(
            f"a90 [mm] of the bound over {found.sizes['panel']} panels\n"
            f"{'place':<12}{'5 %':>8}{'middle':>8}{'95 %':>8}"
        )
        for row in rows:
            cells = [_millimetres(row[name]) for name in ("a90_low", "a90_middle", "a90_high")]
            typer.echo(f"{row['place']:<12}" + "".join(f"{cell:>8}" for cell in cells))


def _known_place(
    throws: "Throws", conditions: "Conditions", closing: float, *, quiet: bool
) -> "xr.Dataset":
    from turnout.cli.watch import watched
    from turnout.detection.known_place_map import known_place_map

    with watched("bound at known places", quiet=quiet) as watch:
        return known_place_map(throws, conditions, closing=closing, report=watch.report)


def _write(
    found: "xr.Dataset",
    advice: "tuple[xr.Dataset, Repeat] | None",
    *,
    out: Path | None,
    plot: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write files first, then print."""
    from turnout.detection.end_positions import end_rows
    from turnout.detection.known_place_map import known_rows
    from turnout.detection.limit import rows_of
    from turnout.detection.what_if import gain_rows

    still = quiet or as_json
    if out is not None:
        from turnout.response.store import response_bytes

        write_and_report(out, response_bytes(found), quiet=still)
    if plot is not None:
        from turnout.plot.limit import plot_limit
        from turnout.plot.style import rendered

        write_and_report(plot, rendered(plot_limit(found), plot.suffix), quiet=still)
    if as_json:
        record = {
            "conditions": _plain(found.attrs),
            "places": rows_of(found),
            "known_place": known_rows(found) if "known_pod" in found else None,
            "end_positions": end_rows(found) if "end_pod" in found else None,
            "measures": gain_rows(advice[0]) if advice else None,
            "second_throw": advice[1] if advice else None,
        }
        written = [path for path in (out, plot) if path is not None]
        print_json("limit", record, units=LENGTHS, written=written)
    elif not quiet:
        _print(found)
        if "known_pod" in found:
            _print_known(known_rows(found), draws=int(found.attrs["known_draws"]))
        if "end_pod" in found:
            _print_ends(end_rows(found))
        if advice:
            _print_advice(gain_rows(advice[0]), advice[1])


def _watching(*, quiet: bool) -> "Callable[..., Callable[[SweepProgress], None]]":
    """Return what makes a watch for each sweep; a finished one takes its bar off the screen."""
    from turnout.cli.sweep import SweepWatch

    shown: list[SweepWatch] = []

    def watch(name: str, of: str = "") -> "Callable[[SweepProgress], None]":
        for before in shown:
            before.__exit__()
        shown[:] = [SweepWatch(of + TEXTS[name], quiet=quiet).__enter__()]

        def report(state: "SweepProgress") -> None:
            shown[0].report(state)
            if state.done == state.total:
                shown[0].__exit__()

        return report

    return watch


def _plain(attributes: "dict[str, object]") -> "dict[str, object]":
    return {
        name: value.tolist() if hasattr(value, "tolist") else value
        for name, value in attributes.items()
    }


def _print(found: "xr.Dataset") -> None:
    from turnout.detection.limit import rows_of

    said = found.attrs
    typer.echo(
        f"{said['quantities'].capitalize()} of the drives: smallest size that the bound detects "
        f"in 90 % of {said['states']} states "
        f"(discrepancy {100 * said['discrepancy']:g} %, {said['history']} sound throws known, "
        f"false-alarm rate {said['false_alarm_rate']:g}); optimistic: place and size are known"
    )
    channels = [str(name) for name in found["channel"].to_numpy()]
    others = "".join(f"{name + ' alone':>16}" for name in channels[1:])
    typer.echo(f"{'place':<12}{'x [m]':>7}{'touch floor':>13}{'a90 [mm]':>10}{'95 %':>15}{others}")
    for row in rows_of(found):
        cells = [_millimetres(row[name]) for name in ("a90", "a90_low", "a90_high")]
        more = "".join(f"{_millimetres(row[f'a90, {name}']):>16}" for name in channels[1:])
        typer.echo(
            f"{row['place']:<12}{row['x']:>7.2f}{_millimetres(row['touch_floor']):>13}"
            f"{cells[0]:>10}{cells[1] + ' ... ' + cells[2]:>15}{more}"
        )


def _millimetres(value: object) -> str:
    return f"{1e3 * value:.1f}" if isinstance(value, float) else "beyond"


def _print_known(rows: "list[dict[str, float | str | None]]", *, draws: int) -> None:
    typer.echo(
        f"\nif the place is known, size and state not ({draws} sound throws drawn): the limit lies "
        "between the two"
    )
    typer.echo(f"{'place':<12}{'a90 [mm]':>10}{'95 %':>15}")
    for row in rows:
        cells = [_millimetres(row[f"known_a90{end}"]) for end in ("", "_low", "_high")]
        typer.echo(f"{row['place']:<12}{cells[0]:>10}{cells[1] + ' ... ' + cells[2]:>15}")


def _print_ends(rows: "list[Mapping[str, float | str | None]]") -> None:
    typer.echo(
        f"\nend position: {'at':<10}{'limit [mm]':>11}{'shown at limit':>16}"
        f"{'shown in 90 % from [mm]':>25}  by"
    )
    for row in rows:
        limit, share = row["gap_limit"], row["end_pod_at_limit"]
        assert isinstance(limit, float)
        assert isinstance(share, float)
        typer.echo(
            f"{'':<14}{row['position']:<10}{1e3 * limit:>11.1f}{100 * share:>14.1f} %"
            f"{_millimetres(row['revealed_gap']):>25}  {row['channel']}"
        )


def _print_advice(rows: "list[Mapping[str, float | str]]", repeat: "Repeat") -> None:
    typer.echo(f"\n{'measure':<18}{'gain of a90 [mm]':>17}{'worst place [mm]':>18}  meaning")
    for row in rows:
        gain, worst = float(row["gain"]), float(row["gain_worst"])
        typer.echo(f"{row['measure']:<18}{1e3 * gain:>17.2f}{1e3 * worst:>18.2f}  {row['note']}")
    typer.echo(
        f"false alarms a switch and year: {repeat.once_a_year:.3g}; {repeat.twice_a_year:.2g} if a "
        f"second throw must confirm (correlation {repeat.correlation:.2f}: independent throws "
        "would square the rate)"
    )
