"""The superelement's layout: interface first, exact statics, recovery; and what is refused."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from turnout.beam.craig_bampton import (
    craig_bampton,
    reduce_matrix,
    reduce_vector,
)
from turnout.beam.reduction_error import format_report, reduction_report
from turnout.core.errors import MechanicsError

SIZE = 12
INTERFACE = [7, 2, 11]
CUTOFF = 0.12


def structure():
    """Make a chain of unequal masses and springs, held at one end, with coupled mass."""
    springs = 1.0 + 0.3 * np.arange(SIZE + 1)
    springs[-1] = 0.0
    stiffness = sp.diags_array(
        [-springs[1:-1], springs[:-1] + springs[1:], -springs[1:-1]], offsets=[-1, 0, 1]
    )
    off = np.full(SIZE - 1, 0.2)
    mass = sp.diags_array([off, 2.0 + 0.1 * np.arange(SIZE), off], offsets=[-1, 0, 1])
    return stiffness.tocsr(), mass.tocsr()


@pytest.fixture(scope="module")
def reduced():
    return craig_bampton(*structure(), INTERFACE, cutoff_frequency=CUTOFF)


def test_interface_dofs_come_first_and_unchanged(reduced):
    rows = reduced.transformation[INTERFACE]
    expected = np.eye(3, reduced.transformation.shape[1])
    np.testing.assert_array_equal(rows, expected)
    assert reduced.n_interface == 3
    assert 0 < reduced.frequencies_kept.size < SIZE - 3


def test_reduced_matrices_are_projections(reduced):
    stiffness, mass = structure()
    np.testing.assert_allclose(reduced.stiffness, reduce_matrix(reduced, stiffness), atol=1e-11)
    np.testing.assert_allclose(reduced.mass, reduce_matrix(reduced, mass), atol=1e-11)


def test_dense_and_sparse_input_agree(reduced):
    dense = craig_bampton(*[m.toarray() for m in structure()], INTERFACE, cutoff_frequency=CUTOFF)
    np.testing.assert_array_equal(dense.mass, reduced.mass)


def test_kept_frequencies_are_those_of_the_fixed_interface(reduced):
    inner = np.setdiff1d(np.arange(SIZE), INTERFACE)
    stiffness, mass = (matrix.toarray()[np.ix_(inner, inner)] for matrix in structure())
    exact = np.sqrt(scipy.linalg.eigvalsh(stiffness, mass)) / (2.0 * np.pi)
    kept = reduced.frequencies_kept.size
    np.testing.assert_allclose(reduced.frequencies_kept, exact[:kept], rtol=1e-10)
    assert reduced.frequency_first_omitted == pytest.approx(exact[kept], rel=1e-10)
    assert exact[kept - 1] < CUTOFF < exact[kept]


def test_static_response_to_interface_loads_is_exact(reduced):
    stiffness, _ = structure()
    load = np.zeros(SIZE)
    load[INTERFACE] = [3.0, -1.0, 2.0]
    expected = np.linalg.solve(stiffness.toarray(), load)
    found = reduced.transformation @ np.linalg.solve(
        reduced.stiffness, reduce_vector(reduced, load)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-11)


def test_unsymmetric_matrix_is_projected_as_it_is(reduced):
    matrix = np.random.default_rng(2).standard_normal((SIZE, SIZE))
    left, right = np.random.default_rng(3).standard_normal((2, reduced.stiffness.shape[0]))
    expected = (reduced.transformation @ left) @ matrix @ (reduced.transformation @ right)
    assert left @ reduce_matrix(reduced, matrix) @ right == pytest.approx(expected, rel=1e-11)


def test_every_dof_may_be_interface():
    stiffness, mass = structure()
    whole = craig_bampton(stiffness, mass, range(SIZE), cutoff_frequency=1.0)
    np.testing.assert_array_equal(whole.stiffness, stiffness.toarray())
    np.testing.assert_allclose(whole.mass, mass.toarray(), rtol=1e-15)


def test_interface_that_does_not_hold_the_body_is_refused():
    two = sp.block_diag([np.array([[1.0, -1.0], [-1.0, 1.0]])] * 2)
    with pytest.raises(MechanicsError, match="1 interface DOFs do not hold the body"):
        craig_bampton(two, np.eye(4), [0], cutoff_frequency=1.0)


@pytest.mark.parametrize(
    ("interface", "cutoff", "text"),
    [
        ([1, 2, 1], 1.0, r"repeat: \[1\]"),
        ([SIZE], 1.0, "from 0 to 11"),
        ([-1], 1.0, "from 0 to 11"),
        ([0], -1.0, "allowed is 0 or more"),
        ([0], float("nan"), "allowed is 0 or more"),
    ],
)
def test_bad_input_is_refused(interface, cutoff, text):
    with pytest.raises(MechanicsError, match=text):
        craig_bampton(*structure(), interface, cutoff_frequency=cutoff)


class TestReport:
    """The report's numbers and its text."""

    def test_numbers(self, reduced):
        stiffness, mass = structure()
        report = reduction_report(reduced, stiffness, mass)
        exact = np.sqrt(scipy.linalg.eigvalsh(stiffness.toarray(), mass.toarray())) / (2.0 * np.pi)
        own = np.sqrt(scipy.linalg.eigvalsh(reduced.stiffness, reduced.mass)) / (2.0 * np.pi)
        shown = exact[exact < CUTOFF]
        np.testing.assert_allclose(report.frequencies_full, shown, rtol=1e-9)
        np.testing.assert_allclose(report.frequencies_reduced, own[: shown.size], rtol=1e-9)
        np.testing.assert_allclose(
            report.modal_error, own[: shown.size] / shown - 1.0, rtol=1e-6, atol=1e-9
        )
        assert report.static_error < 1e-12
        assert report.n_rigid == 0
        assert report.dof_share == reduced.stiffness.shape[0] / SIZE

    def test_wrong_superelement_shows_as_static_error(self, reduced):
        stiffness, mass = structure()
        report = reduction_report(reduced, stiffness * 1.01, mass)
        assert report.static_error == pytest.approx(0.01, rel=1e-6)

    def test_free_body_skips_the_static_error(self):
        stiffness, mass = structure()
        stiffness = stiffness.tolil()
        stiffness[0, 0] -= 1.0
        free = craig_bampton(stiffness.tocsr(), mass, INTERFACE, cutoff_frequency=CUTOFF)
        report = reduction_report(free, stiffness.tocsr(), mass)
        assert np.isnan(report.static_error)
        assert report.n_rigid == 1
        assert np.all(report.frequencies_full > 0.001)
        assert "skipped: the stiffness is singular" in str(report)
        assert "rigid-body modes: 1" in str(report)

    def test_static_shapes_alone_have_no_table(self):
        tiny = craig_bampton(*structure(), [SIZE - 1], cutoff_frequency=0.0)
        assert tiny.stiffness.shape == (1, 1)
        assert tiny.frequency_first_omitted > 0.0
        report = reduction_report(tiny, *structure())
        assert report.frequencies_full.size == 0
        assert "modes kept with fixed interface: none" in str(report)
        assert "free interface" not in str(report)

    def test_as_many_modes_as_reduced_dofs(self):
        """With every mode below the cut-off the table has one line a DOF and no error."""
        whole = craig_bampton(*structure(), INTERFACE, cutoff_frequency=10.0)
        assert whole.stiffness.shape == (SIZE, SIZE)
        assert np.isnan(whole.frequency_first_omitted)
        report = reduction_report(whole, *structure())
        assert report.modal_error.size == SIZE
        assert np.abs(report.modal_error).max() < 1e-9
        assert "none left out" in str(report)

    def test_text_ends_with_the_worst_error(self, reduced):
        report = reduction_report(reduced, *structure())
        lines = format_report(report, most_modes=2).splitlines()
        assert lines[0].startswith(f"{reduced.stiffness.shape[0]} of {SIZE} DOFs")
        assert sum("mode " in line for line in lines) == 2
        worst = np.abs(report.modal_error).max()
        assert lines[-1].endswith(f"{worst:.1e}")
