"""Two machines on the rail of SB1, with the two programs as they are: iterated, or step by step.

Iterated: the rails are moved by rod ends x(t) as markers and answer with y(t); the machines are
loaded by k_r (x - y) with that y(t), and answer with x(t). A few rounds settle this, since a
machine yields little to force. Staggered: in each step the machines meet a rail that goes on as
before, and the rails then follow the rod ends. Both can judge a step that solves all together.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.machine.components import Machine
from turnout.machine.compute import places as at
from turnout.machine.compute.couple import Machines, accept_machines, try_machines
from turnout.machine.machine_file import load_machines
from turnout.machine.rows import command_rows, machine_room, machine_row, start_state, stroke_table
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.load import load_panel
from turnout.solver.arrange import arrange, prepare, set_up_run
from turnout.solver.integration import History, integrate
from turnout.solver.march import march, store_instant
from turnout.solver.record import SavePlan
from turnout.solver.start import start_at_rest

Floats = NDArray[np.float64]
RODS = {"1": 750e3, "2": 810e3}
PLACES = {"1": 0.3, "2": 4.5}
HORIZON = 5.0


def gap(x: float) -> float:
    """Distance between the open rail and the stock rail of SB1 [m]."""
    return 0.118 * (1 - x / 9.7) ** 2 + 0.001


def machines() -> list[tuple[Machine, Floats]]:
    """Return the machines of SB3-rail with their commands."""
    found = []
    for name, ratio, force, beyond, command in (
        ("1", 5600.0, 6000.0, 3.0e-3, 0.1),
        ("2", 16500.0, 6850.0, 3.3e-3, 0.3),
    ):
        changes = {
            "motor.loss_torque": 0.745,
            "stroke.ratio": ratio,
            "clutch.torque": force / (ratio * 0.9),
            "rod.stiffness": RODS[name],
            "circuit.limit_closing": gap(PLACES[name]) + beyond,
            "throw.command": [{"time": command, "direction": "close"}],
        }
        loaded = load_machines("sb3", overrides=changes)
        assert loaded.throw is not None
        found.append((loaded.machine["sb3"], command_rows(loaded.throw.command)))
    return found


@dataclass(frozen=True)
class Throw:
    """What both programs found: rows of machine states, and the history of the rail."""

    time: Floats
    states: Floats
    force: Floats
    y: Floats
    history: History
    changes: tuple[float, ...]


def rail_mechanism() -> Mechanism:
    """Return the rail of SB3-rail with its rods as drives that never slip."""
    panel = load_panel(
        "sb1",
        overrides={
            "drive.2.x": PLACES["2"],
            "drive.saturation_force": 1e6,
            "schedule.end": HORIZON,
            "movement.throw.start": 0.1,
            "movement.throw.duration": 0.5,
            "movement.return.start": 4.0,
            "movement.return.duration": 0.5,
        },
    )
    return build_mechanism(panel)


def group_of(pairs: list[tuple[Machine, Floats]]) -> Machines:
    """Return machines as the kernels take them."""
    made = [machine for machine, _ in pairs]
    return Machines(
        np.array([machine_row(machine) for machine in made]),
        np.array([stroke_table(machine.stroke) for machine in made]),
        np.array([commands for _, commands in pairs]),
        0.0,
    )


def throw_rail(*, step: float = 1e-3, rounds: int = 6) -> Throw:
    """Throw the sound rail by both machines; `changes` are those of the rod force by rounds [N]."""
    mechanism = rail_mechanism()
    scheme = Scheme(step=step, output_interval=step)
    rows = [mechanism.laws.row[mechanism.index.drive[name]] for name in RODS]
    pairs = machines()
    count = round(HORIZON / step)
    time = step * np.arange(count + 1, dtype=np.float64)
    states = march_machines(pairs, None, step, count)
    x = states[:, :, at.ROD_POSITION]
    force = np.zeros((count + 1, 2))
    changes = []
    for _ in range(rounds):

        def inputs(instants: Floats, x: Floats = x) -> Floats:
            return np.array([np.interp(instants, time, x[:, k]) for k in range(2)])

        history = integrate(mechanism, scheme, inputs=inputs, end=HORIZON)
        assert history.outcome.complete, history.outcome
        y = history.g[:, rows]
        found = np.array(list(RODS.values())) * (x - y)
        changes.append(float(np.abs(found - force).max()))
        force = found
        states = march_machines(pairs, y, step, count)
        x = states[:, :, at.ROD_POSITION]
    return Throw(time, states, force, y, history, tuple(changes))


def march_machines(
    pairs: list[tuple[Machine, Floats]], y: Floats | None, step: float, count: int
) -> Floats:
    """March the machines with given rail positions; without them the rods have no force."""
    group = group_of(pairs)
    if y is None:
        group.constants[:, at.ROD_STIFFNESS] = 1.0
        y = np.zeros((count + 1, 2))
    state = np.array([start_state(m, machine_row(m), 0.0) for m, _ in pairs])
    trial, kept = state.copy(), np.zeros((count + 1, *state.shape))
    room = machine_room(2, events=32)
    v, none = np.gradient(y, step, axis=0), np.zeros((2, 2))
    kept[0] = state
    for n in range(count):
        ends = (y[n].copy(), v[n].copy(), y[n + 1].copy(), none)
        assert try_machines(group, state, trial, ends, (n * step, step), room) == at.CONVERGED
        accept_machines(group, state, trial, (n * step, step), room)
        kept[n + 1] = state
    return kept


def throw_staggered(*, step: float) -> tuple[Floats, Floats]:
    """Throw the sound rail step by step; return machine states and the rods' forces on the rail."""
    mechanism, pairs, count = rail_mechanism(), machines(), round(HORIZON / step)
    mode = "waveform" if step <= 1e-3 else "quick"
    scheme = Scheme.of(mode, step=step, output_interval=step)
    positions = np.zeros((count + 1, 2))
    run, rails = prepare(
        set_up_run(arrange(mechanism, scheme), scheme, positions, SavePlan(count + 1))
    )
    rows = [mechanism.laws.row[mechanism.index.drive[name]] for name in RODS]
    ends = [int(run.system.row_place[row]) for row in rows]
    rods, group, none = np.array(list(RODS.values())), group_of(pairs), np.zeros((2, 2))
    state = np.array([start_state(m, machine_row(m), 0.0) for m, _ in pairs])
    trial, kept = state.copy(), np.zeros((count + 1, *state.shape))
    kept[0], force = state, np.zeros((count + 1, 2))
    room = machine_room(2, events=32)
    with one_blas_thread():
        start_at_rest(run, rails, mechanism)
        store_instant(run, rails, 0)
        y = [rails.g[ends].copy()] * 3
        for n in range(count):
            v = (3 * y[0] - 4 * y[1] + y[2]) / (2 * step)
            rail = (y[0], v, y[0] + step * v, none)
            assert try_machines(group, state, trial, rail, (n * step, step), room) == at.CONVERGED
            accept_machines(group, state, trial, (n * step, step), room)
            kept[n + 1] = state
            run.positions[n + 1] = state[:, at.ROD_POSITION]
            assert march(run, rails, n, n + 1)[0] == at.CONVERGED
            y = [rails.g[ends].copy(), y[0], y[1]]
            force[n + 1] = rods * (run.positions[n + 1] - y[0])
    return kept, force
