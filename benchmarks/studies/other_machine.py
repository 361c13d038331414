"""Results of another machine: the library's throws again with other instructions.

    python -m benchmarks.studies.other_machine

Data variables are bit-identical in one environment, whatever the number of workers. Another
processor adds and multiplies in another order. Here it is played by a compiler and a linear algebra
library that may only use what every 64-bit x86 processor has; the kernels are compiled once for
each, which takes half a minute or more.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

PANELS = ("sb1", "sb2", "uic60-760-1-15")
OLDEST = {
    "NUMBA_CPU_NAME": "x86-64",
    "NUMBA_CPU_FEATURES": "+sse,+sse2",
    "OPENBLAS_CORETYPE": "Prescott",
}
TOLERANCE = 1e-7
"""Stated for forces, gaps and displacements on another machine, as a share of a channel's peak."""
CHANNELS = (
    *("drive_force", "object_force", "gap", "sensor_gap", "drive_gap", "stop_force"),
    *("chair_normal_force", "chair_friction_force", "lateral_displacement"),
)


def playable() -> bool:
    """Return whether this machine is one of the family that is played."""
    return platform.machine() in ("x86_64", "AMD64")


def throws() -> dict[str, np.ndarray]:
    """Return the channels of the library's throws, with 13 mm at sleeper 6 if there is one."""
    found = {}
    for name in PANELS:
        panel = load_panel(name)
        item = ForeignObject(0.013, "sleeper 6") if panel.sleeper else None
        dataset = simulate(panel, foreign_object=item)
        found |= {
            f"{name}: {channel}": dataset[channel].to_numpy()
            for channel in CHANNELS
            if channel in dataset
        }
    return found


def throws_elsewhere() -> dict[str, np.ndarray]:
    """Return the same from a program that uses the oldest instructions only."""
    inherited = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "throws.npz"
        subprocess.run(
            [sys.executable, "-m", "benchmarks.studies.other_machine", str(out)],
            env=inherited | OLDEST | {"TURNOUT_CACHE_DIR": folder},
            check=True,
        )
        with np.load(out) as arrays:
            return dict(arrays)


def differences() -> dict[str, float]:
    """Return the largest difference of each channel, as a share of its peak [-]."""
    here, there = throws(), throws_elsewhere()
    return {
        name: float(np.nanmax(np.abs(here[name] - there[name])) / np.nanmax(np.abs(here[name])))
        for name in here
        if np.nanmax(np.abs(here[name]), initial=0.0) > 0.0
    }


def main() -> None:
    """Print the largest difference of each channel."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", nargs="?", help="file for the throws of this machine alone")
    out = parser.parse_args().out
    if out:
        np.savez(out, **throws())
        return
    for channel, share in differences().items():
        print(f"{channel:45s} {share:8.1e} of its peak")


if __name__ == "__main__":
    main()
