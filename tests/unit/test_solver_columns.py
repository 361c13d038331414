"""Rank-one updated columns equal a dense solution from scratch after any series of flips.

The dense reference forms the deviations D and b law by law from the table and solves
(I - S D) g = g0 + S b over all rows of both blocks at once. Tolerance 1e-9 of the largest entry: up
to 400 updates of 64-bit numbers.
"""

from typing import NamedTuple

import numpy as np
import pytest

from turnout.core.errors import MechanicsError
from turnout.core.scheme import Scheme
from turnout.kernels.shared_record import shared_record
from turnout.law.friction import STICK, no_courses
from turnout.law.obstruction import no_obstructions
from turnout.law.table import LawTable, LawTableBuilder
from turnout.solver.columns import (
    activate,
    assemble_level,
    deactivate,
    rebuild,
    update_row,
)
from turnout.solver.condense import Block, BlockModel, folded_stiffness, leading_rows, sum_at_rows
from turnout.solver.modal import LinearSystem, diagonalise_damping, split_modes
from turnout.solver.record import SavePlan, empty_record
from turnout.solver.solve import gather_modes, solve_displacements
from turnout.solver.state import (
    COUNT_FLIPS,
    COUNT_JOINING,
    COUNT_REBUILDS,
    COUNT_RECENT,
    UNSOLVED,
    Options,
    Run,
    State,
    Work,
    fresh_state,
    new_work,
    set_segment,
)
from turnout.solver.system import System, check_normals, condensed_system, place_laws

INERTIA, VISCOSITY = 3e4, 900.0
OPTIONS = Options.of(Scheme(halvings=0, follow_path=False))
TOLERANCE = 1e-9
N_DOF = 16
CONTACTS, FRICTION_ROWS, DRIVEN = range(6), range(6, 9), (9, 10)
IDLE_ROW, N_ROWS, OWN_ROWS, JOINING = 11, 16, 12, (13, 14, 15)
"""The first rows are those of the first block, the last three reach into both."""


class Setup(NamedTuple):
    run: Run
    state: State
    laws: LawTable
    parts: tuple[BlockModel, ...]
    rows: list[int]

    @property
    def system(self) -> System:
        return self.run.system

    @property
    def table(self) -> LawTable:
        return self.run.table

    @property
    def work(self) -> Work:
        return self.run.work


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
    builder.add_piecewise(
        DRIVEN[0], breakpoints=np.zeros(0), slopes=np.array([3e4]), input_index=1
    )  # and a second driven one
    for k, row in enumerate(FRICTION_ROWS):
        for normal in (2 * k, 2 * k + 1):
            builder.add_friction(
                row, normal=normal, friction_coefficient=0.2 + 0.1 * k, stick_stiffness=8e5
            )
    builder.add_friction(1, normal=1, friction_coefficient=0.3, stick_stiffness=1e6)
    builder.add_contact(12, stiffness=7e5, clearance=1e-3, base_closed=True)
    for row in JOINING:
        builder.add_contact(row, stiffness=5e5, clearance=1e-3)
    builder.add_piecewise(
        JOINING[0], breakpoints=np.zeros(0), slopes=np.array([2e5]), input_index=1
    )
    return builder.table()


def follow(rows: np.ndarray) -> None:
    """Let a contact, a driven row and rows that join follow from others, exactly."""
    rows[5] = 0.5 * rows[6] - 0.25 * rows[0] + rows[1]
    rows[10] = rows[7]
    rows[14] = rows[13] * 2.0 if rows[2].any() else rows[12]
    rows[15] += rows[0]


def setup(cutoff_modes: int, seed: int) -> Setup:
    rng = np.random.default_rng(seed)
    given, parts = laws(), []
    for block, rows in enumerate((np.r_[:OWN_ROWS, JOINING], np.r_[12, JOINING])):
        a, b, c = rng.normal(size=(3, N_DOF, N_DOF))
        here = np.zeros((N_ROWS, N_DOF))
        here[rows] = rng.normal(size=(rows.size, N_DOF))
        follow(here)
        at_rows = sum_at_rows(given, folded_stiffness(given), N_ROWS)
        stiffness = 2e5 * (a @ a.T + 4 * np.eye(N_DOF)) + (here.T * at_rows) @ here
        mass = b @ b.T + 5 * np.eye(N_DOF)
        squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
        damping = 20 * c @ c.T if block == 0 else 3.0 * mass
        load_and_rows = rng.normal(size=N_DOF) * 1e3, here[rows]
        linear = LinearSystem(stiffness, mass, damping, *load_and_rows)
        model, _ = split_modes(linear, 1.0001 * np.sqrt(squares[cutoff_modes - 1]) / (2 * np.pi))
        assert model.eigenvalues.size == cutoff_modes
        rubs = np.isin(rows, [*FRICTION_ROWS, *CONTACTS])
        leading = leading_rows(here[rows], first=rubs)
        of_block = Block(np.arange(N_DOF) + block * N_DOF, rows)
        parts.append(BlockModel(of_block, diagonalise_damping(model), leading))
    assert [rows.size for rows in (part.leading.leaders for part in parts)] == [12, 3]
    system = condensed_system(parts, given)
    table = shared_record(place_laws(given, system.row_place))
    state = fresh_state(system, table, n_inputs=len(DRIVEN), levels=2)
    record = empty_record(system, table, SavePlan(1))
    beside = shared_record(no_obstructions()), shared_record(no_courses())
    run = Run(system, table, new_work(system, table), OPTIONS, np.zeros((1, 2)), record, *beside)
    assemble_level(run, state, 0, INERTIA, VISCOSITY)
    rebuild(run, state, 0)
    places = system.row_place.astype(np.int64).tolist()
    return Setup(run, state, given, tuple(parts), places)


def flip(made: Setup, rng: np.random.Generator) -> None:
    """Change one law or friction at random and bring the rows that hang on it up to date."""
    table, state = made.table, made.state
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
        update_row(made.run, made.state, int(row))


def deviations(made: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Form D and b from the meaning of the laws, by the mechanism's rows, not from the kernels."""
    state, table = made.state, made.laws
    n, folded = N_ROWS, folded_stiffness(table)
    matrix, constant = np.zeros((n, n)), np.zeros(n)

    def line(law: int) -> tuple[float, float]:
        if not state.present[law]:
            return 0.0, 0.0
        at = table.segment_start[law] + state.segment[law]
        return table.slope[at], table.intercept[at] - table.slope[at] * table.offset[law]

    for law in range(table.row.size):
        slope, force = line(law)
        matrix[table.row[law], table.row[law]] += folded[law]
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


def dense_solution(made: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and modal coordinates of the step from the whole system in one piece."""
    system, table, state, work = made.system, made.laws, made.state, made.work
    matrix, constant = deviations(made)
    for law in system.input_law:
        constant[table.row[law]] += state.slope[law] * state.inputs[table.input_index[law]]
    m = system.load.size
    modes, flexibility = np.zeros((N_ROWS, m)), np.zeros((N_ROWS, N_ROWS))
    load, dynamic = np.zeros(N_ROWS), np.zeros((m, m))
    for block, part in enumerate(made.parts):
        mine = slice(system.mode_start[block], system.mode_start[block + 1])
        rows, model = part.block.rows, part.model
        modes[rows, mine] += model.row_modes
        flexibility[np.ix_(rows, rows)] += model.flexibility
        load[rows] += model.row_load
        dynamic[mine, mine] = VISCOSITY * model.damping + model.stiffness
    dynamic += INERTIA * np.eye(m)
    inverse = np.linalg.inv(dynamic)
    compliance = flexibility + modes @ inverse @ modes.T
    free = modes @ inverse @ work.right_side + load
    g = np.linalg.solve(np.eye(N_ROWS) - compliance @ matrix, free + compliance @ constant)
    force = matrix @ g + constant
    return g, inverse @ (work.right_side + modes.T @ force)


def check_against_dense(made: Setup) -> None:
    state, work = made.state, made.work
    work.right_side[:] = np.linspace(-500.0, 900.0, work.right_side.size)
    state.inputs[:] = [2e-3, -1e-3]
    state.counters[UNSOLVED] = -1
    solve_displacements(made.run, state)
    gather_modes(made.run, state)
    g, q = dense_solution(made)
    np.testing.assert_allclose(state.g[made.rows], g, rtol=0, atol=TOLERANCE * np.abs(g).max())
    np.testing.assert_allclose(state.q, q, rtol=0, atol=TOLERANCE * np.abs(q).max())


def active_rows(made: Setup) -> list[int]:
    """Return the row of every slot in use, joining rows twice."""
    state = made.state
    rows = []
    for block, first in enumerate(made.system.slot_start[:-1]):
        used = state.row_of_slot[first : first + state.slots[block]]
        assert np.all(used >= 0)
        rows += used.tolist()
    assert len(rows) == int(np.sum(state.row_of_slot >= 0))
    return rows


def check_bookkeeping(made: Setup) -> None:
    system, state = made.system, made.state
    matrix, constant = deviations(made)
    rows = active_rows(made)
    joining = state.joining[: state.counters[COUNT_JOINING]].tolist()
    assert len(set(joining)) == len(joining)
    for number, row in enumerate(made.rows):
        ends = system.row_ends[row][system.row_ends[row] >= 0]
        assert rows.count(row) in (0, ends.size)
        for end in ends:
            slot = state.slot_of_end[end]
            assert (slot >= 0) == (row in rows)
            assert slot < 0 or state.end_of_slot[slot] == end
        assert (row in joining) == (row in rows and ends.size == 2)
        pattern = slice(system.pattern_start[row], system.pattern_start[row + 1])
        terms = system.term_list[system.term_start[row] : system.term_start[row + 1]]
        slopes = matrix[number, [made.rows.index(term) for term in terms]]
        entries = system.pattern_weight[pattern] * slopes[system.pattern_term[pattern]]
        np.testing.assert_allclose(state.entries[pattern], entries, rtol=1e-15, atol=1e-9)
        assert state.shift[row] == pytest.approx(constant[number], rel=1e-12, abs=1e-9)
        if np.any(state.entries[pattern] != 0.0) or state.shift[row] != 0.0:
            assert row in rows
        elif not system.pinned[row]:
            assert row not in rows


@pytest.mark.parametrize("cutoff_modes", [2, 7, N_DOF])
def test_columns_equal_a_dense_solution_after_random_flips(cutoff_modes: int) -> None:
    made = setup(cutoff_modes, seed=cutoff_modes)
    rng = np.random.default_rng(100 + cutoff_modes)
    check_against_dense(made)
    seen = set()
    for _ in range(8):
        for number in range(50):
            flip(made, rng)
            if number % 5 == 0:
                check_bookkeeping(made)
            seen.add(len(active_rows(made)))
        check_against_dense(made)
    assert len(seen) > 3, "rows were hardly ever activated or dropped"


def test_rebuild_gives_the_same_columns_and_removes_drift() -> None:
    made = setup(7, seed=1)
    rng = np.random.default_rng(8)
    for _ in range(60):
        flip(made, rng)
    active = sorted(active_rows(made))
    made.state.columns[:] *= 1.001  # a drift far beyond rounding
    made.state.mode_columns[:] *= 0.999
    before = made.state.counters[COUNT_REBUILDS]
    rebuild(made.run, made.state, 0)
    assert made.state.counters[COUNT_REBUILDS] == before + 1
    assert made.state.counters[COUNT_RECENT] == 0
    assert sorted(active_rows(made)) == active
    check_against_dense(made)
    check_bookkeeping(made)


def test_a_rail_is_solved_again_where_its_columns_have_changed_and_only_there() -> None:
    made, rng = setup(7, seed=8), np.random.default_rng(3)
    system, state, work = made.system, made.state, made.work
    check_against_dense(made)
    for _ in range(40):
        flip(made, rng)
        solve_displacements(made.run, state)
        found = state.g.copy()
        state.counters[UNSOLVED] = -1
        solve_displacements(made.run, state)
        np.testing.assert_array_equal(found, state.g)
    work.free[system.end_start[1] : system.end_start[2]] += 1e-3
    solve_displacements(made.run, state)
    moved = np.abs(state.g - found) > 1e-4
    assert moved[system.end_start[1] : system.end_stop[1]].all()  # it was not made again


def test_a_row_without_a_change_costs_nothing() -> None:
    made = setup(7, seed=2)
    before = made.state.columns.copy(), made.state.counters.copy()
    for row in made.rows:
        update_row(made.run, made.state, row)
    np.testing.assert_array_equal(made.state.columns, before[0])
    assert made.state.counters[COUNT_FLIPS] == before[1][COUNT_FLIPS]


def test_a_column_dropped_from_the_middle_leaves_the_others_as_they_are() -> None:
    made = setup(7, seed=3)
    state = made.state
    idle = made.rows[IDLE_ROW]
    assert state.slot_of_end[idle] == -1
    slot = activate(made.run, state, idle, idle, made.work.row)
    assert state.row_of_slot[slot] == idle
    check_against_dense(made)
    ends = state.end_of_slot[: state.slots[0]].tolist()
    columns = {end: state.columns[state.slot_of_end[end]].copy() for end in ends}
    deactivate(made.run, state, ends[1])
    ends.remove(ends[1])
    assert sorted(state.end_of_slot[: state.slots[0]].tolist()) == sorted(ends)
    for end in ends:
        np.testing.assert_array_equal(state.columns[state.slot_of_end[end]], columns[end])


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
            for row in made.rows:
                update = update_row if made is compiled else update_row.py_func
                update(made.run, made.state, row)
    for name in ("columns", "mode_columns", "constant_column", "entries", "shift"):
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
    with pytest.raises(MechanicsError, match="cannot be driven by a marker"):
        check_normals(table)
