"""The command `turnout gauge`: track gauge beside a closed rail, at rest and under a wheel."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, cast

import typer

from turnout.cli.options import (
    DATASET,
    FIGURE,
    PanelOptions,
    collect_errors,
    gives,
    option,
    read_texts,
)
from turnout.cli.output import FINDINGS, INCOMPLETE, Output, coloured, note
from turnout.core.errors import SolverError
from turnout.core.files import user_path
from turnout.core.library import names_a_file

if TYPE_CHECKING:
    import xarray as xr

    from turnout.metric.least_gauge import LeastGauges
    from turnout.panel.gauge_limits import GaugeLimits
    from turnout.panel.load import LoadedPanel
    from turnout.throw.wheel import Course

GAUGE_UNITS = {
    **{"lateral": "N", "vertical": "N", "at_rest": "m", "at_wheel": "m", "under_wheel": "m"},
    **{"wheel": "m", "roll": "rad", "gauge_nominal": "m", "gauge_limit": "m", "least": "m"},
    **{"up_to": "m/s", "narrowing": "m"},
}
HEADING = f"{'Y [kN]':>8}{'Q [kN]':>8}  {'gauge at the wheel [mm]':<28}least under the wheel [mm]"


@gives("gauge", quiet=True, width=16, out=DATASET, plot=FIGURE)
def gauge_command(
    output: Output,
    panel: PanelOptions,
    objects: list[str] = option(
        "--object SIZE@PLACE", "Foreign object, such as 13mm@sleeper6. Repeatable.", default=[]
    ),
    lateral: list[str] = option(
        "--lateral FORCE",
        "Flange force Y on the rail, towards its stock rail. Repeatable.",
        default=["5 kN", "10 kN", "20 kN", "40 kN"],
    ),
    vertical: list[str] = option(
        "--vertical FORCE",
        "Vertical force Q of the wheel on the rail. Repeatable.",
        default=["0 kN", "50 kN"],
    ),
    rail: str | None = option(
        "--rail NAME",
        "The closed switch rail, so the route. Default that of the object, else the instrumented "
        "one.",
        show_default=False,
    ),
    course: str = option(
        "--course COURSE",
        "facing: the wheel rolls from the toe; trailing: to it",
        default="facing",
    ),
    step: str = option(
        "--step LENGTH", "Largest distance between places of the wheel.", default="0.3 m"
    ),
    offset: str = option(
        "--offset LENGTH",
        "Place of Q from the running edge, towards the stock rail.",
        default="0 mm",
    ),
    limits: str | None = option(
        "--limits NAME",
        "Limits by line speed: of the library, or a file (.toml). Default those of the panel.",
        show_default=False,
    ),
    strict: bool = option("--strict", "Exit code 1 if the gauge is narrower than allowed."),
) -> None:
    """Show the track gauge beside a closed rail, at rest and under a wheel that rolls along it."""
    from turnout.calibration.load_study import case_name, shown_name
    from turnout.metric.least_gauge import least_gauges
    from turnout.panel.foreign_object import parse_objects
    from turnout.panel.gauge_limits import limits_of, load_gauge_limits

    loaded, foreign, classes, forces, lengths = collect_errors(
        panel.opened,
        lambda: parse_objects(objects),
        lambda: None if limits is None else load_gauge_limits(limits),
        lambda: [_forces("--lateral", lateral), _forces("--vertical", vertical)],
        lambda: read_texts({"--step": step, "--offset": offset}, _length),
    )
    from turnout.figures.gauge import plot_gauge
    from turnout.throw.wheel import gauge_under_wheel

    try:
        dataset = gauge_under_wheel(
            _judged_by(loaded, limits, classes),
            lateral=forces[0],
            vertical=forces[1],
            foreign_object=foreign,
            rail=rail,
            step=lengths["--step"],
            course=cast("Course", course),
            offset=lengths["--offset"],
        )
    except SolverError as error:
        note(str(error))
        raise typer.Exit(INCOMPLETE) from None
    found, classes = least_gauges(dataset), classes or limits_of(dataset.attrs)
    name = shown_name(loaded, panel.panel)
    dataset.attrs["title"] = dataset.attrs["title"].replace(loaded.name, name)
    output.lines(gauge_lines(dataset, found, classes, name=name))
    output.dataset(output["out"], dataset)
    output.figure(output["plot"], plot_gauge, dataset)
    case = case_name(panel.panel)
    output.json(gauge_record, dataset, found, classes, case, units=GAUGE_UNITS)
    if strict and _least(found) < float(dataset.attrs["gauge_limit"]):
        raise typer.Exit(FINDINGS)


def _judged_by(
    panel: "LoadedPanel", named: str | None, limits: "GaugeLimits | None"
) -> "LoadedPanel":
    """Return a panel judged by the limits that are named, if any: by the class of its line speed.

    Without a line speed a gauge is too narrow where no class allows it at any speed.
    """
    if panel.gauge is None or named is None or limits is None:
        return panel
    source = str(user_path(named).resolve()) if names_a_file(named) else named
    changes: dict[str, Any] = {"gauge.limits": source}
    if panel.gauge.line_speed is None:
        changes["gauge.limit"] = max(item.narrowing for item in limits.classes)
    return panel.with_overrides(changes)


def _length(_: str, text: str) -> float:
    from turnout.core.units import LENGTH, parse_quantity

    return parse_quantity(text, LENGTH)


def _forces(option: str, texts: Sequence[str]) -> list[float]:
    """Return forces of a command line [N]; refuse all that are none, or negative, at once."""
    from turnout.core.units import FORCE, parse_quantity

    def read(_: str, text: str) -> float:
        value = parse_quantity(text, FORCE)
        if value < 0.0:
            towards = "towards the stock rail" if option == "--lateral" else "downwards"
            message = f"a force {towards} must be at least 0"
            raise ValueError(message)
        return value

    return [read_texts({option: text}, read)[option] for text in texts]


def _least(found: "Sequence[LeastGauges]") -> float:
    """Return the least gauge of all loads [m]."""
    return min(item.least for item in found)


def gauge_lines(
    dataset: "xr.Dataset", found: "Sequence[LeastGauges]", limits: "GaugeLimits", *, name: str
) -> Iterator[str]:
    """Yield the least gauges for each load, and their limits, under the name of the panel."""
    attributes, first = dataset.attrs, found[0]
    yield f"{'panel':<16}{name}, rail {attributes['rail']} closed"
    yield f"{'at rest':<16}{1e3 * first.at_rest:.1f} mm at {first.rest_place}"
    yield HEADING
    for item in found:
        wheel = f"{1e3 * item.at_wheel:.1f} at {item.wheel_place}"
        yield (
            f"{1e-3 * item.lateral:>8g}{1e-3 * item.vertical:>8g}  {wheel:<28}"
            f"{1e3 * item.under_wheel:.1f} {item.where}"
        )
    slipping = {name for item in found for name in item.slipping}
    if slipping:
        reach = "reaches its" if len(slipping) == 1 else "reach their"
        text = f"drive {' and '.join(sorted(slipping))} {reach} saturation force under the wheel"
        yield f"{'drives':<16}{text}"
    if attributes["friction_remark"]:
        yield f"{'friction':<16}{attributes['friction_remark']}"
    least, limit = _least(found), float(attributes["gauge_limit"])
    if limit == limit:
        text = f"at least {1e3 * limit:g} mm required"
        narrow = least < limit
        text = f"TOO NARROW: {1e3 * least:.1f} mm, {text}" if narrow else text
        yield f"{'limit':<16}{coloured(text, 'bad') if narrow else text}"
    nominal = float(attributes["gauge_nominal"])
    speed = 3.6 * limits.highest_speed(nominal - least)
    allowed = f"up to {speed:.0f} km/h" if speed else "allowed at no speed"
    classes = ", ".join(
        f"{1e3 * (nominal - item.narrowing):g} mm up to {3.6 * item.up_to:.0f} km/h"
        for item in limits.classes
    )
    yield f"{'speed':<16}{allowed}, by {limits.name}: {classes}"


def gauge_record(
    dataset: "xr.Dataset",
    found: "Sequence[LeastGauges]",
    limits: "GaugeLimits",
    case: str | None = None,
) -> dict[str, Any]:
    """Return the least gauges for each load as plain data, in SI; `case` of a study, if any."""
    attributes = dataset.attrs
    least = _least(found)
    return {
        "case": case,
        **{name: attributes[name] for name in ("panel", "panel_hash", "rail", "course")},
        **{name: attributes[name] for name in ("gauge_nominal", "gauge_limit")},
        "least": least,
        "loads": [asdict(item) for item in found],
        "friction_remark": attributes["friction_remark"] or None,
        "limits": {"name": limits.name, "classes": [c.model_dump() for c in limits.classes]},
        "up_to": limits.highest_speed(attributes["gauge_nominal"] - least) or None,
    }
