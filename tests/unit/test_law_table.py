"""Laws as data: continuity, force as the derivative of energy, segment search, friction mapping."""

import numpy as np
import pytest

from turnout.core.errors import MechanicsError
from turnout.law.friction import SLIP_BACKWARD, SLIP_FORWARD, STICK, friction_state
from turnout.law.kernel import any_not_finite, law_argument, law_energy, law_force, segment_for
from turnout.law.table import LawTable, LawTableBuilder

KERNELS = [law_argument, segment_for, law_force, law_energy, friction_state, any_not_finite]

LAWS = {
    "contact": {"breakpoints": [0.0], "slopes": [0.0, 1e7]},
    "bushing": {"breakpoints": [-0.0077, 0.0077], "slopes": [2e4, 7.5e5, 2e4]},
    "table": {"breakpoints": [-0.02, -0.004, 0.003, 0.011], "slopes": [5e5, 1e4, 3e5, 0.0, 2e6]},
    "one-sided table": {"breakpoints": [0.002, 0.005], "slopes": [1e3, 2e5, 4e4]},
    "all on the left": {"breakpoints": [-0.03, -0.01], "slopes": [7e4, 0.0, 9e5]},
    "linear": {"breakpoints": [], "slopes": [4e7]},
}


def one_law(name: str, **options: float) -> LawTable:
    builder = LawTableBuilder()
    builder.add_piecewise(
        0,
        breakpoints=np.array(LAWS[name]["breakpoints"], dtype=float),
        slopes=np.array(LAWS[name]["slopes"]),
        **options,
    )
    return builder.table()


def force_at(table: LawTable, e: float, law: int = 0) -> float:
    return law_force(table, law, segment_for(table, law, e, 0, 0.0), e)


def energy_at(table: LawTable, e: float, law: int = 0) -> float:
    return law_energy(table, law, segment_for(table, law, e, 0, 0.0), e)


@pytest.mark.parametrize("name", LAWS)
class TestLaw:
    """Every law goes through the same battery."""

    def test_force_and_energy_join_at_breakpoints(self, name: str) -> None:
        table = one_law(name)
        for s, at in enumerate(LAWS[name]["breakpoints"]):
            scale = max(LAWS[name]["slopes"]) * 0.01
            assert law_force(table, 0, s, at) == pytest.approx(
                law_force(table, 0, s + 1, at), abs=1e-12 * scale
            )
            assert law_energy(table, 0, s, at) == pytest.approx(
                law_energy(table, 0, s + 1, at), abs=1e-12 * scale * 0.01
            )

    def test_force_and_energy_vanish_at_rest(self, name: str) -> None:
        table = one_law(name)
        assert force_at(table, 0.0) == 0.0
        assert energy_at(table, 0.0) == 0.0

    def test_energy_is_the_integral_of_the_force(self, name: str) -> None:
        table = one_law(name)
        nodes = np.unique(np.concatenate(([-0.04, 0.0, 0.03], LAWS[name]["breakpoints"])))
        forces = np.array([force_at(table, e) for e in nodes])
        # the force is linear between nodes, so the trapezoidal rule is exact
        integral = np.concatenate(
            ([0.0], np.cumsum(0.5 * (forces[1:] + forces[:-1]) * np.diff(nodes)))
        )
        integral -= integral[np.flatnonzero(nodes == 0.0)[0]]
        energies = [energy_at(table, e) for e in nodes]
        np.testing.assert_allclose(energies, integral, rtol=1e-11, atol=1e-11)

    def test_slope_is_the_finite_difference_of_the_force(self, name: str) -> None:
        table = one_law(name)
        rng = np.random.default_rng(1)
        d = 1e-6
        checked = 0
        for e in rng.uniform(-0.04, 0.03, 60):
            if np.any(np.abs(np.array(LAWS[name]["breakpoints"]) - e) < 2 * d):
                continue
            segment = segment_for(table, 0, e, 0, 0.0)
            difference = (force_at(table, e + d) - force_at(table, e - d)) / (2 * d)
            assert difference == pytest.approx(table.slope[segment], rel=1e-7, abs=1e-4)
            checked += 1
        assert checked > 50

    def test_segment_search_finds_the_holding_segment_from_any_start(self, name: str) -> None:
        table = one_law(name)
        count = len(LAWS[name]["slopes"])
        for e in np.random.default_rng(2).uniform(-0.04, 0.03, 40):
            expected = int(np.searchsorted(LAWS[name]["breakpoints"], e))
            for present in range(count):
                assert segment_for(table, 0, e, present, 0.0) == expected

    def test_offset_and_input_shift_the_argument(self, name: str) -> None:
        table = one_law(name, offset=0.002, input_index=1)
        g, inputs = np.array([0.011]), np.array([9.0, 0.004])
        assert law_argument(table, 0, g, inputs) == pytest.approx(0.005, abs=1e-16)


def test_tolerance_keeps_the_present_segment_only_within_it() -> None:
    table = one_law("contact")
    assert segment_for(table, 0, 1e-12, 0, 1e-11) == 0
    assert segment_for(table, 0, 2e-11, 0, 1e-11) == 1
    assert segment_for(table, 0, -1e-12, 1, 1e-11) == 1
    assert segment_for(table, 0, -2e-11, 1, 1e-11) == 0


def test_contact_closes_at_its_clearance() -> None:
    builder = LawTableBuilder()
    open_law = builder.add_contact(0, stiffness=4e7, clearance=0.013)
    closed_law = builder.add_contact(1, stiffness=1e7, clearance=0.0, base_closed=True)
    table = builder.table()
    none = np.zeros(0)
    assert table.base_segment.tolist() == [-1, 1]
    for g, force in [(0.0, 0.0), (0.013, 0.0), (0.0131, 4e3)]:
        e = law_argument(table, open_law, np.array([g, 0.0]), none)
        assert force_at(table, e, open_law) == pytest.approx(force, rel=1e-9, abs=1e-9)
    assert force_at(table, -1e-3, closed_law) == 0.0
    assert force_at(table, 1e-3, closed_law) == pytest.approx(1e4, rel=1e-12)


def test_laws_of_several_rows_keep_their_own_segments() -> None:
    builder = LawTableBuilder()
    for row, name in enumerate(LAWS):
        index = builder.add_piecewise(
            row,
            breakpoints=np.array(LAWS[name]["breakpoints"], dtype=float),
            slopes=np.array(LAWS[name]["slopes"]),
        )
        assert index == row
    table = builder.table()
    for law, name in enumerate(LAWS):
        alone = one_law(name)
        for e in (-0.035, -0.006, 0.001, 0.0042, 0.02):
            assert force_at(table, e, law) == force_at(alone, e)
            assert energy_at(table, e, law) == energy_at(alone, e)


@pytest.mark.parametrize(
    ("breakpoints", "slopes"),
    [([0.0, 0.0], [1.0, 2.0, 3.0]), ([0.1, -0.1], [1.0, 2.0, 3.0]), ([0.0], [1.0])],
)
def test_breakpoints_that_do_not_rise_are_refused(
    breakpoints: list[float], slopes: list[float]
) -> None:
    with pytest.raises(MechanicsError, match=r"law on row 7: breakpoints must rise"):
        LawTableBuilder().add_piecewise(
            7, breakpoints=np.array(breakpoints), slopes=np.array(slopes)
        )


def test_an_empty_builder_gives_an_empty_table() -> None:
    table = LawTableBuilder().table()
    assert table.row.size == table.friction_row.size == table.slope.size == 0
    assert table.segment_start.tolist() == [0]


def test_friction_sticks_up_to_its_limit_and_slips_beyond() -> None:
    for trial, expected in [
        (0.0, STICK),
        (9.9, STICK),
        (-9.9, STICK),
        (10.1, SLIP_FORWARD),
        (-10.1, SLIP_BACKWARD),
    ]:
        assert friction_state(trial, 10.0, STICK, 1e-9) == expected


def test_slip_goes_on_turns_back_to_stick_or_reverses() -> None:
    assert friction_state(12.0, 10.0, SLIP_FORWARD, 1e-9) == SLIP_FORWARD
    assert friction_state(8.0, 10.0, SLIP_FORWARD, 1e-9) == STICK
    assert friction_state(-8.0, 10.0, SLIP_FORWARD, 1e-9) == STICK
    assert friction_state(-12.0, 10.0, SLIP_FORWARD, 1e-9) == SLIP_BACKWARD
    assert friction_state(12.0, 10.0, SLIP_BACKWARD, 1e-9) == SLIP_FORWARD


def test_an_open_foot_keeps_its_branch_because_it_carries_no_force() -> None:
    for branch in (SLIP_FORWARD, SLIP_BACKWARD):
        for trial in (-5.0, 0.0, 5.0):
            assert friction_state(trial, 0.0, branch, 1e-9) == branch
    assert friction_state(0.0, 0.0, STICK, 1e-9) == STICK
    assert friction_state(5.0, 0.0, STICK, 1e-9) == SLIP_FORWARD


def return_mapping(
    displacement: np.ndarray, limit: np.ndarray, stiffness: float
) -> tuple[np.ndarray, np.ndarray]:
    """Follow a prescribed path with `friction_state`; return force and plastic slip."""
    anchor, branch = 0.0, STICK
    force, slip = np.zeros(displacement.size), np.zeros(displacement.size)
    for n, (x, bound) in enumerate(zip(displacement, limit, strict=True)):
        trial = stiffness * (x - anchor)
        branch = friction_state(trial, bound, branch, 0.0)
        force[n] = trial if branch == STICK else branch * bound
        anchor = x - force[n] / stiffness
        slip[n] = anchor
    return force, slip


def test_a_cycle_dissipates_the_area_of_its_parallelogram() -> None:
    stiffness, bound, amplitude, n = 1e6, 40.0, 1e-3, 4000
    turn = np.concatenate(
        (np.linspace(0, 1, n), np.linspace(1, -1, 2 * n)[1:], np.linspace(-1, 1, 2 * n)[1:])
    )
    x = amplitude * turn
    force, slip = return_mapping(x, np.full(x.size, bound), stiffness)
    assert np.max(np.abs(force)) <= bound
    cycle = slice(x.size - (4 * n - 1), None)
    area = np.trapezoid(force[cycle], x[cycle])
    expected = 4 * bound * (amplitude - bound / stiffness)
    assert area == pytest.approx(expected, rel=1e-3)  # the corners are cut by the step
    work = np.sum(0.5 * (force[1:] + force[:-1])[-(4 * n - 2) :] * np.diff(slip)[-(4 * n - 2) :])
    assert work == pytest.approx(expected, rel=1e-3)


def test_the_force_never_exceeds_a_limit_that_vanishes_and_returns() -> None:
    t = np.linspace(0, 4, 4001)
    limit = np.maximum(50.0 * np.cos(np.pi * t), 0.0)
    x = 1e-3 * np.sin(3.7 * t)
    force, _ = return_mapping(x, limit, 2e6)
    assert np.all(np.abs(force) <= limit + 1e-12)
    assert np.all(force[limit == 0.0] == 0.0)
    assert np.max(np.abs(force[t > 1.6])) > 30.0


def test_without_friction_there_is_no_force() -> None:
    x = np.sin(np.linspace(0, 9, 200))
    force, slip = return_mapping(x, np.zeros(200), 1e6)
    assert np.all(force == 0.0)
    np.testing.assert_array_equal(slip, x)


def test_kernels_equal_their_plain_functions() -> None:
    rng = np.random.default_rng(5)
    table = one_law("table", offset=0.001, input_index=0)
    for e in rng.uniform(-0.04, 0.03, 50):
        inputs = np.array([0.5 * e])
        segment = segment_for(table, 0, e, 2, 1e-6)
        assert segment == segment_for.py_func(table, 0, e, 2, 1e-6)
        for kernel, arguments in [
            (law_argument, (table, 0, np.array([e]), inputs)),
            (law_force, (table, 0, segment, e)),
            (law_energy, (table, 0, segment, e)),
        ]:
            assert kernel(*arguments) == pytest.approx(
                kernel.py_func(*arguments), rel=1e-13, abs=1e-13
            )
        trial, limit = rng.normal(0, 10), abs(rng.normal(0, 10))
        for branch in (STICK, SLIP_FORWARD, SLIP_BACKWARD):
            arguments = (trial, limit, branch, 1e-9)
            assert friction_state(*arguments) == friction_state.py_func(*arguments)


def test_a_blow_up_is_seen() -> None:
    for kernel in (any_not_finite, any_not_finite.py_func):
        for at in range(48):  # four lines at once, then two that remain
            values = np.zeros(48)
            values[at] = -1e300
            assert not kernel(values)
            for blown_up in (np.nan, np.inf, -np.inf):
                values[at] = blown_up
                assert kernel(values)


def test_laws_that_come_after_a_table_share_its_indices() -> None:
    """Values are their own, and those that laws added to the first ones one by one have."""

    def add_standing(laws: LawTableBuilder) -> None:
        normal = laws.add_contact(0, stiffness=2e7, clearance=1e-3, base_closed=True)
        laws.add_friction(1, normal=normal, friction_coefficient=0.2, stick_stiffness=1e6)
        laws.add_contact(2, stiffness=1e8, clearance=2e-3)

    def add_further(laws: LawTableBuilder, scale: float) -> None:
        slopes = [0.0, scale * 1e5, 0.0]
        laws.add_piecewise(3, breakpoints=[-0.01, 0.01], slopes=slopes, input_index=0)
        laws.add_contact(4, stiffness=scale * 1e6, clearance=scale * 0.02, appears=1.5, waits=True)

    first = LawTableBuilder()
    add_standing(first)
    standing, known = first.table(), {}
    found = []
    for scale in (1.0, 1.25):
        further, whole = LawTableBuilder(), LawTableBuilder()
        add_further(further, scale)
        add_standing(whole)
        add_further(whole, scale)
        found.append(further.after(standing, known))
        for name, array in whole.table()._asdict().items():
            np.testing.assert_array_equal(getattr(found[-1], name), array, strict=True)
    assert found[0].row is found[1].row
    assert not found[0].row.flags.writeable
    assert not np.shares_memory(found[0].offset, found[1].offset)
    found[1].offset[0] = 5.0
    assert standing.offset[0] == 1e-3
    assert len(known) == 1
    alone = LawTableBuilder().after(standing, known)
    for name, array in standing._asdict().items():
        np.testing.assert_array_equal(getattr(alone, name), array, strict=True)
