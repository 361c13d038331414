"""Signals of many throws at once: forces, markers, slips and gaps over time.

Arrays of a single throw are so small that calling NumPy takes longer than what it does, so signals
of throws with the same movements lie in one array, a throw after another. Each has instants of its
own number, which movements that wait for machines may change.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from turnout.measurement.chain.recorder import PERFECT, Recorder
from turnout.mechanism.mechanism import LawIndex
from turnout.panel.load import LoadedPanel
from turnout.panel.markers import marker_offsets
from turnout.solver.driven import Duty
from turnout.solver.record import TIME_TOLERANCE, Watched
from turnout.throw.flangeway import DistancesFound, MovementEnds
from turnout.throw.gaps import split_gaps_of
from turnout.throw.lock_and_control import state_limits
from turnout.throw.route import DirectedMovement
from turnout.throw.signals import (
    Channel,
    is_slipping,
    object_channels,
    object_rows,
    slip_forces,
)
from turnout.throw.slip import Span, late_movements

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]
Variables = dict[str, Channel]
AnyArray = TypeVar("AnyArray", Ints, Floats)

GAPS = ("drive_gap", "sensor_gap")
OF_DRIVES = ("drive_force", "drive_displacement", "drive_slipping")
OF_OBJECTS = ("object_force", "single_object_force")
STACKED_CHANNELS = (*OF_DRIVES, *OF_OBJECTS, *GAPS)
"""Channels that are made for many throws at once."""


@dataclass(frozen=True, slots=True, eq=False)
class ThrowSignals:
    """Signals taken from a complete throw while its rails and its history are there.

    Attributes
    ----------
    panel : LoadedPanel
        Panel that was thrown.
    index : LawIndex
        Laws of its mechanism, which is not kept: rails of its own take megabytes.
    disappears : ndarray, shape (n_laws,)
        When each law ends to act [s].
    watched : Watched
        Forces of drives and objects and marker positions at every instant that the solver kept,
        and open distances at the rate of the study.
    labels : dict
        Remains of objects, and labels of machines.
    ends : MovementEnds or DistancesFound, optional
        Inputs of flangeway and gauge at the ends of the movements.
    clutches : tuple of list and ndarray, optional
        The drives that are machines, and when their clutches slip, shape (n_machines, n_times).
    recorder : Recorder
        Of forces.
    kept : dict
        Further histories at the rate of the study.
    moved : tuple of Throw
        The movements as they were made.
    duties : tuple of Duty
        Movements of its machines on their commands.
    object_rails : tuple of str
        The rail of each object.
    """

    panel: LoadedPanel
    index: LawIndex
    disappears: Floats
    watched: Watched
    labels: Variables
    ends: MovementEnds | DistancesFound | None
    clutches: tuple[list[int], Flags] | None
    recorder: Recorder
    kept: Variables
    moved: tuple[DirectedMovement, ...]
    duties: tuple[Duty, ...] = ()
    object_rails: tuple[str, ...] = ()

    @property
    def spans(self) -> tuple[Span, ...]:
        """The movements with their directions."""
        return tuple(Span(item.name, item.to, item.start, item.end) for item in self.moved)

    @property
    def periods(self) -> list[tuple[Span | None, float]]:
        """Each movement with the onset of the next one [s]; one of the whole run without any."""
        return list(zip(self.spans, [item.until for item in self.moved], strict=True)) or [
            (None, math.inf)
        ]

    def late(self) -> list[bool]:
        """Return for each movement whether it is not over at its end; one value without any."""
        machines = [name for name, drive in self.panel.drive.items() if drive.machine is not None]
        end = float(self.watched.time[-1])
        late = late_movements(self.periods, end=end, made=self.duties, machines=machines)
        return [span in late for span, _ in self.periods]

    def at_rest(self) -> tuple[Ints, Ints]:
        """Return which of the rests are at rest, and the number of the movement before each.

        An object may be taken out while a rail moves.
        """
        times = self.watched.time[self.watched.rests]
        starts, ends = np.array([(i.start, i.end) for i in self.moved] or [(0.0, 0.0)]).T
        after = np.maximum(np.searchsorted(starts, times + TIME_TOLERANCE, side="right") - 1, 0)
        last = np.append(np.diff(after) > 0, True)
        found = np.flatnonzero(last | (times >= ends[after] - TIME_TOLERANCE))
        return found, after[found]

    def layout(self) -> tuple[object, ...]:
        """Return its movements, which of them are over, and which of its rests are at rest."""
        rests = [part.tobytes() for part in self.at_rest()]
        ways = [(item.name, item.to, item.unfinished) for item in self.moved]
        return (*ways, *self.late(), self.watched.rests.size, *rests)


@dataclass(frozen=True, slots=True, eq=False)
class AlikeThrows:
    """Signals of n throws with the same movements, drives and sensors.

    Those of throws with fewer instants are filled up: numbers with NaN, flags with False.

    Attributes
    ----------
    runs : sequence of ThrowSignals
        The throws; their movements are over or not.
    time : ndarray, shape (n_times,)
        Every instant that the solver kept of the longest one [s].
    sizes : ndarray of int, shape (n,)
        Instants of each throw.
    starts : ndarray, shape (n, n_movements)
        Onsets of the movements [s].
    force, recorded_force : ndarray, shape (n, n_drives, n_times)
        Of the drives, true and as recorded [N].
    displacement : ndarray, shape (n, n_drives, n_times) or (1, n_drives, n_times)
        Of their markers; one for all throws where they share it [m].
    slipping : ndarray of bool, shape (n, n_drives, n_times)
        Whether drives slip.
    slip_limits : ndarray, shape (n, n_drives)
        Forces at which they do [N].
    on_objects : dict
        Forces on the objects: their dimensions, and values with throws first.
    gaps : tuple of ndarray of float32, shapes (n, n_drives, n_kept) and (n, n_sensors, n_kept)
        At drives and sensors, at the rate of the study; no instants where that is not wanted [m].
    rests : ndarray of int, shape (n, n_rests)
        Numbers of the last instants before a next movement or the removal of an object, and of the
        last one.
    rest_gaps : tuple of ndarray, shapes (n, n_drives, n_rests) and (n, n_sensors, n_rests)
        Gaps at drives and sensors at these [m].
    gap_limits : tuple of ndarray, shapes (n, n_drives) and (n, n_sensors)
        Their limits [m].
    """

    runs: Sequence[ThrowSignals]
    time: Floats
    sizes: Ints
    starts: Floats
    force: Floats
    recorded_force: Floats
    displacement: Floats
    slipping: Flags
    slip_limits: Floats
    on_objects: Variables
    gaps: tuple[NDArray[np.float32], NDArray[np.float32]]
    rests: Ints
    rest_gaps: tuple[Floats, Floats]
    gap_limits: tuple[Floats, Floats]

    def instants(self, starts: Floats) -> Ints:
        """Return the first instants from some times of each throw on, at most its number of them.

        Times have the shape (n, n_times) [s].
        """
        return np.minimum(np.searchsorted(self.time, starts), self.sizes[:, np.newaxis])

    def of_rows(self, values: AnyArray) -> AnyArray:
        """Return values of each throw, shape (n, ...), for each of its drives."""
        return cast("AnyArray", np.repeat(values, self.force.shape[1], axis=0))


def group_by_layout(runs: Sequence[ThrowSignals]) -> list[list[int]]:
    """Return the numbers of throws whose signals fit in one array, group by group."""
    found: dict[tuple[object, ...], list[int]] = {}
    for number, run in enumerate(runs):
        panel, watched = run.panel, run.watched
        lock = (panel.lock.rule, panel.schedule.starts, panel.instrumented_rail, *panel.rail)
        counts = (len(panel.drive), len(panel.sensor), watched.stride, watched.seen.size > 0)
        objects: object = len(watched.effort)
        if len(run.index.object_parts) > 1:
            objects = tuple(map(tuple, object_rows(run.index)))
        own = [
            (name, *v.shape[: v.ndim - ("time" in dims)])
            for name, (dims, v) in (*run.kept.items(), *run.labels.items())
        ]
        key = (run.layout(), counts, objects, lock, *own)
        found.setdefault(key, []).append(number)
    return list(found.values())


def lay_together(runs: Sequence[ThrowSignals]) -> AlikeThrows:
    """Return the signals of throws that are alike."""
    panel, stride = runs[0].panel, runs[0].watched.stride
    time = max((run.watched.time for run in runs), key=len)
    sizes = np.array([run.watched.time.size for run in runs])
    count = len(panel.drive)
    force = np.empty((len(runs), count, time.size))
    on_objects = np.empty((len(runs), len(runs[0].watched.laws) - count, time.size))
    for number, (run, size) in enumerate(zip(runs, sizes.tolist(), strict=True)):
        effort = run.watched.effort  # of drives, then of objects
        # no negative zeros of free drives
        np.subtract(0.0, effort[:count], out=force[number, :, :size])
        on_objects[number, :, :size] = effort[count:]
        force[number, :, size:] = on_objects[number, :, size:] = np.nan
    slip_limits = np.array([slip_forces(run.panel) for run in runs])
    slipping = is_slipping(force, slip_limits)
    for flags, run, size in zip(slipping, runs, sizes.tolist(), strict=True):
        if run.clutches is not None:
            drives, slip = run.clutches
            flags[drives, :size] = slip
    recorded = force
    if any(run.recorder != PERFECT for run in runs):
        recorded = force.copy()
        for one, run, size in zip(recorded, runs, sizes.tolist(), strict=True):
            one[:, :size] = run.recorder.recorded(run.watched.time, one[:, :size])
    starts = np.array([[item.start for item in run.moved] for run in runs])
    rests = np.array([run.watched.rests for run in runs])
    limits = [state_limits(run.panel) for run in runs]
    late_by = starts - TIME_TOLERANCE
    seen = [run.watched.seen.T for run in runs], np.searchsorted(time[::stride], late_by)
    resting = [run.watched.seen_rests.T for run in runs]
    rest_starts = (time[rests][:, np.newaxis] < late_by[..., np.newaxis]).sum(axis=-1)
    return AlikeThrows(
        runs=runs,
        time=time,
        sizes=sizes,
        starts=starts,
        force=force,
        recorded_force=recorded,
        displacement=_displacements(runs, time.size),
        slipping=slipping,
        slip_limits=slip_limits,
        on_objects=object_channels(runs[0].index, on_objects),
        gaps=split_gaps_of(panel, *seen, kind=np.float32),
        rests=rests,
        rest_gaps=split_gaps_of(panel, resting, rest_starts, kind=np.float64),
        gap_limits=(np.array([row[1] for row in limits]), np.array([row[2] for row in limits])),
    )


def _displacements(runs: Sequence[ThrowSignals], size: int) -> Floats:
    """Return the positions of the markers of some throws, once if all share them [m].

    Throws have inputs in the same memory only where the offsets of their markers are the same.
    """
    all_inputs = [run.watched.inputs for run in runs]
    if len({id(own if own.base is None else own.base) for own in all_inputs}) == 1:
        runs, all_inputs = runs[:1], all_inputs[:1]
    offsets = np.array([marker_offsets(run.panel) for run in runs])
    found = np.full((len(runs), offsets.shape[1], size), np.nan)
    for own, inputs in zip(found, all_inputs, strict=True):
        own[:, : len(inputs)] = inputs.T
    found -= offsets[..., np.newaxis]
    return found


def kept_histories(throws: AlikeThrows, wanted: Sequence[str]) -> Variables:
    """Return the histories that are stored of some throws, in single precision, throws first.

    Parameters
    ----------
    throws : AlikeThrows
        The throws.
    wanted : sequence of str
        Names of channels.
    """
    drive, stride = ("drive", "time"), throws.runs[0].watched.stride
    made: dict[str, tuple[tuple[str, ...], NDArray[np.generic], int]] = {
        "drive_force": (drive, throws.recorded_force, stride),
        "drive_displacement": (drive, throws.displacement, stride),
        "drive_slipping": (drive, throws.slipping, stride),
        **{name: (dims, values, stride) for name, (dims, values) in throws.on_objects.items()},
        "drive_gap": (drive, throws.gaps[0], 1),
        "sensor_gap": (("sensor", "time"), throws.gaps[1], 1),
    }
    stored = {
        name: (dims, _of_each(single_precision(values[..., ::step]), len(throws.runs)))
        for name, (dims, values, step) in made.items()
        if name in wanted and values.size
    }
    for name, (dims, _) in throws.runs[0].kept.items():
        stored[name] = (dims, _filled_up([run.kept[name][1] for run in throws.runs]))
    return stored


def _filled_up(values: Sequence[NDArray[np.generic]]) -> NDArray[np.generic]:
    """Return values of each throw in one array, the shorter ones filled up along the last axis."""
    sizes = [one.shape[-1] for one in values]
    if min(sizes) == max(sizes):
        return np.array(values)
    found = np.zeros((len(values), *values[0].shape[:-1], max(sizes)), values[0].dtype)
    for own, one in zip(found, values, strict=True):
        own[..., : one.shape[-1]] = one
    return found


def _of_each(values: NDArray[np.generic], count: int) -> NDArray[np.generic]:
    """Return values of each throw, of which there may be one for all."""
    return np.broadcast_to(values, (count, *values.shape[1:]))


def single_precision(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return numbers in single precision; states and logical values stay."""
    if values.dtype.kind != "f":
        return values.copy()
    return values.astype(np.float32, order="C", copy=False)
