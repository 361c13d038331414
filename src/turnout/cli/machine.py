"""The commands `turnout machine ...`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.campaign import OutsideOption, opened_campaign
from turnout.cli.options import (
    FIGURES,
    File,
    TogetherOption,
    argument,
    first_sentence,
    gives,
    option,
)
from turnout.cli.output import INCOMPLETE, Output, note, picked, print_library, refuse
from turnout.core.errors import SolverError

if TYPE_CHECKING:
    from turnout.calibration.machine_estimates.current_fit import Estimate
    from turnout.calibration.machine_estimates.force_anchor import ForceAnchor
    from turnout.calibration.machine_estimates.machine_fit import DriveFit, MachineFit
    from turnout.core.units import Dimension
    from turnout.machine.machine_file import LoadedMachines
    from turnout.throw.machine import MachineThrow

FINAL_CURRENT_WINDOW = 0.1
"""Before the cut-off, over which last current and power are averaged [s]."""
THROW_UNITS = {
    **{"time": "s", "energised_time": "s", "current_peak": "A", "current_peak_time": "s"},
    **{"current_mean": "A", "current_last": "A", "power_mean": "W", "power_last": "W"},
    **{"rod_force_max": "N", "rod_force_end": "N", "rod_position_end": "m"},
    **{"rail_position_end": "m", "clutch_slip": "rad", "energies": "J"},
}

app = typer.Typer(
    help="Point machines: list, show, run one on a one-mass rail, fit to measured currents.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
RECORDING = File(
    "--out -o FILE", "File to write (.csv, .mat or .h5).", (".csv", ".mat", ".h5"), ...
)
MachineArgument = Annotated[str, argument("MACHINE", "Library machine, or path of a file (.toml).")]
MachineSetOption = Annotated[
    list[str],
    option(
        "--set KEY=VALUE",
        "Change a value, with its unit: supply.voltage='176 V', rail.object_size='13 mm'. "
        "Repeatable.",
        default=...,
    ),
]


@app.command("list")
@gives("machine list")
def machine_list_command(output: Output) -> None:
    """List the library machines."""
    from turnout.machine.machine_file import load_machines, machine_names

    found = {name: first_sentence(load_machines(name).description) for name in machine_names()}
    print_library(output, "machines", found)


@app.command("show", short_help="Show every value with its origin, and operating points.")
@gives("machine show")
def machine_show_command(
    output: Output,
    machine: MachineArgument,
    settings: MachineSetOption = [],  # noqa: B006 - typer copies it
    toml: bool = option("--toml", "Print the file of a library machine, as a template."),
) -> None:
    """Show every value of a machine with its origin, and its steady operating points."""
    from turnout.machine.machine_file import load_machines, machine_text

    if toml:
        if settings:
            refuse("--toml prints the file as the library has it; leave out --set, or --toml")
        typer.echo(machine_text(machine), nl=False)
        return
    loaded = load_machines(machine).with_settings(settings)
    record = machine_record(loaded)
    output.lines(machine_lines(loaded, record))
    output.json(lambda: record)


@app.command("run", short_help="Simulate a machine throwing a one-mass rail.")
@gives(
    "machine run",
    width=16,
    out=File("--out -o FILE.nc", "Write the histories (netCDF)."),
    plot=File("--plot FILE", "Draw them (.png, .pdf or .svg).", FIGURES),
)
def machine_run_command(
    output: Output,
    machine: MachineArgument,
    settings: MachineSetOption = [],  # noqa: B006 - typer copies it
) -> None:
    """Simulate a machine throwing a one-mass rail: current, force, events, energy."""
    from turnout.machine.machine_file import load_machines
    from turnout.throw.compilation import WITH_MACHINES, must_compile
    from turnout.throw.machine import machine_dataset, throw_one_mass

    loaded = load_machines(machine).with_settings(settings)
    if must_compile(WITH_MACHINES):
        note("compiling kernels, first run only (about half a minute)")
    try:
        throw = throw_one_mass(loaded)
    except SolverError as error:
        note(str(error))
        raise typer.Exit(INCOMPLETE) from None
    record = throw_summary(throw)
    output.show(*throw_lines(throw, record), *_notes(loaded, throw))
    if output["out"] or output["plot"]:
        from turnout.figures.machine import plot_machine

        dataset = machine_dataset(throw)
        output.dataset(output["out"], dataset)
        output.figure(output["plot"], plot_machine, dataset)
    output.json(lambda: record, units=THROW_UNITS)


def machine_record(loaded: "LoadedMachines") -> dict[str, Any]:
    """Return every value of a machine with its unit and origin."""
    rows = []
    for key, value in _values(loaded):
        source = loaded.origin_text(key)
        rows.append({"key": key, "value": value, "unit": loaded.unit_of(key), "origin": source})
    return {"name": loaded.name, "description": loaded.description, "values": rows}


def machine_lines(loaded: "LoadedMachines", record: Mapping[str, Any]) -> Iterator[str]:
    """Yield the values of a machine as its record has them, and its operating points."""
    from turnout.core.problems import show_value
    from turnout.machine.steady import steady_lines

    yield f"{loaded.name}: {loaded.description}"
    for row in record["values"]:
        value = show_value(row["value"])
        yield f"  {row['key']:<44}{value:>16} {row['unit']:<12}{row['origin']}"
    for name, machine in loaded.machine.items():
        yield from (f"steady, {name}", *steady_lines(machine))


def _values(loaded: "LoadedMachines") -> list[tuple[str, Any]]:
    """Return keys and values that count: not those left out, nor defaults of another motor."""
    spare = {
        f"machine.{name}.{key}"
        for name, machine in loaded.machine.items()
        for key in machine.motor.of_kind.meaningless
        if loaded.origin_text(f"machine.{name}.{key}") == "default"
    }
    values = loaded.model_dump(exclude={"schema_version", "name", "description"})
    leaves = _leaves("", values)
    return [(k, v) for k, v in leaves if v is not None and v != "" and k not in spare]


def _leaves(prefix: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, dict):
        return [
            leaf
            for key, item in value.items()
            for leaf in _leaves(f"{prefix}.{key}" if prefix else key, item)
        ]
    return [(prefix, value)]


def throw_summary(throw: "MachineThrow") -> dict[str, Any]:
    """Return the record that `turnout machine run --json` prints."""
    import numpy as np

    current, force = np.abs(throw["lead_current"]), throw["rod_force"]
    energies = {name: throw[name] for name in throw.histories if name.startswith("energy_")}
    own_names = throw.kind.energy_names
    finite = throw.energised_time == throw.energised_time
    span = throw.last_energised
    last = (
        span & (throw.time > throw.time[span].max() - FINAL_CURRENT_WINDOW) if span.any() else span
    )
    means = {
        "current_mean": (current, span),
        "current_last": (current, last),
        "power_mean": (throw["power"], span),
        "power_last": (throw["power"], last),
    }
    return {
        "machine": throw.name,
        "outcome": throw.outcome,
        "events": [{"time": time, "event": text} for time, text in throw.events],
        "energised_time": throw.energised_time if finite else None,
        "current_peak": float(current.max()),
        "current_peak_time": float(throw.time[current.argmax()]),
        **{
            name: float(values[inside].mean()) if inside.any() else None
            for name, (values, inside) in means.items()
        },
        "rod_force_max": float(force.max()),
        "rod_force_end": float(force[-1]),
        "rod_position_end": float(throw["rod_position"][-1]),
        "rail_position_end": float(throw["rail_position"][-1]),
        "clutch_slip": float(throw["clutch_slip"][-1]),
        "energies": {
            own_names.get(name, name): float(values[-1]) for name, values in energies.items()
        },
        "energy_residual": throw.energy_residual,
        "halved_steps": throw.halved,
    }


def _notes(loaded: "LoadedMachines", throw: "MachineThrow") -> list[str]:
    """Return notes of the machine's record on its currents and on a phase lost too late."""
    from turnout.machine.steady import blind_text

    machine = loaded.machine[throw.name]
    lost, blind = machine.supply.phase_lost_at, blind_text(machine)
    lines = [f"{'note':<16}{blind}"] if blind else []
    if lost is not None and lost > throw.time[-1]:
        lines.append(f"{'note':<16}supply.phase_lost_at = {lost:g} s is after the end: no effect")
    return lines


def throw_lines(throw: "MachineThrow", found: Mapping[str, Any]) -> list[str]:
    """Return a throw, and what its summary says, as the lines of `turnout machine run`."""
    events = ", ".join(f"{text} {time:.4f} s" for time, text in throw.events)
    switched = found["energised_time"]
    seconds = f", energised {switched:.4f} s" if switched is not None else ""
    energies = {key.removeprefix("energy_"): value for key, value in found["energies"].items()}
    rms = " rms" if throw.kind.alternating else ""
    means, power = "", []
    if found["current_mean"] is not None:
        last = f"over the last {FINAL_CURRENT_WINDOW} s"
        means = f", mean {found['current_mean']:.4f} A, {found['current_last']:.4f} A {last}"
        text = f"mean {found['power_mean']:.1f} W, {found['power_last']:.1f} W {last}"
        power = [f"active power    {text}"]
    shown = [f"{key} {value:.4g}" for key, value in energies.items() if abs(value) >= 5e-4]
    return [
        f"outcome         {throw.outcome}{seconds}",
        f"events          {events}",
        f"current         peak {found['current_peak']:.4f} A{rms} at "
        f"{found['current_peak_time']:.3f} s{means}",
        *power,
        f"rod force       at most {found['rod_force_max']:.1f} N, at the end "
        f"{found['rod_force_end']:.1f} N",
        f"positions       rod {found['rod_position_end'] * 1e3:.4f} mm, rail "
        f"{found['rail_position_end'] * 1e3:.4f} mm at the end",
        f"clutch          slipped {found['clutch_slip']:.3f} rad",
        f"energy, J       {', '.join(shown)}",
        f"energy residual {throw.energy_residual:.1e}, halved steps {throw.halved}",
    ]


@app.command("monitor", short_help="Sample a throw as a monitoring system in service stores it.")
@gives("machine monitor", quiet=True, out=RECORDING)
def monitor_command(
    output: Output,
    run: Path = argument("RUN", "Result of a throw whose drives are machines."),
    rate: str = option(
        "--rate RATE",
        "Values a second, usually 25 to 100 Hz; or 'zyj7', 'switchmonitor'.",
        default="50 Hz",
    ),
    together: TogetherOption = [],  # noqa: B006 - typer copies it
    current_step: str | None = option(
        "--current-step CURRENT",
        "Resolution, default 0.01 A or that of the system; '0 A' for none.",
    ),
    power_step: str | None = option(
        "--power-step POWER", "Resolution, default 1 W or that of the system; '0 W' for none."
    ),
) -> None:
    """Sample currents (RMS) and powers (mean) of a throw over windows, in coarse steps.

    The file is a recording: `turnout import` shows it.
    """
    from turnout.measurement.chain.monitoring import (
        monitored,
        monitoring_of,
        monitoring_recording,
    )
    from turnout.measurement.formats.file_format import write_recording
    from turnout.throw.store import open_response

    chosen = monitoring_of(
        rate=rate, together=together, current_step=current_step, power_step=power_step
    )
    stored = monitored(open_response(run), chosen)
    recording = monitoring_recording(stored, source=f"monitoring of {run.name}, simulated")
    size = stored.sizes["time"]
    output.show(f"{size} values at {chosen.rate:g} Hz", heading="sampled")
    found = [
        {"name": name, "unit": channel.unit, "largest": float(channel.values.max())}
        for name, channel in recording.channels.items()
    ]
    output.rows("", (f"{row['name']}: at most {row['largest']:g} {row['unit']}" for row in found))
    output.save(output["out"], lambda path: write_recording(recording, path))
    output.json(
        lambda: {"rate": chosen.rate, "samples": size, "channels": found}, units={"rate": "1/s"}
    )


FIT_UNITS = {
    **{"idle": "A", "slope": "A/N", "slope_driven_back": "A/N", "slip": "A", "current": "A"},
    **{"held": "N", "lag": "s", "lag_coil": "s", "rms": "A", "reference": "N", "energised": "s"},
    **{"per_movement": "A", "current_mean": "A", "current_most": "A"},
    **{"force_mean": "N", "force_most": "N"},
}


@app.command("fit", short_help="Identify machines from the currents of a campaign.")
@gives("machine fit", quiet=True)
def fit_command(
    output: Output,
    source: Path = argument("CAMPAIGN", "Folder of a campaign, or its dataset (.nc)."),
    series_motor: str | None = option(
        "--series-motor CURRENT",
        "The motors are series motors that saturate at this field current ('3 A'); 'none' "
        "without saturation. Default permanent magnet or separate field.",
    ),
    three_phase: str | None = option(
        "--three-phase VOLTAGE",
        "The motors are three-phase, rated for this voltage between lines ('380 V'): fit voltage, "
        "current and power of their throws, of which one may be missing.",
    ),
    to_neutral: bool = option("--to-neutral", "Recorded voltages are those of a phase."),
    free: list[str] = option(
        "--free MOVEMENT", "Movement with the rod off, of three-phase motors. Repeat.", default=[]
    ),
    idle: list[str] = option(
        "--idle DRIVE=CURRENT",
        "Current with the rod taken off, such as 1='0.8 A'; for the two anchors below.",
        default=[],
    ),
    clutch_force: list[str] = option(
        "--clutch-force DRIVE=FORCE+-DEVIATION",
        "Anchor: force at which the clutch slips, by a gauge: 1='6.0 kN +- 0.2 kN'.",
        default=[],
    ),
    sister: list[str] = option(
        "--sister DRIVE=RISE+-SPREAD",
        "Anchor: rise of the current of a machine of this type, and its spread from machine to "
        "machine: 1='0.21 A/kN +- 0.02 A/kN'. Of series motors with the force up to which it "
        "was taken, and the sister's idle current if it differs: 1='0.21 A/kN +- 0.02 A/kN to "
        "4 kN from 0.9 A'.",
        default=[],
    ),
    allow_outside: OutsideOption = False,
) -> None:
    """Identify machines from the currents of a campaign, per drive and direction.

    Idle current and amperes per kN where forces are measured too, slip current where a clutch
    slipped, with 95 % intervals, and whether clutches change over the movements. Forces from
    currents need an anchor: measured forces, --clutch-force or --sister. Of three-phase motors
    slopes of the current with voltage and load, line and stator resistance, saturation and losses.
    """
    from turnout.core.units import CURRENT, CURRENT_PER_FORCE, FORCE, VOLTAGE

    problems: list[str] = []
    saturated = None if series_motor is None or series_motor.strip() == "none" else series_motor
    saturation = _positive(saturated, problems, "--series-motor", CURRENT)
    series = series_motor is not None
    idles = _of_drives("--idle", idle, {"idle": CURRENT}, problems)
    known = {"force": FORCE, "deviation": FORCE}
    gauges = _of_drives("--clutch-force", clutch_force, known, problems)
    known = {"slope": CURRENT_PER_FORCE, "spread": CURRENT_PER_FORCE}
    known |= {"reference": FORCE, "idle": CURRENT}
    sisters = _of_drives("--sister", sister, known, problems)
    problems += [
        f"--sister drive {name}: the current of a series motor does not rise straight; add the "
        "force up to which the rise was taken, such as ' to 4 kN'"
        for name, given in sisters.items()
        if series and "reference" not in given
    ]
    for name in {*gauges, *sisters} - set(idles):
        problems.append(
            f"drive {name} has an anchor but no --idle {name}='...': the current with the rod off"
        )
    if three_phase is None and (to_neutral or free):
        problems.append("--to-neutral and --free are of three-phase motors: give --three-phase")
    if three_phase is not None and (series or idle or clutch_force or sister):
        problems.append("--three-phase takes no --series-motor, --idle, --clutch-force or --sister")
    rated = _positive(three_phase, problems, "--three-phase", VOLTAGE)
    if problems:
        from turnout.core.errors import MachineError

        raise MachineError(problems, source="options")
    dataset = opened_campaign(source, None, allow_outside=allow_outside, quiet=output.silent)
    if three_phase is not None:
        from turnout.calibration.machine_estimates.three_phase import fit_three_phase
        from turnout.cli.three_phase import (
            THREE_PHASE_UNITS,
            three_phase_lines,
            three_phase_record,
        )

        fits = fit_three_phase(dataset, rated_voltage=rated, to_neutral=to_neutral, free=free)
        for text in str(dataset.attrs.get("unbalanced", "")).splitlines():
            note(text)
        output.show(*three_phase_lines(fits))
        output.json(three_phase_record, fits, units=THREE_PHASE_UNITS)
        return
    from turnout.calibration.machine_estimates.force_anchor import Gauge, Sister
    from turnout.calibration.machine_estimates.machine_fit import fit_machines

    fit = fit_machines(
        dataset,
        saturation_current=saturation if series else None,
        idle={name: given["idle"] for name, given in idles.items()},
        gauges={name: Gauge(**given) for name, given in gauges.items()},
        sisters={name: Sister(**given) for name, given in sisters.items()},
    )
    output.show(*fit_lines(fit))
    output.json(fit_record, fit, units=FIT_UNITS)


def _positive(text: str | None, problems: list[str], option: str, dimension: "Dimension") -> float:
    """Return the value of an option, infinity without it; collect its faults."""
    from turnout.core.units import parse_quantity

    if text is None:
        return math.inf
    try:
        found = parse_quantity(text, dimension)
        if found <= 0.0:
            raise ValueError(f"must be more than 0 {dimension.unit}")  # noqa: EM102, TRY301
    except ValueError as error:
        problems.append(f"{option} '{text}': {error}")
        return math.inf
    return found


SIGNS = {"deviation": "+-", "spread": "+-", "reference": " to ", "idle": " from "}
"""Between the quantities of a drive, before each but the first."""


def _of_drives(
    option: str, texts: Sequence[str], known: Mapping[str, "Dimension"], problems: list[str]
) -> dict[str, dict[str, float]]:
    """Return the quantities of an option by drive and name; collect its faults.

    `known` has the dimensions of its quantities; the first, and deviation and spread, must be
    given.
    """
    from turnout.core.units import parse_quantity

    (first, dimension), *later = known.items()
    needed = [name for name, _ in later if SIGNS[name] == "+-"]
    found: dict[str, dict[str, float]] = {}
    for text in texts:
        drive, _, rest = text.replace("±", "+-").partition("=")
        parts = dict[str, str]()
        for name, _ in reversed(later):
            rest, sign, part = rest.partition(SIGNS[name])
            parts |= {name: part} if sign else {}
        parts[first] = rest
        if not drive.strip() or not rest.strip() or not parts.keys() >= {*needed}:
            form = f"DRIVE='{dimension.example}{' +- ...' if needed else ''}'"
            problems.append(f'{option} "{text}": must be {form}, with unit and deviation')
            continue
        if drive.strip() in found:
            problems.append(f'{option} "{text}": drive {drive.strip()} has one already')
            continue
        try:
            found[drive.strip()] = {
                name: parse_quantity(part.strip(), known[name]) for name, part in parts.items()
            }
        except ValueError as error:
            problems.append(f'{option} "{text}": {error}')
    return found


def fit_record(fit: "MachineFit") -> dict[str, Any]:
    """Return the record that `turnout machine fit --json` prints."""
    return {
        "drives": [_drive_record(item) for item in fit.drives],
        "three_phase": [],
        "not_separated": list(fit.not_separated),
    }


def _drive_record(item: "DriveFit") -> dict[str, Any]:
    from turnout.calibration.machine_estimates.current_fit import LoadLine

    line = item.line if isinstance(item.line, LoadLine) else None
    fields = ("idle", "slope", "slope_driven_back", "lag", "lag_coil", "rms", "reference")
    clutch = None
    if item.trend is not None:
        clutch = {"per_movement": item.trend.per_throw, **picked(item.trend, "share", "changes")}
    return {
        **picked(item, "drive", "direction", "movements", "slip", "held", "energised", "anchor"),
        **picked(line, *fields),
        "reason": None if line else item.line.reason,  # type: ignore[union-attr]
        "slip_movements": [
            {"movement": level.name, **picked(level, "current", "held")} for level in item.levels
        ],
        "clutch": clutch,
        "usage": [
            {"current_mean": one.mean, "current_most": one.most}
            | picked(one, "movement", "force_mean", "force_most")
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
    from turnout.calibration.machine_estimates.current_fit import LoadLine

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
