"""A machine in another program's implicit step against the same machine in that of the solver.

The other program is a linear rail of one or two masses stepped by the trapezoidal rule: for a step
it is `y = free + compliance F` at the rods. One machine must give what the solver gives in shorter
steps; two machines on coupled masses must satisfy the condensed equations exactly.
"""

from typing import Any

import numpy as np
import pytest

from turnout.machine.compute import places as at
from turnout.machine.compute.couple import Machines, accept_machines, try_machines
from turnout.machine.machine_file import load_machines
from turnout.machine.rows import command_rows, machine_room, machine_row, start_state, stroke_table
from turnout.throw.machine import throw_one_mass

RAIL = {"rail.friction_force": 0.0, "rail.stop_stiffness": 0.0, "rail.bed_stiffness": 60e3}


class TrapezoidalRail:
    """M y'' + C y' + K (y - rest) = F by the trapezoidal rule, condensed to its masses."""

    def __init__(self, M: Any, C: Any, K: Any, rest: Any, y: Any, h: float) -> None:
        self.M, self.C, self.K, self.rest, self.h = M, C, K, rest, h
        self.y, self.v = y.copy(), np.zeros_like(y)
        self.effective = np.linalg.inv(M + h / 2 * C + h * h / 4 * K)
        self.compliance = np.ascontiguousarray(h * h / 4 * self.effective)

    def start(self, F: np.ndarray) -> None:
        self.a = np.linalg.solve(self.M, F - self.K @ (self.y - self.rest))

    def free(self) -> np.ndarray:
        h = self.h
        self.y_pred = self.y + h * self.v + h * h / 4 * self.a
        self.v_pred = self.v + h / 2 * self.a
        load = -self.C @ self.v_pred - self.K @ (self.y_pred - self.rest)
        return self.y_pred + h * h / 4 * (self.effective @ load)

    def finish(self, F: np.ndarray) -> None:
        h = self.h
        load = F - self.C @ self.v_pred - self.K @ (self.y_pred - self.rest)
        self.a = self.effective @ load
        self.y, self.v = self.y_pred + h * h / 4 * self.a, self.v_pred + h / 2 * self.a


def coupled(
    machines: list[Any], rail: TrapezoidalRail, x: list[float], steps: int, shared: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """March machines and rail together; return the state rows, rail positions and residuals."""
    loaded = [m for m, _ in machines]
    rows = [machine_row(m) for m in loaded]
    tables = [stroke_table(m.stroke) for m in loaded]
    commands = [command_rows(c) for _, c in machines]
    group = Machines(np.array(rows), np.array(tables), np.array(commands), shared)
    count, h = len(loaded), rail.h
    state = np.array([start_state(m, row, s) for m, row, s in zip(loaded, rows, x, strict=True)])
    force = np.array([m.rod.stiffness for m in loaded]) * (state[:, at.ROD_POSITION] - rail.y)
    state[:, at.ROD_FORCE] = force
    rail.start(force)
    room = machine_room(count, events=32)
    trial = state.copy()
    kept, places, residuals = [state.copy()], [rail.y.copy()], [0.0]
    for n in range(steps):
        free = rail.free()
        ends = (rail.y.copy(), rail.v.copy(), free, rail.compliance)
        assert try_machines(group, state, trial, ends, (n * h, h), room) == at.CONVERGED
        F = trial[:, at.ROD_FORCE].copy()
        rail.finish(F)
        k = np.array([m.rod.stiffness for m in loaded])
        residuals.append(np.abs(F - k * (trial[:, at.ROD_POSITION] - rail.y)).max())
        accept_machines(group, state, trial, (n * h, h), room)
        kept.append(state.copy())
        places.append(rail.y.copy())
    return np.array(kept), np.array(places), np.array(residuals)


@pytest.mark.parametrize(
    ("h", "share"), [pytest.param(2.5e-4, 2e-4, marks=pytest.mark.long), (1e-3, 1.5e-3)]
)
def test_one_machine_as_in_the_solver(h: float, share: float) -> None:
    loaded = load_machines("sb3", overrides=RAIL | {"throw.duration": 4.0, "throw.step": 1.25e-4})
    inside = throw_one_mass(loaded)
    machine, rail = loaded.machine["sb3"], loaded.rail
    assert rail is not None
    assert loaded.throw is not None
    bed = np.array([[rail.bed_stiffness]])
    y0 = inside["rail_position"][:1]
    outside = TrapezoidalRail(
        np.array([[rail.mass]]), np.array([[rail.damping]]), bed, np.array([rail.bed_rest]), y0, h
    )
    steps = round(4.0 / h)
    kept, places, residual = coupled(
        [(machine, loaded.throw.command)], outside, [loaded.throw.start], steps
    )
    every = round(1e-3 / h)
    for name, place, most in (
        ("rod_force", at.ROD_FORCE, share),
        ("current", at.CURRENT, share),
        ("speed", at.SPEED, share),
        ("rod_position", at.ROD_POSITION, share / 10),
    ):
        difference = kept[::every, 0, place] - inside[name]
        rms = np.sqrt(np.mean(difference**2))
        assert rms <= most * np.abs(inside[name]).max(), name
    assert np.abs(places[::every, 0] - inside["rail_position"]).max() <= 2e-5
    assert residual.max() <= 1e-6


@pytest.mark.parametrize("name", ["sb3", "s700k"])
def test_a_step_worked_out_at_its_acceptance_is_that_worked_out_at_once(name: str) -> None:
    """A shared resistance that is all but none takes the other way, to the same bits.

    Over a whole throw: start, run, limit contact, lock, rest; of `s700k` as a steady circuit.
    """
    changes: dict[str, object] = {"motor.transient": False} if name == "s700k" else {}
    loaded = load_machines(name, overrides=changes)
    machine, rail, throw = loaded.machine[name], loaded.rail, loaded.throw
    assert rail is not None
    assert throw is not None
    step, end = 2e-3, 7.0
    bed, y0 = np.array([[rail.bed_stiffness]]), np.array([throw.start])

    def states(shared: float) -> np.ndarray:
        outside = TrapezoidalRail(
            np.array([[rail.mass]]),
            np.array([[rail.damping]]),
            bed,
            np.array([rail.bed_rest]),
            y0,
            step,
        )
        pairs = [(machine, throw.command)]
        return coupled(pairs, outside, [throw.start], round(end / step), shared)[0][:, 0]

    later, at_once = states(0.0), states(1e-300)
    assert later[-1, at.LOCKED] == 1.0
    np.testing.assert_array_equal(later, at_once)


def test_two_machines_on_one_rail_and_supply() -> None:
    """Stiff coupling of the rods and a supply that drops: the condensed equations hold exactly."""
    loaded = load_machines("sb3", overrides={"supply.shared_resistance": 3.0})
    machine = loaded.machine["sb3"]
    other = loaded.with_overrides({"stroke.ratio": 9000.0, "clutch.torque": 0.7}).machine["sb3"]
    assert loaded.throw is not None
    later = loaded.with_overrides({"throw.command": [{"time": 0.13, "direction": "close"}]}).throw
    assert later is not None
    M = np.diag([300.0, 300.0])
    K = np.array([[400e3, -380e3], [-380e3, 400e3]])
    start = np.full(2, -0.06)

    def rail() -> TrapezoidalRail:
        return TrapezoidalRail(M, 20.0 * np.eye(2) + 2e-3 * K, K, start, start, 1e-3)

    pairs = [(machine, loaded.throw.command), (other, later.command)]
    kept, places, residual = coupled(pairs, rail(), [-0.06, -0.06], 1200, shared=3.0)
    assert residual.max() <= 1e-4
    assert np.ptp(places, axis=0).min() > 0.01
    both_run = kept[400]
    assert both_run[0, at.SHARED_DROP] == pytest.approx(3.0 * both_run[1, at.CURRENT], rel=1e-6)
    alone, _, _ = coupled(pairs, rail(), [-0.06, -0.06], 1200)
    # the shared drop slows both
    assert kept[400, 0, at.SPEED] < alone[400, 0, at.SPEED]


def test_staggered_step_with_a_corrector_is_the_condensed_one() -> None:
    """Predicted rail first, then the rail that the found forces give: the same after two passes."""
    loaded = load_machines("sb3")
    machine = loaded.machine["sb3"]
    assert loaded.throw is not None
    row = machine_row(machine)
    group = Machines(
        np.array([row]),
        np.array([stroke_table(machine.stroke)]),
        np.array([command_rows(loaded.throw.command)]),
        0.0,
    )
    state = np.array([start_state(machine, row, -0.117)])
    room = machine_room(1, events=32)
    y, v, c = np.array([-0.113]), np.array([0.0]), np.array([[4e-10]])
    state[:, at.ROD_FORCE] = 750e3 * (state[:, at.ROD_POSITION] - y)
    before = state.copy()
    condensed, staggered = state.copy(), state.copy()
    free = y - c[0] * state[0, at.ROD_FORCE] + 3e-6
    assert try_machines(group, state, condensed, (y, v, free, c), (0.2, 1e-3), room) == 0
    force = state[:, at.ROD_FORCE]
    for _ in range(3):
        found = free + c @ force
        none = np.zeros((1, 1))
        assert try_machines(group, state, staggered, (y, v, found, none), (0.2, 1e-3), room) == 0
        force = staggered[:, at.ROD_FORCE].copy()
    assert force[0] == pytest.approx(condensed[0, at.ROD_FORCE], rel=1e-6)
    assert np.array_equal(state, before)


@pytest.mark.parametrize("transient", [False, True])
def test_two_induction_motors_on_one_supply(transient: bool) -> None:
    """Two alike on a shared resistance R: each as one alone behind 2 R more of its line."""
    loaded = load_machines("s700k", overrides={"motor.transient": transient})
    machine = loaded.machine["s700k"]
    assert loaded.throw is not None
    shared = loaded.with_overrides({"supply.shared_resistance": 4.0}).machine["s700k"]
    behind = loaded.with_overrides({"supply.line_resistance": 12.0}).machine["s700k"]
    start = np.full(2, -0.22)

    def rail() -> TrapezoidalRail:
        M, K = np.diag([300.0, 300.0]), np.diag([4e3, 4e3])
        return TrapezoidalRail(M, 20.0 * np.eye(2), K, start, start, 2e-4)

    def run(one: Any, other: Any, resistance: float) -> np.ndarray:
        pairs = [(m, loaded.throw.command) for m in (one, other)]  # type: ignore[union-attr]
        return coupled(pairs, rail(), [-0.22, -0.22], 2500, shared=resistance)[0]

    both = run(shared, shared, 4.0)
    alone = run(behind, behind, 0.0)
    # the others' current is that of the end of a step throughout it: first order in its length
    assert both[-1, 0, at.SPEED] == pytest.approx(alone[-1, 0, at.SPEED], rel=1e-3)
    assert both[-1, 0, at.CURRENT] == pytest.approx(alone[-1, 0, at.CURRENT], rel=1e-4)
    free = run(machine, machine, 0.0)
    assert both[-1, 0, at.SPEED] < free[-1, 0, at.SPEED]
    for values in shared.motor.of_kind.powers(machine_row(shared), both[:, 0]):
        assert np.isfinite(values).all()
    # the supply gives what both take: what one line takes more is lost in the shared one
    supplied = both[-1, :, at.ENERGIES + at.SUPPLY]
    spent = both[-1, :, [at.ENERGIES + k for k in LOSSES]].sum(axis=0)
    into = both[-1, :, at.ENERGIES + at.INTO_STORES] + both[-1, :, at.ENERGIES + at.ROD_INPUT]
    assert supplied == pytest.approx(spent + into, rel=1e-9)


LOSSES = (
    *(at.COPPER, at.LINE, at.FIELD, at.MOTOR_FRICTION, at.MOTOR_DRAG_HEAT, at.GEAR),
    *(at.GEAR_DRAG_HEAT, at.CLUTCH),
)
