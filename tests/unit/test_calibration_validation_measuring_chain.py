"""What a calibration found of gains, zeros and the clock is in the predictions of a validation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from tests.unit.calibrations import calibration
from tests.unit.test_calibration_fit import TRUE, movement, response

from turnout.calibration.result import load_calibration
from turnout.calibration.validation.seen_throws import (
    SharedBins,
    chain_directions,
    found_chain,
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
    grid = SharedBins.of([item])
    made = response(TRUE)
    plain = grid.predicted([item], [made], shifts=np.zeros(1))
    later = -np.gradient(plain, 0.02, axis=2)
    seen = through_chain(plain, later, grid, CHAIN)
    # Seconds that are too short by 0.1 % show a force of t (1 - 0.1 %) at t.
    time, onset = made.time, made.onsets["closing"]
    slow = np.interp(onset + (time - onset) * (1.0 - 1e-3), time, made.drive_force["1"])
    exact = grid.predicted([item], [replace(made, drive_force={"1": slow})], shifts=np.zeros(1))
    # To first order, which a kink is not: the object is touched at 1.5 s.
    smooth = np.abs(grid.time - 1.5) > 0.04
    np.testing.assert_allclose(seen[..., smooth], 1.012 * exact[..., smooth] + 5.0, atol=1.0)
    assert np.abs(1.012 * exact + 5.0 - plain).max() > 60.0
    np.testing.assert_array_equal(through_chain(plain, later, grid, {}), plain)
    known = (chain_directions(plain, later, grid, CHAIN) ** 2).sum(axis=0)
    rest = (3e-4 * plain) ** 2 + 4.0
    np.testing.assert_allclose(known, rest, rtol=0.02, atol=0.02 * rest.max())
    assert not chain_directions(plain, later, grid, {}).any()


def test_a_force_is_seen_with_a_share_of_each_other_one() -> None:
    item = movement("m", rng=np.random.default_rng(0))
    grid = replace(SharedBins.of([item]), channels=("drive 1", "drive 2", "object"))
    plain = np.random.default_rng(1).uniform(-6e3, 6e3, (3, 1, grid.time.size))
    chain = {
        "cross-talk drive_force.1 drive_force.2": (0.02, 1e-3),
        "cross-talk object_force drive_force.1": (-0.01, 2e-3),
    }
    first, second, third = plain
    seen = through_chain(plain, 0.0 * plain, grid, chain)
    np.testing.assert_allclose(seen, [first + 0.02 * second, second, third - 0.01 * first])
    known = (chain_directions(plain, 0.0 * plain, grid, chain) ** 2).sum(axis=0)
    nothing = np.zeros_like(first)
    np.testing.assert_allclose(known, [(1e-3 * second) ** 2, nothing, (2e-3 * first) ** 2])


def test_a_chain_is_kept_with_the_values_and_is_that_of_one_channel_map(tmp_path: Path) -> None:
    known = replace(calibration(), chain=CHAIN, about={"channel_map_hash": "a"})
    known.save(tmp_path / "c.toml")
    again = load_calibration(tmp_path / "c.toml")
    assert again.chain == CHAIN
    assert found_chain(xr.Dataset(attrs={"channel_map_hash": "a"}), again) == again.chain
    assert found_chain(xr.Dataset(attrs={"channel_map_hash": "b"}), again) == {}
