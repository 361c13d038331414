"""Condense a mechanism and arrange it for the kernels, once for runs that differ in values only.

Friction, clearances, forces of saturation, times and motion change neither modes nor the structure
of the laws. Mechanisms made of the same records share their matrices, which can then not be
written to: those are recognised by being the same.
"""

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.errors import MechanicsError
from turnout.integrate.memory import release
from turnout.integrate.places import placed
from turnout.integrate.scheme import Scheme
from turnout.integrate.state import State
from turnout.integrate.system import System, check_normals, condensed_system
from turnout.integrate.work import Work
from turnout.law.shared import shared
from turnout.law.table import LawTable
from turnout.mechanism.blocks import without_joining_bases
from turnout.mechanism.condense import base_stiffness, condense_blocks, joined_model
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.modal import ModalModel

Ints = NDArray[np.int64]

MOST_KEPT = 24
"""So many condensed mechanisms are kept in memory, the latest used."""


Blanks = dict[tuple[int, int], tuple[State, Work]]


@dataclass(frozen=True, slots=True)
class Arranged:
    """A condensed mechanism.

    Attributes
    ----------
    laws : LawTable
        The laws as integrated: those that join rails are not part of the linear system.
    table : LawTable
        The same for the kernels.
    model : ModalModel
        Modes and flexibility of the rails.
    system : System
        The same for the kernels.
    blanks : dict
        States at rest and scratch arrays of runs, for numbers of inputs and levels, to be copied.
    """

    laws: LawTable
    table: LawTable
    model: ModalModel
    system: System
    blanks: Blanks


@dataclass(frozen=True, slots=True)
class _Kept:
    """What is the same for all values of the laws; `mechanism` keeps alive what the key names."""

    mechanism: Mechanism
    base_segment: Ints
    model: ModalModel
    system: System
    blanks: Blanks


_memory: OrderedDict[Hashable, _Kept] = OrderedDict()


def arranged(mechanism: Mechanism, scheme: Scheme) -> Arranged:
    """Condense the rails apart from each other; in one piece if one is held by another only.

    Raises
    ------
    MechanicsError
        If a rail is not held, or a law of friction cannot be integrated.
    """
    check_normals(mechanism.laws)
    key = _key(mechanism, scheme)
    kept = _memory.get(key) if key is not None else None
    if kept is None:
        kept = _made(mechanism, scheme)
        if key is not None:
            _memory[key] = kept
            while len(_memory) > MOST_KEPT:
                _memory.popitem(last=False)
    elif key in _memory:
        _memory.move_to_end(key)
    laws = mechanism.laws._replace(base_segment=kept.base_segment)
    table = shared(placed(laws, kept.system.row_place))
    return Arranged(laws, table, kept.model, kept.system, kept.blanks)


def forget() -> None:
    """Empty the memory of condensed mechanisms, and that of histories that are gone."""
    _memory.clear()
    release()


def _key(mechanism: Mechanism, scheme: Scheme) -> Hashable | None:
    """Return what condensed mechanisms are known by; None where matrices could be written to."""
    matrices = (
        mechanism.stiffness,
        mechanism.mass,
        mechanism.damping,
        mechanism.load,
        mechanism.rows,
    )
    if any(matrix.flags.writeable for matrix in matrices):
        return None
    laws = mechanism.laws
    structure = (
        laws.row,
        laws.input_index,
        laws.base_segment,
        laws.segment_start,
        base_stiffness(laws),
        np.isfinite(laws.appears) | np.isfinite(laws.disappears) | (laws.waits == 1),
        laws.friction_row,
        laws.friction_normal,
        laws.stick_stiffness,
    )
    same = tuple(id(matrix) for matrix in matrices)
    rails = tuple((rail.first, rail.count) for rail in mechanism.rails)
    return (*same, rails, scheme.cutoff_frequency, *(part.tobytes() for part in structure))


def _made(mechanism: Mechanism, scheme: Scheme) -> _Kept:
    cutoff = scheme.cutoff_frequency
    laws = without_joining_bases(mechanism, mechanism.laws)
    try:
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff)
    except MechanicsError:
        laws = mechanism.laws
        parts = condense_blocks(mechanism, laws, cutoff_frequency=cutoff)
    model, system = joined_model(parts, mechanism), condensed_system(parts, laws)
    return _Kept(mechanism, laws.base_segment, model, system, {})
