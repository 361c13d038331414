"""Single numbers and states that a sweep stores of each throw, made of many throws at once.

They need every instant of a few channels, which are small; the history of a throw is gone by then.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.drive_machines import slip_force
from turnout.mechanism.mechanism import Mechanism
from turnout.metric.features import FEATURES, run_features
from turnout.metric.slip import Span
from turnout.metric.trapped import is_trapped
from turnout.panel.load import LoadedPanel
from turnout.response.labels import control_states, force_margins
from turnout.response.route import Throw
from turnout.response.signals import Variable

Floats = NDArray[np.float64]
Variables = dict[str, Variable]

LABELS = {
    "object_force_peak": ("N", "largest force on foreign objects"),
    "object_force_end": ("N", "force on foreign objects at the end"),
    "object_trapped": ("1", "whether a foreign object was touched and is still there at the end"),
    "slipped": ("1", "whether a drive slipped in the last movement"),
    "slipped_free": ("1", "whether a drive slipped before any object was touched"),
    "end_locked": ("1", "lock rule met at the end"),
    "end_in_control": ("1", "sensor gap below its limit at the end"),
}
"""Unit and meaning of the labels that only a sweep has."""


@dataclass(frozen=True, slots=True, eq=False)
class ThrowSignals:
    """What is taken from a run while its history is there.

    Attributes
    ----------
    panel : LoadedPanel
        What was thrown.
    mechanism : Mechanism
        Of it.
    time : ndarray, shape (n_times,)
        Every instant that the solver kept [s].
    signals : dict
        Forces of drives and objects at these, what was touched when and what is left of it, and
        flangeways.
    recorded_force : ndarray, shape (n_drives, n_times)
        Drive forces as they were recorded, of which features are made [N].
    kept : dict
        Histories at the rate of the study.
    end_gaps : tuple of ndarray
        At drives and sensors at the end, shapes (n_drives, 1) and (n_sensors, 1) [m].
    moved : tuple of Throw
        The movements as they were made.
    """

    panel: LoadedPanel
    mechanism: Mechanism
    time: Floats
    signals: Variables
    recorded_force: Floats
    kept: Variables
    end_gaps: tuple[Floats, Floats]
    moved: tuple[Throw, ...]


def compute_labels(runs: Sequence[ThrowSignals]) -> list[Variables]:
    """Return labels and features of some throws.

    Those with the same instants, movements and number of drives, which most studies have, are
    evaluated together.

    Parameters
    ----------
    runs : sequence of ThrowSignals
        Of any throws of one panel, of changed ones too.

    Returns
    -------
    list of dict
        In the same order.
    """
    spans = [_movement_spans(item.moved) for item in runs]
    alike: dict[tuple[object, ...], list[int]] = {}
    for number, item in enumerate(runs):
        key = (spans[number], item.time.size, float(item.time[-1]), len(item.panel.drive))
        alike.setdefault(key, []).append(number)
    found: list[Variables] = [{}] * len(runs)
    for numbers in alike.values():
        together = [runs[number] for number in numbers]
        features = _drive_features(together, spans[numbers[0]])
        for number, item, values in zip(numbers, together, features, strict=True):
            labels = values | object_labels(item.time, item.signals, spans=spans[number])
            found[number] = labels | _state_labels(item) | _trapped_label(item)
    return found


def _movement_spans(moved: Sequence[Throw]) -> tuple[Span, ...]:
    return tuple(Span(item.name, item.to, item.start, item.end) for item in moved)


def _drive_features(runs: Sequence[ThrowSignals], spans: tuple[Span, ...]) -> list[Variables]:
    """Return the features of each drive and movement, the drives of all throws at once."""
    found = run_features(
        runs[0].time,
        np.concatenate([item.recorded_force for item in runs]),
        spans=spans,
        limits=np.array(
            [slip_force(item.panel, name) for item in runs for name in item.panel.drive]
        ),
        travel=np.concatenate([float_values(item.signals["drive_displacement"]) for item in runs]),
    )
    dims = ("drive", "direction")
    parts = np.split(found, len(runs), axis=1)
    return [{name: (dims, row) for name, row in zip(FEATURES, part, strict=True)} for part in parts]


def _state_labels(item: ThrowSignals) -> Variables:
    """Return margins, and gaps and states at the end."""
    panel, (drive_gap, sensor_gap) = item.panel, item.end_gaps
    margins = force_margins(
        panel, time=item.time, drive_force=float_values(item.signals["drive_force"])
    )
    states = control_states(
        panel,
        time=item.time[-1:],
        slipping=item.signals["drive_slipping"][1][:, -1:].astype(np.bool_),
        drive_gap=drive_gap,
        sensor_gap=sensor_gap if sensor_gap.size else None,
        moved=item.moved,
    )
    found: Variables = {
        "force_margin": (("drive", "direction"), margins),
        "end_gap": (("drive",), drive_gap[:, -1].copy()),
    }
    return found | {
        f"end_{name}": (dims[:-1], np.asarray(values[..., -1]))
        for name, (dims, values) in states.items()
    }


def _trapped_label(item: ThrowSignals) -> Variables:
    """Return whether an object that was touched is still there at the end."""
    groups = item.mechanism.index.object_laws.values()
    contact = item.signals.get("object_contact_time", item.signals["contact_time"])
    taken = np.array([item.mechanism.laws.disappears[own[0]] for own in groups])
    left = item.signals.get("object_left", (("object",), np.full(taken.size, np.nan)))
    trapped = is_trapped(
        np.broadcast_to(float_values(contact), taken.shape),
        np.where(taken > item.time[-1], np.inf, taken),
        float_values(left),
    )
    return {"object_trapped": ((), np.asarray(trapped.any()))}


def object_labels(time: Floats, every: Variables, *, spans: Sequence[Span]) -> Variables:
    """Return the largest and last force on the objects, and whether drives slipped.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        [s]
    every : dict
        `object_force`, `drive_force`, `drive_slipping` and `contact_time` as bare arrays.
    spans : sequence of Span
        The movements.
    """
    force = float_values(every["object_force"])
    sense, onset = np.zeros(time.size), 0
    for span in spans:
        onset = int(np.searchsorted(time, span.start - 1e-9))
        sense[onset:] = 1.0 if span.to == "closed" else -1.0
    # At the onset of a movement a drive may still hold with the force of the one before.
    working = sense * float_values(every["drive_force"]) > 0
    slipping = np.any(every["drive_slipping"][1].astype(np.bool_) & working, axis=0)
    contact = float(float_values(every["contact_time"]))
    alone = np.searchsorted(time, contact if np.isfinite(contact) else np.inf)
    return {
        "object_force_peak": ((), np.asarray(np.max(force, initial=0.0))),
        "object_force_end": ((), np.asarray(force[-1])),
        "slipped": ((), np.asarray(slipping[onset:].any())),
        "slipped_free": ((), np.asarray(slipping[:alone].any())),
    }


def float_values(variable: Variable) -> Floats:
    """Return the values of a channel in double precision."""
    return np.asarray(variable[1], dtype=np.float64)
