"""Random mechanisms keep every law at every instant, whatever the step, cut-off and scheme.

Reference: the law table itself, evaluated here in plain numpy at the displacements of the run.
Tolerances: a contact force may disagree by what the gap tolerance of 1e-11 m makes at the stiffest
law (1e-4 N), friction may exceed its limit by the force tolerance of 1e-6 N, the energy residual
close to 1e-8 of their scale and the rows agree with the base system to 1e-10 m.
"""

import numpy as np
import pytest
from tests.verification.hand_made import ALL_MODES, energy_residual, hand_made

from turnout.core.scheme import Scheme
from turnout.law.table import LawTable, LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.integration import History, integrate

SEEDS = range(200)


def random_laws(rng: np.random.Generator, n_rows: int) -> LawTable:
    """Add one or two laws a row, some of which come or go, and feet on those that stay."""
    laws = LawTableBuilder()
    supports = []
    for row in range(n_rows):
        for _ in range(rng.integers(1, 3)):
            times = {}
            if rng.random() < 0.2:
                times = {
                    "appears": float(rng.choice([-np.inf, 0.3])),
                    "disappears": float(rng.choice([0.7, np.inf])),
                }
            kind = rng.integers(3)
            if kind == 0:
                law = laws.add_contact(
                    row,
                    stiffness=10 ** rng.uniform(4, 6.5),
                    clearance=float(rng.choice([0.0, 0.002, 0.02])),
                    base_closed=bool(rng.random() < 0.5),
                    **times,
                )
                if not times:
                    supports.append(law)
            elif kind == 1:
                laws.add_piecewise(
                    row,
                    breakpoints=np.array([-0.01, 0.01]),
                    slopes=np.array([1e3, 10 ** rng.uniform(4, 5.5), 1e3]),
                    input_index=int(rng.integers(2)),
                    base_segment=int(rng.choice([-1, 1])),
                    **times,
                )
            else:
                laws.add_piecewise(
                    row,
                    breakpoints=np.sort(0.02 * rng.normal(size=3)),
                    slopes=10 ** rng.uniform(2, 5, size=4),
                    **times,
                )
    for normal in supports:
        laws.add_friction(
            int(rng.integers(n_rows)),
            normal=normal,
            friction_coefficient=float(rng.choice([0.0, 0.1, 0.3, 0.6])),
            stick_stiffness=10 ** rng.uniform(4, 6.5),
        )
    return laws.table()


def random_run(seed: int) -> tuple[Mechanism, History]:
    rng = np.random.default_rng(seed)
    n, n_rows = int(rng.integers(3, 12)), int(rng.integers(6, 16))
    a, b = rng.normal(size=(2, n, n))
    stiffness = 1e4 * (a @ a.T / n + 0.3 * np.eye(n))
    mass = 3 * b @ b.T / n + 2 * np.eye(n)
    mechanism = hand_made(
        LawTableBuilder(),
        mass=mass,
        rows=rng.normal(size=(n_rows, n)),
        stiffness=stiffness,
        damping=2e-3 * stiffness + 5 * rng.random() * mass,
        load=20 * rng.normal(size=n),
    )
    table = random_laws(rng, n_rows)
    mechanism = Mechanism(
        matrices=mechanism.matrices,
        core=mechanism.rows,
        laws=table,
        law_names=tuple(str(law) for law in range(table.row.size)),
        friction_names=tuple(str(foot) for foot in range(table.friction_row.size)),
    )
    step = float(rng.choice([2.5e-4, 1e-3, 4e-3]))
    scheme = Scheme(
        step=step,
        output_interval=max(step, 1e-3),
        cutoff_frequency=float(rng.choice([ALL_MODES, 60.0])),
        spectral_radius=float(rng.choice([0.0, 0.5, 1.0])),
    )
    rate = rng.uniform(2, 20, size=(2, 1))
    history = integrate(mechanism, scheme, inputs=lambda t: 0.03 * np.sin(rate * t), end=1.2)
    return mechanism, history


def law_forces(table: LawTable, history: History) -> np.ndarray:
    """Evaluate every law from the table at the stored displacements."""
    forces = np.zeros_like(history.law_force)
    for law in range(table.row.size):
        e = history.g[:, table.row[law]] - table.offset[law]
        if table.input_index[law] >= 0:
            e = e - history.inputs[:, table.input_index[law]]
        first, last = table.segment_start[law], table.segment_start[law + 1]
        at = first + np.searchsorted(table.segment_upper[first : last - 1], e)
        there = (history.time > table.appears[law] - 1e-6) & (
            history.time < table.disappears[law] + 1e-6
        )
        forces[:, law] = np.where(there, table.slope[at] * e + table.intercept[at], 0.0)
    return forces


@pytest.mark.parametrize("seed", SEEDS)
def test_every_law_holds_at_every_instant(seed: int) -> None:
    mechanism, history = random_run(seed)
    assert history.outcome.complete, history.outcome.message()
    assert history.flips > 0
    table = mechanism.laws
    np.testing.assert_allclose(history.law_force, law_forces(table, history), rtol=0, atol=1e-4)
    limits = table.friction_coefficient * history.law_force[:, table.friction_normal]
    assert np.all(np.abs(history.friction_force) <= limits + 2e-6)
    assert energy_residual(history) < 1e-8
    assert history.outcome.residual < 1e-10
