"""What a sweep takes of a throw while its history is there.

Where gaps, forces and markers alone are wanted, the throw is *watched*: the solver keeps the forces
of drives and objects at every instant and the gaps at the rate of the study, and only the ends of
the movements whole. Other channels need the whole history.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.errors import FileError
from turnout.integrate.integration import History
from turnout.integrate.watch import Watch, Watched
from turnout.measurement.chain.recorder import Recorder, clocked, recorded_force
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.load import LoadedPanel
from turnout.response.dataset import response_channels
from turnout.response.drives import machine_signals, machine_slips, moved_throws
from turnout.response.gaps import drive_and_sensor_gaps, split_gaps, watched_gaps
from turnout.response.labels import contact_labels, flangeway_labels
from turnout.response.recovery import Motion, recover_motion
from turnout.response.route import throws
from turnout.response.save import Save
from turnout.response.signals import Variable, drive_signals, object_memory, object_signals
from turnout.response.simulate import Solved
from turnout.study.study import Study
from turnout.sweep.labels import ThrowSignals, float_values

Floats = NDArray[np.float64]
Variables = dict[str, Variable]

GAPS = ("drive_gap", "sensor_gap")
WATCHED = ("drive_force", "drive_displacement", "drive_slipping", "object_force", *GAPS)
"""Channels that a watched throw gives."""


def watch_of(study: Study, panel: LoadedPanel) -> Callable[[Mechanism], Watch] | None:
    """Return what is wanted of a throw of a mechanism, None where it needs its whole history."""
    if not {*study.output.channels} <= {*WATCHED}:
        return None
    ends = [throw.end for throw in throws(panel)]
    count = 2 * len(panel.drive) + len(panel.sensor)

    def watch(mechanism: Mechanism) -> Watch:
        index = mechanism.index
        laws = [*(index.drive[name] for name in panel.drive), *index.object.values()]
        return Watch(laws, output_stride(study), ends, count, watched_gaps(panel, mechanism))

    return watch


def extract_signals(
    study: Study, panel: LoadedPanel, solved: Solved, *, recorder: Recorder
) -> ThrowSignals:
    """Return what is stored of a complete throw and what its labels are made of.

    Parameters
    ----------
    study : Study
        What is kept, at which rate.
    panel : LoadedPanel
        What was thrown.
    solved : Solved
        The throw.
    recorder : Recorder
        Of what is kept of forces and currents over time, and of their features.
    """
    given, history, stride = (panel, solved.mechanism), solved.history, output_stride(study)
    every = history if history.watched is None else history.watched
    signals = drive_signals(*given, every) | object_signals(solved.mechanism, every)
    signals |= contact_labels(solved.mechanism, every) | object_memory(solved.mechanism, history)
    machine_slips(history, np.asarray(signals["drive_slipping"][1]))
    signals |= machine_signals(panel, history)
    recorded = _recorded(signals, every.time, recorder)
    moved = moved_throws(panel, history)
    wanted = study.output.channels
    kept = {
        name: (dims, values[..., ::stride])
        for name, (dims, values) in (signals | recorded).items()
        if name in wanted and "time" in dims
    }
    motion = recover_motion(solved.mechanism, history)
    signals |= flangeway_labels(panel, motion, history.time, moved)
    if history.watched is None:
        gaps, last = _recovered_gaps(study, panel, motion)
    else:
        gaps, last = _watched_gaps(panel, history.watched)
    kept |= {name: gaps[name] for name in GAPS if name in wanted and gaps[name][1].size}
    further = tuple(name for name in wanted if name not in {*signals, *GAPS})
    if further:
        sparse = select_instants(history, slice(None, None, stride))
        kept |= response_channels(*given, sparse, save=Save(fields=further))
    ends = float_values(last["drive_gap"]), float_values(last["sensor_gap"])
    small = {name: (dims, _to_single_precision(values)) for name, (dims, values) in kept.items()}
    force = float_values(recorded["drive_force"])
    return ThrowSignals(panel, solved.mechanism, every.time, signals, force, small, ends, moved)


def _recorded(signals: Variables, time: Floats, recorder: Recorder) -> Variables:
    """Return drive forces and motor currents as a recorder gives them."""
    dims, force = signals["drive_force"]
    found: Variables = {"drive_force": (dims, recorded_force(np.asarray(force), time, recorder))}
    if "drive_current" in signals:
        dims, current = signals["drive_current"]
        found["drive_current"] = (dims, clocked(np.asarray(current), time, recorder))
    return found


def _watched_gaps(panel: LoadedPanel, watched: Watched) -> tuple[Variables, Variables]:
    """Return gaps at the instants that were kept, and at the last instant."""
    kept = split_gaps(panel, watched.seen.T, watched.time[:: watched.stride])
    return _named(*kept), _named(*split_gaps(panel, watched.seen_last.T, watched.time[-1:]))


def _recovered_gaps(
    study: Study, panel: LoadedPanel, motion: Motion
) -> tuple[Variables, Variables]:
    """Return gaps at the instants that are kept, if they are wanted, and at the last instant."""
    stride, gaps = output_stride(study), None
    if {*study.output.channels} & {*GAPS}:
        sparse = select_instants(motion.history, slice(None, None, stride))
        gaps = _gap_signals(panel, replace(motion, history=sparse))
    if gaps is not None and (motion.history.time.size - 1) % stride == 0:
        last = {name: (dims, values[:, -1:]) for name, (dims, values) in gaps.items()}
    else:
        end = select_instants(motion.history, slice(-1, None))
        last = _gap_signals(panel, replace(motion, history=end))
    return last if gaps is None else gaps, last


def _gap_signals(panel: LoadedPanel, motion: Motion) -> Variables:
    """Return gaps at drives and sensors at all instants of a history."""
    return _named(*drive_and_sensor_gaps(panel, motion, motion.history.time))


def _named(at_drives: Floats, at_sensors: Floats) -> Variables:
    return {
        "drive_gap": (("drive", "time"), at_drives),
        "sensor_gap": (("sensor", "time"), at_sensors),
    }


def select_instants(history: History, index: NDArray[np.int64] | slice) -> History:
    """Return a history at some of its instants; what was gathered from every step stays.

    A slice copies nothing.
    """
    names = ("time", "inputs", "q", "g", "law_force", "friction_force", "stored", "ledger")
    machines = history.machines.select(index) if history.machines is not None else None
    found = {name: getattr(history, name)[index] for name in names}
    return replace(history, **found, machines=machines)


def output_stride(study: Study) -> int:
    """Return how many instants of the solver there are to one that is kept.

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


def _to_single_precision(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return numbers in single precision; logical values stay."""
    return values.astype(np.float32) if values.dtype.kind == "f" else values
