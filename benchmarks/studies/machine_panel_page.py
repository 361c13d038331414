"""Write what machines do on panels into docs/use/machines.md, from what the tests call.

python -m benchmarks.studies.machine_panel_page

replaces the tables between the marks "machine-panels" there.
"""

import argparse
from pathlib import Path

import numpy as np
import xarray as xr
from tests.verification.machine_panels import (
    default_panel,
    default_run,
    fed_back,
    rms_of_peak,
    solved_default,
)
from tests.verification.reference import DATA
from tests.verification.test_drive_machine import sb3_run

from benchmarks.studies.resumable import put_section
from turnout.machine.steady import slip_point
from turnout.mechanism.drive_machines import fitted_machine

PAGE = Path(__file__).parents[2] / "docs" / "use" / "machines.md"
CHANNELS = {
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
            for name, (channel, key) in CHANNELS.items():
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
            channel = CHANNELS[name][0]
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
    """Replace the tables on the page."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    head = ["| case | | Drive 1 | Drive 2 |", "|---|---|--:|--:|"]
    lines = [*head, *sb3_lines(), *default_lines(), *piece_lines()]
    put_section(PAGE, name="machine-panels", heading="What is found", lines=lines)


if __name__ == "__main__":
    main()
