"""Mechanisms of a few masses made by hand, and the energy residual of a run."""

from collections.abc import Callable

import numpy as np

from turnout.core.scheme import Scheme
from turnout.law.object_kind import Compression, Trapped
from turnout.law.obstruction import Obstructions, no_obstructions
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Matrices, Mechanism
from turnout.solver.integration import History, integrate

LEDGER = ("markers", "friction", "damping", "switched", "algorithmic", "segments", "objects")
STORED = ("kinetic", "strain", "contact", "gravity")
LEDGER_SIGN = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0])
ALL_MODES = 1e9


def hand_made(
    laws: LawTableBuilder,
    *,
    mass: list[float] | np.ndarray,
    rows: list[list[float]] | np.ndarray | None = None,
    stiffness: np.ndarray | None = None,
    damping: np.ndarray | None = None,
    load: list[float] | np.ndarray | None = None,
    obstructions: Obstructions | None = None,
) -> Mechanism:
    """Put masses, springs and laws together; what is not given is zero, rows are the masses."""
    masses = np.diag(mass) if np.ndim(mass) == 1 else np.asarray(mass)
    n = masses.shape[0]
    table = laws.table()
    return Mechanism(
        matrices=Matrices(
            stiffness=np.zeros((n, n)) if stiffness is None else stiffness,
            mass=np.asarray(masses, dtype=float),
            damping=np.zeros((n, n)) if damping is None else damping,
            load=np.zeros(n) if load is None else np.asarray(load, dtype=float),
        ),
        core=np.eye(n) if rows is None else np.asarray(rows, dtype=float),
        laws=table,
        law_names=tuple(f"law {i}" for i in range(table.row.size)),
        friction_names=tuple(f"foot {i}" for i in range(table.friction_row.size)),
        obstructions=obstructions or no_obstructions(),
    )


def curve_of(
    kind: str, *, size: float, contact: float, area: float = 0.0, **values: float
) -> Compression:
    """Return the curve of an object of a kind that has not been touched."""
    item = Trapped(
        kind=kind, size=size, stiffness=contact, length=area, depth=1.0, **values
    )  # fmt: skip
    return item.of_kind.curve(item)


def linear_spring(
    laws: LawTableBuilder, row: int, stiffness: float, *, input_index: int = -1, **options: float
) -> int:
    """Add a linear law that the linear system holds."""
    return laws.add_piecewise(
        row,
        breakpoints=np.zeros(0),
        slopes=np.array([stiffness]),
        input_index=input_index,
        base_segment=0,
        **options,
    )


def obstruction(law: int, curve: Compression, *, size: float, deepest: float = 0.0) -> Obstructions:
    """Return the memory of one law."""
    found = no_obstructions(1)
    values = {
        name: getattr(curve, name) for name in ("breaks", "unloading", "piece", "limit", "crushed")
    }
    for name, value in (values | {"law": law, "least": curve.least, "size": size}).items():
        getattr(found, name)[0] = value
    found.deepest[0] = deepest
    return found


def run(
    mechanism: Mechanism,
    *markers: Callable[[np.ndarray], np.ndarray],
    end: float,
    step: float = 1e-3,
    every: int = 1,
    cutoff_frequency: float = ALL_MODES,
    **options: float,
) -> History:
    """Integrate with one function of time a marker, to the end; keep all modes by default."""
    scheme = Scheme(
        step=step, output_interval=every * step, cutoff_frequency=cutoff_frequency, **options
    )

    def inputs(time: np.ndarray) -> np.ndarray:
        values = [np.broadcast_to(marker(time), time.shape) for marker in markers]
        return np.array(values).reshape(len(markers), time.size)

    history = integrate(mechanism, scheme, inputs=inputs, end=end)
    assert history.outcome.complete, history.outcome.message()
    return history


def smooth_ramp(time: np.ndarray, *, start: float, end: float) -> np.ndarray:
    """Rise from 0 to 1 between two times without a jump of acceleration."""
    s = np.clip((time - start) / (end - start), 0.0, 1.0)
    return s - np.sin(2 * np.pi * s) / (2 * np.pi)


def energy_scale(history: History) -> float:
    """Return the largest sum of work and stored energy of the run [J]."""
    return float(np.max(np.abs(history.ledger).sum(axis=1) + np.abs(history.stored).sum(axis=1)))


def energy_residual(history: History, *, without: str = "") -> float:
    """Return what the energy residual leave open, over their scale [-].

    `without` names a term that is left out, to see that it would be missed.
    """
    stored = history.stored - history.stored[0]
    stored = stored[:, [name != without for name in STORED]].sum(axis=1)
    signs = LEDGER_SIGN * [name != without for name in LEDGER]
    return float(np.max(np.abs(stored - history.ledger @ signs)) / energy_scale(history))
