"""How the detector judges switches of other sections, meshes and friction than it learned from.

    python -m benchmarks.studies.detector_other DIR

DIR is that of `python -m benchmarks.studies.detector`, whose throws and detector are read, and
which states the figures of recordings with uncertain onsets (`other_figures`). This command states
those of recordings of forces alone, whose movements must be found without marks: each rests for an
unknown while before opening and before closing; a discrepancy of 5 % of the peak force with the
kernel exp(-|t| / 0.5 s) goes on through rest and motion, half of its variance the same in all
throws of a switch, and noise is added. No onset comes with a recording.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.studies.detector_figures import a90, false_alarm_limits
from benchmarks.studies.detector_sets import KNOWN, OTHER_OBJECTS, OTHER_SOUND
from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import Conditions
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_verdict import CANNOT, OBJECTS
from turnout.detection.detector.throws_of_dataset import throws_of_dataset
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
        lost += [item.reason for item in alone if item.status in (CANNOT, OBJECTS)]
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


Floats = NDArray[np.float64]

KERNEL = 0.5
"""Correlation time of the discrepancy [s]."""
LONGEST_REST = (3.0, 1.5)
"""Before opening, and added before closing [s]."""
BETWEEN = 4.2
"""When a switch rests between opening and closing, in the throws as they are simulated [s]."""
STARTS = (0.2, 4.4)
"""Of opening and closing in these [s]."""
SWITCHES, WITH_HISTORY = 20, 6
JUDGED_SOUND, JUDGED_OBJECTS = 3, 2


def recording(
    time: Floats,
    force: Floats,
    *,
    scale: Floats,
    fixed: Floats,
    rng: np.random.Generator,
    drives: Sequence[str],
) -> tuple[xr.Dataset, tuple[float, float]]:
    """Return a recording of a throw, and when its movements begin [s]."""
    lead, more = (float(rng.uniform(0.0, most)) for most in LONGEST_REST)
    step = float(time[1] - time[0])
    at = np.arange(0.0, time[-1] + lead + more + 1.0, step)
    own = np.where(at - lead < BETWEEN, at - lead, np.maximum(at - lead - more, BETWEEN))
    own = np.clip(own, time[0], time[-1])
    rows = np.array([np.interp(own, time, row) for row in force])
    rows += fixed[:, : at.size] + scale * wandering(at.size, step, rng, len(rows))
    rows += NOISE * rng.standard_normal(rows.shape)
    data = xr.Dataset(
        {"drive_force": (("drive", "time"), rows)}, {"time": at, "drive": list(drives)}
    )
    return data, (STARTS[0] + lead, STARTS[1] + lead + more)


def wandering(size: int, step: float, rng: np.random.Generator, rows: int) -> Floats:
    """Return unit discrepancies with the kernel exp(-|t| / 0.5 s), shape (rows, size)."""
    keep = np.exp(-step / KERNEL)
    drawn = rng.standard_normal((rows, size))
    drawn[:, 1:] *= np.sqrt(1.0 - keep**2)
    for number in range(1, size):
        drawn[:, number] += keep * drawn[:, number - 1]
    return drawn


def unmarked_figures(
    knowledge: Knowledge, forces: Sequence[dict[str, np.ndarray]]
) -> dict[str, object]:
    """Return judged throws, false alarms and objects called, without and with a history."""
    rng = np.random.default_rng(53)
    found: dict[str, list[tuple[str, bool]]] = {}
    errors: list[float] = []
    reasons: list[str] = []
    each = KNOWN + OTHER_SOUND + OTHER_OBJECTS
    scale = np.sqrt(0.5) * SHARE * knowledge.setting.amplitude[:, np.newaxis]
    for number in range(SWITCHES):
        mesh = forces[number % len(forces)]
        switch = np.unique(mesh["switch"])[number // len(forces)]
        rows = np.flatnonzero(mesh["switch"] == switch)
        place, touch = mesh["row"][rows] % each, mesh["touch"][rows]
        step = float(mesh["time"][1] - mesh["time"][0])
        size = round((mesh["time"][-1] + sum(LONGEST_REST) + 2.0) / step)
        fixed = scale * wandering(size, step, rng, len(scale))
        groups = {
            "first": rows[place < KNOWN],
            "dry" if switch % 2 else "sound": rows[
                (place >= KNOWN) & (place < each - OTHER_OBJECTS)
            ][:JUDGED_SOUND],
            "object": rows[(place >= each - OTHER_OBJECTS) & (touch > TOUCH_FORCE)][
                :JUDGED_OBJECTS
            ],
        }
        made = {
            name: [
                recording(
                    mesh["time"],
                    mesh["force"][row],
                    scale=scale,
                    fixed=fixed,
                    rng=rng,
                    drives=knowledge.layout.drives,
                )
                for row in group
            ]
            for name, group in groups.items()
        }
        detector = Detector(knowledge)
        for known in (0, KNOWN) if number < WITH_HISTORY else (0,):
            if known:
                detector.learn(
                    [throw for data, _ in made["first"] for throw in throws_of_dataset(data)]
                )
            for name, items in made.items():
                if name == "first":
                    continue
                for data, starts in items:
                    throws = [x for y in throws_of_dataset(data) for x in detector.located(y)]
                    verdicts = [detector.judge(throw) for throw in throws]
                    status = verdicts[0].status if len(verdicts) == 1 else "several"
                    found.setdefault(f"{name}, {known} known", []).append(
                        (status, any(item.alarm for item in verdicts))
                    )
                    reasons += [item.reason for item in verdicts if item.reason]
                    errors += [
                        throw.onsets[part] - start
                        for throw in throws
                        for part, start in zip(("opening", "closing"), starts, strict=True)
                        if part in throw.onsets
                    ]
    return {
        "throws": {
            name: {
                "throws": len(rows),
                "judged": sum(status not in (CANNOT, OBJECTS, "several") for status, _ in rows),
                "alarms": sum(alarm for _, alarm in rows),
            }
            for name, rows in found.items()
        },
        "onset errors [s]": np.quantile(np.abs(errors), [0.5, 0.95, 1.0]).round(4).tolist(),
        "not judged": reasons,
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="that of benchmarks.studies.detector")
    folder: Path = parser.parse_args().folder
    forces = []
    for mesh in ("0.1", "0.2"):
        with np.load(folder / "cases" / f"other-{mesh}-m forces.npz", allow_pickle=False) as kept:
            forces.append({name: kept[name] for name in kept.files})
    path = max(folder.glob("switch-*.detector"), key=lambda item: item.stat().st_mtime)
    knowledge = Detector.load(path).knowledge
    with one_blas_thread():
        print(json.dumps(unmarked_figures(knowledge, forces), indent=1))


if __name__ == "__main__":
    main()
