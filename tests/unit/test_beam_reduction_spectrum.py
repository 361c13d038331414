"""Counting and finding the low modes of a structure."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from turnout.beam.spectrum import count_below, factorise, modes_below
from turnout.core.errors import MechanicsError

TURN = 2.0 * np.pi


def chain(count, *, mass=1.0, spring=1.0, free=False):
    """Make a chain of equal masses between walls, or free."""
    diagonal = np.full(count, 2.0 * spring)
    if free:
        diagonal[[0, -1]] = spring
    off = np.full(count - 1, -spring)
    stiffness = sp.diags_array([off, diagonal, off], offsets=[-1, 0, 1]).tocsr()
    return stiffness, sp.csr_array(sp.eye_array(count) * mass)


def chain_frequencies(count, *, mass=1.0, spring=1.0):
    """Return 2 sqrt(k/m) sin(j pi / 2 (N + 1)) [Hz] of a chain between walls."""
    number = np.arange(1, count + 1)
    return 2.0 * np.sqrt(spring / mass) * np.sin(number * np.pi / (2 * (count + 1))) / TURN


def twins(count):
    """Make two equal chains side by side: every frequency comes twice."""
    stiffness, mass = chain(count)
    return sp.block_diag([stiffness] * 2, format="csr"), sp.block_diag([mass] * 2, format="csr")


@pytest.mark.parametrize("count", [5, 40, 300], ids=["dense", "either", "lanczos"])
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_chain_between_walls(count, share):
    """Closed-form frequencies; the first left out is known too."""
    values = {"mass": 3.0, "spring": 5e4}
    exact = chain_frequencies(count, **values)
    cutoff = share * exact[-1]
    frequencies, modes, omitted = modes_below(*chain(count, **values), cutoff_frequency=cutoff)
    kept = np.count_nonzero(exact < cutoff)
    np.testing.assert_allclose(frequencies, exact[:kept], rtol=1e-10)
    assert omitted == pytest.approx(exact[kept], rel=1e-10)
    np.testing.assert_allclose(3.0 * modes.T @ modes, np.eye(kept), atol=1e-10)


@pytest.mark.parametrize("count", [20, 200], ids=["dense", "lanczos"])
def test_double_frequencies_are_all_found(count):
    exact = np.repeat(chain_frequencies(count), 2)
    frequencies, modes, _ = modes_below(*twins(count), cutoff_frequency=0.1)
    kept = np.count_nonzero(exact < 0.1)
    assert kept >= 4
    np.testing.assert_allclose(frequencies, exact[:kept], rtol=1e-9)
    np.testing.assert_allclose(modes.T @ modes, np.eye(kept), atol=1e-9)


@pytest.mark.parametrize("count", [20, 200], ids=["dense", "lanczos"])
def test_free_body_has_its_rigid_modes_too(count):
    stiffness, mass = chain(count, free=True)
    frequencies, modes, _ = modes_below(stiffness, mass, cutoff_frequency=0.03)
    exact = 2.0 * np.sin(np.arange(count) * np.pi / (2 * count)) / TURN
    np.testing.assert_allclose(frequencies, exact[exact < 0.03], rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(modes[:, 0], 1.0 / np.sqrt(count), rtol=1e-9)
    with pytest.raises(MechanicsError, match="not held"):
        modes_below(stiffness, mass, cutoff_frequency=0.0)


def test_all_modes_below_a_high_cutoff():
    frequencies, _, omitted = modes_below(*chain(7), cutoff_frequency=10.0)
    np.testing.assert_allclose(frequencies, chain_frequencies(7), rtol=1e-12)
    assert np.isnan(omitted)


def test_masses_at_rest_have_no_modes():
    """DOFs without mass follow statically and count as infinitely high."""
    stiffness, _ = chain(3)
    mass = sp.csr_array(np.diag([0.0, 1.0, 0.0]))
    frequencies, modes, omitted = modes_below(stiffness, mass, cutoff_frequency=10.0)
    np.testing.assert_allclose(frequencies, [1.0 / TURN], rtol=1e-12)
    np.testing.assert_allclose(modes[:, 0], [0.5, 1.0, 0.5], rtol=1e-12)
    assert not np.isfinite(omitted)


@pytest.mark.parametrize("count", [3, 200], ids=["dense", "lanczos"])
def test_structure_without_mass_has_no_modes(count):
    stiffness, mass = chain(count)
    frequencies, modes, omitted = modes_below(stiffness, 0.0 * mass, cutoff_frequency=10.0)
    assert frequencies.size == 0
    assert modes.shape == (count, 0)
    assert np.isnan(omitted)


@pytest.mark.parametrize("count", [30, 200], ids=["dense", "lanczos"])
def test_modes_are_the_same_every_time_and_their_first_large_entry_is_positive(count):
    (_, modes, _), (_, again, _) = (
        modes_below(*chain(count), cutoff_frequency=0.05) for _ in range(2)
    )
    np.testing.assert_array_equal(modes, again)
    size = np.abs(modes)
    first = np.argmax(size > 0.3 * size.max(axis=0), axis=0)
    assert np.all(modes[first, np.arange(modes.shape[1])] > 0.0)


def test_modes_are_counted_between_all_frequencies():
    exact = chain_frequencies(12)
    for number, frequency in enumerate(0.5 * (exact[1:] + exact[:-1])):
        assert count_below(*chain(12), frequency=frequency) == number + 1


def test_count_survives_a_zero_pivot():
    """At this shift both diagonal entries vanish, one eigenvalue is below and one above."""
    shift = (TURN * 0.1) ** 2
    stiffness = sp.csr_array(shift * np.array([[1.0, 0.5], [0.5, 1.0]]))
    assert count_below(stiffness, sp.eye_array(2, format="csr"), frequency=0.1) == 1


def test_factor_solves_one_and_many():
    stiffness, _ = chain(50, spring=1e9)
    right = np.random.default_rng(0).standard_normal((50, 3))
    factor = factorise(stiffness)
    expected = scipy.linalg.solve(stiffness.toarray(), right)
    np.testing.assert_allclose(factor.solve(right), expected, rtol=1e-10)
    np.testing.assert_allclose(factor.solve(right[:, 1]), expected[:, 1], rtol=1e-10)


def test_factor_of_a_singular_matrix_is_none():
    assert factorise(chain(50, free=True)[0]) is None
    assert factorise(sp.csr_array(np.diag([1.0, 0.0]))) is None
