"""The command `turnout limit`: detectable trapped objects by place, from the drives."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.json_output import JsonOption
from turnout.cli.options import (
    FIGURES,
    CalibrationOption,
    FigureOption,
    PanelArgument,
    QuietOption,
    SetOption,
    check_outputs,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import xarray as xr

    from turnout.detection.limit.bands import Member
    from turnout.detection.limit.what_if import Measure, Repeat
    from turnout.detection.reference import Conditions
    from turnout.detection.throws import Throws
    from turnout.panel.load import LoadedPanel
    from turnout.study.sweep.run import SweepProgress

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
    machine_discrepancy: Annotated[
        float,
        typer.Option(
            "--machine-discrepancy",
            metavar="SHARE",
            help="Of current and power for a given force, share of their peak [-].",
        ),
    ] = 0.02,
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
        int, typer.Option("--sound", metavar="N", min=100, help="Sound throws of the population.")
    ] = 1500,
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Samples a second of the recorder.")
    ] = 125.0,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Estimate within minutes: at most 400 sound throws, two sizes at each place.",
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
    most: Annotated[
        int | None,
        typer.Option(
            "--most", metavar="N", min=1, help="Of --panels: so many of them, evenly chosen."
        ),
    ] = None,
    over_travel: Annotated[
        bool,
        typer.Option(
            "--over-travel", help="Bands over a closing over-travel of 0 to 5 mm instead."
        ),
    ] = False,
    kind: Annotated[
        str,
        typer.Option(
            "--kind", metavar="NAME", help="Of the objects, such as ice; an unknown one lists all."
        ),
    ] = "spring",
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
    from turnout.cli.limit_output import write_bands, write_map
    from turnout.cli.sweep import cores
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
    given = _given(panel, settings, calibration)
    watch, count = _watching(quiet=quiet), workers or cores()
    steps, least = steps_of(quick=quick), min(sound, QUICK_SOUND) if quick else sound
    if panels is not None or over_travel:
        _of_one_panel({"--known-place": known_place, "--ends": ends, "--what-if": bool(measures)})
        members = _members(panels, given, over_travel=over_travel, most=most)
        bands = limit_bands(
            members, folder, conditions,
            states=states, sound=least, steps=steps, channels=channels, kind=kind, workers=count,
            report=lambda name, sweep: watch(sweep, f"{name}, "),
        )  # fmt: skip
        write_bands(bands, out=out, plot=plot, as_json=as_json, quiet=quiet)
        return
    _check_population(given, channels, measures, quiet=quiet)
    throws = throw_all(
        given, folder,
        sound=max(least, states), states=states, channels=channels, steps=steps, kind=kind,
        workers=count, report=watch,
    )  # fmt: skip
    closing = closing_time(given)
    _warn([too_few_sound(throws, closing=closing)], quiet=quiet)
    found = limit_map(throws, conditions, closing=closing)
    if known_place:
        known = _known_place(throws, conditions, closing, quiet=quiet)
        found = found.merge(known, combine_attrs="no_conflicts")
    if ends:
        own = throw_ends(
            given, folder, throws,
            states=min(states, END_STATES), workers=count, report=watch("ends"),
        )  # fmt: skip
        positions = end_position_map(throws, own, conditions, closing=closing)
        found = found.merge(positions, combine_attrs="no_conflicts")
    read = read_measures(
        measures, given, folder, throws, conditions,
        advise=advise, steps=steps, workers=count, report=watch,
    )  # fmt: skip
    advice = _advice(throws, conditions, read, closing) if read else None
    write_map(found, advice, out=out, plot=plot, as_json=as_json, quiet=quiet)


OPTIONS = {
    "discrepancy": "--discrepancy",
    "machine_discrepancy": "--machine-discrepancy",
    "false_alarm_rate": "--far",
    "history": "--history",
    "kernel": "--kernel",
    "rate": "--rate",
}
"""Options of the command line, by the field of `Conditions` that they set."""


def conditions_of_options(**values: float | int | str) -> "Conditions":
    """Return conditions; refuse meaningless values by option, warn about an exact model."""
    from types import SimpleNamespace

    from turnout.core.errors import StudyError
    from turnout.detection.conditions import condition_faults
    from turnout.detection.reference import Conditions

    faults = condition_faults(SimpleNamespace(**values))
    if faults:
        listed = [f"{OPTIONS[name]} {given}: {text}" for name, (given, text) in faults.items()]
        raise StudyError(listed, source="options")
    if values.get("discrepancy") == 0.0:
        text = "--discrepancy 0: no model is exact; the result is far too good"
        typer.echo(f"turnout: {text}", err=True)
    return Conditions(**values)  # type: ignore[arg-type]


def _given(
    panel: str | None, settings: list[str], calibration: Path | None
) -> "LoadedPanel | None":
    """Return the panel of the command line, None for that of the reference case."""
    if panel is None and calibration is None and not settings:
        return None
    from turnout.cli.options import opened_panel

    return opened_panel(panel, settings, calibration)


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
        typer.echo(f"turnout: {remark}", err=True)


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
    from turnout.core.errors import FileError
    from turnout.detection.limit.bands import over_travels, panels_of

    if panels is None:
        if most is not None:
            message = "--most: chooses among the panels of --panels; leave it out"
            raise FileError(message)
        return over_travels(given)
    if over_travel or given is not None:
        message = "--panels: takes its panels from there alone; leave PANEL and --over-travel out"
        raise FileError(message)
    return panels_of(panels, most=most)


def _of_one_panel(options: "Mapping[str, bool]") -> None:
    from turnout.core.errors import FileError

    wanted = [name for name, given in options.items() if given]
    if wanted:
        message = f"{', '.join(wanted)}: of one panel only; leave out --panels and --over-travel"
        raise FileError(message)


def _known_place(
    throws: "Throws", conditions: "Conditions", closing: float, *, quiet: bool
) -> "xr.Dataset":
    from turnout.cli.watch import watched
    from turnout.detection.limit.known_place_map import known_place_map

    with watched("bound at known places", quiet=quiet) as watch:
        return known_place_map(throws, conditions, closing=closing, report=watch.report)


def _watching(*, quiet: bool) -> "Callable[..., Callable[[SweepProgress], None]]":
    """Return a maker of one watch per sweep; a finished one takes its bar off the screen."""
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
