"""Machines of drives in a run: arranged for the kernels, what they leave behind, and their duty."""

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import SolverError
from turnout.core.scheme import Scheme
from turnout.kernels.shared_record import shared_record
from turnout.machine.components import Machine
from turnout.machine.compute import places as at
from turnout.machine.rows import machine_room
from turnout.machine.steady import shaft_travel
from turnout.mechanism.mechanism import DriveMachines, Mechanism
from turnout.solver.arrange import Grid, RunSetup
from turnout.solver.rods import Rods, find_slips
from turnout.solver.schedule import Pause, new_schedule
from turnout.solver.state import acquire_buffer

Floats = NDArray[np.float64]

LEAST_MOVE = 1e-4
"""A rod that moved by less while its motor was on never moved [m]."""


@dataclass(frozen=True, slots=True)
class Duty:
    """Duty of a machine on one command.

    Attributes
    ----------
    drive : str
    to : str
        "open" or "closed".
    command, on, off, rest : float
        Command, contactor closed, motor off, gear at rest [s]; NaN where it did not come to that.
    outcome : str
        "limit", "time-out", "overload"; "reversed" by the next command; "moving" where the motor
        was still on at the end; "stalled" where the rod never moved and no limit contact opened.
    """

    drive: str
    to: str
    command: float
    on: float
    off: float
    rest: float
    outcome: str


def machine_duties(
    name: str,
    *,
    commands: Floats,
    events: Sequence[tuple[float, str]],
    time: Floats,
    states: Floats,
) -> list[Duty]:
    """Return what one machine did on every command that it was given.

    Parameters
    ----------
    name : str
        Of its drive.
    commands : ndarray, shape (n, 2)
        Time [s] and direction, 1 closing or -1 opening; what fills the table up is infinite.
    events : sequence of (float, str)
        Time [s] and what happened.
    time : ndarray, shape (n_times,)
        [s].
    states : ndarray, shape (n_times, STATES)
        See `turnout.machine.compute.places`.
    """
    ons = [place for place, (_, text) in enumerate(events) if text == "on"]
    given = [row for row in commands.tolist() if math.isfinite(row[0])]
    found = []
    for (command, direction), first, last in zip(given, ons, [*ons[1:], None], strict=False):
        after = events[first:last]
        on = after[0][0]
        offs = [(t, text) for t, text in after if text.startswith("off ")]
        unended = (events[last][0], "off reversed") if last else (math.nan, "off moving")
        off, how = offs[0] if offs else unended
        outcome = how.removeprefix("off ")
        if outcome != "limit" and _rod_travel(time, states, on, off) < LEAST_MOVE:
            outcome = "stalled"
        to = "closed" if direction > 0 else "open"
        rest = _rest_after(off, after, time, states)
        found.append(Duty(name, to, command, on, off, rest, outcome))
    return found


def _rod_travel(time: Floats, states: Floats, on: float, off: float) -> float:
    """Return the way of the rod between two times, until the end where `off` is NaN [m]."""
    inside = (time >= on) & ~(time > off)
    rod = states[inside, at.ROD_POSITION]
    return float(np.ptp(rod)) if rod.size else 0.0


def _rest_after(
    off: float, after: Sequence[tuple[float, str]], time: Floats, states: Floats
) -> float:
    """Return when the gear stands after the cut-off, locked or not; NaN where it never does [s]."""
    if math.isnan(off):
        return math.nan
    held = [t for t, text in after if text == "locked" and t >= off]
    if held:
        return held[0]
    begin = int(np.searchsorted(time, off))
    standing = np.flatnonzero(states[begin:, at.GEAR_SPEED] == 0.0)
    return float(time[begin + standing[0]]) if standing.size else math.nan


LEAST_SLIP = 1e-4
"""Slip of a clutch on one command, as travel of the rod, that is overlooked: a lock that opens
under load lets the rod throw the gear back by less than its backlash [m]."""
SLIP_ROUNDING = 1e-6
"""From one stored instant to the next [rad]."""
MOST_EVENTS = 64
"""So many events of a machine are kept; a throw has five."""
LONGEST_TRANSIENT = 2e-3
"""In longer steps of the rails an induction motor is a steady circuit [s]."""
STORES = {
    at.CURRENT: at.INDUCTANCE,
    at.SPEED: at.MOTOR_INERTIA,
    at.GEAR_SPEED: at.GEAR_INERTIA,
    at.TWIST: at.CLUTCH_STIFFNESS,
}
"""States of a machine that hold energy, with what half of their square is multiplied by."""
CONTINUOUS = [
    *range(at.INTEGRATED, at.PAST_INTEGRATED),
    *(at.SLIP, at.ROD_POSITION, at.ROD_FORCE, at.CLUTCH_TEMPERATURE),
    *range(at.ENERGIES, at.STATES),
]
"""States that may be interpolated."""
LOSSES = {
    "copper": (at.COPPER,),
    "line": (at.LINE, at.SNUB),
    "brush": (at.BRUSH,),
    "field": (at.FIELD,),
    "motor friction": (at.MOTOR_FRICTION, at.MOTOR_DRAG_HEAT),
    "gear": (at.GEAR, at.GEAR_DRAG_HEAT),
    "clutch": (at.CLUTCH,),
}
"""Sums of a machine's own losses by what they are."""
_BALANCE = np.zeros(at.SUMS)
"""Weights of the sums of a machine in its energy balance."""
_BALANCE[[at.SUPPLY, at.HAND]] = 1.0
_BALANCE[[*itertools.chain(*LOSSES.values()), at.INTO_STORES, at.ROD_INPUT]] = -1.0


@dataclass(frozen=True, eq=False)
class MachineHistory:
    """Histories of the machines of a run at its stored instants.

    Attributes
    ----------
    time : ndarray, shape (n_times,)
        [s].
    names : tuple of str
        Of the drives that are machines.
    records : tuple of Machine
        As fitted to the drives.
    constants : ndarray, shape (n, CONSTANTS)
    commands : ndarray, shape (n, n_commands, 2)
        Time [s] and direction; what fills the table up is infinite.
    inputs : ndarray of int, shape (n,)
        Column of the inputs that each machine moves.
    shift : ndarray, shape (n,)
        Input less rod position [m].
    states : ndarray, shape (n_times, n, STATES)
        See `turnout.machine.compute.places`; of a watched run the first FOLLOWED or TRACED.
    booked : ndarray, shape (n_booked, n, STATES)
        All states where energies are stored, which a watched run does at some instants alone.
    given : ndarray, shape (n_booked, n)
        Work of the rod ends on the rods there, by the sums of the rails [J].
    events : tuple of tuple of (float, str)
        Time [s] and what happened, machine by machine.
    imbalance : float
        Largest movement of a rod end that a step left uncorrected [m].
    pauses : tuple of Pause
        Of the schedule before each movement but the first, and at its end; most have no length.
    """

    time: Floats
    names: tuple[str, ...]
    records: tuple[Machine, ...]
    constants: Floats
    commands: Floats
    inputs: NDArray[np.int64]
    shift: Floats
    states: Floats
    booked: Floats
    given: Floats
    events: tuple[tuple[tuple[float, str], ...], ...]
    imbalance: float
    pauses: tuple[Pause, ...]

    def at(self, instants: Floats, positions: Floats) -> "MachineHistory":
        """Return the history at other instants, linear in between, and write its inputs.

        Parameters
        ----------
        instants : ndarray, shape (n,)
            [s].
        positions : ndarray, shape (n, n_inputs)
            Receives the inputs of the machines [m].
        """
        number = np.clip(np.searchsorted(self.time, instants, side="right") - 1, 0, None)
        number = np.minimum(number, self.time.size - 2)
        share = (instants - self.time[number]) / (self.time[number + 1] - self.time[number])

        def between(values: Floats) -> Floats:
            part = share.reshape(-1, *[1] * (values.ndim - 1))
            return values[number] + part * (values[number + 1] - values[number])

        states = self.states[number + (share > 0.5)]  # flags and times of switching
        states[:, :, CONTINUOUS] = between(self.states[:, :, CONTINUOUS])
        positions[:, self.inputs] = states[:, :, at.ROD_POSITION] + self.shift
        given = between(self.given)
        return replace(self, time=instants, states=states, booked=states, given=given)

    def select(self, index: NDArray[np.int64] | slice) -> "MachineHistory":
        """Return the history at some of its instants; what was done on commands stays."""
        states, given = self.states[index], self.given[index]
        chosen = replace(self, time=self.time[index], states=states, booked=states, given=given)
        chosen.__dict__["duties"] = self.duties  # found with every instant
        return chosen

    @property
    def onsets(self) -> list[float]:
        """Onsets of all movements but the first [s]."""
        return [item.begin + item.length for item in self.pauses[:-1]]

    @cached_property
    def duties(self) -> tuple[Duty, ...]:
        """Duty of every machine on every command that it was given."""
        return tuple(
            duty
            for number, name in enumerate(self.names)
            for duty in machine_duties(
                name,
                commands=self.commands[number],
                events=self.events[number],
                time=self.time,
                states=self.states[:, number],
            )
        )

    @cached_property
    def slips(self) -> NDArray[np.bool_]:
        """Slip of each clutch above the ignored amount, shape (n, n_times)."""
        found = np.zeros((len(self.names), self.time.size), dtype=np.int64)
        slip = np.ascontiguousarray(self.states[:, :, at.SLIP].T)
        if not self.time.size:
            return found.astype(np.bool_)
        slides = np.flatnonzero(np.ptp(slip, axis=1) > SLIP_ROUNDING)
        if not slides.size:
            return found.astype(np.bool_)
        ons = np.full((len(self.names), MOST_EVENTS), np.inf)
        for row, events in zip(ons, self.events, strict=True):
            times = [time for time, text in events if text == "on"]
            row[: len(times)] = times
        travel = np.zeros(len(self.records))
        for number in slides.tolist():
            travel[number] = shaft_travel(self.records[number])
        time = np.require(self.time, np.float64, ["C", "W"])
        find_slips(time, slip, ons, travel, (SLIP_ROUNDING, LEAST_SLIP), found)
        return found.astype(np.bool_)

    def sums(self, *places: int) -> Floats:
        """Return sums of energy over time, shape (n_booked, n) [J]."""
        return functools.reduce(np.add, (self.booked[:, :, at.ENERGIES + p] for p in places))

    @cached_property
    def losses(self) -> Mapping[str, Floats]:
        """Losses of each machine by `LOSSES`, shape (n_booked, n) [J]."""
        return {name: self.sums(*places) for name, places in LOSSES.items()}

    @cached_property
    def stored(self) -> Floats:
        """Change of energy in coil, inertias and clutch, shape (n_booked, n) [J]."""
        energy = np.zeros(self.given.shape)
        for state, constant in STORES.items():
            energy += 0.5 * self.constants[:, constant] * self.booked[:, :, state] ** 2
        for number, machine in enumerate(self.records):
            kind = machine.motor.of_kind
            energy[:, number] += kind.field_energies(self.constants[number], self.booked[:, number])
        return np.asarray(energy - energy[:1])  # no row without a start

    @cached_property
    def numerical(self) -> Floats:
        """Energy lost by the schemes, shape (n_booked, n) [J].

        In what a machine stores, and where its work into the rod by its own sums differs from that
        by the sums of the rails.
        """
        own = self.sums(at.INTO_STORES) - self.stored
        return np.asarray(own + self.sums(at.ROD_INPUT) - self.given)

    @property
    def residual(self) -> Floats:
        """Residual of the energy balance of each machine, shape (n_booked, n) [J].

        What is stored and given to the rails is in `numerical` too, and leaves the sums alone.
        """
        return np.asarray(self.booked[:, :, at.ENERGIES :] @ _BALANCE)

    def with_balance(self, residual: float, scale: float) -> tuple[float, float]:
        """Add the machines to residual and scale of the rails' balance [J]."""
        if not self.time.size:
            return residual, scale
        worst = sum_machines(np.abs(self.residual)).max()
        turned_over = sum_machines(np.abs(self.sums(at.SUPPLY, at.HAND))).max()
        return residual + float(worst), scale + float(turned_over)


def sum_machines(values: Floats) -> Floats:
    """Return the sum over machines of values of shape (n_booked, n), column by column.

    NumPy sums along short rows far more slowly.
    """
    return functools.reduce(np.add, values.T)


def run_constants(given: DriveMachines, scheme: Scheme) -> Floats:
    """Return the constants of the machines in a run of a scheme.

    In long steps, as those of quick mode, induction motors are steady circuits.
    """
    transient = np.isfinite(given.constants[:, at.LONGEST_STEP])
    if not transient.any() or scheme.step <= LONGEST_TRANSIENT:
        return given.constants
    found = given.constants.copy()
    found[transient, at.STEADY_CIRCUIT] = 1.0
    found[transient, at.LONGEST_STEP] = np.inf
    return found


def new_rods(setup: RunSetup, scheme: Scheme, grid: Grid) -> Rods | None:
    """Arrange the machines of a mechanism for the kernels, for one run; None without any.

    Raises
    ------
    SolverError
        For a scheme without inertia: machines have a time of their own.
    """
    given, save, positions = setup.arrangement.mechanism.machines, setup.save, setup.positions
    if given is None:
        return None
    if not scheme.inertia:
        drives = ", ".join(given.names)
        message = (
            f'mode "quasi-static" has no time for the machines of drives {drives}; take "quick" or '
            '"waveform", or leave out drive.N.machine'
        )
        raise SolverError(message)
    n, count = len(given.names), grid.n_stored
    width, books = at.STATES, save.count
    if save.watches:
        width = at.TRACED if save.save_at.traced else at.FOLLOWED
        books = save.counts[2] + save.further
    size = count * n * width
    memory = np.empty(size) if width < at.STATES else acquire_buffer(size)[:size]
    rods = Rods(
        constants=run_constants(given, scheme),
        tables=given.tables,
        commands=given.commands.copy(),
        shared_resistance=np.array([given.shared_resistance]),
        **machine_room(n, events=MOST_EVENTS)._asdict(),
        place=setup.table.row[given.laws].astype(np.int64),
        law=given.laws,
        input=given.inputs,
        shift=given.shift,
        lock_gap=given.lock_gap,
        state=given.start.copy(),
        trial=given.start.copy(),
        **dict.fromkeys(("start", "speed", "free", "force", "given"), np.zeros(n)),
        compliance=np.zeros((n, n)),
        before=np.zeros((2, n)),
        rod_before=np.zeros((2, n)),
        lengths=np.full(2, float(scheme.step)),
        left=np.zeros(1),
        kept=memory.reshape(n, width, count),
        booked=np.empty((0 if width == at.STATES else books, n, at.STATES)),
        booked_given=np.empty((books, n)),
        stood=np.ones(n, dtype=np.int64),
        schedule=new_schedule(grid.room, grid.check),
        stops=np.array([(stop.step, stop.rest, stop.longest) for stop in grid.stops]),
        stop_times=np.array([stop.time for stop in grid.stops]),
        pauses=np.zeros((len(grid.stops), 2)),
        ends=np.array(save.save_at.whole, dtype=np.float64),
        planned=given.commands,
        markers=positions[:0] if n == positions.shape[1] else positions.copy(),
    )
    return shared_record(rods)


def most_places(machines: DriveMachines, grid: Grid, ends: Sequence[float]) -> int:
    """Return the most instants that a watched run with machines keeps whole as it goes on.

    Where a machine comes to rest, and at each stop of the schedule up to four, and `ends`.
    """
    commands = int(np.isfinite(machines.commands[:, :, 0]).sum())
    return commands + len(grid.stops) * (4 + len(ends))


def machine_history(
    rods: Rods | None,
    mechanism: Mechanism,
    time: Floats,
    booked: slice | NDArray[np.int64],
    pauses: tuple[Pause, ...],
) -> MachineHistory | None:
    """Return states and events of the machines of a run at its stored instants [s].

    `booked` are the rows of their energies.
    """
    given = mechanism.machines
    if rods is None or given is None:
        return None
    counts = rods.state[:, at.EVENTS].astype(int)
    states = rods.kept[:, :, : time.size].transpose(2, 0, 1)
    return MachineHistory(
        time=time,
        names=given.names,
        records=given.records,
        constants=rods.constants,
        commands=rods.commands,
        inputs=given.inputs,
        shift=given.shift,
        states=states,
        booked=rods.booked[booked] if rods.booked.shape[0] else states,
        given=rods.booked_given[booked],
        events=tuple(
            tuple((time, at.EVENT_TEXTS[int(event)]) for time, event in rows[:count].tolist())
            for rows, count in zip(rods.log, counts, strict=True)
        ),
        imbalance=float(rods.left[0]),
        pauses=pauses,
    )
