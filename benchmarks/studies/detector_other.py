"""How the detector judges switches of another kind, from recordings with uncertain onsets."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.detector_cases import KNOWN, OTHER_OBJECTS, OTHER_SOUND
from benchmarks.studies.detector_figures import a90, false_alarm_limits
from turnout.detection.conditions import Conditions
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.recorded import Recorded
from turnout.detection.features import correlation
from turnout.detection.floor import TOUCH_FORCE

Floats = NDArray[np.float64]

SHARE, NOISE = 0.05, 20.0
"""Discrepancy, as a share of the amplitude [-], and noise of a sample [N]."""
ONSET_ERROR = 8e-3
"""Deviation of the onsets that come with a recording, which the detector finds again [s]. They are
not sought in the forces: a discrepancy that goes on at rest leaves no rest to find them by."""
KERNELS = ("matern 3/2", "exponential")


def other_figures(
    knowledge: Knowledge, forces: Sequence[dict[str, np.ndarray]]
) -> dict[str, object]:
    """Return alarms of sound throws and of touched objects, without and with a history.

    Half of the variance of the discrepancy is fixed for a switch; its kernel is the assumed one for
    every other switch, and a smooth one for the rest.
    """
    names = ("sound", "dry", "object")
    alarms: dict[tuple[str, int], list[list[bool]]] = {
        (name, known): [] for name in names for known in (0, KNOWN)
    }
    seen: dict[int, list[tuple[float, float, bool]]] = {0: [], KNOWN: []}
    lost: list[str] = []
    named: list[str] = []
    for dry, first, later, held, sizes in _switches(knowledge, forces):
        detector = Detector(knowledge)
        alone = [detector.judge(item) for item in first]
        lost += [item.reason for item in alone if item.status == "cannot judge"]
        alarms["sound", 0].append([item.alarm for item in alone])
        for known in (0, KNOWN):
            if known:
                detector.learn(first)
            kind = "dry" if dry else "sound"
            said = [detector.judge(item) for item in later]
            alarms[kind, known].append([item.alarm for item in said])
            if dry and known:
                named += [_name(item) for item in said]
            called = [detector.judge(item).alarm for item in held]
            alarms["object", known].append(called)
            seen[known] += [(*size, alarm) for size, alarm in zip(sizes, called, strict=True)]
    return {
        "not judged": lost,
        "alarms": {
            f"{name}, {known} known": false_alarm_limits([np.array(row) for row in item])
            for (name, known), item in alarms.items()
            if item
        },
        "objects": {str(known): rows for known, rows in seen.items()},
        "dry called": {name: named.count(name) for name in dict.fromkeys(named)},
    }


def relative_a90(
    figures: Mapping[str, Any],
    reference: Mapping[str, Mapping[str, Sequence[float]]],
    places: Mapping[str, float],
) -> dict[str, tuple[float, float, float]]:
    """Return a90 of these switches as a multiple of that of the reference case, with 90 % limits.

    Sizes count in units of a90 at their place, so that objects at all places count together.

    Parameters
    ----------
    figures : mapping
        From `other_figures`.
    reference : mapping of str to mapping
        "0" and "20": a90 and more by place, without and with a history [m].
    places : mapping of str to float
        [m]
    """
    rng = np.random.default_rng(32)
    found = {}
    for known, rows in figures["objects"].items():
        near = [min(places, key=lambda name: abs(places[name] - row[0])) for row in rows]
        unit = [reference[known][name][0] for name in near]
        size = 1e-3 * np.array([row[1] for row in rows]) / unit
        seen = np.array([bool(row[2]) for row in rows])
        drawn = rng.integers(0, len(size), (200, len(size)))
        low, high = np.quantile([a90(size[i], seen[i]) for i in drawn], [0.05, 0.95])
        found[known] = (1e3 * a90(size, seen), 1e3 * float(low), 1e3 * float(high))
    return found


def _name(verdict: object) -> str:
    from benchmarks.studies.detector_figures import name_of

    return name_of(verdict)  # type: ignore[arg-type]


def _switches(
    knowledge: Knowledge, forces: Sequence[dict[str, np.ndarray]]
) -> Iterator[
    tuple[bool, list[Recorded], list[Recorded], list[Recorded], list[tuple[float, float]]]
]:
    rng = np.random.default_rng(31)
    each = KNOWN + OTHER_SOUND + OTHER_OBJECTS
    for mesh in forces:
        for switch in np.unique(mesh["switch"]):
            rows = np.flatnonzero(mesh["switch"] == switch)
            draw = _Discrepancy(knowledge, mesh["time"], KERNELS[switch // 2 % 2], rng)
            throws = [draw.recorded(mesh["force"][row]) for row in rows]
            place = mesh["row"][rows] % each
            held = np.flatnonzero(
                (place >= KNOWN + OTHER_SOUND) & (mesh["touch"][rows] > TOUCH_FORCE)
            )
            yield (
                bool(switch % 2),
                [throws[i] for i in np.flatnonzero(place < KNOWN)],
                [
                    throws[i]
                    for i in np.flatnonzero((place >= KNOWN) & (place < each - OTHER_OBJECTS))
                ],
                [throws[i] for i in held],
                [(float(mesh["x"][rows[i]]), float(mesh["size"][rows[i]])) for i in held],
            )


class _Discrepancy:
    """Makes recordings of one switch: discrepancy on the samples, noise, onsets to be found."""

    def __init__(
        self, knowledge: Knowledge, time: Floats, kernel: str, rng: np.random.Generator
    ) -> None:
        conditions = Conditions(kernel=kernel)
        covariance = correlation(time[:, np.newaxis] - time, conditions)
        self._root = np.linalg.cholesky(covariance + 1e-8 * np.eye(time.size))
        self._scale = np.sqrt(0.5) * SHARE * knowledge.setting.amplitude[:, np.newaxis]
        self._time, self._drives, self._rng = time, list(knowledge.layout.drives), rng
        self._fixed = self._drawn()

    def _drawn(self) -> Floats:
        shape = (len(self._drives), self._time.size)
        return np.asarray(self._scale * (self._rng.standard_normal(shape) @ self._root.T))

    def recorded(self, force: Floats) -> Recorded:
        noise = NOISE * self._rng.standard_normal(force.shape)
        late = ONSET_ERROR * self._rng.standard_normal(2)
        return Recorded(
            name="throw",
            time=self._time,
            force=force + self._fixed + self._drawn() + noise,
            drives=tuple(self._drives),
            onsets={"opening": 0.2 + float(late[0]), "closing": 4.4 + float(late[1])},
        )
