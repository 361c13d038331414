"""Steps of rails at rest are not made, and what follows is as if they had been."""

import numpy as np
import pytest
from numpy.typing import NDArray

from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.load import load_panel
from turnout.panel.markers import marker_offsets, marker_positions
from turnout.solver.arrange import arrange, prepare, set_up_run
from turnout.solver.integration import integrate
from turnout.solver.march import REST_TIME, STILL, is_at_rest, march, predict, step_factors
from turnout.solver.outcome import Code
from turnout.solver.record import SavePlan
from turnout.solver.start import start_at_rest
from turnout.solver.state import COUNT_ITERATIONS, COUNT_JOINING, UNSOLVED, Run, State

Floats = NDArray[np.float64]
SCHEME = Scheme.of("quick")
BEGINS, MOVES = 1.0, 1.5
"""When the drives of SB1 begin to move, and until when it is thrown here [s]."""


def ready(name: str = "sb1", *, change: Floats | float = 0.0) -> tuple[Run, State]:
    """Return a run of a panel whose markers are changed a little, at rest."""
    panel = load_panel(name)
    mechanism = build_mechanism(panel, ())
    times = SCHEME.step * np.arange(round(MOVES / SCHEME.step) + 1)
    positions = (marker_positions(panel, times) + marker_offsets(panel)[:, np.newaxis]).T + change
    run, state = prepare(
        set_up_run(arrange(mechanism, SCHEME), SCHEME, positions, SavePlan(times.size))
    )
    assert start_at_rest(run, state, mechanism) == Code.COMPLETE
    return run, state


def thrown(change: Floats | float = 0.0) -> tuple[Run, State, tuple[int, int]]:
    """Return a run that has ended with its state, and its code and last instant."""
    run, state = ready(change=change)
    return run, state, march(run, state, 0, run.positions.shape[0] - 1, None)


def moving(run: Run, state: State) -> int:
    """Predict a step; return a bit for each block that is to be solved again."""
    state.counters[UNSOLVED] = 0
    predict(run, state, step_factors(run.options, SCHEME.step))
    return int(state.counters[UNSOLVED])


def test_only_moving_rails_are_solved_for() -> None:
    run, state, (code, reached) = thrown()
    assert (code, reached) == (Code.COMPLETE, run.positions.shape[0] - 1)
    moving = round((MOVES - BEGINS) / SCHEME.step)
    assert moving <= state.counters[COUNT_ITERATIONS] < 2.5 * moving
    still = round(0.9 * BEGINS / SCHEME.step)
    np.testing.assert_array_equal(run.record.law[2:still], run.record.law[1 : still - 1])


def test_the_motion_after_rest_is_that_of_rails_that_were_solved_for() -> None:
    still, *_ = thrown()
    trembling = 1e-15 * np.where(np.arange(still.positions.shape[0]) % 2, 1.0, -1.0)
    stirred, state, _ = thrown(trembling[:, np.newaxis])
    assert state.counters[COUNT_ITERATIONS] > still.positions.shape[0]
    expected = still.record.g[1:]  # the start is stored by what calls a march
    tolerance = 1e-9 * np.abs(expected).max()
    np.testing.assert_allclose(stirred.record.g[1:], expected, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("chunk", [1, 7])
def test_rest_does_not_depend_on_how_a_march_is_split(chunk: int) -> None:
    whole, *_ = thrown()
    run, state = ready()
    last = whole.positions.shape[0] - 1
    for first in range(0, last, chunk):
        march(run, state, first, min(first + chunk, last), None)
    np.testing.assert_array_equal(run.record.g[1:], whole.record.g[1:])


def test_a_rail_that_hardly_moves_is_stopped_and_no_other() -> None:
    run, state = ready("uic60-760-1-15")
    system = run.system
    block = system.mode_start.size - 2  # a stock rail
    modes = int(system.mode_start[block]), int(system.mode_start[block + 1]) - 1
    state.counters[COUNT_JOINING] = 0
    for motion in (state.v, state.a, state.acceleration):
        for share, moves in ((0.9, False), (1.1, True), (np.nan, True)):
            for mode in modes:
                state.v[:] = state.a[:] = state.acceleration[:] = 0.0
                span = REST_TIME if motion is state.v else REST_TIME**2
                motion[mode] = share * STILL / span
                assert moving(run, state) >> block == int(moves)
                assert (motion[mode] == 0.0) == (not moves)


def test_a_rail_on_which_others_act_is_not_stopped() -> None:
    run, state = ready("uic60-760-1-15")
    blocks = range(run.system.mode_start.size - 1)
    state.v[:] = state.a[:] = state.acceleration[:] = 0.0
    rows = state.joining[: state.counters[COUNT_JOINING]]
    ends = [*run.system.input_end.tolist(), *run.system.row_ends[rows].ravel().tolist()]
    acted_on = {int(run.system.block_of_end[end]) for end in ends}
    assert 0 < len(acted_on) < len(blocks)
    assert {block for block in blocks if moving(run, state) >> block & 1} == acted_on


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
    run, state = ready()
    gap = run.options.gap
    state.v[:] = 0.0
    state.acceleration[:] = 0.5 * gap / REST_TIME**2
    assert is_at_rest(state, step, gap)
    state.acceleration[0] = 2.0 * gap / REST_TIME**2
    assert not is_at_rest(state, step, gap)
