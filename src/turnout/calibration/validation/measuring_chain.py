"""Gains, zeros and clock of a measuring chain as a calibration found them, in predictions."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.result import Calibration
from turnout.calibration.sensors import chain_key
from turnout.calibration.shared import CLOCK, GAIN, ZERO
from turnout.calibration.validation.grid import DRIVE, OBJECT, Grid

Floats = NDArray[np.float64]
OTHER_CHAIN = (
    "gains, zeros and clock of the calibration are of another channel map, and not applied"
)


def found_chain(dataset: xr.Dataset, calibration: Calibration) -> Mapping[str, tuple[float, float]]:
    """Return what is known of the chain of a campaign: nothing where it is another one.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`.
    calibration : Calibration
        With value and deviation of each gain, zero and of the clock.
    """
    return calibration.chain if is_of_chain(dataset, calibration) else {}


def is_of_chain(dataset: xr.Dataset, calibration: Calibration) -> bool:
    """Return whether a campaign was measured through the chain that was calibrated to."""
    return str(dataset.attrs.get("channel_map_hash", "")) == calibration.about.get(
        "channel_map_hash", ""
    )


def through_chain(
    forces: Floats, later: Floats, grid: Grid, chain: Mapping[str, tuple[float, float]]
) -> Floats:
    r"""Return forces as the chain of a campaign shows them.

    .. math:: F_{seen} = (1 + g) F - c \, t \dot F + z

    with gain `g` and zero `z` of each channel, and the share `c` by which seconds are too short.

    Parameters
    ----------
    forces, later : ndarray, shape (n_channels, n_movements, n_times)
        Simulated [N], and their change with a later onset, :math:`-\dot F` [N/s].
    grid : Grid
        With channels and times from the onset.
    chain : mapping of str to (float, float)
        From `found_chain`.
    """
    gain, zero = _of_channels(grid, chain, GAIN)[0], _of_channels(grid, chain, ZERO)[0]
    clock = chain.get(CLOCK, (0.0, 0.0))[0]
    return np.asarray((1.0 + gain) * forces + clock * grid.time * later + zero)


def chain_variance(
    forces: Floats, later: Floats, grid: Grid, chain: Mapping[str, tuple[float, float]]
) -> Floats:
    """Return the variance of forces by what is not known of the chain [N^2]; as `through_chain`."""
    gain, zero = _of_channels(grid, chain, GAIN)[1], _of_channels(grid, chain, ZERO)[1]
    clock = chain.get(CLOCK, (0.0, 0.0))[1]
    return np.asarray((gain * forces) ** 2 + (clock * grid.time * later) ** 2 + zero**2)


def chain_directions(
    forces: Floats, later: Floats, grid: Grid, chain: Mapping[str, tuple[float, float]]
) -> Floats:
    """Return what one deviation of gains, zeros and clock makes of forces [N]; as `through_chain`.

    Shape (3, n_channels, n_movements, n_times). Each channel has gain and zero of its own, so that
    sums over channels of these mean nothing.
    """
    gain, zero = _of_channels(grid, chain, GAIN)[1], _of_channels(grid, chain, ZERO)[1]
    clock = chain.get(CLOCK, (0.0, 0.0))[1]
    zeros = np.broadcast_to(zero, forces.shape)
    return np.stack([gain * forces, clock * grid.time * later, zeros])


def _of_channels(
    grid: Grid, chain: Mapping[str, tuple[float, float]], kind: str
) -> tuple[Floats, Floats]:
    """Return values and deviations of one kind, shape (n_channels, 1, 1); zero where none is."""
    keys = [
        chain_key(kind, "object_force", "")
        if name == OBJECT
        else chain_key(kind, "drive_force", name.removeprefix(DRIVE))
        for name in grid.channels
    ]
    pairs = np.array([chain.get(key, (0.0, 0.0)) for key in keys], dtype=np.float64)
    return pairs[:, 0].reshape(-1, 1, 1), pairs[:, 1].reshape(-1, 1, 1)
