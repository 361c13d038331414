"""Rank-one updated columns equal a dense solution from scratch after any series of flips.

The dense reference forms the deviations D and b law by law from the table, B = I - R D, and solves
for T, c and P. Tolerance 1e-9 of the largest entry: up to 400 updates of 64-bit numbers.
"""

from typing import NamedTuple

import numpy as np
import pytest

from turnout.errors import MechanicsError
from turnout.integrate.columns import activate, deactivate, rebuild, refresh_inverse, update_row
from turnout.integrate.solve import new_work
from turnout.integrate.system import (
    COUNT_ACTIVE,
    COUNT_FLIPS,
    COUNT_REBUILDS,
    COUNT_RECENT,
    State,
    System,
    condensed_system,
    fresh_state,
    set_segment,
)
from turnout.law.kernel import STICK
from turnout.law.table import LawTable, LawTableBuilder
from turnout.mechanism.condense import linear_stiffness, modal_model

INERTIA, VISCOSITY = 3e4, 900.0
TOLERANCE = 1e-9
N_DOF = 16
CONTACTS, FRICTION_ROWS, DRIVEN = range(6), range(6, 9), (9, 10)
IDLE_ROW = 11


class Setup(NamedTuple):
    system: System
    table: LawTable
    state: State
    scratch: np.ndarray


def laws() -> LawTable:
    builder = LawTableBuilder()
    for row in CONTACTS:
        builder.add_contact(row, stiffness=1e6, clearance=1e-3 * row, base_closed=row % 2 == 0)
    for row in DRIVEN:
        builder.add_piecewise(
            row,
            breakpoints=np.array([-0.01, 0.01]),
            slopes=np.array([2e4, 7e5, 3e4]),
            offset=1e-3,
            input_index=row - DRIVEN[0],
            base_segment=1,
        )
    builder.add_contact(0, stiffness=4e5, clearance=0.02)  # a second law on a row
    for k, row in enumerate(FRICTION_ROWS):
        for normal in (2 * k, 2 * k + 1):
            builder.add_friction(
                row, normal=normal, friction_coefficient=0.2 + 0.1 * k, stick_stiffness=8e5
            )
    builder.add_friction(1, normal=1, friction_coefficient=0.3, stick_stiffness=1e6)
    return builder.table()


def setup(cutoff_modes: int, seed: int) -> Setup:
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, N_DOF, N_DOF))
    rows = rng.normal(size=(12, N_DOF))
    table = laws()
    stiffness = linear_stiffness(2e5 * (a @ a.T + 4 * np.eye(N_DOF)), rows, table)
    mass = b @ b.T + 5 * np.eye(N_DOF)
    frequencies = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)) / (
        2 * np.pi
    )
    model = modal_model(
        stiffness,
        mass,
        damping=20 * c @ c.T,
        rows=rows,
        load=rng.normal(size=N_DOF) * 1e3,
        cutoff_frequency=1.0001 * frequencies[cutoff_modes - 1],
    )
    assert model.eigenvalues.size == cutoff_modes
    system = condensed_system(model, table)
    state = fresh_state(system, table, n_inputs=len(DRIVEN))
    scratch = new_work(system, table).row
    rebuild(system, table, state, INERTIA, VISCOSITY, scratch)
    return Setup(system, table, state, scratch)


def flip(made: Setup, rng: np.random.Generator) -> None:
    """Change one law or friction at random and bring the rows that hang on it up to date."""
    _, table, state, _ = made
    if rng.random() < 0.5:
        law = int(rng.integers(table.row.size))
        count = table.segment_start[law + 1] - table.segment_start[law]
        state.present[law] = int(rng.random() < 0.9)
        set_segment(table, state, law, int(rng.integers(count)))
        touched = {int(table.row[law])}
        touched |= set(table.friction_row[table.friction_normal == law].tolist())
    else:
        friction = int(rng.integers(table.friction_row.size))
        state.friction[friction] = rng.integers(-1, 2)
        state.anchor[friction] = rng.normal() * 1e-3
        touched = {int(table.friction_row[friction])}
    for row in rng.permutation(sorted(touched)):
        update_row(*made[:3], int(row), made.scratch)


def deviations(made: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Form D and b from the meaning of the table, not from the kernels."""
    system, table, state, _ = made
    n = system.row_load.size
    matrix, constant = np.zeros((n, n)), np.zeros(n)

    def line(law: int) -> tuple[float, float]:
        if not state.present[law]:
            return 0.0, 0.0
        at = table.segment_start[law] + state.segment[law]
        return table.slope[at], table.intercept[at] - table.slope[at] * table.offset[law]

    for law in range(table.row.size):
        slope, force = line(law)
        base = table.base_segment[law]
        if base >= 0:
            matrix[table.row[law], table.row[law]] += table.slope[table.segment_start[law] + base]
        matrix[table.row[law], table.row[law]] -= slope
        constant[table.row[law]] -= force
    for friction in range(table.friction_row.size):
        row, branch = table.friction_row[friction], state.friction[friction]
        if branch == STICK:
            matrix[row, row] -= table.stick_stiffness[friction]
            constant[row] += table.stick_stiffness[friction] * state.anchor[friction]
            continue
        normal = table.friction_normal[friction]
        slope, force = line(normal)
        gain = branch * table.friction_coefficient[friction]
        matrix[row, table.row[normal]] -= gain * slope
        constant[row] -= gain * force
    return matrix, constant


def check_against_dense(made: Setup) -> None:
    system, _, state, _ = made
    n, m = system.row_load.size, system.eigenvalues.size
    flexibility, modes = system.base[:, :n], system.base[:, n:]
    matrix, constant = deviations(made)
    whole = np.eye(n) - flexibility @ matrix
    t = np.linalg.solve(whole, modes)
    c = np.linalg.solve(whole, flexibility @ constant + system.row_load)
    p = np.linalg.solve(whole, flexibility)
    active = state.row_of_slot[: state.counters[COUNT_ACTIVE]]
    expected = np.zeros((m + 1 + active.size, n + m))
    expected[:m, :n], expected[:m, n:] = t.T, (modes.T @ matrix @ t).T
    expected[m, :n], expected[m, n:] = c, modes.T @ (matrix @ c + constant)
    response = modes.T @ (np.eye(n) + matrix @ p)
    expected[m + 1 :, :n], expected[m + 1 :, n:] = p[:, active].T, response[:, active].T
    got = state.columns[: expected.shape[0]]
    for block in (slice(None, n), slice(n, None)):
        for part in (slice(None, m), slice(m, m + 1), slice(m + 1, None)):
            want = expected[part, block]
            scale = np.abs(want).max(initial=0.0)
            np.testing.assert_allclose(got[part, block], want, rtol=0, atol=TOLERANCE * scale)
    modal = (
        INERTIA * np.eye(m)
        + VISCOSITY * system.damping
        + np.diag(system.eigenvalues)
        - modes.T @ matrix @ t
    )
    inverse = np.linalg.inv(modal)
    np.testing.assert_allclose(state.inverse, inverse, rtol=0, atol=TOLERANCE * abs(inverse).max())


def check_bookkeeping(made: Setup) -> None:
    system, _, state, _ = made
    matrix, constant = deviations(made)
    count = state.counters[COUNT_ACTIVE]
    active = state.row_of_slot[:count]
    assert np.all(state.row_of_slot[count:] == -1)
    assert len(set(active.tolist())) == count
    for row in range(system.row_load.size):
        slot = state.slot_of_row[row]
        assert (slot >= 0) == (row in active)
        assert slot < 0 or active[slot] == row
        pattern = slice(system.pattern_start[row], system.pattern_start[row + 1])
        np.testing.assert_allclose(
            state.entries[pattern], matrix[row, system.pattern_list[pattern]], rtol=1e-15, atol=1e-9
        )
        assert state.shift[row] == pytest.approx(constant[row], rel=1e-12, abs=1e-9)
        if np.any(state.entries[pattern] != 0.0) or state.shift[row] != 0.0:
            assert slot >= 0
        elif not system.pinned[row]:
            assert slot < 0


@pytest.mark.parametrize("cutoff_modes", [2, 7, N_DOF])
def test_columns_equal_a_dense_solution_after_random_flips(cutoff_modes: int) -> None:
    made = setup(cutoff_modes, seed=cutoff_modes)
    rng = np.random.default_rng(100 + cutoff_modes)
    check_against_dense(made)
    seen = set()
    for _ in range(8):
        for _ in range(50):
            flip(made, rng)
            check_bookkeeping(made)
            seen.add(int(made.state.counters[COUNT_ACTIVE]))
        check_against_dense(made)
    assert len(seen) > 3, "rows were hardly ever activated or dropped"


def test_rebuild_gives_the_same_columns_and_removes_drift() -> None:
    made = setup(7, seed=1)
    rng = np.random.default_rng(8)
    for _ in range(60):
        flip(made, rng)
    active = made.state.counters[COUNT_ACTIVE]
    made.state.columns[:] *= 1.001  # a drift far beyond rounding
    made.state.inverse[:] *= 0.999
    before = made.state.counters[COUNT_REBUILDS]
    rebuild(made.system, made.table, made.state, INERTIA, VISCOSITY, made.scratch)
    assert made.state.counters[COUNT_REBUILDS] == before + 1
    assert made.state.counters[COUNT_RECENT] == 0
    assert made.state.counters[COUNT_ACTIVE] == active
    check_against_dense(made)
    check_bookkeeping(made)


def test_a_row_without_a_change_costs_nothing() -> None:
    made = setup(7, seed=2)
    before = made.state.columns.copy(), made.state.counters.copy()
    for row in range(made.system.row_load.size):
        update_row(*made[:3], row, made.scratch)
    np.testing.assert_array_equal(made.state.columns, before[0])
    assert made.state.counters[COUNT_FLIPS] == before[1][COUNT_FLIPS]


def test_a_column_dropped_from_the_middle_leaves_the_others_as_they_are() -> None:
    made = setup(7, seed=3)
    state, n_modes = made.state, made.system.eigenvalues.size
    assert state.slot_of_row[IDLE_ROW] == -1
    slot = activate(made.system, state, IDLE_ROW)
    assert state.row_of_slot[slot] == IDLE_ROW
    check_against_dense(made)
    rows = state.row_of_slot[: state.counters[COUNT_ACTIVE]].tolist()
    columns = {row: state.columns[n_modes + 1 + state.slot_of_row[row]].copy() for row in rows}
    deactivate(made.system, state, rows[1])
    rows.remove(rows[1])
    assert sorted(state.row_of_slot[: state.counters[COUNT_ACTIVE]].tolist()) == sorted(rows)
    for row in rows:
        np.testing.assert_array_equal(
            state.columns[n_modes + 1 + state.slot_of_row[row]], columns[row]
        )


def test_kernels_equal_their_plain_functions() -> None:
    compiled, plain = setup(7, seed=4), setup(7, seed=4)
    rng = np.random.default_rng(9)
    for _ in range(25):
        law = int(rng.integers(compiled.table.row.size))
        friction = int(rng.integers(compiled.table.friction_row.size))
        branch = rng.integers(-1, 2)
        for made in (compiled, plain):
            count = made.table.segment_start[law + 1] - made.table.segment_start[law]
            kernel = set_segment if made is compiled else set_segment.py_func
            kernel(made.table, made.state, law, int((made.state.segment[law] + 1) % count))
            made.state.friction[friction] = branch
            for row in range(made.system.row_load.size):
                update = update_row if made is compiled else update_row.py_func
                update(*made[:3], row, made.scratch)
    for made, refresh in ((compiled, refresh_inverse), (plain, refresh_inverse.py_func)):
        refresh(made.system, made.state, INERTIA, VISCOSITY)
    for name in ("columns", "inverse", "entries", "shift"):
        want = getattr(compiled.state, name)
        np.testing.assert_allclose(
            getattr(plain.state, name), want, rtol=0, atol=1e-11 * np.abs(want).max()
        )
    np.testing.assert_array_equal(plain.state.row_of_slot, compiled.state.row_of_slot)


def test_a_driven_normal_law_is_refused() -> None:
    builder = LawTableBuilder()
    driven = builder.add_piecewise(
        0, breakpoints=np.zeros(0), slopes=np.array([1e5]), input_index=0, base_segment=0
    )
    builder.add_friction(1, normal=driven, friction_coefficient=0.3, stick_stiffness=1e6)
    table = builder.table()
    rows = np.eye(2)
    model = modal_model(
        linear_stiffness(np.eye(2), rows, table),
        np.eye(2),
        damping=np.zeros((2, 2)),
        rows=rows,
        load=np.zeros(2),
        cutoff_frequency=1e3,
    )
    with pytest.raises(MechanicsError, match="cannot be driven by a marker"):
        condensed_system(model, table)
