"""Recordings of simulated throws that several tests use, and what can happen to them."""

from functools import cache

import numpy as np
import xarray as xr
from tests.unit.simulated import sb2_panel

from turnout.measurement.campaign.find_throws import FoundThrow, find_throws
from turnout.measurement.quality.throw_faults import ForceProfile, early_profile, typical_profile
from turnout.panel.foreign_object import ForeignObject
from turnout.study.virtual.disturbance import add_disturbance
from turnout.study.virtual.record_throw import record_throw
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

FIELDS = ("drive_force", "drive_displacement", "drive_slipping", "object_force", "contact_time")


@cache
def run(size: float = 0.0, place: str = "sleeper 6", friction: float = 0.4) -> xr.Dataset:
    """Simulate a throw; no test may change it."""
    panel = sb2_panel().with_overrides({"chair.friction_coefficient": friction})
    foreign = ForeignObject(size, place) if size else None
    return simulate(panel, foreign_object=foreign, save=Save(fields=FIELDS))


@cache
def clean(size: float = 0.0, direction: str = "closing", friction: float = 0.4) -> xr.Dataset:
    """What perfect transducers record of it."""
    return record_throw(run(size, friction=friction), direction=direction)


def noisy(
    seed: int, size: float = 0.0, direction: str = "closing", friction: float = 0.4
) -> xr.Dataset:
    return add_disturbance(clean(size, direction, friction), rng=np.random.default_rng(seed))


def only(dataset: xr.Dataset) -> FoundThrow:
    """Return the one throw of a recording."""
    (throw,) = find_throws(dataset)
    return throw


@cache
def typical(direction: str = "closing") -> ForceProfile:
    """How three other throws begin."""
    profiles = []
    for seed in (11, 12, 13):
        dataset = noisy(seed, direction=direction)
        profile = early_profile(dataset, only(dataset))
        assert profile is not None
        profiles.append(profile)
    found = typical_profile(profiles)
    assert found is not None
    return found


def changed(dataset: xr.Dataset, channel: str, values: np.ndarray) -> xr.Dataset:
    """Put other samples into a channel: "drive_force 2"."""
    name, _, drive = channel.partition(" ")
    other = dataset[name].values.copy()
    if drive:
        other[dataset["drive"].values.tolist().index(drive)] = values
    else:
        other = values
    return dataset.assign({name: (dataset[name].dims, other)})


def samples(dataset: xr.Dataset, channel: str) -> np.ndarray:
    name, _, drive = channel.partition(" ")
    values = dataset[name].sel(drive=drive).values if drive else dataset[name].values
    return np.array(values)
