"""Quantities that a sweep takes from a throw while its history is there.

Where gaps, forces and markers alone are wanted, the throw is *watched*: the solver keeps the forces
of drives and objects at every instant and the gaps at the rate of the study, and only the ends of
the movements whole. Other channels need the whole history.
"""

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.measurement.chain.recorder import Recorder, clocked
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.load import LoadedPanel
from turnout.solver.integration import History
from turnout.solver.record import SaveAt, Watched, rest_instants
from turnout.study.study import Study
from turnout.study.sweep.throw_group import (
    GAPS,
    OF_DRIVES,
    STACKED_CHANNELS,
    ThrowSignals,
    single_precision,
)
from turnout.throw.dataset import response_channels
from turnout.throw.drives import (
    duties,
    machine_labels,
    machine_signals,
    machine_slips,
    marker_ends,
    moved_throws,
    needs_powers,
)
from turnout.throw.gaps import gaps_over_time, watched_gaps
from turnout.throw.lock_and_control import distance_ends
from turnout.throw.recovery import Motion, recover_motion
from turnout.throw.route import DirectedMovement, throws
from turnout.throw.save import Save
from turnout.throw.signals import Channel, object_memory
from turnout.throw.simulate import Solved

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Variables = dict[str, Channel]

OF_MACHINES = (
    *("drive_current", "drive_voltage", "drive_power", "drive_apparent_power"),
    *("motor_speed", "clutch_slip", "drive_state"),
)
WATCHED = (*OF_DRIVES, "object_force", *GAPS, *OF_MACHINES)
"""Channels that a watched throw gives."""


def save_at_of(study: Study, panel: LoadedPanel) -> Callable[[Mechanism], SaveAt] | None:
    """Return what is saved of a throw of a mechanism; None if its whole history is needed."""
    if not {*study.output.channels} <= {*WATCHED}:
        return None
    ends = marker_ends(panel)
    count = 2 * (len(panel.drive) + len(panel.sensor))
    traced = not {*study.output.channels}.isdisjoint(OF_MACHINES) or needs_powers(panel)

    def save_at(mechanism: Mechanism) -> SaveAt:
        laws, seen = watched_laws(panel, mechanism), watched_gaps(panel, mechanism)
        rests, taken = _rests(throws(panel), mechanism)
        return SaveAt(laws, output_stride(study), ends, rests, count, seen, taken, traced)

    return save_at


def _rests(
    moved: Sequence[DirectedMovement], mechanism: Mechanism
) -> tuple[list[float], list[float]]:
    """Return the times before which the switch may rest, and those of them that are certain [s].

    Onsets of the movements that follow others, which machines may postpone, and removals of
    objects.
    """
    removals = mechanism.laws.disappears[list(mechanism.index.object.values())].tolist()
    taken = [time for time in removals if math.isfinite(time)]
    onsets = {throw.until for throw in moved if math.isfinite(throw.until)}
    return sorted(onsets.union(taken)), taken


def watched_laws(panel: LoadedPanel, mechanism: Mechanism) -> list[int]:
    """Return the laws of drives, then those of objects."""
    index = mechanism.index
    return [*(index.drive[name] for name in panel.drive), *index.object.values()]


def extract_signals(
    study: Study, panel: LoadedPanel, solved: Solved, *, recorder: Recorder
) -> ThrowSignals:
    """Return the stored channels of a complete throw, and the inputs of its labels.

    Parameters
    ----------
    study : Study
        Study with kept channels and their rate.
    panel : LoadedPanel
        Panel that was thrown.
    solved : Solved
        The throw.
    recorder : Recorder
        Recorder of kept forces and currents, and of their features.
    """
    mechanism, history = solved.mechanism, solved.history
    motion, moved = recover_motion(mechanism, history), moved_throws(panel, history)
    labels = object_memory(mechanism, history) | machine_labels(panel, history)
    watched, kept = history.watched, Variables()
    if watched is None or {*study.output.channels} & {*OF_MACHINES}:
        kept = _kept_of_machines(study, panel, history, recorder)
    if watched is None:
        watched = _watched_of(study, panel, motion, mechanism, moved)
        kept |= _further_channels(study, panel, solved, known={*kept, *STACKED_CHANNELS})
    return ThrowSignals(
        panel=panel,
        index=mechanism.index,
        disappears=mechanism.laws.disappears,
        watched=watched,
        labels=labels,
        ends=distance_ends(panel, motion, moved),
        clutches=_clutches(panel, history),
        recorder=recorder,
        kept=kept,
        moved=moved,
        duties=duties(history),
        object_rails=tuple(
            {item.whole or item.name: item.rail for item in solved.objects}.values()
        ),
    )


def _clutches(panel: LoadedPanel, history: History) -> tuple[list[int], Flags] | None:
    """Return the drives that are machines, and when their clutches slip; None without machines."""
    if history.machines is None:
        return None
    flags = np.zeros((len(panel.drive), history.machines.time.size), dtype=np.bool_)
    machine_slips(history, flags)
    drives = list(history.machines.inputs)
    return drives, flags[drives]


def _kept_of_machines(
    study: Study, panel: LoadedPanel, history: History, recorder: Recorder
) -> Variables:
    """Return the kept channels of machines, currents as a recorder gives them."""
    found, stride = Variables(), output_stride(study)
    for name, (dims, values) in machine_signals(panel, history).items():
        if history.machines is not None and name in study.output.channels:
            is_current, time = name == "drive_current", history.machines.time
            seen = clocked(np.asarray(values), time, recorder) if is_current else values
            found[name] = (dims, single_precision(seen[..., ::stride]))
    return found


def _further_channels(
    study: Study, panel: LoadedPanel, solved: Solved, *, known: Container[str]
) -> Variables:
    """Return the kept channels that come from the whole history alone."""
    further = tuple(name for name in study.output.channels if name not in known)
    if not further:
        return {}
    sparse = select_instants(solved.history, slice(None, None, output_stride(study)))
    made = response_channels(panel, solved.mechanism, sparse, save=Save(fields=further))
    return {name: (dims, single_precision(values)) for name, (dims, values) in made.items()}


def _watched_of(
    study: Study,
    panel: LoadedPanel,
    motion: Motion,
    mechanism: Mechanism,
    moved: Sequence[DirectedMovement],
) -> Watched:
    """Return the results of a watched throw from a whole history, gaps only if they are wanted."""
    history, laws = motion.history, watched_laws(panel, mechanism)
    rests = rest_instants(history.time, _rests(moved, mechanism)[0])
    gaps, resting = _recovered_gaps(study, panel, motion, rests)
    return Watched(
        time=history.time,
        inputs=history.inputs,
        law_first=history.law_first,
        law_placed=history.law_placed,
        stride=output_stride(study),
        seen=gaps.T,
        rests=rests,
        seen_rests=resting.T,
        laws=laws,
        effort=history.forces(laws).T,
    )


def _recovered_gaps(
    study: Study, panel: LoadedPanel, motion: Motion, rests: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Return open distances at the instants that are kept, if wanted, and at those of rest."""
    stride, history = output_stride(study), motion.history
    resting = gaps_over_time(panel, replace(motion, history=select_instants(history, rests)))
    if not {*study.output.channels} & {*GAPS}:
        return resting[:, :0], resting
    sparse = replace(motion, history=select_instants(history, slice(None, None, stride)))
    return gaps_over_time(panel, sparse), resting


def select_instants(history: History, index: NDArray[np.int64] | slice) -> History:
    """Return a history at some of its instants; results from every step stay.

    A slice copies nothing.
    """
    names = ("time", "inputs", "q", "g", "law_force", "friction_force", "stored", "ledger")
    machines = history.machines.select(index) if history.machines is not None else None
    found = {name: getattr(history, name)[index] for name in names}
    return replace(history, **found, machines=machines)


def output_stride(study: Study) -> int:
    """Return the number of instants of the solver per kept one.

    Raises
    ------
    FileError
        When the rates do not fit together.
    """
    fine = study.scheme.output_interval
    stride = round(study.output.interval / fine)
    if stride < 1 or not math.isclose(stride * fine, study.output.interval, rel_tol=1e-6):
        message = (
            f"output.rate = {study.output.rate:g} Hz: the solver keeps an instant every "
            f"{1e3 * fine:g} ms; take a rate that divides {1.0 / fine:g} Hz"
        )
        raise FileError(message)
    return stride
