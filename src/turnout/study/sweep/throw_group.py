"""Signals of many throws at once: forces, markers, slips and gaps over time.

Arrays of a single throw are so small that calling NumPy takes longer than what it does, so signals
of throws that have the instants before and after each onset in common lie in one array, a throw
after another.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.measurement.chain.recorder import PERFECT, Recorder
from turnout.mechanism.mechanism import LawIndex
from turnout.panel.load import LoadedPanel
from turnout.panel.markers import marker_offsets
from turnout.solver.driven import Duty
from turnout.solver.record import Watched
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
from turnout.throw.slip import TIME_TOLERANCE, Span, late_movements

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]
Variables = dict[str, Channel]

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
        """Return where among the instants its movements lie, and which of them are over."""
        time, starts = self.watched.time, np.array([item.start for item in self.moved])
        onsets = [time.searchsorted(starts - early).tobytes() for early in (0.0, TIME_TOLERANCE)]
        rests = [part.tobytes() for part in (self.watched.rests, *self.at_rest())]
        ways = [(item.name, item.to, item.unfinished) for item in self.moved]
        return (*ways, *self.late(), time.size, float(time[-1]), *onsets, *rests)


@dataclass(frozen=True, slots=True, eq=False)
class AlikeThrows:
    """Signals of n throws with the same instants and numbers of movements, drives and sensors.

    Attributes
    ----------
    runs : sequence of ThrowSignals
        The throws; between the same instants their movements begin, and are over or not.
    time : ndarray, shape (n_times,)
        Every instant that the solver kept [s].
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
    drive_gap, sensor_gap : ndarray of float32, shape (n, n_drives, n_kept), (n, n_sensors, n_kept)
        At the rate of the study; without instants where that is not wanted [m].
    rests : ndarray of int, shape (n_rests,)
        Numbers of the last instants before a next movement or the removal of an object, and of the
        last one.
    rest_gaps : tuple of ndarray, shapes (n, n_drives, n_rests) and (n, n_sensors, n_rests)
        Gaps at drives and sensors at these [m].
    gap_limits : tuple of ndarray, shapes (n, n_drives) and (n, n_sensors)
        Their limits [m].
    """

    runs: Sequence[ThrowSignals]
    time: Floats
    force: Floats
    recorded_force: Floats
    displacement: Floats
    slipping: Flags
    slip_limits: Floats
    on_objects: Variables
    drive_gap: NDArray[np.float32]
    sensor_gap: NDArray[np.float32]
    rests: NDArray[np.int64]
    rest_gaps: tuple[Floats, Floats]
    gap_limits: tuple[Floats, Floats]


def group_by_layout(runs: Sequence[ThrowSignals]) -> list[list[int]]:
    """Return the numbers of throws whose signals fit in one array, group by group."""
    found: dict[tuple[object, ...], list[int]] = {}
    for number, run in enumerate(runs):
        panel, seen = run.panel, run.watched.seen
        lock = (panel.lock.rule, panel.schedule.starts, panel.instrumented_rail, *panel.rail)
        counts = (len(panel.drive), len(panel.sensor), run.watched.stride)
        objects: object = run.watched.effort.shape
        if len(run.index.object_parts) > 1:
            objects = tuple(map(tuple, object_rows(run.index)))
        own = [(name, *v.shape) for name, (_, v) in (*run.kept.items(), *run.labels.items())]
        key = (run.layout(), seen.shape, counts, objects, lock, *own)
        found.setdefault(key, []).append(number)
    return list(found.values())


def lay_together(runs: Sequence[ThrowSignals]) -> AlikeThrows:
    """Return the signals of throws that are alike."""
    panel, time, stride = runs[0].panel, runs[0].watched.time, runs[0].watched.stride
    count = len(panel.drive)
    force = np.empty((len(runs), count, time.size))
    on_objects = np.empty((len(runs), len(runs[0].watched.laws) - count, time.size))
    for number, run in enumerate(runs):
        effort = run.watched.effort  # of drives, then of objects
        np.subtract(0.0, effort[:count], out=force[number])  # no negative zeros of free drives
        on_objects[number] = effort[count:]
    slip_limits = np.array([slip_forces(run.panel) for run in runs])
    slipping = is_slipping(force, slip_limits)
    for flags, run in zip(slipping, runs, strict=True):
        if run.clutches is not None:
            drives, slip = run.clutches
            flags[drives] = slip
    recorded = force
    if any(run.recorder != PERFECT for run in runs):
        recorded = np.array(
            [run.recorder.recorded(time, one) for one, run in zip(force, runs, strict=True)]
        )
    kept = time[::stride][: runs[0].watched.seen.shape[0]]
    gaps = split_gaps_of(panel, [run.watched.seen.T for run in runs], kept, kind=np.float32)
    rests = runs[0].watched.rests
    resting = [run.watched.seen_rests.T for run in runs]
    rest_gaps = split_gaps_of(panel, resting, time[rests], kind=np.float64)
    limits = [state_limits(run.panel) for run in runs]
    return AlikeThrows(
        runs=runs,
        time=time,
        force=force,
        recorded_force=recorded,
        displacement=_displacements(runs),
        slipping=slipping,
        slip_limits=slip_limits,
        on_objects=object_channels(runs[0].index, on_objects),
        drive_gap=gaps[0],
        sensor_gap=gaps[1],
        rests=rests,
        rest_gaps=rest_gaps,
        gap_limits=(np.array([row[1] for row in limits]), np.array([row[2] for row in limits])),
    )


def _displacements(runs: Sequence[ThrowSignals]) -> Floats:
    """Return the positions of the markers of some throws, once if all share them [m].

    Throws have inputs in the same memory only where the offsets of their markers are the same.
    """
    all_inputs = [run.watched.inputs for run in runs]
    if len({id(own if own.base is None else own.base) for own in all_inputs}) == 1:
        runs = runs[:1]
    offsets = np.array([marker_offsets(run.panel) for run in runs])
    inputs = np.array([run.watched.inputs.T for run in runs])
    found: Floats = inputs - offsets[..., np.newaxis]
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
        "drive_gap": (drive, throws.drive_gap, 1),
        "sensor_gap": (("sensor", "time"), throws.sensor_gap, 1),
    }
    stored = {
        name: (dims, _of_each(single_precision(values[..., ::step]), len(throws.runs)))
        for name, (dims, values, step) in made.items()
        if name in wanted and values.size
    }
    for name, (dims, _) in throws.runs[0].kept.items():
        stored[name] = (dims, np.array([run.kept[name][1] for run in throws.runs]))
    return stored


def _of_each(values: NDArray[np.generic], count: int) -> NDArray[np.generic]:
    """Return values of each throw, of which there may be one for all."""
    return np.broadcast_to(values, (count, *values.shape[1:]))


def single_precision(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return numbers in single precision; states and logical values stay."""
    if values.dtype.kind != "f":
        return values.copy()
    return values.astype(np.float32, order="C", copy=False)
