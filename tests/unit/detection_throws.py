"""Throws of a toy switch, quick to make: forces that are linear in everything."""

from functools import cache

import numpy as np
import xarray as xr

from turnout.detection.limit.limit_map import limit_map
from turnout.detection.reference import Conditions
from turnout.detection.signal_discrepancy import Signal, forces_only
from turnout.detection.throws import Throws

CLOSING = 0.8


@cache
def toy_map() -> xr.Dataset:
    """Return the map of these throws under the usual conditions; no test may change it."""
    return limit_map(toy_throws(), Conditions(), closing=CLOSING)


def toy_throws(*, states: int = 60, seed: int = 1, drives: int = 2) -> Throws:
    """Two places where objects change the closing forces by 100 N and 400 N a millimetre."""
    rng = np.random.default_rng(seed)
    count, time = 600, np.arange(0.0, 1.6, 0.008)
    level, adjustment = rng.uniform(0.1, 0.5, count), rng.uniform(-1.0, 1.0, count)
    closing = (time > CLOSING).astype(float)
    sound = 3000.0 * level[:, None, None] + 200.0 * adjustment[:, None, None] * closing
    sound = np.repeat(sound, drives, axis=1) + 20.0 * rng.normal(size=(count, drives, 1))
    sizes = np.array([[1e-3, 3e-3, 9e-3], [2e-3, 4e-3, 10e-3]])
    gap = np.column_stack([np.full(states, 0.5e-3), rng.uniform(1e-3, 2e-3, states)])
    deep = np.maximum(sizes - gap[..., None], 0.0)
    slope = np.array([100e3, 400e3])[None, :, None]
    change = np.broadcast_to((deep * slope)[..., None, None] * closing, (*deep.shape, drives, 200))
    return Throws(
        sound=sound,
        time=time,
        switch=adjustment[:, None],
        level=level,
        states=np.arange(states),
        change=np.array(change),
        force_peak=1e6 * deep,
        gap=gap,
        places=("drive 1", "sleeper 1"),
        x=np.array([0.3, 0.6]),
        sizes=sizes,
        errors=forces_only(np.full(drives, 3000.0), count=time.size),
        signals=tuple(Signal(quantity="force", drive=str(n + 1)) for n in range(drives)),
    )
