"""A rail of one mass with one machine as a mechanism: bed, stop, object, friction, and its rod."""

import math

import numpy as np
from numpy.typing import NDArray

from turnout.law.table import LawTableBuilder
from turnout.machine.components import Machine, OneMassRail, Throw
from turnout.machine.compute import places as at
from turnout.machine.rows import command_rows, machine_row, start_state, stroke_table
from turnout.mechanism.mechanism import DriveMachines, Matrices, Mechanism

Floats = NDArray[np.float64]


def one_mass_mechanism(machine: Machine, rail: OneMassRail, throw: Throw) -> Mechanism:
    """Return the rail as a mechanism with the rod as its first law.

    Parameters
    ----------
    machine : Machine
        Its rod position is 0 where the rail is home, and the input of the mechanism [m].
    rail : OneMassRail
    throw : Throw
        Of which start and commands count.

    Examples
    --------
    >>> from turnout.machine.machine_file import load_machines
    >>> loaded = load_machines("sb3")
    >>> one_mass_mechanism(loaded.machine["sb3"], loaded.rail, loaded.throw).law_names
    ('rod', 'stop', 'friction limit')
    """
    laws, names = LawTableBuilder(), ["rod", "stop"]
    play, k = 0.5 * machine.rod.play, machine.rod.stiffness
    ends, slopes = ([-play, play], [k, 0.0, k]) if play > 0.0 else ([], [k])
    laws.add_piecewise(0, breakpoints=ends, slopes=slopes, input_index=0, base_segment=0)
    laws.add_contact(0, stiffness=rail.stop_stiffness, clearance=0.0)
    if rail.object_size is not None:
        names.append("object")
        laws.add_contact(0, stiffness=rail.object_stiffness, clearance=-rail.object_size)
    if rail.friction_force > 0.0:
        names.append("friction limit")  # a contact of a row that stands, which always presses
        limit = laws.add_contact(1, stiffness=rail.friction_force, clearance=-1.0)
        laws.add_friction(
            0, normal=limit, friction_coefficient=1.0, stick_stiffness=rail.friction_stiffness
        )
    return Mechanism(
        matrices=Matrices(
            stiffness=np.array([[rail.bed_stiffness]]),
            mass=np.array([[rail.mass]]),
            damping=np.array([[rail.damping]]),
            load=np.array([rail.bed_stiffness * rail.bed_rest]),
        ),
        core=np.array([[1.0], [0.0]]),
        laws=laws.table(),
        law_names=tuple(names),
        friction_names=("rail",) if rail.friction_force > 0.0 else (),
        machines=_machine_of(machine, throw),
    )


def _machine_of(machine: Machine, throw: Throw) -> DriveMachines:
    constants, gap = machine_row(machine), machine.circuit.lock_gap
    return DriveMachines(
        names=("1",),
        records=(machine,),
        inputs=np.array([0]),
        laws=np.array([0]),
        constants=constants[np.newaxis],
        tables=stroke_table(machine.stroke)[np.newaxis],
        commands=command_rows(throw.command)[np.newaxis],
        shared_resistance=0.0,
        start=start_state(machine, constants, throw.start)[np.newaxis],
        shift=np.zeros(1),
        lock_gap=np.array([math.inf if gap is None else gap]),
    )


def rod_before(mechanism: Mechanism, rail: OneMassRail) -> float:
    """Return the rod position from which the rod comes to its start [m].

    The rail rests there without friction, which the way of the rod from there takes to
    `friction_at_start` of its limit.

    Parameters
    ----------
    mechanism : Mechanism
        From `one_mass_mechanism`.
    rail : OneMassRail
    """
    from scipy.optimize import brentq  # slow to load

    assert mechanism.machines is not None
    x = float(mechanism.machines.start[0, at.ROD_POSITION])
    stiffness, play = mechanism.machines.constants[0, [at.ROD_STIFFNESS, at.ROD_PLAY]]
    friction = rail.friction_at_start * rail.friction_force

    def rod_at(y: float, friction: float) -> float:
        """Return the rod position that holds the rail; it rises with y, by at least as much."""
        force = friction + rail.bed_stiffness * (y - rail.bed_rest)
        force += rail.stop_stiffness * max(y, 0.0)
        if rail.object_size is not None:
            force += rail.object_stiffness * max(y + rail.object_size, 0.0)
        return float(y + force / stiffness + math.copysign(0.5 * play, force))

    beyond = rod_at(x, friction) - x
    y = brentq(lambda y: rod_at(y, friction) - x, x - 2.0 * beyond, x, xtol=1e-16, rtol=1e-15)
    return rod_at(y - friction / rail.friction_stiffness, 0.0)
