"""How the detector judges recordings of forces alone, whose movements it must find without marks.

Switches of other sections, meshes and friction are thrown as in `detector_other`. Each recording
rests for an unknown while before opening and before closing; a discrepancy of 5 % of the peak force
with the kernel exp(-|t| / 0.5 s) goes on through rest and motion, half of its variance the same in
all throws of a switch, and noise is added. No onset comes with a recording.

    python -m benchmarks.studies.detector_unmarked DIR

DIR is that of `python -m benchmarks.studies.detector`, whose throws and detector are read.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.studies.detector_cases import KNOWN, OTHER_OBJECTS, OTHER_SOUND
from benchmarks.studies.detector_other import NOISE, SHARE
from turnout.core.threads import one_blas_thread
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.throws_of_dataset import throws_of_dataset
from turnout.detection.floor import TOUCH_FORCE

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
    """Return what is judged, false alarms and objects called, without and with a history."""
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
                "judged": sum(status not in ("cannot judge", "several") for status, _ in rows),
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
