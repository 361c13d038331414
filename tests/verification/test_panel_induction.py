"""Induction motors as drives of the default panel: energy, both modes, what is said of them."""

import json
from functools import cache

import numpy as np
import pytest
import xarray as xr

from turnout.core.scheme import Scheme
from turnout.metric.panel_check import blind_concerns
from turnout.panel.load import LoadedPanel, load_panel
from turnout.throw.simulate import simulate

CLUTCH = {"machine.s700k.clutch.torque": 2.6}  # the default panel's Drive 2 needs more than 6 kN


@cache
def panel_of() -> LoadedPanel:
    panel = load_panel("uic60-760-1-15")
    machines = {"drive.1.machine": "s700k", "drive.2.machine": "s700k"}
    return panel.with_overrides(machines).with_overrides(CLUTCH)


@cache
def run_of(mode: str) -> xr.Dataset:
    return simulate(panel_of(), scheme=Scheme.of(mode))


@pytest.mark.parametrize("mode", ["quick", "waveform"])
def test_energy_and_powers(mode: str) -> None:
    run = run_of(mode)
    scale = float(run.attrs["energy_scale"])
    assert float(abs(run["energy_residual"]).max()) <= 1e-6 * scale
    active, apparent = run["drive_power"].values, run["drive_apparent_power"].values
    assert np.all(apparent >= np.abs(active) - 1e-9)
    running = (run["drive_state"].values == 1) & (np.abs(run["motor_speed"].values) > 150.0)
    assert running.any()
    current = run["drive_current"].values
    assert apparent[running] == pytest.approx(np.sqrt(3.0) * 380.0 * current[running], rel=1e-6)
    assert set(json.loads(run.attrs["blind_currents"])) == {"1", "2"}
    energy = np.trapezoid(active, run["time"].values, axis=1).sum()
    assert energy == pytest.approx(float(run["energy_supply"][-1]), rel=0.02)


def test_steady_circuit_agrees_with_the_fluxes() -> None:
    """Throw times within 10 ms: the start differs by the flux that builds up."""
    quick, fine = (run_of(mode)["throw_time"].values for mode in ("quick", "waveform"))
    assert quick == pytest.approx(fine, abs=0.01)


def test_the_check_says_that_current_cannot_tell_load() -> None:
    texts = [concern.text for concern in blind_concerns(panel_of())]
    assert len(texts) == 2
    assert "current cannot show load: use power" in texts[0]
    dc = load_panel("uic60-760-1-15").with_overrides({"drive.1.machine": "jea73"})
    assert blind_concerns(dc) == []
