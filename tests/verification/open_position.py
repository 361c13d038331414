"""Open and closed positions of a switch without friction, by an independent lateral beam program.

Two Euler-Bernoulli beams, 150 mm elements, lateral displacement and slope alone: the rails cannot
roll, twist or lift. They are held by the lateral and yaw springs of the fastenings and the clamped
heel, joined rigidly at the drives, held by linear bushings at the markers, and pressed against
rigid stock rails by springs that do not pull. Only the sections' lateral second moments of area are
turnout's. y is positive in the closing direction of the instrumented rail and zero where that rail
is closed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.rail_sections import section_values
from turnout.panel.load import LoadedPanel
from turnout.panel.profile import evaluate_profile, running_edge_distance

Floats = NDArray[np.float64]
ELEMENT = 0.15
CONTACT, RIGID = 2e8, 1e10


@dataclass(frozen=True)
class Beam:
    """One rail: places of its nodes [m], stiffness over (y, slope) of each, way to open [m]."""

    x: Floats
    stiffness: Floats
    travel: Floats

    def at(self, x: float) -> int:
        """Return the coordinate of the lateral displacement at a place, which has a node."""
        return 2 * int(np.argmin(np.abs(self.x - x)))


def beam(panel: LoadedPanel, rail: str) -> Beam:
    """Return a rail, and its way from closed to open when the drives stand at their strokes."""
    record = panel.rail[rail]
    x = np.linspace(record.start, record.end, round((record.end - record.start) / ELEMENT) + 1)
    inertia = section_values(panel, rail, 0.5 * (x[1:] + x[:-1]))["second_moment_lateral"]
    stiffness = np.zeros((2 * x.size, 2 * x.size))
    h = ELEMENT
    hermite = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h * h, -6 * h, 2 * h * h],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h * h, -6 * h, 4 * h * h],
        ]
    )
    for number, second_moment in enumerate(inertia):
        place = slice(2 * number, 2 * number + 4)
        stiffness[place, place] += panel.material.youngs_modulus * second_moment / h**3 * hermite
    for item in panel.fastening.values():
        node = 2 * int(np.argmin(np.abs(x - item.x)))
        stiffness[node, node] += item.stiffness_y
        stiffness[node + 1, node + 1] += item.stiffness_yaw
    stiffness[-2:, -2:] += RIGID * np.eye(2)
    held = stiffness.copy()
    load = np.zeros(2 * x.size)
    for drive in panel.drive.values():
        node = 2 * int(np.argmin(np.abs(x - drive.x)))
        held[node, node] += RIGID
        load[node] += RIGID * drive.stroke
    return Beam(x, stiffness, np.linalg.solve(held, load))


@dataclass(frozen=True)
class Position:
    """Gaps of the instrumented and of the other rail over x [m]."""

    x: Floats
    gaps: dict[str, Floats]

    def flangeway(self, panel: LoadedPanel, rail: str) -> float:
        """Return the least flangeway of a rail [m]."""
        record = panel.rail[rail]
        assert record.running_edge is not None
        assert record.head_width is not None
        apart = running_edge_distance(record.running_edge, self.x) - record.head_width
        return float(np.min(self.gaps[rail] + np.maximum(apart, 0.0)))


def position(panel: LoadedPanel, *, to: str) -> Position:
    """Return where both rails rest when the markers stand at their over-travel."""
    own = panel.instrumented_rail
    (other,) = [name for name in panel.rail if name != own]
    a, b = beam(panel, own), beam(panel, other)
    size = a.stiffness.shape[0]
    # stress-free: f of the way to open, which the other rail is at y = 0
    free = np.concatenate(
        (
            -panel.rail[own].fraction * a.travel,
            -(1.0 - panel.rail[other].fraction) * b.travel,
        )
    )
    bent = np.zeros((2 * size, 2 * size))
    bent[:size, :size], bent[size:, size:] = a.stiffness, b.stiffness
    load = bent @ free
    stiffness = bent.copy()
    for drive in panel.drive.values():
        node = a.at(drive.x)
        marker = (
            drive.over_travel_closed if to == "closed" else -drive.stroke - drive.over_travel_open
        )
        stiffness[node, node] += drive.stiffness
        load[node] += drive.stiffness * marker
        pair = np.array([node, size + node])
        stiffness[np.ix_(pair, pair)] += RIGID * np.array([[1.0, -1.0], [-1.0, 1.0]])
    room_a, room_b = _fit(panel, own, a.x), _fit(panel, other, b.x) + b.travel[::2]
    nodes = np.array([a.at(s.x) for s in (*panel.stop.values(), *panel.stud.values())])
    touching: frozenset[int] = frozenset()
    for _ in range(50):
        k, f = stiffness.copy(), load.copy()
        for node in touching:
            k[node, node] += CONTACT
            at = (node % size) // 2
            f[node] += CONTACT * (room_a[at] if node < size else -room_b[at])
        y = np.linalg.solve(k, f)
        gaps = {own: room_a - y[:size:2], other: room_b + y[size::2]}
        now = frozenset(int(n) for n in nodes if gaps[own][n // 2] < 0) | frozenset(
            int(size + n) for n in nodes if gaps[other][n // 2] < 0
        )
        if now == touching:
            return Position(a.x, gaps)
        touching = now
    message = "the contacts of the independent beams do not settle"
    raise AssertionError(message)


def _fit(panel: LoadedPanel, rail: str, x: Floats) -> Floats:
    gap = panel.rail[rail].fit_gap
    assert gap is not None
    return evaluate_profile(gap, x)
