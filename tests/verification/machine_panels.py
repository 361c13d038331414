"""Panels whose drives are machines: SB3-rail, the default panel, and what is read off them."""

import tomllib
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from tests.verification.machine_rail import HORIZON, PLACES, RODS, gap

from turnout.core.scheme import Scheme
from turnout.machine.machine_file import machine_text
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.solver.integration import History, integrate
from turnout.throw.simulate import Solved, prior_motion, simulate, solve

Floats = NDArray[np.float64]
MACHINES = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}


def sb3_rail(changes: Mapping[str, object] | None = None) -> LoadedPanel:
    """Return SB3-rail, two machines on the rail of SB1, with changes such as another end.

    A foreign object is given to `simulate`:
    `ForeignObject(0.013, "drive 1", appears=0.0, disappears=13.0)` (SB1 takes its own away), or at
    "x = 2.4 m" between the drives.
    """
    base: dict[str, Any] = tomllib.loads(machine_text("sb3"))["machine"]["sb3"]
    circuit = {k: v for k, v in base["circuit"].items() if not k.startswith("limit_")}
    overrides: dict[str, object] = {
        "drive.2.x": PLACES["2"],
        "movement.throw.start": 0.1,
        "movement.throw.extra_time": {"2": 0.2},
        "movement.return.start": HORIZON - 0.03,
        "movement.return.duration": 0.02,
        "movement.return.extra_time": {},
        "schedule.end": HORIZON,
    }
    for name, ratio, force, beyond in (("1", 5600.0, 6e3, 3.0e-3), ("2", 16500.0, 6.85e3, 3.3e-3)):
        overrides[f"machine.of{name}"] = base | {
            "motor": base["motor"] | {"loss_torque": "0.745 N m"},
            "stroke": {"kind": "screw", "ratio": ratio},
            "clutch": base["clutch"] | {"torque": force / (ratio * 0.9)},
            "circuit": circuit,
        }
        overrides[f"drive.{name}.machine"] = f"of{name}"
        overrides[f"drive.{name}.stiffness"] = RODS[name]
        overrides[f"drive.{name}.stroke"] = gap(PLACES[name])
        overrides[f"drive.{name}.over_travel_closed"] = beyond
    return load_panel("sb1", overrides=overrides | dict(changes or {}))


def default_panel(changes: Mapping[str, object] | None = None) -> LoadedPanel:
    """Return the default panel with the machines of the paper's drives."""
    return load_panel("uic60-760-1-15", overrides=MACHINES | dict(changes or {}))


@cache
def default_run(
    size: float = 0.0, at: str = "drive 1", *, step: float = 1e-3, end: float = 8.5
) -> xr.Dataset:
    """Return a throw of the default panel with machines, to be read only."""
    panel = default_panel({"schedule.end": end})
    piece = ForeignObject(size, at) if size else None
    scheme = Scheme.of("waveform", step=step, output_interval=1e-3)
    return simulate(panel, foreign_object=piece, scheme=scheme)


def solved_default() -> Solved:
    """Return the default panel with machines as the solver leaves it, every millisecond."""
    return solve(default_panel(), scheme=Scheme.of("waveform"))


def fed_back(solved: Solved) -> tuple[Floats, Floats]:
    """Return drive forces of a run, and those of markers that move as its rod ends did."""
    panel = load_panel("uic60-760-1-15", overrides={"drive.saturation_force": 1e6})
    given: History = solved.history
    marker = build_mechanism(panel)

    def inputs(instants: Floats) -> Floats:
        return np.array([np.interp(instants, given.time, row) for row in given.inputs.T])

    end, prior = float(given.time[-1]), prior_motion(panel)
    again = integrate(marker, Scheme.of("waveform"), inputs=inputs, end=end, prior=prior)
    laws = [solved.mechanism.index.drive[name] for name in panel.drive]
    return given.law_force[:, laws], again.law_force[:, laws]


def rms_of_peak(found: Floats, right: Floats) -> float:
    """Return the root mean square of a difference, as a share of the largest value [-]."""
    return float(np.sqrt(np.mean((found - right) ** 2)) / np.abs(right).max())
