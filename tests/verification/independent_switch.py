r"""Another program that throws a whole switch: no modes, no shared laws, steps or start.

What it takes of turnout are the superelements of the rails, the rows at which laws act and the
numbers of these laws. Everything after that is its own: markers, contact, friction, drives that
slip, the start and the steps in time, backward differences of second order with a fixed step,

.. math:: v_n = (3 u_n - 4 u_{n-1} + u_{n-2}) / 2h, \quad a_n = (3 v_n - 4 v_{n-1} + v_{n-2}) / 2h .

With the closed segments of laws in S, a step is g + A d(g) = G S^-1 r on the rows, where d is what
the laws differ by from these; it is solved by guessing the segment of each, one linear
solution, and a check of the guess. Normal forces of friction are those of the guess before, until
they no longer change. The switch starts open and without friction, returns once, and is then
thrown: what it is pressed home with at the start is left by that return.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]

STEP = 10e-3
"""Of time [s]."""
OPENED = 4.2
"""When the switch stands open, and the return before the throw begins in the schedule [s]."""
GUESSES = 60
FORCE_CHANGE = 0.05
"""Change of a normal force from guess to guess that counts as none [N]."""


@dataclass(frozen=True, slots=True, eq=False)
class Thrown:
    """A throw: instants [s], forces of the drives [N], and steps that found no segments."""

    time: Floats
    force: Floats
    touch: float
    unsettled: int


@dataclass(frozen=True, slots=True, eq=False)
class Switch:
    """What throws of one switch have in common.

    Attributes
    ----------
    panel : LoadedPanel
        With its sections and shapes.
    blocks : list of slice
        Coordinates of each rail.
    """

    panel: LoadedPanel
    blocks: list[slice]
    moving: tuple[Floats, Floats, Floats]
    still: Floats


def switch_of(panel: LoadedPanel) -> Switch:
    """Return a switch with the inverse of each rail's matrix for a step in time and for rest."""
    mechanism = build_mechanism(panel, [])
    blocks = [slice(rail.first, rail.first + rail.count) for rail in mechanism.rails]
    stiffness = _with_closed(mechanism)
    moving = 9 / (4 * STEP**2) * mechanism.mass + 3 / (2 * STEP) * mechanism.damping + stiffness
    matrices = (_inverse(moving, blocks), _padded(mechanism.mass, blocks))
    return Switch(
        panel=panel,
        blocks=blocks,
        moving=(*matrices, _padded(mechanism.damping, blocks)),
        still=_inverse(stiffness, blocks),
    )


def throw(
    switch: Switch,
    *,
    friction: Floats,
    trapped: ForeignObject | None = None,
    later: float = 0.0,
) -> Thrown:
    """Throw a switch open and closed.

    Parameters
    ----------
    switch : Switch
        From `switch_of`.
    friction : ndarray, shape (n_chairs, 2)
        Coefficient of each chair under the instrumented and the other rail [-].
    trapped : ForeignObject, optional
        In the gap from when the switch stands open.
    later : float
        By which the return begins later than in the schedule [s].
    """
    panel = switch.panel
    objects = resolve_objects(panel, [] if trapped is None else [trapped])
    mechanism = build_mechanism(panel, objects)
    laws, rows = mechanism.laws, mechanism.rows
    size = max(item.stop - item.start for item in switch.blocks)
    places = np.array([[item.start, item.stop] for item in switch.blocks])
    segments = _segments(mechanism)
    held = [mechanism.index.drive[name] for name in panel.drive]
    trap = np.zeros(laws.row.size, dtype=np.bool_)
    trap[list(mechanism.index.object.values())] = True
    slides = (
        laws.friction_row,
        laws.friction_normal,
        _coefficients(mechanism, friction),
        laws.stick_stiffness,
    )
    common = (rows, segments, laws.row, laws.offset, laws.input_index, laws.base_segment, trap)
    still = np.zeros((len(places), size, size))
    first = markers(panel, np.array([OPENED]), later)
    slippery = (*slides[:2], np.zeros(slides[2].size), slides[3])
    state = _rest(mechanism)
    none = np.zeros(1, dtype=np.bool_)
    _, _, state, lost = march(
        places, (switch.still, still, still), mechanism.load, common, slippery, first, none,
        1e9, state, np.array(held),
    )  # fmt: skip
    end = float(panel.schedule.end) + later
    before = np.arange(OPENED, end + 1e-9, STEP)
    after = np.arange(0.0, end + 1e-9, STEP)
    time = np.concatenate([before, after])
    there = np.concatenate([np.zeros(before.size, bool), after >= 4.3])
    force, touch, _, unsettled = march(
        places, switch.moving, mechanism.load, common, slides,
        markers(panel, time, later), there, STEP, state, np.array(held),
    )  # fmt: skip
    return Thrown(after, -force[before.size :].T, touch, int(unsettled + lost))


def markers(panel: LoadedPanel, time: Floats, later: float) -> Floats:
    """Return where each drive's marker is, from where its rail is free of force, (n_times, n) [m].

    A rail that is free of force stands at a fraction of its way from closed to open.
    """
    opening, closing = panel.movement["throw"], panel.movement["return"]
    free = float(panel.rail[panel.instrumented_rail].stress_free)
    found = []
    for name, drive in panel.drive.items():
        closed = float(drive.over_travel_closed)
        opened = -float(drive.stroke) - float(drive.over_travel_open)
        way = opened - closed
        span = float(closing.duration) + float(closing.extra_time.get(name, 0.0))
        to = _share(time - float(opening.start), float(opening.duration), float(opening.ramp))
        back = _share(time - float(closing.start) - later, span, float(closing.ramp))
        found.append(free * float(drive.stroke) + closed + way * (to - back))
    return np.array(found).T


def _share(time: Floats, duration: float, ramp: float) -> Floats:
    """Return the share of a movement: even speed, raised to and lowered from as half a cosine."""
    speed = 1.0 / (duration - ramp)
    t = np.clip(time, 0.0, duration)
    up = np.minimum(t, ramp)
    down = np.clip(t - (duration - ramp), 0.0, ramp)
    even = np.clip(t, ramp, duration - ramp) - ramp
    rise = 0.5 * (up - ramp / np.pi * np.sin(np.pi * up / ramp))
    fall = 0.5 * (down + ramp / np.pi * np.sin(np.pi * down / ramp))
    return np.asarray(speed * (rise + even + fall))


def _coefficients(mechanism: Mechanism, friction: Floats) -> Floats:
    """Return the coefficient of each foot; both feet of a chair have the same."""
    found = np.array(mechanism.laws.friction_coefficient, dtype=np.float64)
    rails = list(dict.fromkeys(rail for rail, _ in mechanism.index.chair_friction))
    chairs = list(dict.fromkeys(name for _, name in mechanism.index.chair_friction))
    for (rail, name), feet in mechanism.index.chair_friction.items():
        found[list(feet)] = friction[chairs.index(name), rails.index(rail)]
    return found


def _with_closed(mechanism: Mechanism) -> Floats:
    """Return the stiffness of the rails with the closed segment of each law that has one.

    Links join rails, and are left out, so that each rail has a matrix of its own.
    """
    laws, found = mechanism.laws, mechanism.stiffness.copy()
    links = set(mechanism.index.link.values())
    for law in np.flatnonzero(laws.base_segment >= 0):
        if int(law) not in links:
            row = mechanism.rows[laws.row[law]]
            slope = laws.slope[laws.segment_start[law] + laws.base_segment[law]]
            found += slope * np.outer(row, row)
    return found


def _segments(mechanism: Mechanism) -> Floats:
    """Return lower end, upper end, slope and force at zero of three segments of each law.

    Further numbers: slope and force at zero of the segment within the rails' matrices.
    """
    laws = mechanism.laws
    links = set(mechanism.index.link.values())
    count = laws.row.size
    found = np.zeros((count, 4, 4))
    found[:, :3, 0] = np.inf
    found[:, :3, 1] = np.inf
    ends = np.append(laws.segment_start, laws.slope.size)
    for law in range(count):
        own = np.arange(ends[law], ends[law + 1])
        assert own.size <= 3, "at most three segments"
        for number, at in enumerate(own):
            found[law, number] = (
                laws.segment_lower[at],
                laws.segment_upper[at],
                laws.slope[at],
                laws.intercept[at],
            )
        base = laws.base_segment[law]
        if base >= 0 and law not in links:
            found[law, 3, 2:] = laws.slope[own[base]], laws.intercept[own[base]]
    return found


def _padded(matrix: Floats, blocks: list[slice]) -> Floats:
    size = max(item.stop - item.start for item in blocks)
    found = np.zeros((len(blocks), size, size))
    for number, own in enumerate(blocks):
        count = own.stop - own.start
        found[number, :count, :count] = matrix[own, own]
    return found


def _inverse(matrix: Floats, blocks: list[slice]) -> Floats:
    found = _padded(matrix, blocks)
    for number, own in enumerate(blocks):
        count = own.stop - own.start
        found[number, :count, :count] = np.linalg.inv(matrix[own, own])
    return found


def _rest(mechanism: Mechanism) -> tuple[Floats, Floats]:
    """Return coordinates without motion, and the anchors of the feet."""
    return np.zeros(mechanism.load.size), np.zeros(mechanism.laws.friction_row.size)


@njit(cache=True)
def _times(blocks, places, vector):
    """Multiply a matrix of one block a rail with a vector."""
    found = np.zeros(vector.size)
    for number in range(places.shape[0]):
        first, last = places[number]
        own = np.ascontiguousarray(blocks[number, : last - first, : last - first])
        found[first:last] = own @ np.ascontiguousarray(vector[first:last])
    return found


@njit(cache=True)
def _argument(segment, e):
    """Return which segment of a law holds an argument."""
    for s in range(3):
        if e <= segment[s, 1]:
            return s
    return 2


@njit(cache=True)
def _deviations(common, slides, g, marker, anchor, normal, there, slope, force, kinds, slips):
    """Put slope and force at zero of what laws differ by on their rows; return whether all stay."""
    _, segments, row, offset, inputs, _, trap = common
    slope[:] = 0.0
    force[:] = 0.0
    same = True
    for law in range(row.size):
        if trap[law] and not there:
            continue
        zero = offset[law]
        if inputs[law] >= 0:
            zero += marker[inputs[law]]
        s = _argument(segments[law], g[row[law]] - zero)
        same = same and kinds[law] == s
        kinds[law] = s
        k, base = segments[law, s, 2], segments[law, 3, 2]
        slope[row[law]] += k - base
        force[row[law]] += segments[law, s, 3] - k * zero
        # what the matrices hold already is the closed law about zero, without its offset
    for foot in range(slides[0].size):
        at, contact = slides[0][foot], slides[1][foot]
        e = g[row[contact]] - offset[contact]
        s = _argument(segments[contact], e)
        pressed = max(segments[contact, s, 2] * e + segments[contact, s, 3], 0.0)
        same = same and abs(pressed - normal[foot]) < FORCE_CHANGE
        normal[foot] = pressed
        limit = slides[2][foot] * pressed
        trial = slides[3][foot] * (g[at] - anchor[foot])
        slip = 0
        if trial > limit:
            slip = 1
        elif trial < -limit:
            slip = -1
        same = same and slips[foot] == slip
        slips[foot] = slip
        if slip == 0:
            slope[at] += slides[3][foot]
            force[at] -= slides[3][foot] * anchor[foot]
        else:
            force[at] += slip * limit
    return same


@njit(cache=True)
def _solved(flexible, free, slope, force):
    """Solve g + A (slope g + force) = free on the rows that have a slope, and return g."""
    active = np.flatnonzero(slope != 0.0)
    start = free - flexible @ force
    if active.size == 0:
        return start
    matrix = np.zeros((active.size, active.size))
    right = np.zeros(active.size)
    for i in range(active.size):
        right[i] = start[active[i]]
        for j in range(active.size):
            matrix[i, j] = flexible[active[i], active[j]] * slope[active[j]]
        matrix[i, i] += 1.0
    found = np.linalg.solve(matrix, right)
    for j in range(active.size):
        start -= flexible[:, active[j]] * (slope[active[j]] * found[j])
    return start


@njit(cache=True)
def _flexibility(inverse, places, rows):
    """Return displacements of rows for forces along rows."""
    count = rows.shape[0]
    found = np.zeros((count, count))
    for number in range(places.shape[0]):
        first, last = places[number]
        own = np.ascontiguousarray(rows[:, first:last])
        block = np.ascontiguousarray(inverse[number, : last - first, : last - first])
        found += own @ block @ own.T
    return found


@njit(cache=True)
def march(places, matrices, load, common, slides, markers, there, step, state, held):
    """Step through the markers; return forces of drives, peak of the object, state, lost steps."""
    rows, segments, row, offset, inputs, _, trap = common
    inverse, mass, damping = matrices
    u = state[0].copy()
    anchor = state[1].copy()
    older, v, v_older = u.copy(), np.zeros(u.size), np.zeros(u.size)
    flexible = _flexibility(inverse, places, rows)
    slope, force = np.zeros(rows.shape[0]), np.zeros(rows.shape[0])
    kinds, slips = np.full(row.size, -1), np.full(slides[0].size, 9)
    normal = np.zeros(slides[0].size)
    stored = np.zeros((markers.shape[0], held.size))
    g = rows @ u
    touch, lost = 0.0, 0
    for n in range(markers.shape[0]):
        right = load + _times(
            mass, places, (12 * u - 3 * older) / (4 * step**2) + (4 * v - v_older) / (2 * step)
        )
        right += _times(damping, places, (4 * u - older) / (2 * step))
        free = rows @ _times(inverse, places, right)
        for guess in range(GUESSES):
            same = _deviations(
                common, slides, g, markers[n], anchor, normal, there[n], slope, force, kinds, slips
            )
            if same and guess > 0:
                break
            g = _solved(flexible, free, slope, force)
            if guess == GUESSES - 1:
                lost += 1
        total = slope * g + force
        new = _times(inverse, places, right - rows.T @ total)
        speed = (3 * new - 4 * u + older) / (2 * step)
        v_older, v, older, u = v, speed, u, new
        for foot in range(slides[0].size):
            limit = slides[2][foot] * normal[foot]
            at = slides[0][foot]
            trial = slides[3][foot] * (g[at] - anchor[foot])
            if normal[foot] == 0.0:
                anchor[foot] = g[at]
            elif abs(trial) > limit:
                anchor[foot] = g[at] - np.sign(trial) * limit / slides[3][foot]
        for number in range(held.size):
            law = held[number]
            e = g[row[law]] - offset[law] - markers[n, inputs[law]]
            s = _argument(segments[law], e)
            stored[n, number] = segments[law, s, 2] * e + segments[law, s, 3]
        for law in range(row.size):
            if trap[law] and there[n]:
                e = g[row[law]] - offset[law]
                s = _argument(segments[law], e)
                touch = max(touch, segments[law, s, 2] * e + segments[law, s, 3])
    return stored, touch, (u, anchor), lost
