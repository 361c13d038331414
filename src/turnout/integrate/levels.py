"""Compliances of the lengths of a step, kept from one run to the next.

They depend on the condensed rails and the length of the step (`turnout.integrate.columns`), not on
laws: throws of a study that differ in friction, stiffness of drives, slip levels and the object
have them alike. Where objects stand matters for their own rows and columns alone, which are made
again. A run takes the compliances out of the memory and gives them back at its end, so that no two
runs ever write to them. Rails of which there is a single throw give nothing back.
"""

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from turnout.core.lru_cache import LRUCache
from turnout.integrate.compliance import READY, STALE
from turnout.integrate.scratch import lines_from_buffer
from turnout.integrate.state import State
from turnout.integrate.step import Stepping
from turnout.integrate.system import Floats, Ints, System

MOST_KEPT = 12
"""Sets of compliances, the latest used; two megabytes each in quick mode."""


@dataclass(frozen=True, slots=True)
class _Levels:
    """Compliances of a system; `frame` keeps alive what the key names by its identity."""

    frame: object
    system: System
    compliance: Floats
    ready: Ints


_kept = LRUCache[_Levels](MOST_KEPT)


def take_levels(
    frame: object, system: System, stepping: Stepping, shape: tuple[int, ...]
) -> tuple[Floats, Ints]:
    """Return memory for the compliances of a run, and which of them are known.

    Parameters
    ----------
    frame : object
        What systems have in common that differ in the places of objects alone.
    system : System
        Of the run.
    stepping : Stepping
        The lengths of its steps.
    shape : tuple of int
        Of the compliances: levels, ends and modes, leading ends and modes.
    """
    found = _kept.pop(_key(frame, stepping, shape))
    if found is None:
        return lines_from_buffer(*shape), np.zeros(shape[0], dtype=np.int64)
    ready = found.ready
    if found.system is not system:
        ready = np.where(ready == READY, STALE, ready)
    return found.compliance, ready


def give_back_levels(frame: object, system: System, stepping: Stepping, state: State) -> None:
    """Give back the compliances of a run that has ended."""
    compliance = state.compliance
    found = _Levels(frame, system, compliance, state.level_ready.copy())
    _kept.put(_key(frame, stepping, compliance.shape), found)


def clear_levels() -> None:
    """Forget all compliances."""
    _kept.clear()


def _key(frame: object, stepping: Stepping, shape: tuple[int, ...]) -> Hashable:
    numbers = (stepping.step, stepping.alpha_m, stepping.alpha_f, stepping.beta, stepping.gamma)
    return (id(frame), *numbers, shape)
