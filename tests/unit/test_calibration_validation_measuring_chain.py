"""What a calibration found of gains, zeros and the clock is in the predictions of a validation."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import xarray as xr
from tests.unit.calibrations import calibration, fitted
from tests.unit.test_calibration_fit import TRUE, force, movement, response

from turnout.calibration.measured_movements import BIN
from turnout.calibration.misfit import Misfit
from turnout.calibration.result import load_calibration
from turnout.calibration.validation.validate import (
    Model,
    SharedBins,
    _failure,
    _scatter,
    chain_directions,
    found_chain,
    of_chain,
    through_chain,
)

CHAIN = {
    "gain drive_force.1": (0.012, 3e-4),
    "zero drive_force.1": (5.0, 2.0),
    "clock": (1e-3, 1e-5),
    "gain object_force": (0.5, 0.1),
}


def test_a_force_is_seen_through_gain_zero_and_clock() -> None:
    item = movement("m", rng=np.random.default_rng(0))
    grid, made, shifts = SharedBins.of([item]), response(TRUE), np.zeros(1)
    plain = grid.predicted([item], [made], shifts=shifts)
    seen = through_chain([made], [item], grid, CHAIN, shifts=shifts)
    # Seconds that are too short by 0.1 % show a force of t / 1.001 at t.
    within = BIN * ((np.arange(200) + 0.5) / 200 - 0.5)
    instants = grid.time[:, np.newaxis] / 1.001 + within
    exact = force(instants, mu=TRUE["mu"], k=TRUE["k"]).mean(axis=1)
    off = np.abs(seen[0, 0] - 1.012 * exact - 5.0)
    # Means of cells do not say where between them a kink is: the object is touched at 1.5 s.
    assert off.max() < 0.5
    assert off[np.abs(grid.time - 1.5) > 0.04].max() < 0.1
    assert np.abs(1.012 * exact + 5.0 - plain).max() > 60.0
    np.testing.assert_array_equal(through_chain([made], [item], grid, {}, shifts=shifts), plain)
    known = (chain_directions(plain, grid, CHAIN) ** 2).sum(axis=0)
    rest = (3e-4 * plain) ** 2 + 4.0
    np.testing.assert_allclose(known, rest, rtol=0.02, atol=0.02 * rest.max())
    assert not chain_directions(plain, grid, {}).any()


def test_a_force_is_seen_with_a_share_of_each_other_one() -> None:
    keys = (("drive_force", "1"), ("drive_force", "2"), ("object_force", ""))
    chain = {
        "cross-talk drive_force.1 drive_force.2": (0.02, 1e-3),
        "cross-talk object_force drive_force.1": (-0.01, 2e-3),
    }
    plain = np.random.default_rng(1).uniform(-6e3, 6e3, (3, 1, 40))
    first, second, third = plain
    gain, zero, clock = of_chain(keys, chain, 0)
    seen = plain + np.tensordot(gain, plain, axes=1) + zero
    np.testing.assert_allclose(seen, [first + 0.02 * second, second, third - 0.01 * first])
    assert clock == 0.0
    grid = SharedBins(keys, np.arange(40) * 0.02, np.arange(40))
    known = (chain_directions(plain, grid, chain) ** 2).sum(axis=0)
    nothing = np.zeros_like(first)
    np.testing.assert_allclose(known, [(1e-3 * second) ** 2, nothing, (2e-3 * first) ** 2])


def test_a_chain_is_kept_with_the_values_and_is_that_of_one_channel_map(tmp_path: Path) -> None:
    known = replace(calibration(), chain=CHAIN, about={"channel_map_hash": "a"})
    known.save(tmp_path / "c.toml")
    again = load_calibration(tmp_path / "c.toml")
    assert again.chain == CHAIN
    assert found_chain(xr.Dataset(attrs={"channel_map_hash": "a"}), again) == again.chain
    assert found_chain(xr.Dataset(attrs={"channel_map_hash": "b"}), again) == {}


def test_a_throw_that_fails_is_named_where_its_movement_is_predicted() -> None:
    movements = [movement(name, rng=np.random.default_rng(0)) for name in ("a", "b")]
    row = [response(TRUE), replace(response(TRUE), failure="stopped\nearly")]
    assert _failure(movements, np.zeros((1, 2, 3)), row).endswith(": stopped early")
    # One that cannot be predicted at all says nothing of a value.
    unknown = np.stack([np.zeros((1, 3)), np.full((1, 3), np.nan)], axis=1)
    assert _failure(movements, unknown, row) == ""


def test_without_repeats_throws_differ_as_expected() -> None:
    """By the calibration's scatter, or 2 % of friction; by 1 % of a slip level; by 5 ms."""
    items = [movement("m", rng=np.random.default_rng(0))]
    grid, known = SharedBins.of(items), calibration()
    names = ("chair.friction_coefficient", "drive.1.stiffness", "drive.1.saturation_force")
    known = replace(known, parameters=tuple(fitted(name, 2.0, unit="1") for name in names))
    forces = grid.predicted(items, [response(TRUE)], shifts=np.zeros(1))
    model = Model(
        thrown=cast("Misfit", SimpleNamespace(movements=items)),
        grid=grid,
        chain={},
        shifts=np.zeros(1),
        forces=forces,
        slopes=np.stack([forces] * 3),
        failures=("",) * 3,
    )
    for scatter, friction in (({}, 0.02), ({names[0]: 0.03}, 0.03)):
        own = replace(known, scatter=scatter)
        sizes, found = _scatter(model, grid.measured(items), own, [])
        assert sizes == {names[0]: friction, names[2]: 0.01, "onset [s]": 0.005}
        np.testing.assert_allclose(found.own[1], 0.01 * 2.0 * forces)
