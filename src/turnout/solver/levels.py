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
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.solver.compliance import READY, STALE
from turnout.solver.numbering import Places
from turnout.solver.scratch import Work
from turnout.solver.seen import StepRecord
from turnout.solver.state import Options, State
from turnout.solver.system import Ints, System

Templates = dict[tuple[int, int], tuple[State, Work]]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Condensed rails, without what depends on where in its blocks an object stands.

    Attributes
    ----------
    system : System
        Of one arrangement.
    places : Places
        Of its ends, modes and rows.
    templates : dict
        States at rest and scratch arrays, by numbers of inputs and of levels, for runs to copy;
        rails of other sections share them.
    feet : dict
        Modes at the feet of frictions whose curves follow speed, by the rows of the frictions.
    """

    system: System
    places: Places
    templates: Templates
    feet: dict[bytes, dict[str, NDArray[Any]]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class RunMemory:
    """Memory of a run that has ended.

    Attributes
    ----------
    frame : Frame
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

    frame: Frame  # its templates are kept alive, since the key names them by their identity
    system: System
    state: State
    work: Work
    ready: Ints
    record: StepRecord | None

    def ready_for(self, system: System, frame: Frame) -> Ints:
        """Return which of the compliances are known for a system."""
        if self.system is system:
            return self.ready
        if self.frame is not frame:
            return np.zeros_like(self.ready)
        return np.where(self.ready == READY, STALE, self.ready)


_kept = LRUCache[RunMemory](24)  # three megabytes each in quick mode


def take_memory(frame: Frame, options: Options, sizes: tuple[int, ...]) -> RunMemory | None:
    """Take the memory of a run; None where there is none.

    Parameters
    ----------
    frame : Frame
        As of `RunMemory`.
    options : Options
        The lengths of its steps.
    sizes : tuple of int
        Numbers of its inputs and levels.
    """
    return _kept.pop(_key(frame, options, sizes))


def give_back_memory(
    frame: Frame,
    system: System,
    options: Options,
    state: State,
    work: Work,
    record: StepRecord | None = None,
) -> None:
    """Give back the memory of a run that has ended."""
    sizes = state.inputs.size, state.level_ready.size
    memory = RunMemory(frame, system, state, work, state.level_ready.copy(), record)
    _kept.put(_key(frame, options, sizes), memory)


def clear_levels() -> None:
    """Forget all memory of runs."""
    _kept.clear()


def _key(frame: Frame, options: Options, sizes: tuple[int, ...]) -> Hashable:
    numbers = (options.step, options.alpha_m, options.alpha_f, options.beta, options.gamma)
    return (id(frame.templates), *numbers, *sizes)
