"""Rails that the schedule wants closed at each instant."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.panel.markers import movement_end, ordered_movements
from turnout.panel.model import Panel
from turnout.solver.record import TIME_TOLERANCE

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class DirectedMovement:
    """One movement with the time at which its last drive arrives.

    Attributes
    ----------
    name : str
        Name of the movement.
    to : str
        "open" or "closed": where the instrumented rail goes.
    start, end : float
        Onset, and arrival of the last drive [s].
    until : float
        Onset of the next movement, infinite for the last [s].
    unfinished : bool
        Whether the next movement begins before a machine has arrived.
    """

    name: str
    to: str
    start: float
    end: float
    until: float
    unfinished: bool = False

    @property
    def direction(self) -> str:
        """Return "opening" or "closing", as seen by the instrumented rail."""
        return "closing" if self.to == "closed" else "opening"


def throws(panel: Panel) -> tuple[DirectedMovement, ...]:
    """Return the movements of a panel in the order of time."""
    ordered = ordered_movements(panel)
    untils = [*(movement.start for _, movement in ordered[1:]), float("inf")]
    return tuple(
        DirectedMovement(name, movement.to, movement.start, movement_end(panel, movement), until)
        for (name, movement), until in zip(ordered, untils[: len(ordered)], strict=True)
    )


def closed_rail(panel: Panel, position: str) -> str:
    """Return the rail that should be closed while the instrumented rail is "open" or "closed"."""
    others = [name for name in panel.rail if name != panel.instrumented_rail]
    if position == "open" and others:
        return others[0]
    return panel.instrumented_rail


def open_rail(panel: Panel, position: str) -> str | None:
    """Return the rail that should be open in a position; None if the only rail is closed."""
    closed = closed_rail(panel, position)
    others = [name for name in panel.rail if name != closed]
    if others:
        return others[0]
    return closed if position == "open" else None


def closed_spans(panel: Panel, time: Floats) -> list[tuple[int, int, bool]]:
    """Return spans of instants, each with True if the instrumented rail should be closed there.

    Movements want it so from their onset on. A span has its first instant and the one after its
    last; together they are all instants, in order.
    """
    edges = [0, *first_instants(panel, time).tolist(), time.size]
    return list(zip(edges, edges[1:], closed_in_turn(panel), strict=False))


def first_instants(panel: Panel, time: Floats) -> Ints:
    """Return the number of the first instant of each movement of the schedule."""
    return time.searchsorted([throw.start - TIME_TOLERANCE for throw in throws(panel)])


def closed_in_turn(panel: Panel) -> list[bool]:
    """Return if the instrumented rail is wanted closed, before the first movement and from each."""
    return [panel.schedule.starts == "closed", *(throw.to == "closed" for throw in throws(panel))]


def sensor_rails(panel: Panel) -> dict[str, str]:
    """Return the rail of each sensor that is not a pair."""
    only = panel.instrumented_rail if len(panel.rail) == 1 else None
    rails = {name: item.rail or only for name, item in panel.sensor.items()}
    return {name: rail for name, rail in rails.items() if rail is not None}


def wants_closed(panel: Panel, time: Floats, starts: Floats) -> Flags:
    """Flag the times at which the present or last movement wants the instrumented rail closed.

    Onsets of the movements have the shape (..., n_movements), times and flags (..., n_times) [s].
    """
    begun = time[..., np.newaxis, :] >= starts[..., np.newaxis] - TIME_TOLERANCE
    return np.asarray(np.array(closed_in_turn(panel))[begun.sum(axis=-2)])


def rail_closes(panel: Panel, time: Floats) -> Flags:
    """Flag the instants with a rail that should be closed: all, but for a single open rail."""
    return rail_closes_after(panel, time, np.array([throw.start for throw in throws(panel)]))


def rail_closes_after(panel: Panel, time: Floats, starts: Floats) -> Flags:
    """Return `rail_closes` of movements with onsets of their own, shape (..., n_movements) [s]."""
    if len(panel.rail) > 1:
        return np.ones(time.shape, dtype=np.bool_)
    return wants_closed(panel, time, starts)


def at_rest(panel: Panel, time: Floats, moved: Sequence[DirectedMovement] | None = None) -> Flags:
    """Flag the times at which no movement is under way, shape (n_times,).

    Movements are those of the schedule, or as they were made.
    """
    made = throws(panel) if moved is None else moved
    return rests_between(
        time, np.array([throw.start for throw in made]), np.array([throw.end for throw in made])
    )


def rests_between(time: Floats, starts: Floats, ends: Floats) -> Flags:
    """Flag the times at which no movement is under way, shape (..., n_times).

    Onsets and ends of the movements have the shape (..., n_movements) [s].
    """
    instants = time[..., np.newaxis, :]
    moves = instants >= starts[..., np.newaxis] - TIME_TOLERANCE
    moves &= instants < ends[..., np.newaxis] - TIME_TOLERANCE
    return np.asarray(~moves.any(axis=-2))
