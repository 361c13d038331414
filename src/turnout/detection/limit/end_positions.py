"""Detection of a rail that stayed open from drive forces: the gap at sensors and drives at the end.

Objects as large as the limit of each position, and somewhat smaller and larger, hold the rail open
there in the states of the reference case. The bound says with which probability the forces of that
throw differ from a sound one, over the gap that remains.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.core.progress import Pace
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
from turnout.detection.drive_quantities import read_signals, stored_channels
from turnout.detection.limit.bound import probability_of_detection
from turnout.detection.limit.limit_map import SoundThrows, smallest_seen, sound_throws
from turnout.detection.reference import Conditions, reference_study
from turnout.detection.throws import Throws, objects_study
from turnout.panel.load import LoadedPanel
from turnout.study.study import Study
from turnout.study.sweep.read import last_values, open_batches
from turnout.study.sweep.run import throw_studies

Floats = NDArray[np.float64]

ENDS = "ends"
SHARES = (0.5, 0.75, 0.9, 1.0, 1.1, 1.3, 1.6)
"""Sizes of the objects as shares of the limit of their position."""
GAP_STEP, LARGEST_SHARE = 0.1e-3, 1.5
"""Of the gaps at which the result is given [m], and their end as a share of the limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Position:
    """Places at which the end position is judged.

    Attributes
    ----------
    name : str
        Of the sensor or drive.
    at : str
        The same as the place of an object.
    x : float
        [m]
    limit : float
        Gap from which the switch must not be reported closed [m].
    channel : str
        Channel of a dataset that holds the gap there.
    """

    name: str
    at: str
    x: float
    limit: float
    channel: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EndThrows:
    """Throws with objects at the positions.

    Attributes
    ----------
    positions : tuple of Position
    change : ndarray, shape (n_states, n_positions, n_sizes, n_signals, n_times)
        Signal with an object less that without; NaN where there was no room.
    gap : ndarray, shape (n_states, n_positions, n_sizes)
        At the position at the end of the throw [m].
    level : ndarray, shape (n_states,)
        Mean friction coefficient [-].
    """

    positions: tuple[Position, ...]
    change: Floats
    gap: Floats
    level: Floats


def positions_of(panel: LoadedPanel) -> tuple[Position, ...]:
    """Return sensors with their limit, and drives with that of the lock, from the toe on.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [(item.name, item.limit) for item in positions_of(load_panel("uic60-760-1-15"))]
    [('drive 1', 0.005), ('TKK1', 0.013), ('drive 2', 0.005), ('TKK2', 0.013)]
    """
    found = [
        Position(name=name, at=f"sensor {name}", x=item.x, limit=item.limit, channel="sensor_gap")
        for name, item in panel.sensor.items()
    ]
    found += [
        Position(
            name=f"drive {name}", at=f"drive {name}", x=item.x,
            limit=panel.lock.gap_limit, channel="drive_gap",
        )
        for name, item in panel.drive.items()
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda item: item.x))


def ends_study(study: Study, positions: Sequence[Position]) -> Study:
    """Return a study that throws each state with objects at each position."""
    sizes = {item.at: [round(share * item.limit, 5) for share in SHARES] for item in positions}
    made = objects_study(study, sizes)
    channels = (*stored_channels(study.panel), *dict.fromkeys(item.channel for item in positions))
    return replace(
        made, name=f"{study.name}, end positions",
        output=replace(study.output, channels=channels),
    )  # fmt: skip


def throw_ends(
    panel: LoadedPanel | None,
    folder: Path,
    throws: Throws,
    *,
    states: int,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> EndThrows:
    """Throw what is missing of a sweep beside those of `throw_all`, and read it.

    Parameters
    ----------
    panel : LoadedPanel or None
        None for the panel of the reference case.
    folder : Path
        That of `throw_all`.
    throws : Throws
        From there.
    states : int
        The first ones, at most as many as were thrown with objects there.
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts the throws.
    """
    study = reference_study(panel, count=states)
    positions = positions_of(study.panel)
    throw_studies({folder / ENDS: ends_study(study, positions)}, workers=workers, pace=pace)
    found = open_batches(folder / ENDS)
    shape = (states, len(positions), len(SHARES))
    until = slice(None, throws.time[-1] + 1e-9)  # some waited longer for machines
    force = read_signals(found.sel(time=until), throws.signals)
    force = force.reshape(*shape, *force.shape[1:])
    used = throws.states < states
    rows = throws.states[used]
    kept = np.flatnonzero(np.isfinite(throws.sound[rows]).all(axis=(1, 2)))
    return EndThrows(
        positions=positions,
        change=(force[rows] - throws.sound[rows][:, np.newaxis, np.newaxis])[kept],
        gap=_end_gaps(found, positions, shape)[rows][kept],
        level=throws.level[rows][kept],
    )


def _end_gaps(
    dataset: xr.Dataset, positions: Sequence[Position], shape: tuple[int, int, int]
) -> Floats:
    """Return the last gap of each throw at the position of its object."""
    found = np.empty(shape)
    for number, item in enumerate(positions):
        dimension = item.channel.removesuffix("_gap")
        name = item.name.removeprefix("drive ") if dimension == "drive" else item.name
        last = last_values(dataset[item.channel].sel({dimension: name}))
        found[:, number] = last.reshape(shape)[:, number]
    return found


def end_position_map(
    throws: Throws, ends: EndThrows, conditions: Conditions, *, closing: float
) -> xr.Dataset:
    """Return the probability that forces reveal a gap at each position.

    Parameters
    ----------
    throws : Throws
        Of the population, from `throw_all`.
    ends : EndThrows
        From `throw_ends`.
    conditions : Conditions
        Discrepancy, noise, history, rate of false alarms.
    closing : float
        When the last closing begins [s].

    Returns
    -------
    xarray.Dataset
        `end_pod` over channel, position and end gap; `end_pod_at_limit`; `revealed_gap`, from
        which nine of ten are revealed, NaN where none is.
    """
    with one_blas_thread():
        known = sound_throws(throws, conditions, closing=closing)
        pod = np.stack(
            [_over_gap(ends, known, used, conditions) for used in known.channels.values()]
        )
    gaps = _gap_grid(ends.positions)
    limits = np.array([item.limit for item in ends.positions])
    at_limit = np.array(
        [
            [np.interp(limit, gaps, row) for limit, row in zip(limits, one, strict=True)]
            for one in pod
        ]
    )
    largest = LARGEST_SHARE * limits
    seen = smallest_seen(pod, gaps)
    dims = ("channel", "position")
    dataset = xr.Dataset(
        {
            "end_pod": ((*dims, "end_gap"), pod),
            "end_pod_at_limit": (dims, at_limit),
            "revealed_gap": (dims, np.where(seen <= largest, seen, np.nan)),
            "gap_limit": (("position",), limits),
        },
        {
            "channel": list(known.channels),
            "position": [item.name for item in ends.positions],
            "end_gap": gaps,
        },
        {"end_states": len(ends.level)},
    )
    for name, (units, long_name) in UNITS.items():
        dataset[name].attrs |= {"units": units, "long_name": long_name}
    return dataset


UNITS = {
    "end_pod": ("1", "probability that forces reveal the gap"),
    "end_pod_at_limit": ("1", "probability that forces reveal a gap at its limit"),
    "revealed_gap": ("m", "gap from which nine of ten are revealed"),
    "gap_limit": ("m", "gap from which the switch must not be reported closed"),
    "end_gap": ("m", "gap at the end of the throw"),
}


def _gap_grid(positions: Sequence[Position]) -> Floats:
    top = LARGEST_SHARE * max(item.limit for item in positions)
    return np.arange(0.0, top + 0.5 * GAP_STEP, GAP_STEP)


def _over_gap(
    ends: EndThrows, known: SoundThrows, used: NDArray[np.intp], conditions: Conditions
) -> Floats:
    """Return the probability of detection over the end gap, shape (n_positions, n_gaps).

    Between thrown sizes the index of detection is interpolated over the gap that remained.
    """
    signatures = known.features(ends.change)[..., used]
    nearest = known.nearest(ends.level)
    gaps = _gap_grid(ends.positions)
    index = np.zeros((*ends.gap.shape[:2], gaps.size))
    roots = [
        np.linalg.cholesky(known.covariances[level][np.ix_(used, used)])
        for level in range(len(known.levels))
    ]
    for state, level in enumerate(nearest):
        for place in range(len(ends.positions)):
            given = np.isfinite(signatures[state, place]).all(axis=-1)
            white = solve_triangular(roots[level], signatures[state, place, given].T, lower=True)
            along = ends.gap[state, place, given]
            order = np.argsort(along)
            height = np.linalg.norm(white, axis=0)[order]
            index[state, place] = np.interp(gaps, along[order], height, left=0.0)
    pod = probability_of_detection(index, false_alarm_rate=conditions.false_alarm_rate)
    return np.asarray(pod.mean(axis=0))


def end_rows(dataset: xr.Dataset) -> list[Mapping[str, float | str | None]]:
    """Return limit, probability at the limit and revealed gap of each position and channel."""
    rows: list[Mapping[str, float | str | None]] = []
    for position in dataset["position"].to_numpy().tolist():
        for channel in dataset["channel"].to_numpy().tolist():
            one = dataset.sel(position=position, channel=channel)
            revealed = float(one["revealed_gap"])
            rows.append(
                {
                    "position": str(position),
                    "channel": str(channel),
                    "gap_limit": float(one["gap_limit"]),
                    "end_pod_at_limit": float(one["end_pod_at_limit"]),
                    "revealed_gap": revealed if np.isfinite(revealed) else None,
                }
            )
    return rows
