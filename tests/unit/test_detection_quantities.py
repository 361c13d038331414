"""Currents and powers of drives that are machines, beside their forces."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.channels_confirmed import confirmed
from tests.unit.detection_throws import toy_map, toy_throws

from turnout.core.errors import StudyError
from turnout.detection.drive_quantities import (
    noise_of,
    signals_of,
    stored_channels,
)
from turnout.detection.limit.limit_map import limit_map, sound_throws, too_few_sound
from turnout.detection.reference import Conditions, reference_study
from turnout.detection.signal_discrepancy import Signal, SignalErrors, discrepancy_of_signals
from turnout.detection.signal_errors import signal_errors
from turnout.detection.throws import Throws
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
        errors=SignalErrors(
            amplitude=np.concatenate([throws.amplitude, 1e-3 * throws.amplitude]),
            force_peak=np.tile(throws.amplitude, 2),
            gain=np.repeat([1.0, 1e-3], 2)[:, None] * np.ones(throws.time.size),
        ),
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
    time = np.arange(0.0, 8.5, 0.008)
    errors = signal_errors(machine_panel(), signals, time=time)
    found = errors.amplitude
    assert np.all((found[:2] > 2e3) & (found[:2] < 8e3))
    assert np.all((found[2:4] > 0.8) & (found[2:4] < 3.0))  # the inrush of 10 A is left out
    np.testing.assert_allclose(found[4:] / found[2:4], 190.0, rtol=0.35)
    np.testing.assert_array_equal(errors.force_peak, np.tile(found[:2], 3))
    np.testing.assert_array_equal(errors.gain[:2], 1.0)
    moving = errors.gain[2] > 0.0
    assert 0.4 < moving.mean() < 0.9  # two throws of 3 s in 8.5 s
    assert np.all(errors.gain[2][time < 0.1] == 0.0)  # off
    assert 0.1e-3 < errors.gain[2][moving].mean() < 0.3e-3  # A/N
    np.testing.assert_allclose(errors.gain[4][moving] / errors.gain[2][moving], 190.0, rtol=0.35)


def test_a_machine_error_is_one_of_currents_and_powers_and_follows_the_force() -> None:
    throws = with_currents(1.0)
    means = np.eye(throws.time.size)[::50]

    def covariance(**given: float) -> np.ndarray:
        return discrepancy_of_signals(
            throws.time, means, errors=throws.errors, signals=throws.signals,
            conditions=Conditions(**given),  # type: ignore[arg-type]
        )  # fmt: skip

    found, count = covariance(), len(means)
    force, current = slice(0, count), slice(2 * count, 3 * count)
    kernel = found[force, force] / (0.05 * 3000.0) ** 2
    np.testing.assert_allclose(found[force, current], 1e-3 * found[force, force])
    own = (0.05 * 3.0) ** 2 + (0.02 * 3.0) ** 2
    np.testing.assert_allclose(found[current, current], own * kernel)
    np.testing.assert_array_equal(found[count : 2 * count, current], 0.0)  # the other drive
    exact = covariance(machine_discrepancy=0.0)
    whole = exact[np.ix_(np.r_[force, current], np.r_[force, current])]
    assert np.linalg.matrix_rank(whole) == count  # the current says what the force says


def test_a_current_beside_the_force_adds_no_second_look_at_it() -> None:
    """Independent errors would lower the error of the mean of both by a third."""
    throws = with_currents(1.0)
    found = limit_map(throws, Conditions(machine_discrepancy=0.0), closing=CLOSING)
    both, force = (found["a90"].sel(channel=name) for name in ("both drives", "force"))
    np.testing.assert_allclose(both, force, atol=0.3e-3)


def test_the_clutch_takes_the_place_of_the_slip_level() -> None:
    study = reference_study(machine_panel(), count=1)
    keys = [item.key for item in study.variables.values()]
    assert "machine.jea73.clutch.torque" in keys
    assert "machine.jea73-drive2.clutch.torque" in keys
    assert not any("saturation_force" in key for key in keys)
    assert set(stored_channels(study.panel)) <= set(study.output.channels)


def only_currents(throws: Throws) -> Throws:
    rows = [n for n, item in enumerate(throws.signals) if item.quantity == "current"]
    return replace(
        throws, sound=throws.sound[:, rows], change=throws.change[:, :, :, rows],
        errors=SignalErrors(
            amplitude=throws.errors.amplitude[rows], force_peak=throws.errors.force_peak[rows],
            gain=throws.errors.gain[rows],
        ),
        signals=tuple(throws.signals[row] for row in rows),
    )  # fmt: skip


def test_forces_are_also_judged_alone() -> None:
    found = limit_map(with_currents(1.0), Conditions(), closing=CLOSING)
    names = ["both drives", "drive 1", "drive 2", "force"]
    assert found["channel"].to_numpy().tolist() == names
    assert found.attrs["quantities"] == "force and current"
    only = toy_map()
    np.testing.assert_allclose(
        found["pod"].sel(channel="force"), only["pod"].sel(channel="both drives"), rtol=1e-9
    )
    both, force = (found["pod"].sel(channel=name) for name in ("both drives", "force"))
    assert np.all(both >= force - 1e-12)


def test_a_current_without_a_signature_shows_nothing_alone() -> None:
    alone = limit_map(only_currents(with_currents(0.0)), Conditions(), closing=CLOSING)["pod"]
    np.testing.assert_allclose(alone, 1e-3, rtol=1e-6)


def test_few_sound_throws_of_many_signals_are_warned_of() -> None:
    assert not too_few_sound(
        toy_throws(), closing=CLOSING
    )  # forces: the discrepancy fills what throws leave open
    many = with_currents(1.0)
    few = replace(many, sound=many.sound[:50], switch=many.switch[:50], level=many.level[:50])
    assert "50 sound throws for" in too_few_sound(few, closing=CLOSING)


@pytest.mark.parametrize("name", ["noise", "current_noise", "power_noise"])
def test_noise_of_nothing_is_refused(name: str) -> None:
    with pytest.raises(StudyError, match="must be more than 0"):
        Conditions(**{name: 0.0})  # type: ignore[arg-type]


def test_what_one_half_claims_the_same_half_confirms() -> None:
    throws = toy_throws()
    change = throws.change.copy()
    change[:, :, 1, 0] = change[:, :, 2, 1] = 0.0  # small objects show at Drive 2, large at Drive 1
    throws = replace(throws, change=change)
    twice = replace(
        throws, sound=throws.sound.repeat(2, axis=0), switch=throws.switch.repeat(2, axis=0),
        level=throws.level.repeat(2), states=2 * throws.states,
    )  # fmt: skip
    found = confirmed(twice, Conditions(), CLOSING)
    claimed = limit_map(throws, Conditions(), closing=CLOSING)["a90"].sel(channel="both drives")
    np.testing.assert_allclose(found, claimed, atol=1e-9)


def test_currents_and_powers_have_wider_windows_and_forces_do_not() -> None:
    both = sound_throws(with_currents(1.0), Conditions(), closing=CLOSING)
    force = sound_throws(toy_throws(), Conditions(), closing=CLOSING)
    assert force.pooling is None
    windows = len(force.channels["drive 1"])
    own = (len(both.channels["both drives"]) - 2 * windows) // 2
    assert len(both.channels["force"]) == 2 * windows
    assert own == len(range(0, windows // 3 - 7, 8)) + len(range(0, 2 * windows // 3 - 7, 8))
    values = np.broadcast_to(np.arange(200.0), (4, 200))  # a mean of a line is that of its middle
    np.testing.assert_allclose(both.features(values)[both.channels["force"][:windows]],
                               force.features(values[:2])[:windows])  # fmt: skip
    assert both.features(values)[both.channels["both drives"][2 * windows]] == pytest.approx(39.5)
    alone = sound_throws(only_currents(with_currents(1.0)), Conditions(), closing=CLOSING)
    assert own < len(alone.covariances[0]) // 2 < windows
