"""Answers of independent programs: where they come from, how they are thinned and read.

`sb1_A`, `sb1_B`: Exudyn 1.13.6, 0.5 ms, Newmark; OpenSeesPy and a SciPy program agree to 1e-5.
`sb2_none`, `sb2_sleeper6_13mm`: an independent banded beam program at 1 ms, converged in step and
element, with an Exudyn twin. `sb3_S1`, `sb3_S2`, `sb3_S4`: a machine on a one-mass rail by an
event-driven program, DOP853 at 1e-11; Radau agrees to 3e-9. `sb3_rail_A`: two machines on the rail
of `sb1`, BDF2 at 50 us. The benchmarks are the project's own;
the panels `sb1` and `sb2` and the machine `sb3` are their definitions. The thinned copies in
`data/` are made from the full files by

    python -m tests.verification.reference FOLDER

with the folder that holds `sb1/`, `sb2/` and `sb3/`; histories keep every fifth or tenth sample,
arrays over the chairs every fiftieth, all as float32; of the energies of `sb3` only the last.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

DATA = Path(__file__).parent / "data"
CASES = {
    "sb1_A": ("sb1/A.npz", 10),
    "sb1_B": ("sb1/B.npz", 10),
    "sb2_none": ("sb2/none.npz", 5),
    "sb2_sleeper6_13mm": ("sb2/sleeper6_13mm.npz", 5),
}
MACHINE_CASES, MACHINE_STRIDE = ("S1", "S2", "S4", "rail_A"), 5
Arrays = dict[str, NDArray[np.float64]]


def thinned(case: str) -> Arrays:
    """Return the committed copy of a case; arrays over chairs go with `time_chairs`."""
    with np.load(DATA / f"{case}.npz") as file:
        return {name: file[name].astype(np.float64) for name in file.files}


def full(case: str, folder: Path) -> Arrays:
    """Return a case as its program wrote it."""
    with np.load(folder / CASES[case][0]) as file:
        arrays = {name: file[name].astype(np.float64) for name in file.files}
    arrays["time_chairs"] = arrays["time"]
    return arrays


def thin_machine(case: str, folder: Path) -> None:
    """Write the committed copy of a case of `sb3`, with its events."""
    kept = {}
    with np.load(folder / "sb3" / f"{case}.npz") as file:
        n = file["time"].size
        for name in file.files:
            values = file[name]
            if name.startswith("energy_"):
                kept[name] = values[-1:]
            else:
                kept[name] = values[::MACHINE_STRIDE] if values.shape == (n,) else values
    np.savez_compressed(DATA / f"sb3_{case}.npz", **kept)


def thin(case: str, folder: Path) -> None:
    """Write the committed copy of a case."""
    arrays = full(case, folder)
    stride = CASES[case][1]
    n = arrays["time"].size
    kept: dict[str, NDArray[np.float32]] = {}
    for name, values in arrays.items():
        if name == "time_chairs":
            kept[name] = values[::50]
        elif values.shape[:1] != (n,):
            kept[name] = values
        elif values.ndim == 2 and name != "gap":
            kept[name] = values[::50]
        else:
            kept[name] = values[::stride]
    exact = {"time", "time_chairs", "open_shape", "stops_x", "chairs_x"}
    np.savez_compressed(
        DATA / f"{case}.npz",
        **{k: v if k in exact else v.astype(np.float32) for k, v in kept.items()},
    )


if __name__ == "__main__":
    DATA.mkdir(exist_ok=True)
    for each in CASES:
        thin(each, Path(sys.argv[1]))
    for each in MACHINE_CASES:
        thin_machine(each, Path(sys.argv[1]))
