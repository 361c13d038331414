"""Both criteria on the energy residual, and a rail that does not creep.

(i) The energy residual is below 1e-6 of its scale: proves the code. (ii) Numerical dissipation is
at most 0.5 % on a default throw and 2 % on SB1 B, whose object is hit at full speed, and shrinks
with the step at the rates stated below, fitted over steps of 4, 2, 1 and 0.5 ms: proves the
physics. A smooth run would give 2; contacts that change within a step and impacts cost part of it.
"""

import numpy as np
import pytest
import xarray as xr
from tests.verification.runs import DEFAULT, energy_balance, throw

from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

STEPS = (4e-3, 2e-3, 1e-3, 5e-4)
"""Name: panel, object's place, largest loss, measured rate of the loss."""
CASES: dict[str, tuple[str, str | None, float, float]] = {
    "no object": (DEFAULT, None, 0.005, 1.35),
    "sleeper 6": (DEFAULT, "sleeper 6", 0.005, 1.42),
    "drive 1": (DEFAULT, "drive 1", 0.005, 1.32),
    "drive 2": (DEFAULT, "drive 2", 0.005, 1.48),
    "SB1 A": ("sb1", None, 0.005, 1.50),
    "SB1 B": ("sb1", "x = 3.9 m", 0.02, 1.27),
    "SB2": ("sb2", None, 0.005, 1.53),
}
RATE_TOLERANCE = 0.15
PUT_IN = ("work_markers", "energy_object_switched")
TAKEN_OUT = ("energy_friction", "energy_damping", "energy_numerical")
STORED = ("energy_kinetic", "energy_strain", "energy_contact", "energy_gravity")


BALANCED = {name: case[:3] for name, case in CASES.items()}
BALANCED["SB2, sleeper 6"] = ("sb2", "sleeper 6", 0.02)


@pytest.mark.parametrize("case", BALANCED)
def test_the_books_close_and_the_scheme_loses_little(case: str) -> None:
    panel, place, allowed = BALANCED[case]
    residual, loss = energy_balance(throw(panel, place))
    assert residual <= 1e-6
    assert loss <= allowed


RATED = ("no object", "drive 2", "SB1 B", "SB2")


@pytest.mark.parametrize(
    "case", [c if c in RATED else pytest.param(c, marks=pytest.mark.long) for c in CASES]
)
def test_the_loss_shrinks_with_the_step(case: str) -> None:
    panel, place, _, rate = CASES[case]
    losses = []
    for step in STEPS:
        residual, loss = energy_balance(coarse_throw(panel, place, step))
        assert residual <= 1e-6
        losses.append(loss)
    assert losses == sorted(losses, reverse=True)
    fitted = np.polyfit(np.log(STEPS), np.log(losses), 1)[0]
    assert fitted == pytest.approx(rate, abs=RATE_TOLERANCE)


def coarse_throw(panel: str, place: str | None, step: float) -> xr.Dataset:
    """Return the throw of `runs.throw` with another step, of which every one above 1 ms is kept."""
    trapped = ForeignObject(0.013, place) if place else None
    scheme = Scheme(step=step, cutoff_frequency=300.0)
    return simulate(load_panel(panel), foreign_object=trapped, scheme=scheme)


def residual_share(ds: xr.Dataset, *, term: str, factor: float) -> float:
    """Recompute the energy residual with one term wrong by a factor."""

    def value(name: str) -> np.ndarray:
        return np.asarray(ds[name]) * (factor if name == term else 1.0)

    change = sum(value(name) for name in STORED)
    known = sum(value(name) for name in PUT_IN) - sum(value(name) for name in TAKEN_OUT)
    return float(np.abs(change - known).max()) / float(ds.attrs["energy_scale"])


RICH = {
    name: ("sb1", "x = 3.9 m") for name in (*PUT_IN, *TAKEN_OUT, *STORED) if name != STORED[-1]
} | {"energy_gravity": (DEFAULT, "drive 2")}
"""A run in which the term takes part; only eccentric sections lift a rail against gravity."""


@pytest.mark.parametrize("term", RICH)
def test_a_wrong_term_opens_the_books(term: str) -> None:
    """A term left out shows, and one that is wrong by 1 % where it is 1e-4 of the scale."""
    ds = throw(*RICH[term])
    assert residual_share(ds, term=term, factor=1.0) == pytest.approx(
        energy_balance(ds)[0], abs=1e-9
    )
    assert residual_share(ds, term=term, factor=0.0) > 1e-5
    largest = float(np.abs(ds[term]).max()) / ds.attrs["energy_scale"]
    wrong = residual_share(ds, term=term, factor=1.01)
    assert wrong == pytest.approx(0.01 * largest, rel=1e-3)
    if term != "energy_gravity":  # 3.5e-5 of the scale: 1 % of it is below what is allowed
        assert wrong > 1e-6


def test_a_held_rail_does_not_creep() -> None:
    """Between 40 s and 60 s of a hold no place of either rail moves by more than 1 nm."""
    panel = load_panel(DEFAULT).with_overrides({"schedule.end": 60.0})
    keep = Save(interval=0.01, stations="all", fields=("lateral_displacement", "drive_force"))
    ds = simulate(panel, save=keep)
    assert ds.sizes["rail"] == 2
    held = ds["lateral_displacement"].sel(time=slice(39.995, None))
    assert held.sizes["time"] == 2001
    assert float((held.max("time") - held.min("time")).max()) < 1e-9
    assert float(np.abs(ds["drive_force"][:, -1]).max()) > 1000.0
    moved = ds["lateral_displacement"]
    assert float((moved.max("time") - moved.min("time")).max()) > 0.1
