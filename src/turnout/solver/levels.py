"""Memory of runs that serves the next one: states, scratch arrays, compliances.

Compliances depend on the condensed rails and the length of the step
(`turnout.solver.columns`), not on laws: throws of a study that differ in friction, stiffness of
drives, slip levels and the object have them alike. Where objects stand matters for their own rows
and columns alone, which are made again. States and scratch arrays are only laid out alike, which
takes longer than to fill them.

A run takes its memory out and gives it back at its end, so that no two runs ever write to one.
Rails of which there is a single throw give nothing back.
"""

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from turnout.core.lru_cache import LRUCache
from turnout.solver.compliance import READY, STALE
from turnout.solver.scratch import Work
from turnout.solver.seen import StepRecord
from turnout.solver.state import State
from turnout.solver.step import Stepping
from turnout.solver.system import Ints, System


@dataclass(frozen=True, slots=True, eq=False)
class RunMemory:
    """Memory of a run that has ended.

    Attributes
    ----------
    frame : object
        What systems have in common that differ in the places of objects alone.
    system : System
        Of the run.
    state : State
        Whose compliances are known.
    work : Work
        Scratch arrays.
    ready : ndarray of int, shape (n_levels,)
        Which of the compliances are known for this system.
    record : StepRecord, optional
        Of a run whose stored instants are of no more use.
    """

    frame: object  # kept alive, since the key names it by its identity
    system: System
    state: State
    work: Work
    ready: Ints
    record: StepRecord | None

    def ready_for(self, system: System) -> Ints:
        """Return which of the compliances are known for a system with the same frame."""
        if self.system is system:
            return self.ready
        return np.where(self.ready == READY, STALE, self.ready)


_kept = LRUCache[RunMemory](24)  # three megabytes each in quick mode


def take_memory(frame: object, stepping: Stepping, sizes: tuple[int, ...]) -> RunMemory | None:
    """Take the memory of a run; None where there is none.

    Parameters
    ----------
    frame : object
        As of `RunMemory`.
    stepping : Stepping
        The lengths of its steps.
    sizes : tuple of int
        Numbers of its inputs and levels.
    """
    return _kept.pop(_key(frame, stepping, sizes))


def give_back_memory(
    frame: object,
    system: System,
    stepping: Stepping,
    state: State,
    work: Work,
    record: StepRecord | None = None,
) -> None:
    """Give back the memory of a run that has ended."""
    sizes = state.inputs.size, state.level_ready.size
    memory = RunMemory(frame, system, state, work, state.level_ready.copy(), record)
    _kept.put(_key(frame, stepping, sizes), memory)


def clear_levels() -> None:
    """Forget all memory of runs."""
    _kept.clear()


def _key(frame: object, stepping: Stepping, sizes: tuple[int, ...]) -> Hashable:
    numbers = (stepping.step, stepping.alpha_m, stepping.alpha_f, stepping.beta, stepping.gamma)
    return (id(frame), *numbers, *sizes)
