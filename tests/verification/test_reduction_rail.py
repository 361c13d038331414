"""Reduction of a rail: against the full beam, in frequency, at rest and under a harmonic load.

Tolerances: statics at the interface are exact (1e-9, rounding); below a quarter of the cut-off a
frequency is off by less than 0.5 %, below half of it by less than 5 %, and the error falls at
least fourfold when the cut-off is doubled.
"""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from turnout.beam.assembly import assemble_beam, dof_index, point_row
from turnout.beam.craig_bampton import craig_bampton, reduce_vector
from turnout.beam.material import ElasticMaterial
from turnout.beam.mesh import mesh_nodes
from turnout.beam.reduction_error import reduction_report
from turnout.beam.section_record import SectionProperties, interpolate_sections

STEEL = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
LENGTH = 6.0
SUPPORTS = np.arange(0.3, LENGTH, 0.6)
THICK = [7e-3, 3e-5, 5e-6, 3e-7, 2e-6, 0.4, 0.5, 0.004, 0.08, 0.003, 0.05]
THIN = [3e-3, 8e-6, 1e-6, 1e-7, 8e-7, 0.4, 0.5, 0.010, 0.06, 0.008, 0.03]


@pytest.fixture(scope="module")
def beam():
    """Make a tapered rail with an unsymmetric, eccentric section."""
    x = mesh_nodes(0.0, LENGTH, element_length=0.15, forced=SUPPORTS)
    ends = SectionProperties(*[np.array(pair) for pair in zip(THIN, THICK, strict=True)])
    middle = interpolate_sections([0.0, LENGTH], ends, 0.5 * (x[1:] + x[:-1]))
    return assemble_beam(x, middle, STEEL)


def on_springs(beam):
    """Add vertical and lateral springs at the supports' feet and one along the rail."""
    stiffness = beam.stiffness
    for at in SUPPORTS:
        for direction, rate in [("uz", 3e7), ("uy", 5e6)]:
            for side in (-0.05, 0.05):
                row = sp.csr_array(point_row(beam, at, direction, y=side, z=-0.01)[None, :])
                stiffness = stiffness + rate * (row.T @ row)
    row = sp.csr_array(point_row(beam, SUPPORTS[-1], "ux")[None, :])
    return sp.csr_array(stiffness + 1e7 * (row.T @ row))


@pytest.fixture(scope="module")
def stiffness(beam):
    return on_springs(beam)


@pytest.fixture(scope="module")
def interface(beam):
    dofs = [dof_index(beam, at, name) for at in SUPPORTS for name in ("uy", "uz", "rx")]
    return [*dofs, dof_index(beam, LENGTH, "ux")]


def test_rail_on_springs_keeps_its_statics(beam, stiffness, interface):
    reduced = craig_bampton(stiffness, beam.mass, interface, cutoff_frequency=300.0)
    report = reduction_report(reduced, stiffness, beam.mass)
    assert report.static_error < 1e-9
    assert report.n_rigid == 0
    assert report.dof_share < 0.2


def test_error_falls_with_the_cutoff(beam, stiffness, interface):
    """Frequencies up to 400 Hz with modes up to 800 and up to 1600 Hz."""
    worst = []
    for cutoff in (800.0, 1600.0):
        reduced = craig_bampton(stiffness, beam.mass, interface, cutoff_frequency=cutoff)
        report = reduction_report(reduced, stiffness, beam.mass)
        low = report.frequencies_full < 400.0
        assert report.modal_error.min() > -1e-9  # a reduced body is never softer
        assert report.modal_error[report.frequencies_full < cutoff / 4.0].max() < 5e-3
        worst.append(report.modal_error[low].max())
    assert worst[0] < 5e-2
    assert worst[1] < worst[0] / 4.0


def test_full_frequencies_are_those_of_the_beam(beam, stiffness, interface):
    reduced = craig_bampton(stiffness, beam.mass, interface, cutoff_frequency=500.0)
    found = reduction_report(reduced, stiffness, beam.mass).frequencies_full
    exact = scipy.linalg.eigvalsh(stiffness.toarray(), beam.mass.toarray())
    exact = np.sqrt(exact) / (2.0 * np.pi)
    np.testing.assert_allclose(found, exact[exact < 500.0], rtol=1e-8)


def test_free_rail_keeps_six_rigid_motions(beam, interface):
    reduced = craig_bampton(beam.stiffness, beam.mass, interface, cutoff_frequency=500.0)
    report = reduction_report(reduced, beam.stiffness, beam.mass)
    assert report.n_rigid == 6
    assert np.isnan(report.static_error)
    assert "free" in report.static_note
    assert np.abs(report.modal_error[:3]).max() < 1e-3


def test_rigid_motion_is_recovered_exactly(beam, interface):
    """A yaw about the origin, seen at the interface only, moves every DOF along."""
    reduced = craig_bampton(beam.stiffness, beam.mass, interface, cutoff_frequency=0.0)
    yaw = np.zeros(beam.gravity_load.size)
    yaw[1::6], yaw[5::6] = beam.x, 1.0
    found = reduced.transformation @ yaw[reduced.interface]
    np.testing.assert_allclose(found, yaw, atol=1e-8)
    assert abs(yaw[reduced.interface] @ reduced.stiffness @ yaw[reduced.interface]) < 1e-3


def test_weight_is_carried_by_the_interface_exactly(beam, stiffness, interface):
    """Loads inside the body reach the interface through the static shapes."""
    reduced = craig_bampton(stiffness, beam.mass, interface, cutoff_frequency=300.0)
    full = np.linalg.solve(stiffness.toarray(), beam.gravity_load)
    small = np.linalg.solve(reduced.stiffness, reduce_vector(reduced, beam.gravity_load))
    np.testing.assert_allclose(small[: len(interface)], full[interface], rtol=1e-7)


def test_harmonic_response_below_the_cutoff(beam, stiffness, interface):
    """A lateral force on the thin end's foot at 60 Hz, with modes up to 1000 Hz: 0.2 %."""
    reduced = craig_bampton(stiffness, beam.mass, interface, cutoff_frequency=1000.0)
    load = point_row(beam, SUPPORTS[0], "uy", z=-0.01)
    square = (2.0 * np.pi * 60.0) ** 2
    full = np.linalg.solve((stiffness - square * beam.mass).toarray(), load)
    dynamic = reduced.stiffness - square * reduced.mass
    found = reduced.transformation @ np.linalg.solve(dynamic, reduce_vector(reduced, load))
    assert load @ found == pytest.approx(load @ full, rel=2e-3)
    still = load @ np.linalg.solve(stiffness.toarray(), load)
    assert abs(load @ full - still) > 0.05 * still  # inertia matters at this frequency
