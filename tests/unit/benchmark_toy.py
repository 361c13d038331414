"""A benchmark of made-up throws: a hump that an object raises, on switches that differ a little."""

import numpy as np
from benchmarks.detection.data import Benchmark, Side, window_features
from benchmarks.detection.definition import MID_SPAN, panels_study
from benchmarks.detection.make_throws import fine_layout

from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.training import layout_of_panel

LAYOUT = layout_of_panel(panels_study().panel)
FINE = fine_layout(LAYOUT)
TIME = FINE.time[: FINE.windows]
POSITIONS = ("sensor TKK1", "drive 1")
EFFECT = 150.0
"""Of an object on the end force, for each millimetre [N]."""


def toy_side(first: int, switches: int, *, sound: int = 40, objects: int = 20) -> Side:
    """Return throws of some switches: 5 of a history, sound ones, and with objects."""
    rows = []
    for switch in range(first, first + switches):
        rng = np.random.default_rng([7, switch])
        offset = 300.0 * rng.standard_normal(2)
        for number in range(5 + sound + objects):
            role = "history" if number < 5 else "sound" if number < 5 + sound else "object"
            size = 31e-3 * rng.random() if role == "object" else 0.0
            force = 2000.0 * np.exp(-(((TIME - 6.5) / 0.8) ** 2)) * np.ones((2, 1))
            late = TIME > 7.0
            force = force + offset[:, np.newaxis] * late + EFFECT * 1e3 * size * late
            force = force + 60.0 * rng.standard_normal(force.shape)
            place = MID_SPAN[number % len(MID_SPAN)] if role == "object" else ""
            rows.append((switch, role, size, place, force))
    histories = np.array([row[-1] for row in rows])
    size = np.array([row[2] for row in rows])
    role = np.array([row[1] for row in rows])
    count = len(rows)
    return Side(
        throw=np.arange(count) + 10_000 * first,
        histories=histories,
        features=window_features(histories, LAYOUT),
        labels={
            "role": role,
            "kind": np.where(role == "object", "stone", ""),
            "place": np.array([row[3] for row in rows]),
            "size": size,
            "x": np.where(size > 0.0, 3.6, np.nan),
            "object_force": 1e6 * size,
            "panel": np.array([row[0] for row in rows]),
            "machine": np.full(count, ""),
            "level": np.full(count, 0.3),
        },
        gaps=np.zeros((count, 2)),
        groups=np.array([row[0] for row in rows]),
        partner=np.full(count, -1),
        clean=histories[:0],
        inputs=np.zeros((0, 1)),
        positions=POSITIONS,
    )


def toy_benchmark(*, train: int = 9, test: int = 5, history: int = 5) -> Benchmark:
    """Return a benchmark of some switches."""
    return Benchmark(
        train=toy_side(0, train),
        test=toy_side(100, test),
        layout=LAYOUT,
        time=TIME,
        signals=("force 1", "force 2"),
        history=history,
        errors=Allowances(),
        track="markers",
        amplitude={"": np.array([2000.0, 2000.0])},
        attrs={"data": "toy"},
    )
