"""The command `turnout machine fit`: machines from the currents of a campaign."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from turnout.cli.campaign import OutsideOption, opened_campaign
from turnout.cli.options import QuietOption, argument, option
from turnout.cli.output import JsonOption, Output

if TYPE_CHECKING:
    from turnout.calibration.current_fit import Estimate
    from turnout.calibration.force_anchor import ForceAnchor
    from turnout.calibration.machine_fit import DriveFit, MachineFit
    from turnout.core.units import Dimension

FIT_UNITS = {
    **{"idle": "A", "slope": "A/N", "slope_driven_back": "A/N", "slip": "A", "current": "A"},
    **{"held": "N", "lag": "s", "lag_coil": "s", "rms": "A", "reference": "N", "energised": "s"},
    **{"per_movement": "A", "current_mean": "A", "current_most": "A"},
    **{"force_mean": "N", "force_most": "N"},
}

CampaignArgument = Annotated[
    Path, argument("CAMPAIGN", "Folder of a campaign, or its dataset (.nc).")
]
SeriesOption = Annotated[
    str | None,
    option(
        "--series-motor CURRENT",
        "The motors are series motors that saturate at this field current ('3 A'); 'none' "
        "without saturation. Default permanent magnet or separate field.",
    ),
]
IdleOption = Annotated[
    list[str],
    option(
        "--idle DRIVE=CURRENT",
        "Current with the rod taken off, such as 1='0.8 A'; for the two anchors below.",
    ),
]
GaugeOption = Annotated[
    list[str],
    option(
        "--clutch-force DRIVE=FORCE+-DEVIATION",
        "Anchor: force at which the clutch slips, by a gauge: 1='6.0 kN +- 0.2 kN'.",
    ),
]
SisterOption = Annotated[
    list[str],
    option(
        "--sister DRIVE=RISE+-SPREAD",
        "Anchor: rise of the current of a machine of this type, and its spread from machine to "
        "machine: 1='0.21 A/kN +- 0.02 A/kN'. Of series motors with the force up to which it "
        "was taken, and the sister's idle current if it differs: 1='0.21 A/kN +- 0.02 A/kN to "
        "4 kN from 0.9 A'.",
    ),
]


def fit_command(
    source: CampaignArgument,
    series_motor: SeriesOption = None,
    idle: IdleOption = [],  # noqa: B006 - typer copies it
    clutch_force: GaugeOption = [],  # noqa: B006
    sister: SisterOption = [],  # noqa: B006
    allow_outside: OutsideOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Identify machines from the currents of a campaign, per drive and direction.

    Idle current and amperes per kN where forces are measured too, slip current where a clutch
    slipped, with 95 % intervals, and whether clutches change over the movements. Forces from
    currents need an anchor: measured forces, --clutch-force or --sister.
    """
    from turnout.core.units import CURRENT, CURRENT_PER_FORCE, FORCE

    problems: list[str] = []
    saturation = _saturation(series_motor, problems)
    idles = dict(_pairs("--idle", idle, CURRENT, problems, spread=False))
    gauges = dict(_pairs("--clutch-force", clutch_force, FORCE, problems))
    series = series_motor is not None
    ranges = dict(_ranges(sister, problems, series=series))
    bare = [text.partition(" to ")[0] for text in sister]
    sisters = dict(_pairs("--sister", bare, CURRENT_PER_FORCE, problems))
    for name in {*gauges, *sisters} - set(idles):
        problems.append(
            f"drive {name} has an anchor but no --idle {name}='...': the current with the rod off"
        )
    if problems:
        from turnout.core.errors import MachineError

        raise MachineError(problems, source="options")
    dataset = opened_campaign(source, None, allow_outside=allow_outside, quiet=quiet or as_json)
    from turnout.calibration.machine_fit import Gauge, Sister, fit_machines

    fit = fit_machines(
        dataset,
        kind="series" if series else "linear",
        saturation_current=saturation,
        idle={name: value for name, (value, _) in idles.items()},
        gauges={n: Gauge(force=value, deviation=d) for n, (value, d) in gauges.items()},
        sisters={n: Sister(slope=v, spread=d, **ranges[n]) for n, (v, d) in sisters.items()},
    )
    output = Output("machine fit", as_json=as_json)
    output.show(*fit_lines(fit))
    if as_json:
        output.json(fit_record(fit), units=FIT_UNITS)


def _saturation(text: str | None, problems: list[str]) -> float:
    from turnout.core.units import CURRENT, parse_quantity

    if text is None or text.strip() == "none":
        return math.inf
    try:
        found = parse_quantity(text, CURRENT)
        if found <= 0.0:
            raise ValueError("must be more than 0 A")  # noqa: EM101, TRY301
    except ValueError as error:
        problems.append(f"--series-motor '{text}': {error}")
        return math.inf
    return found


def _pairs(
    option: str,
    texts: Sequence[str],
    dimension: "Dimension",
    problems: list[str],
    *,
    spread: bool = True,
) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield drive, value and deviation of an option; collect its faults."""
    from turnout.core.units import parse_quantity

    form = f"DRIVE='{dimension.example}{' +- ...' if spread else ''}'"
    for text in texts:
        name, equals, rest = text.partition("=")
        value, plus_minus, deviation = rest.replace("±", "+-").partition("+-")
        if not (equals and name.strip()) or bool(plus_minus) != spread:
            problems.append(f'{option} "{text}": must be {form}, with unit and standard deviation')
            continue
        try:
            number = parse_quantity(value.strip(), dimension)
            width = parse_quantity(deviation.strip(), dimension) if spread else 0.0
        except ValueError as error:
            problems.append(f'{option} "{text}": {error}')
            continue
        yield name.strip(), (number, width)


def _ranges(
    texts: Sequence[str], problems: list[str], *, series: bool
) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield of each sister the force up to which its rise was taken, and its idle current."""
    from turnout.core.units import CURRENT, FORCE, parse_quantity

    for text in texts:
        head, to, rest = text.partition(" to ")
        force, from_word, current = rest.partition(" from ")
        given = {}
        if series and not to:
            problems.append(
                f'--sister "{text}": the current of a series motor does not rise straight; add the '
                "force up to which the rise was taken, such as ' to 4 kN'"
            )
        try:
            if to:
                given["reference"] = parse_quantity(force.strip(), FORCE)
            if from_word:
                given["idle"] = parse_quantity(current.strip(), CURRENT)
        except ValueError as error:
            problems.append(f'--sister "{text}": {error}')
        yield head.partition("=")[0].strip(), given


def fit_record(fit: "MachineFit") -> dict[str, Any]:
    """Return the record that `turnout machine fit --json` prints."""
    return {
        "drives": [_drive_record(item) for item in fit.drives],
        "not_separated": list(fit.not_separated),
    }


def _drive_record(item: "DriveFit") -> dict[str, Any]:
    from turnout.calibration.current_fit import LoadLine

    line = item.line if isinstance(item.line, LoadLine) else None
    fields = ("idle", "slope", "slope_driven_back", "lag", "lag_coil", "rms", "reference")
    trend = item.trend
    return {
        "drive": item.drive,
        "direction": item.direction,
        "movements": item.movements,
        **{key: getattr(line, key) if line else None for key in fields},
        "reason": None if line else item.line.reason,  # type: ignore[union-attr]
        "slip": item.slip,
        "held": item.held,
        "slip_movements": [
            {"movement": level.name, "current": level.current, "held": level.held}
            for level in item.levels
        ],
        "clutch": None
        if trend is None
        else {"per_movement": trend.per_throw, "share": trend.share, "changes": trend.changes},
        "energised": item.energised,
        "anchor": item.anchor,
        "usage": [
            {
                "movement": one.movement,
                "current_mean": one.mean,
                "current_most": one.most,
                "force_mean": one.force_mean,
                "force_most": one.force_most,
            }
            for one in item.usage
        ],
    }


def fit_lines(fit: "MachineFit") -> list[str]:
    """Return the lines that `turnout machine fit` prints."""
    lines: list[str] = []
    for item in fit.drives:
        lines.append(f"drive {item.drive}, {item.direction} ({item.movements} movements)")
        lines += [f"  {name:<15}{text}" for name, text in _drive_rows(item)]
    lines.append("not separated by currents")
    return lines + [f"  {text}" for text in fit.not_separated]


def _drive_rows(item: "DriveFit") -> Iterator[tuple[str, str]]:
    from turnout.calibration.current_fit import LoadLine

    if isinstance(item.line, LoadLine):
        yield "idle current", _stated(item.line.idle, "A", 4)
        rise = _stated(item.line.slope, "A/kN", 4, scale=1e3)
        chord = item.anchor.series if item.anchor is not None else None
        yield "rise", rise + (f", from no force to {chord[0] / 1e3:.2f} kN" if chord else "")
        if item.line.slope_driven_back is not None:
            yield "  driven back", _stated(item.line.slope_driven_back, "A/kN", 4, scale=1e3)
    else:
        yield "rise", f"not identified: {item.line.reason}"
    if item.slip is None:
        yield "slip current", "the clutch did not slip"
    else:
        held = f"; the gear holds {item.held / 1e3:.2f} kN" if math.isfinite(item.held) else ""
        yield "slip current", f"{_stated(item.slip, 'A', 4)} in {len(item.levels)} movements{held}"
    if item.trend is not None:
        change = item.trend.share
        text = (
            f"{_stated(change, '%', 2, scale=1e2)} of its torque per movement"
            if change is not None
            else f"{_stated(item.trend.per_throw, 'A', 5)} per movement"
        )
        yield "clutch", f"{'changes' if item.trend.changes else 'no change found'}: {text}"
    if item.energised is not None:
        yield "energised", _stated(item.energised, "s", 3)
    yield "anchor", _anchor_text(item.anchor)
    yield "running", _running_text(item)


def _anchor_text(anchor: "ForceAnchor | None") -> str:
    if anchor is None:
        return "none: currents stay amperes (see --clutch-force, --sister)"
    return (
        f"{anchor.kind}: {1e3 * anchor.slope:.4f} A/kN ± {1e3 * anchor.slope_deviation:.4f}, from "
        f"{anchor.idle:.4f} A"
    )


def _running_text(item: "DriveFit") -> str:
    if not item.usage:
        return "never steadily"
    most = max(item.usage, key=lambda one: one.most)
    force = most.force_most
    newtons = f", {_stated(force, 'kN', 2, scale=1e-3)}" if force is not None else ""
    return f"at most {most.most:.3f} A{newtons} in {most.movement}"


def _stated(estimate: "Estimate", unit: str, digits: int, *, scale: float = 1.0) -> str:
    """Return value and 95 % interval as text."""
    value, low, high = (scale * v for v in (estimate.value, estimate.low, estimate.high))
    return f"{value:.{digits}f} {unit} [{low:.{digits}f}, {high:.{digits}f}]"
