"""Currents and powers of drives that are machines, beside their forces."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.detection_throws import toy_throws

from turnout.detection.drive_quantities import (
    Signal,
    amplitudes,
    noise_of,
    signals_of,
    stored_channels,
)
from turnout.detection.limit import limit_map
from turnout.detection.reference import Conditions, reference_study
from turnout.detection.throws import Throws
from turnout.errors import StudyError
from turnout.panel.load import LoadedPanel, load_panel

CLOSING = 0.8


def machine_panel() -> LoadedPanel:
    machines = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
    return load_panel("uic60-760-1-15", overrides=machines)


def with_currents(share: float) -> Throws:
    """A toy whose currents are the forces divided by 1 kN/A, with a share of the signature."""
    throws = toy_throws()
    rng = np.random.default_rng(9)
    current = 1e-3 * throws.sound + 0.02 * rng.standard_normal((600, 2, 1))
    return replace(
        throws,
        sound=np.concatenate([throws.sound, current], axis=1),
        change=np.concatenate([throws.change, 1e-3 * share * throws.change], axis=-2),
        amplitude=np.concatenate([throws.amplitude, 1e-3 * throws.amplitude]),
        signals=(*throws.signals, *(Signal(quantity="current", drive=n) for n in ("1", "2"))),
    )


def test_a_panel_has_the_forces_of_all_drives_and_the_currents_of_machines() -> None:
    markers, machines = load_panel("uic60-760-1-15"), machine_panel()
    one = load_panel("uic60-760-1-15", overrides={"drive.2.machine": "jea73-drive2"})
    assert [item.drive for item in signals_of(one, "current")] == ["2"]
    assert len(signals_of(markers, "all")) == 2
    assert len(signals_of(machines, "all")) == 6
    assert stored_channels(machines) == ("drive_force", "drive_current", "drive_power")


def test_noise_and_amplitude_are_those_of_each_quantity() -> None:
    signals = signals_of(machine_panel(), "all")
    assert noise_of(signals, Conditions()).tolist() == [20.0, 20.0, 0.02, 0.02, 5.0, 5.0]
    found = amplitudes(machine_panel(), signals)
    assert np.all((found[:2] > 2e3) & (found[:2] < 8e3))
    assert np.all((found[2:4] > 0.8) & (found[2:4] < 3.0))  # the inrush of 10 A is left out
    np.testing.assert_allclose(found[4:] / found[2:4], 190.0, rtol=0.35)


def test_the_clutch_takes_the_place_of_the_slip_level() -> None:
    study = reference_study(machine_panel(), count=1)
    keys = [item.key for item in study.variables.values()]
    assert "machine.jea73.clutch.torque" in keys
    assert "machine.jea73-drive2.clutch.torque" in keys
    assert not any("saturation_force" in key for key in keys)
    assert set(stored_channels(study.panel)) <= set(study.output.channels)


def test_quantities_are_also_judged_alone() -> None:
    found = limit_map(with_currents(1.0), Conditions(), closing=CLOSING)
    names = ["both drives", "drive 1", "drive 2", "force", "current"]
    assert found["channel"].to_numpy().tolist() == names
    assert found.attrs["quantities"] == "force and current"
    only = limit_map(toy_throws(), Conditions(), closing=CLOSING)
    np.testing.assert_allclose(
        found["pod"].sel(channel="force"), only["pod"].sel(channel="both drives"), rtol=1e-9
    )
    both, force = (found["pod"].sel(channel=name) for name in ("both drives", "force"))
    assert np.all(both >= force - 1e-12)


def test_a_current_that_shows_nothing_adds_little() -> None:
    found = limit_map(with_currents(0.0), Conditions(), closing=CLOSING)
    blind = found["pod"].sel(channel="current")
    np.testing.assert_allclose(blind, 1e-3, rtol=1e-6)


@pytest.mark.parametrize("name", ["noise", "current_noise", "power_noise"])
def test_noise_of_nothing_is_refused(name: str) -> None:
    with pytest.raises(StudyError, match="must be more than 0"):
        Conditions(**{name: 0.0})  # type: ignore[arg-type]
