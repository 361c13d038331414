"""A switch of formulas, so that a detector is trained and tried within seconds.

Both drives slide by friction, press home by their over-travel, and feel an object from the moment
that the closing rail meets it, by how much it is larger than the gap left there. Thresholds and
widths, which take most of a training, are stored: `python -m tests.unit.detector_toy` makes them
again.
"""

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import with_calibration
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import View, evidence_of
from turnout.detection.detector.knowledge import Calibrated, Knowledge, Setting
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_layout import Layout, layout_of, throw_features
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import knowledge_of_sets
from turnout.detection.detector.training import SHIFT, teach
from turnout.detection.likelihood import Evidence

PLACES = {"drive 1": 0.3, "sleeper 3": 1.8, "sleeper 6": 3.6, "drive 2": 6.9}
CALIBRATED = Path(__file__).with_name("toy_calibration.json")
RATE = 125.0
TIME = np.arange(0.0, 8.5, 1.0 / RATE)
Numbers = np.ndarray


def toy_layout() -> Layout:
    return layout_of([("opening", 0.2, 3.2), ("closing", 4.4, 3.4)], end=8.5, drives=["1", "2"])


def toy_force(
    level: Numbers, over: Numbers, *, size: Numbers, x: Numbers, dry: Numbers, shift: float = 0.0
) -> Numbers:
    """Return drive forces, shape (n, 2, n_times) [N]; over-travels in mm, size in m."""
    t = TIME - shift
    opening = np.clip((t - 0.2) / 0.3, 0.0, 1.0) * np.clip((4.3 - t) / 0.5, 0.0, 1.0)
    closing = np.clip((t - 4.4) / 0.3, 0.0, 1.0)
    home = np.clip((t - 7.2) / 0.5, 0.0, 1.0)
    late = np.clip((t - 7.0) / 0.4, 0.0, 1.0)
    near = np.clip((x - 0.3) / 6.6, 0.0, 1.0)
    stop = 7.0e-3 * 4.0 * near * (1.0 - near) * (size > 0.0)
    press = 120.0e3 * np.clip(size - stop, 0.0, None)
    found = []
    for number, share in ((0, 1.0 - near), (1, near)):
        slide = (2000.0 + 800.0 * number) * level
        rise = np.clip((t - 5.5) / 1.5, 0.0, 1.0)
        row = np.outer(-slide, opening) + np.outer(slide, closing)
        row += np.outer(700.0 * over[:, number], home) + np.outer(press * (0.3 + share), late)
        found.append(row + np.outer((1.0 - 0.5 * number) * dry, rise + opening))
    return np.stack(found, axis=1)


def toy_set(
    count: int, *, seed: int = 0, kind: str = "sound", repeats: int = 1, sound_seed: int = 0
) -> ThrowSet:
    """Return throws of a kind in the states of the sound throws of the same seed."""
    states = np.random.default_rng([sound_seed, 1])
    level = states.uniform(0.1, 0.5, count)
    over = np.repeat(states.uniform(3.0, 5.0, (count // repeats, 2)), repeats, axis=0)
    rng = np.random.default_rng([seed, 2])
    size, x, dry = np.zeros(count), np.zeros(count), np.zeros(count)
    if kind == "object":
        size, x = rng.triangular(1e-3, 6e-3, 31e-3, count), 0.3 * rng.integers(1, 24, count)
    elif kind == "dry chairs":
        dry = rng.uniform(200.0, 500.0, count)
    elif kind == "adjustment":
        over = over + rng.uniform(-1.2, 1.2, over.shape) * (rng.random(over.shape) < 0.6)
    layout = toy_layout()
    onsets = np.tile([0.2, 4.4], (count, 1))
    given = {"size": size, "x": x, "dry": dry}
    features, early, late = (
        throw_features(TIME, toy_force(level, over, shift=s, **given), layout=layout, onsets=onsets)
        for s in (0.0, SHIFT, -SHIFT)
    )
    gap = np.column_stack([6e-3 - 1e-3 * (over[:, 0] - 4.0), 1e-3 * (5.0 - over[:, 1])])
    gap += 0.4 * np.column_stack([size, 0.5 * size])
    row = np.arange(count)
    return ThrowSet(
        features=features,
        rates=(early - late) / (2.0 * SHIFT),
        gaps=gap,
        level=level,
        inputs=over if kind != "adjustment" else over,
        switch=row // repeats,
        partner=row if kind != "sound" else np.full(count, -1),
        row=row,
        size=size,
        x=x,
        force=np.where(kind == "object", 1e4 * np.clip(size - 0.5e-3, 0.0, None), 0.0),
    )


def toy_setting() -> Setting:
    return Setting(
        layout=toy_layout(),
        places=PLACES,
        amplitude=np.array([3000.0, 3000.0]),
        gaps=("sensor TKK1", "drive 2"),
        limits=(13e-3, 5e-3),
        allowances=Allowances(discrepancy=0.03),
    )


def toy_sets() -> dict[str, ThrowSet]:
    """Return what the detector learns from."""
    return {
        "sound": toy_set(600),
        "object": toy_set(500, kind="object"),
        "dry chairs": toy_set(100, kind="dry chairs"),
        "adjustment": toy_set(100, kind="adjustment"),
        "history": toy_set(72, seed=9, sound_seed=9, repeats=12),
    }


def toy_training() -> Knowledge:
    """Train the detector, thresholds and widths with it."""
    return knowledge_of_sets(toy_sets(), toy_setting(), draws=6, history_draws=1, histories=(8,))


@cache
def toy_detector() -> Detector:
    """Return the detector, with the thresholds and widths that are stored; to judge alone."""
    stored = json.loads(CALIBRATED.read_text(encoding="utf-8"))
    calibrated = [
        Calibrated(**{name: tuples_of(value) for name, value in item.items()}) for item in stored
    ]
    return Detector(with_calibration(teach(toy_sets(), toy_setting()), calibrated))


def tuples_of(value: Any) -> Any:
    return tuple(map(tuples_of, value)) if isinstance(value, list) else value


def toy_throw(
    *,
    level: float = 0.3,
    over: tuple[float, float] = (4.0, 4.0),
    size: float = 0.0,
    x: float = 3.6,
    seed: int = 0,
    shift: float = 0.0,
) -> Recorded:
    """Return a throw as recorded, with noise of 20 N."""
    rng = np.random.default_rng([seed, 4])
    force = toy_force(
        np.array([level]),
        np.array([over]),
        size=np.array([size]),
        x=np.array([x]),
        dry=np.zeros(1),
        shift=shift,
    )[0]
    return Recorded(
        name=f"throw {seed}",
        time=TIME,
        force=force + 20.0 * rng.standard_normal(force.shape),
        drives=("1", "2"),
        onsets={"opening": 0.2, "closing": 4.4},
    )


def toy_evidence() -> tuple[View, Evidence]:
    """Return how a sound throw at a middle friction level is judged."""
    detector = toy_detector()
    view = detector.view()
    features = detector.knowledge.model.mean[5][np.newaxis, : detector.knowledge.layout.size]
    evidence = evidence_of(view, features)
    return view, evidence


if __name__ == "__main__":
    made = [asdict(item) for item in toy_training().calibrated]
    lines = ",\n".join(map(json.dumps, made))
    CALIBRATED.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
