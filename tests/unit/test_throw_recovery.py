"""Recovery of shapes: exact at the rows of the laws, linear between nodes."""

import numpy as np
import pytest
from tests.unit.simulated import sb2_run

from turnout.mechanism.mechanism import RailBody
from turnout.throw.recovery import (
    Motion,
    RowTerms,
    histories_of,
    lateral_rows,
    output_rows,
    recover_motion,
    row_motion,
)


@pytest.fixture(scope="module")
def body() -> RailBody:
    """Two elements whose reduced coordinates are the nodal displacements."""
    return RailBody(
        name="A",
        closes=1.0,
        x=np.array([0.0, 1.0, 3.0]),
        first=0,
        count=18,
        recovery=np.eye(18),
        at_interface=np.ones(18, dtype=bool),
        frequency_kept=1.0,
        frequency_omitted=2.0,
        n_full=18,
        n_interface=18,
    )


def test_rows_are_recovered() -> None:
    run = sb2_run()
    motion, rows = recover_motion(run.mechanism, run.history), run.mechanism.rows
    model = run.history.model
    terms = RowTerms(rows @ model.modes, rows @ model.residual_shapes, rows @ model.residual_load)
    recovered = output_rows(motion, terms).over_time(histories_of(run.history)).T
    assert np.abs(run.history.g).max() > 0.1
    np.testing.assert_allclose(recovered, run.history.g, rtol=0, atol=1e-12)


def lateral_displacement(
    motion: Motion, rail: str, x: np.ndarray, z: np.ndarray, at: np.ndarray | None = None
) -> np.ndarray:
    """Return lateral displacements of points of a rail over time [m]."""
    body = motion.rails[rail]
    return row_motion(motion, [(body, lateral_rows(body, x, z))], at=at)


def test_points_are_where_the_rows_say() -> None:
    """Drives read the lateral displacement at rod height through a law of their own."""
    run = sb2_run()
    motion = recover_motion(run.mechanism, run.history)
    for name, drive in run.panel.drive.items():
        row = run.mechanism.laws.row[run.mechanism.index.drive[name]]
        moved = lateral_displacement(
            motion, drive.rail, x=np.array([drive.x]), z=np.array([drive.height])
        )
        np.testing.assert_allclose(moved[0], run.history.g[:, row], rtol=0, atol=1e-12)


def test_chosen_instants_are_those_of_the_whole() -> None:
    run = sb2_run()
    motion = recover_motion(run.mechanism, run.history)
    x, z = np.array([3.6, 5.01]), np.array([0.1, 0.0])
    whole = lateral_displacement(motion, "B", x=x, z=z)
    some = lateral_displacement(motion, "B", x=x, z=z, at=np.array([7, 700]))
    np.testing.assert_allclose(some, whole[:, [7, 700]], rtol=0, atol=1e-15)


def test_nodes_are_exact(body: RailBody) -> None:
    rows = lateral_rows(body, body.x, np.zeros(3))
    np.testing.assert_array_equal(rows, np.eye(18)[1::6])


def test_height_turns_with_the_section(body: RailBody) -> None:
    rows = lateral_rows(body, np.array([1.0]), np.array([0.1]))
    expected = np.zeros(18)
    expected[6 + 1], expected[6 + 3] = 1.0, -0.1
    np.testing.assert_allclose(rows[0], expected, rtol=0, atol=1e-16)


def test_between_nodes_it_is_linear(body: RailBody) -> None:
    rows = lateral_rows(body, np.array([1.5]), np.zeros(1))
    assert rows[0, 6 + 1] == pytest.approx(0.75)
    assert rows[0, 12 + 1] == pytest.approx(0.25)


def test_beyond_the_rail_there_is_nothing(body: RailBody) -> None:
    rows = lateral_rows(body, np.array([-0.1, 3.1]), np.zeros(2))
    assert np.isnan(rows @ np.ones(18)).all()
