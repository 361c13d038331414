"""Write the results on docs/evidence/machines.md, by functions that the tests call.

    python -m benchmarks.studies.machine_page

replaces what stands below the line "(machine-results)=" on that page, and the tables between the
marks "machine-panels".
"""

import argparse
import time
from collections.abc import Iterator

import numpy as np
import xarray as xr
from tests.verification.machine_panels import (
    default_panel,
    default_run,
    fed_back,
    rms_of_peak,
    solved_default,
)
from tests.verification.machines import (
    PEAK_CURRENT,
    PEAK_TIME,
    bare_motor,
    random_induction_overrides,
    random_overrides,
)
from tests.verification.reference import DATA
from tests.verification.test_drive_machine import sb3_run
from tests.verification.test_machine_coupling import coupled
from tests.verification.test_machine_library import LIMITS, RATED, sheet_of
from tests.verification.test_machine_sb3 import CASES

from benchmarks.page import EVIDENCE, put_section, write_section
from turnout.figures.machine import plot_machine
from turnout.figures.style import rendered
from turnout.machine.machine_file import load_machines
from turnout.machine.steady import slip_point
from turnout.mechanism.drive_machines import fitted_machine
from turnout.throw.machine import MachineThrow, machine_dataset, throw_one_mass

PAGE = EVIDENCE / "machines.md"
CHANNELS = ("current", "speed", "rod_force", "rod_position", "rail_position")


def errors(ours: MachineThrow, name: str) -> list[float]:
    """Return the rms difference of each channel over its peak, in per cent."""
    found = []
    with np.load(DATA / f"sb3_{name}.npz") as theirs:
        for channel in CHANNELS:
            difference = ours[channel][::5] - theirs[channel]
            found.append(100 * np.sqrt(np.mean(difference**2)) / np.abs(theirs[channel]).max())
    return found


def benchmark_lines() -> Iterator[str]:
    """Yield the section on the benchmark SB3."""
    yield "### Benchmark SB3\n"
    yield "Difference from the independent program, rms in % of the peak (tolerance 0.1; 0.02 for"
    yield "positions), by the step; balance: largest residual over the energy turned over. The"
    yield "force differs in the ringing of the rail on its stop once the lock holds; how large it"
    yield "is depends on where within a step the rail was caught, so it falls unevenly.\n"
    head = " | ".join(name.replace("_", " ") for name in CHANNELS)
    yield f"| case | step | {head} | energised | balance | lost by the scheme |"
    yield "|---|--:|" + "--:|" * (len(CHANNELS) + 3)
    for name in ("S1", "S2", "S4"):
        for step in (1e-5, 5e-5, 1e-4, 2.5e-4, 1e-3):
            thrown = throw_one_mass("sb3", overrides=CASES[name] | {"throw.step": step})
            cells = " | ".join(f"{value:.4f}" for value in errors(thrown, name))
            lost = np.abs(thrown["energy_numerical"]).max()
            yield (
                f"| {name} | {step * 1e3:g} ms | {cells} | {thrown.energised_time:.6f} s "
                f"| {thrown.energy_residual:.0e} | {1e3 * lost:.1f} mJ |"
            )
    yield "\nThe cases without a stored answer, at 0.05 ms:\n"
    heads = ("case", "outcome", "energised", "peak current", "force at most, at the end")
    yield f"| {' | '.join(heads)} | slip | balance |"
    yield "|---|---|--:|--:|--:|--:|--:|"
    for name in ("S3", "S5", "S6", "S7"):
        thrown = throw_one_mass("sb3", overrides=CASES[name])
        force = thrown["rod_force"]
        yield (
            f"| {name} | {thrown.outcome} | {thrown.energised_time:.6f} s "
            f"| {np.abs(thrown['current']).max():.4f} A | {force.max():.1f}, {force[-1]:.1f} N "
            f"| {thrown['clutch_slip'][-1]:z.3f} rad | {thrown.energy_residual:.0e} |"
        )


def motor_lines() -> Iterator[str]:
    """Yield the section on the start of a bare motor."""
    yield "\n### Start of a bare motor\n"
    motor = bare_motor(V=220, R=15, L=0.15, k=0.99, J=2e-3)
    timing = {"throw.duration": 0.03, "throw.step": 5e-6, "throw.output_interval": 5e-6}
    thrown = throw_one_mass("sb3", overrides=motor | timing)
    at = thrown["current"].argmax()
    curve = np.polyfit(
        thrown.time[at - 1 : at + 2] - thrown.time[at], thrown["current"][at - 1 : at + 2], 2
    )
    offset = -curve[1] / (2 * curve[0])
    yield (
        f"Peak {np.polyval(curve, offset):.6f} A at {1e3 * (thrown.time[at] + offset):.6f} ms; "
        f"closed form {PEAK_CURRENT:.6f} A at {1e3 * PEAK_TIME:.6f} ms."
    )


SHEET_COLUMNS = (
    *(("running_current", ".3f", "A"), ("shaft_speed", ".1f", "rad/s"), ("power", ".0f", "W")),
    *(("time", ".3f", "s"), ("slip_current", ".3f", "A"), ("peak", ".2f", "A")),
)


def allowed(limits: tuple[float, float] | None, form: str) -> str:
    """Return the range of a data sheet in brackets, nothing without one."""
    return "" if limits is None else f" ({limits[0]:{form}} to {limits[1]:{form}})"


def library_lines() -> Iterator[str]:
    """Yield the section on library machines."""
    yield "\n### Library machines under their rated force\n"
    yield (
        "In brackets the ranges of data sheets, of `three-phase` those on record, of JEA 73 those "
        "of the paper and its parameter set. Where a sheet has an upper end alone (currents, "
        "times) the lower one is ours; sources stand in `test_machine_library.py`.\n"
    )
    yield "| machine | force | current | shaft | power | energised | slip current | peak |"
    yield "|---|--:|--:|--:|--:|--:|--:|--:|"
    for name in RATED:
        found = sheet_of(name)
        cells = (
            f"{getattr(found, key):{form}} {unit}{allowed(LIMITS[name].get(key), form)}"
            for key, form, unit in SHEET_COLUMNS
        )
        yield f"| `{name}` | {found.force / 1e3:.2f} kN | {' | '.join(cells)} |"
    yield "\nSupply, line and copper of `jea73`, sound closing throw and clutch slipping:\n"
    yield "| changed | energised | peak | slip current |"
    yield "|---|--:|--:|--:|"
    supplies: dict[str, dict[str, object]] = {
        "rated": {},
        "supply -20 %": {"supply.voltage": 176.0},
        "supply +20 %": {"supply.voltage": 264.0},
        "line 0 ohm": {"supply.line_resistance": 0.0},
        "line 20 ohm": {"supply.line_resistance": 20.0},
        "line 54 ohm": {"supply.line_resistance": 54.0},
        "copper at -25 degC": {"motor.temperature": 248.15},
        "copper at 40 degC": {"motor.temperature": 313.15},
    }
    for text, changes in supplies.items():
        sound = throw_one_mass("jea73", overrides=changes | {"throw.duration": 8.0})
        wall = {"rail.object_size": 0.013, "throw.duration": 8.1}
        held = throw_one_mass("jea73", overrides=changes | wall)
        slip = held["current"][np.searchsorted(held.time, 8.0)]
        yield (
            f"| {text} | {sound.energised_time:.3f} s | {sound['current'].max():.2f} A "
            f"| {slip:.4f} A |"
        )


def random_lines() -> Iterator[str]:
    """Yield the section on random machines."""
    yield "\n### Random machines\n"
    yield "Steps of 1 and 4 ms, a closing and an opening throw each; balance: largest residual over"
    yield "the energy turned over; none was left unconverged.\n"
    yield "| machines | slipped | stalled | lost a phase | steps halved | balance |"
    yield "|---|--:|--:|--:|--:|--:|"
    for text, count, draw in (
        ("with direct-current motors", 2000, random_overrides),
        ("with induction motors", 1000, random_induction_overrides),
    ):
        generator, base = np.random.default_rng(count), load_machines("sb3")
        worst, halved, slipped, stalled, lost = 0.0, 0, 0, 0, 0
        for _ in range(count):
            thrown = throw_one_mass(base.with_overrides(draw(generator)))
            worst = max(worst, thrown.energy_residual)
            halved += thrown.halved
            slipped += np.abs(thrown["clutch_slip"]).max() > 1.0
            stalled += thrown.outcome == "stalled"
            lost += any(event == "phase lost" for _, event in thrown.events)
        yield f"| {count:,} {text} | {slipped} | {stalled} | {lost} | {halved} | {worst:.0e} |"


def coupled_lines() -> Iterator[str]:
    """Yield the section on a machine in another program's step."""
    yield "\n### Coupled to another program's step\n"
    yield "One machine on a linear rail that the trapezoidal rule moves, against the same in the"
    yield "solver (steps of 0.125 ms): rms in % of the peak.\n"
    yield "| step of the rail | rod force | current |"
    yield "|--:|--:|--:|"
    yield from coupled_rows()


def coupled_rows() -> Iterator[str]:
    """Yield the rows of that table."""
    from tests.verification.test_machine_coupling import RAIL, TrapezoidalRail

    from turnout.machine.compute import places as at

    loaded = load_machines("sb3", overrides=RAIL | {"throw.duration": 4.0, "throw.step": 1.25e-4})
    inside, machine, rail = throw_one_mass(loaded), loaded.machine["sb3"], loaded.rail
    assert rail is not None
    assert loaded.throw is not None
    for h in (2.5e-4, 1e-3, 4e-3):
        outside = TrapezoidalRail(
            np.array([[rail.mass]]),
            np.array([[rail.damping]]),
            np.array([[rail.bed_stiffness]]),
            np.array([rail.bed_rest]),
            inside["rail_position"][:1],
            h,
        )
        pairs = [(machine, loaded.throw.command)]
        kept, _, _ = coupled(pairs, outside, [loaded.throw.start], round(4.0 / h))
        ours, theirs = max(1, round(1e-3 / h)), max(1, round(h / 1e-3))
        cells = []
        for name, place in (("rod_force", at.ROD_FORCE), ("current", at.CURRENT)):
            exact = inside[name][::theirs]
            difference = kept[::ours, 0, place] - exact
            cells.append(100 * np.sqrt(np.mean(difference**2)) / np.abs(exact).max())
        yield f"| {h * 1e3:g} ms | {cells[0]:.4f} | {cells[1]:.4f} |"


def rail_lines() -> Iterator[str]:
    """Yield the section on two machines on the rail of SB1."""
    from tests.verification.machine_rail import throw_rail, throw_staggered

    from turnout.machine.compute import places as at

    yield "\n### Two machines on the rail of SB1\n"
    yield "Case A of SB3-rail, rms in % of the peak (tolerance 0.1). Rail and machines stepped"
    yield "apart: iterated seven times over the whole throw, or staggered in each step.\n"
    yield "| | step | drive | rod force | current | rod position | force at the end |"
    yield "|---|--:|---|--:|--:|--:|--:|"
    iterated = throw_rail(rounds=7)
    found = [("iterated", 1, iterated.states, iterated.force)]
    found += [("staggered", ms, *throw_staggered(step=ms * 1e-3)) for ms in (1, 4)]
    with np.load(DATA / "sb3_rail_A.npz") as theirs:
        for text, ms, states, force in found:
            for number in range(2):
                cells = []
                for name, ours in (
                    ("rod_force", force[:, number]),
                    ("current", states[:, number, at.CURRENT]),
                    ("rod_position", states[:, number, at.ROD_POSITION]),
                ):
                    expected = theirs[f"{name}{number + 1}"][::ms]
                    rms = np.sqrt(np.mean((ours[::5] - expected) ** 2))
                    cells.append(f"{100 * rms / np.abs(expected).max():.4f}")
                known = theirs[f"rod_force{number + 1}"][-1]
                yield (
                    f"| {text} | {ms} ms | {number + 1} | {' | '.join(cells)} "
                    f"| {force[-1, number]:.1f} N ({known:.1f} N) |"
                )


PANEL_CHANNELS = {
    "rod force": ("drive_force", "rod_force"),
    "current": ("drive_current", "current"),
    "rod position": ("drive_displacement", "rod_position"),
}
BOTH = ("1", "2")


def sb3_lines() -> list[str]:
    """Return rows of SB3-rail A against the independent program."""
    lines = []
    with np.load(DATA / "sb3_rail_A.npz") as theirs:
        for mode, text, every in (("waveform", "1 ms", 1), ("quick", "quick, 4 ms", 4)):
            for name, (channel, key) in PANEL_CHANNELS.items():
                cells = [
                    100
                    * rms_of_peak(
                        sb3_run(mode)[channel].sel(drive=d).values[::5],
                        theirs[f"{key}{d}"][::every],
                    )
                    for d in BOTH
                ]
                lines.append(
                    f"| SB3-rail A, {text} | {name}, rms of the peak "
                    f"| {cells[0]:.4f} % | {cells[1]:.4f} % |"
                )
    times = sb3_run("waveform")["throw_time"].sel(direction="closing").values
    lines.append(f"| | energised (3.1747, 3.0690 s) | {times[0]:.5f} s | {times[1]:.5f} s |")
    return lines


def default_lines() -> list[str]:
    """Return rows of the default panel: halved steps, motion fed back, clutch on an object."""
    lines = []
    for text, size, end in (("sound", 0.0, 8.5), ("13 mm at Drive 1", 0.013, 14.0)):
        coarse, fine = default_run(size, end=end), default_run(size, step=5e-4, end=end)
        for name in ("rod force", "current"):
            channel = PANEL_CHANNELS[name][0]
            cells = [
                100
                * rms_of_peak(
                    coarse[channel].sel(drive=d).values, fine[channel].sel(drive=d).values
                )
                for d in BOTH
            ]
            lines.append(
                f"| default panel, {text} | {name}, step halved, rms | {cells[0]:.3f} % "
                f"| {cells[1]:.3f} % |"
            )
    machines, markers = fed_back(solved_default())
    apart = 100 * np.abs(machines - markers).max(axis=0) / np.abs(machines).max(axis=0)
    lines.append(
        f"| | rod ends as marker table: force, largest | {apart[0]:.4f} % | {apart[1]:.4f} % |"
    )
    drive = default_run(0.013, end=14.0).sel(drive="1")
    during, slips = (
        drive.sel(time=slice(8.0, 12.0)),
        slip_point(fitted_machine(default_panel(), "1")),
    )
    current, force = (float(during[name].mean()) for name in ("drive_current", "drive_force"))
    lines += [
        f"| 13 mm at Drive 1 | current while it slips (closed form {slips.current:.4f} A) "
        f"| {current:.5f} A | - |",
        f"| | force (band 6.0 to 7.4 kN) | {force:.0f} N | - |",
        "| | energised (time-out 8 s) | "
        f"{float(drive['throw_time'].sel(direction='closing')):.4f} s | - |",
    ]
    times = default_run()["throw_time"].sel(direction="closing").values
    lines.append(
        f"| default panel, sound | energised, closing | {times[0]:.3f} s | {times[1]:.3f} s |"
    )
    held = default_run()["drive_force"]
    first, last = (held.isel(time=at).values / 1e3 for at in (0, -1))
    lines += [
        f"| | force at the start, as markers leave it | {first[0]:.2f} kN | {first[1]:.2f} kN |",
        f"| | force that the machines' own return leaves | {last[0]:.2f} kN | {last[1]:.2f} kN |",
    ]
    return lines


def piece_lines() -> list[str]:
    """Return a table of objects at sleeper 6 in the current of Drive 2."""
    shown = ["drive_current", "drive_power", "drive_force", "drive_voltage"]
    free = default_run()[shown].sel(drive="2")
    off = _cut_off(free)
    lines = [
        "",
        "Objects at sleeper 6, change against the free throw at Drive 2: over the last 0.4 s",
        f"before its cut-off at {off:.3f} s, and at the end:",
        "",
        "| object | current, mean | current, at most | power, at most | force at the end |",
        "|---|--:|--:|--:|--:|",
    ]
    for size in (5, 10, 13):
        piece = default_run(1e-3 * size, "sleeper 6")[shown].sel(drive="2")
        last = (piece - free).sel(time=slice(off - 0.4, off - 1e-3))
        end = float(piece["drive_force"][-1] - free["drive_force"][-1])
        lines.append(
            f"| {size} mm | {float(last['drive_current'].mean()):+.3f} A "
            f"| {float(last['drive_current'].max()):+.3f} A "
            f"| {float(last['drive_power'].max()):+.0f} W | {end:+.0f} N |"
        )
    return lines


def _cut_off(drive: xr.Dataset) -> float:
    """Return when the motor was switched off last [s]."""
    on = np.flatnonzero(drive["drive_voltage"].values != 0.0)
    return float(drive["time"][on[-1]])


def main() -> None:
    """Replace the results and the figure on the page."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    start = time.perf_counter()
    on_panels = ["| case | | Drive 1 | Drive 2 |", "|---|---|--:|--:|"]
    on_panels += [*sb3_lines(), *default_lines(), *piece_lines()]
    put_section(PAGE, name="machine-panels", heading="What is found", lines=on_panels)
    held = machine_dataset(throw_one_mass("sb3", overrides=CASES["S3"]))
    (PAGE.parents[1] / "figures" / "machine.png").write_bytes(rendered(plot_machine(held), ".png"))
    sections = (
        benchmark_lines,
        motor_lines,
        library_lines,
        random_lines,
        coupled_lines,
        rail_lines,
    )
    lines = [line for section in sections for line in section()]
    written = "Written by `python -m benchmarks.studies.machine_page`.\n"
    write_section("Results", "\n".join([written, *lines]), page=PAGE)
    print(f"{PAGE}: written in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
