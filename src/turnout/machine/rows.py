"""From the records of a machine to the rows of floats that the kernels read."""

import math
from collections.abc import Sequence

import numpy as np

from turnout.core.errors import MachineError
from turnout.law.table import Floats
from turnout.machine.components import Command, Machine, Stroke
from turnout.machine.compute import places as at
from turnout.machine.compute.circuit import kinetic_level, switch_off
from turnout.machine.compute.couple import Room
from turnout.machine.compute.machine_step import WORK_ROWS, rod_position
from turnout.machine.motor_kind import motor_row


def stroke_table(stroke: Stroke) -> Floats:
    """Return the pieces of a stroke given as a table: share where each begins, a0 ... a3."""
    if stroke.kind != "table":
        return np.zeros((2, 5))
    s = np.array([0.0, *(stroke.angle_share or ())])
    x = np.array([0.0, *(stroke.length_share or ())])
    from scipy.interpolate import PchipInterpolator  # slow to load, and of tables only

    pieces = PchipInterpolator(s, x)
    table = np.zeros((s.size, 5))
    table[:, 0] = s
    table[:-1, 1:] = pieces.c[::-1].T
    return table


CORNER = 1e-3
"""Way over which a rod behind a lock bar takes up the speed of its screw [m]."""


def with_lock_stroke(machine: Machine) -> Machine:
    """Return a machine whose screw is a table that stands while its lock bar moves.

    Others are returned as they are. The way goes from limit contact to limit contact and
    `circuit.overrun` beyond; the limit contacts then act where the bar has arrived.

    Raises
    ------
    MachineError
        If a limit contact is not given.
    """
    lock, circuit, ratio = machine.lock, machine.circuit, machine.stroke.ratio
    if lock is None or lock.stroke is None or machine.stroke.kind != "screw" or ratio is None:
        return machine
    if circuit.limit_closing is None or circuit.limit_opening is None:
        message = (
            "lock.stroke: where the way of the rod ends is not known; give circuit.limit_closing "
            "and circuit.limit_opening"
        )
        raise MachineError([message], source="machine")
    opened = circuit.limit_opening - circuit.overrun
    length = circuit.limit_closing + circuit.overrun - opened
    # half a corner of the way is covered in a whole corner of the bar
    near = CORNER * np.array([0.0, 0.5, 1.0, 2.0])
    moved = CORNER * np.array([0.0, 0.125, 0.5, 1.5])
    whole = length + CORNER
    bar = np.concatenate((lock.stroke + near, lock.stroke + whole - near[::-1]))
    total = 2.0 * lock.stroke + whole
    way = np.concatenate((moved, length - moved[::-1]))
    stroke = machine.stroke.model_copy(
        update={
            "kind": "table",
            "angle": ratio * total,
            "length": length,
            "start": opened,
            "angle_share": (*(bar / total).tolist(), 1.0),
            "length_share": (*(way[:-1] / length).tolist(), 1.0, 1.0),
        }
    )
    circuit = circuit.model_copy(update={"limit_closing": None, "limit_opening": None})
    return machine.model_copy(update={"stroke": stroke, "circuit": circuit})


AT_END = 1e-9
"""Way to an end of a stroke within which a rod is at it, as sums of floats miss it [m]."""


def angle_at(machine: Machine, constants: Floats, position: float) -> float:
    """Return the least shaft angle at which the rod is at a position [rad].

    Parameters
    ----------
    machine : Machine
    constants : ndarray, shape (CONSTANTS,)
        Of which the stroke is read.
    position : float
        Of the rod's machine end [m]; at the ends of a crank or table and beyond, with its lock
        bar home.
    """
    from scipy.optimize import brentq  # slow to load; sweeps of markers need none

    stroke = machine.stroke
    if stroke.ratio is not None and stroke.kind == "screw":
        return position * stroke.ratio
    whole, length = stroke.angle or 0.0, stroke.length or 0.0
    if position <= stroke.start + AT_END:
        return 0.0
    if position >= stroke.start + length - AT_END:
        return whole
    table = stroke_table(stroke)
    return float(
        brentq(lambda a: rod_position(constants, table, a)[0] - position, 0.0, whole, xtol=1e-12)
    )


def _gear_entries(machine: Machine) -> dict[int, float]:
    clutch, gear, stroke = machine.clutch, machine.gear, machine.stroke
    back = gear.efficiency if gear.back_efficiency is None else gear.back_efficiency
    kinds = {"screw": at.SCREW, "crank": at.CRANK, "table": at.TABLE}
    ratio = stroke.ratio if stroke.kind == "screw" else stroke.angle
    first, last = stroke.standing
    return {
        at.CLUTCH_STIFFNESS: clutch.stiffness,
        at.CLUTCH_TORQUE: clutch.slip_torque,
        at.STATIC_RATIO: clutch.static_ratio,
        at.LEVEL_PER_KELVIN: clutch.temperature_coefficient,
        at.LEVEL_PER_JOULE: clutch.wear,
        at.CLUTCH_HEAT_CAPACITY: clutch.heat_capacity or math.inf,
        at.CLUTCH_COOLING: 1.0 / clutch.cooling_time if clutch.cooling_time else 0.0,
        at.GEAR_INERTIA: gear.inertia,
        at.GEAR_DRAG: gear.drag,
        at.FACTOR_DRIVING: 1.0 / gear.efficiency,
        at.FACTOR_DRIVEN: back,
        at.STROKE_KIND: float(kinds[stroke.kind]),
        at.RATIO: ratio or 0.0,
        at.STROKE: stroke.length or 0.0,
        at.STROKE_START: stroke.start,
        at.DRY_RATIO: gear.dry_ratio,
        at.DRY_FROM: _or(gear.dry_from, math.inf),
        at.DRY_TO: _or(gear.dry_to, -math.inf),
        at.ROD_STIFFNESS: machine.rod.stiffness,
        at.ROD_PLAY: machine.rod.play,
        at.LOCK_TORQUE: machine.lock_torque,
        at.UNLOCKED_FROM: -math.inf if machine.lock is None else first * (stroke.angle or 0.0),
        at.UNLOCKED_TO: math.inf if machine.lock is None else last * (stroke.angle or 0.0),
    }


def _circuit_entries(machine: Machine) -> dict[int, float]:
    circuit, hand = machine.circuit, machine.hand
    cranked = hand is not None
    return {
        at.SNUB_RESISTANCE: circuit.snub_resistance,
        at.OPEN_AFTER: float(circuit.after_cutoff == "open"),
        at.CONTACTOR_DELAY: circuit.contactor_delay,
        at.CUTOFF_DELAY: circuit.cutoff_delay,
        at.TIME_OUT: math.inf if cranked else circuit.time_out or math.inf,
        at.OVERLOAD_CURRENT: circuit.overload_current or math.inf,
        at.OVERLOAD_TIME: circuit.overload_time,
        at.DETECTION_OPEN: _or(circuit.detection_open, -math.inf),
        at.DETECTION_CLOSED: _or(circuit.detection_closed, math.inf),
        at.HOLDS: float(circuit.holding == "lock"),
        at.HAND_GAIN: hand.stiffness if hand else 0.0,
        at.HAND_SPEED: hand.speed if hand else 0.0,
        at.HAND_RAMP: hand.ramp if hand else 1.0,
        at.HAND_STAYS: float(hand is not None and hand.release == "never"),
    }


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def machine_row(machine: Machine) -> Floats:
    """Return the constants of a machine, see `turnout.machine.compute.places`."""
    row = motor_row(machine.motor, machine.supply)
    for place, value in (_gear_entries(machine) | _circuit_entries(machine)).items():
        row[place] = value
    circuit, stroke = machine.circuit, machine.stroke
    opened, closed = (
        (-math.inf, math.inf) if stroke.kind == "screw" else (0.0, stroke.angle or math.inf)
    )
    for place, limit, end in (
        (at.LIMIT_CLOSING, circuit.limit_closing, closed),
        (at.LIMIT_OPENING, circuit.limit_opening, opened),
    ):
        row[place] = end if limit is None else angle_at(machine, row, limit)
    return row


def start_state(machine: Machine, constants: Floats, position: float) -> Floats:
    """Return the state of a machine at rest: de-energised, clutch unloaded, held by its lock."""
    state = np.zeros(at.STATES)
    state[at.GEAR_ANGLE] = angle_at(machine, constants, position)
    table = stroke_table(machine.stroke)
    state[at.ROD_POSITION] = rod_position(constants, table, state[at.GEAR_ANGLE])[0]
    state[at.DIRECTION] = 1.0
    state[at.LOCK_ALLOWED] = 1.0
    state[at.GEAR_RATIO] = 1.0
    state[at.LOCKED] = constants[at.HOLDS]
    state[at.OVERLOAD_SINCE] = math.inf
    state[at.LEVEL] = kinetic_level(constants, state) * constants[at.STATIC_RATIO]
    switch_off(constants, state)
    return state


def command_rows(commands: Sequence[Command]) -> Floats:
    """Return time and direction of each command."""
    rows = [(c.time, 1.0 if c.direction == "close" else -1.0) for c in commands]
    return np.array(rows, dtype=np.float64).reshape(len(rows), 2)


def machine_room(count: int, *, events: int) -> Room:
    """Return room for a step of so many machines, each with a log of so many events."""
    return Room(
        rails=np.zeros((count, at.RAIL_CONSTANTS)),
        work=np.zeros((count, WORK_ROWS, at.ROD_FORCE + 1)),
        log=np.zeros((count, events, 2)),
        plain=np.zeros(count),
    )
