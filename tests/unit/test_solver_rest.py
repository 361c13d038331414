"""Steps of rails at rest are not made, and what follows is as if they had been."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.load import load_panel
from turnout.panel.markers import marker_offsets, marker_positions
from turnout.solver.arrange import arrange
from turnout.solver.integration import integrate
from turnout.solver.march import march
from turnout.solver.outcome import Code
from turnout.solver.prepared_run import PreparedRun, prepare, set_up_run
from turnout.solver.start import start_at_rest
from turnout.solver.state import COUNT_ITERATIONS, COUNT_JOINING, UNSOLVED
from turnout.solver.step import REST_TIME, STILL, is_at_rest, predict, step_factors

Floats = NDArray[np.float64]
SCHEME = Scheme.of("quick")
BEGINS, MOVES = 1.0, 1.5
"""When the drives of SB1 begin to move, and until when it is thrown here [s]."""


def ready(name: str = "sb1", *, change: Floats | float = 0.0) -> PreparedRun:
    """Return a run of a panel whose markers are changed a little, at rest."""
    panel = load_panel(name)
    mechanism = build_mechanism(panel, ())
    times = SCHEME.step * np.arange(round(MOVES / SCHEME.step) + 1)
    positions = (marker_positions(panel, times) + marker_offsets(panel)[:, np.newaxis]).T + change
    run = prepare(set_up_run(arrange(mechanism, SCHEME), SCHEME, positions, times.size))
    assert start_at_rest(run, mechanism) == Code.COMPLETE
    return run


def thrown(change: Floats | float = 0.0) -> tuple[PreparedRun, list[Any]]:
    """Return a run that has ended, and its code and last instant."""
    run = ready(change=change)
    return run, marched(run, 0, run.positions.shape[0] - 1)


def marched(run: PreparedRun, first: int, last: int) -> list[Any]:
    """March from one instant to another."""
    given = (run.system, run.table, run.state, run.work, run.tolerances, run.stepping)
    record = (run.record, run.obstructions, run.courses)
    return list(march(*given, run.positions, first, last, *record, None))


def moving(run: PreparedRun) -> int:
    """Predict a step; return a bit for each block that is to be solved again."""
    run.state.counters[UNSOLVED] = 0
    factors = step_factors(run.stepping, SCHEME.step)
    predict(run.system, run.state, run.work, run.stepping, SCHEME.step, factors)
    return int(run.state.counters[UNSOLVED])


def test_only_moving_rails_are_solved_for() -> None:
    run, (code, reached) = thrown()
    assert (code, reached) == (Code.COMPLETE, run.positions.shape[0] - 1)
    moving = round((MOVES - BEGINS) / SCHEME.step)
    assert moving <= run.state.counters[COUNT_ITERATIONS] < 2.5 * moving
    still = round(0.9 * BEGINS / SCHEME.step)
    np.testing.assert_array_equal(run.record.law[2:still], run.record.law[1 : still - 1])


def test_the_motion_after_rest_is_that_of_rails_that_were_solved_for() -> None:
    still, _ = thrown()
    trembling = 1e-15 * np.where(np.arange(still.positions.shape[0]) % 2, 1.0, -1.0)
    stirred, _ = thrown(trembling[:, np.newaxis])
    assert stirred.state.counters[COUNT_ITERATIONS] > still.positions.shape[0]
    expected = still.record.g[1:]  # the start is stored by what calls a march
    tolerance = 1e-9 * np.abs(expected).max()
    np.testing.assert_allclose(stirred.record.g[1:], expected, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("chunk", [1, 7])
def test_rest_does_not_depend_on_how_a_march_is_split(chunk: int) -> None:
    whole, _ = thrown()
    run = ready()
    last = whole.positions.shape[0] - 1
    for first in range(0, last, chunk):
        marched(run, first, min(first + chunk, last))
    np.testing.assert_array_equal(run.record.g[1:], whole.record.g[1:])


def test_a_rail_that_hardly_moves_is_stopped_and_no_other() -> None:
    run = ready("uic60-760-1-15")
    system, state = run.system, run.state
    block = system.mode_start.size - 2  # a stock rail
    modes = int(system.mode_start[block]), int(system.mode_start[block + 1]) - 1
    state.counters[COUNT_JOINING] = 0
    for motion in (state.v, state.a, state.acceleration):
        for share, moves in ((0.9, False), (1.1, True), (np.nan, True)):
            for mode in modes:
                state.v[:] = state.a[:] = state.acceleration[:] = 0.0
                span = REST_TIME if motion is state.v else REST_TIME**2
                motion[mode] = share * STILL / span
                assert moving(run) >> block == int(moves)
                assert (motion[mode] == 0.0) == (not moves)


def test_a_rail_on_which_others_act_is_not_stopped() -> None:
    run = ready("uic60-760-1-15")
    state, blocks = run.state, range(run.system.mode_start.size - 1)
    state.v[:] = state.a[:] = state.acceleration[:] = 0.0
    rows = state.joining[: state.counters[COUNT_JOINING]]
    ends = [*run.system.input_end.tolist(), *run.system.row_ends[rows].ravel().tolist()]
    acted_on = {int(run.system.block_of_end[end]) for end in ends}
    assert 0 < len(acted_on) < len(blocks)
    assert {block for block in blocks if moving(run) >> block & 1} == acted_on


def test_short_steps_see_a_movement_begin() -> None:
    """A rail that hardly moves in one of them was stopped again and again, and stayed behind."""
    panel = load_panel("sb1")
    found = [
        integrate(
            build_mechanism(panel, ()),
            Scheme(step=step, cutoff_frequency=100.0, output_interval=2e-2),
            inputs=lambda t: marker_positions(panel, t),
            end=1.2,
        )
        for step in (5e-6, 5e-5)
    ]
    short, long = (np.array(history.g[-1]) for history in found)
    assert np.abs(long).max() > 5e-4
    np.testing.assert_allclose(short, long, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("step", [1e-6, 1e-3])
def test_a_mode_that_turns_round_is_not_at_rest_in_a_short_step(step: float) -> None:
    run = ready()
    gap = run.tolerances.gap
    run.state.v[:] = 0.0
    run.state.acceleration[:] = 0.5 * gap / REST_TIME**2
    assert is_at_rest(run.state, step, gap)
    run.state.acceleration[0] = 2.0 * gap / REST_TIME**2
    assert not is_at_rest(run.state, step, gap)
