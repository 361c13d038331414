"""The commands `turnout machine ...`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.machine_fit import fit_command
from turnout.cli.machine_monitor import monitor_command
from turnout.cli.options import FIGURES, argument, check_outputs, first_sentence, option
from turnout.cli.output import INCOMPLETE, JsonOption, Output, note, print_library, refuse
from turnout.core.errors import SolverError

if TYPE_CHECKING:
    from turnout.machine.machine_file import LoadedMachines
    from turnout.machine.one_mass_throw import MachineThrow

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
MachineArgument = Annotated[str, argument("MACHINE", "Library machine, or path of a file (.toml).")]
MachineSetOption = Annotated[
    list[str],
    option(
        "--set KEY=VALUE",
        "Change a value, with its unit: supply.voltage='176 V', rail.object_size='13 mm'. "
        "Repeatable.",
    ),
]


@app.command("list")
def machine_list_command(as_json: JsonOption = False) -> None:
    """List the library machines."""
    from turnout.machine.machine_file import load_machines, machine_names

    found = {name: first_sentence(load_machines(name).description) for name in machine_names()}
    print_library("machine list", "machines", found, as_json=as_json)


@app.command("show", short_help="Show every value with its origin, and operating points.")
def machine_show_command(
    machine: MachineArgument,
    settings: MachineSetOption = [],  # noqa: B006 - typer copies it
    toml: Annotated[
        bool, option("--toml", "Print the file of a library machine, as a template.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show every value of a machine with its origin, and its steady operating points."""
    from turnout.machine.machine_file import load_machines, machine_text

    if toml:
        if settings:
            refuse("--toml prints the file as the library has it; leave out --set, or --toml")
        typer.echo(machine_text(machine), nl=False)
        return
    loaded = load_machines(machine).with_settings(settings)
    output = Output("machine show", as_json=as_json)
    output.show(*machine_lines(loaded))
    if as_json:
        output.json(machine_record(loaded))


@app.command("run", short_help="Simulate a machine throwing a one-mass rail.")
def machine_run_command(
    machine: MachineArgument,
    settings: MachineSetOption = [],  # noqa: B006 - typer copies it
    out: Annotated[Path | None, option("--out -o FILE.nc", "Write the histories (netCDF).")] = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw them (.png, .pdf or .svg).")] = None,
    as_json: JsonOption = False,
) -> None:
    """Simulate a machine throwing a one-mass rail: current, force, events, energy."""
    check_outputs({"--out": out, "--plot": plot}, {"--out": (".nc",), "--plot": FIGURES})
    from turnout.machine.compute.circuit import throw as kernel
    from turnout.machine.machine_file import load_machines
    from turnout.machine.one_mass_throw import throw_one_mass
    from turnout.throw.compilation import must_compile

    loaded = load_machines(machine).with_settings(settings)
    if must_compile(kernel):
        note("compiling kernels, first run only (5 to 20 s)")
    try:
        throw = throw_one_mass(loaded)
    except SolverError as error:
        note(str(error))
        raise typer.Exit(INCOMPLETE) from None
    output = Output("machine run", as_json=as_json, width=16)
    output.show(*throw_lines(throw), *_notes(loaded, throw))
    if out is not None or plot is not None:
        from turnout.figures.machine import plot_machine
        from turnout.throw.machine import machine_dataset

        dataset = machine_dataset(throw)
        output.dataset(out, dataset)
        output.figure(plot, lambda: plot_machine(dataset))
    if as_json:
        output.json(throw_summary(throw), units=THROW_UNITS)
    if not throw.is_balanced:
        raise typer.Exit(INCOMPLETE)


app.command("monitor", short_help="Sample a throw as a monitoring system in service stores it.")(
    monitor_command
)
app.command("fit", short_help="Identify machines from the currents of a campaign.")(fit_command)


def machine_record(loaded: "LoadedMachines") -> dict[str, Any]:
    """Return every value of a machine with its unit and origin."""
    rows = []
    for key, value in _values(loaded):
        source = loaded.origin_text(key)
        rows.append({"key": key, "value": value, "unit": loaded.unit_of(key), "origin": source})
    return {"name": loaded.name, "description": loaded.description, "values": rows}


def machine_lines(loaded: "LoadedMachines") -> list[str]:
    """Return the lines of `turnout machine show`."""
    from turnout.machine.steady import steady_lines

    lines = [f"{loaded.name}: {loaded.description}"]
    for key, value in _values(loaded):
        source = loaded.origin_text(key)
        lines.append(f"  {key:<44}{_shown(value):>16} {loaded.unit_of(key):<12}{source}")
    for name, machine in loaded.machine.items():
        lines += [f"steady, {name}", *steady_lines(machine)]
    return lines


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


def _shown(value: Any) -> str:
    from turnout.core.problems import show_value

    return show_value(value)


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


def throw_lines(throw: "MachineThrow") -> list[str]:
    """Return the lines of `turnout machine run`."""
    found = throw_summary(throw)
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
