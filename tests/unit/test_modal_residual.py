"""Splitting a linear system at a frequency loses nothing of its static answer."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from turnout.beam.assembly import assemble_beam
from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties
from turnout.core.errors import MechanicsError
from turnout.solver.modal import LinearSystem, ModalModel, diagonalise_damping, split_modes

N_DOF, N_ROWS = 14, 9


def random_system(seed: int = 3) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, N_DOF, N_DOF))
    return {
        "stiffness": 1e6 * (a @ a.T + 0.1 * np.eye(N_DOF)),
        "mass": 10.0 * (b @ b.T + np.eye(N_DOF)),
        "damping": 5.0 * c @ c.T,
        "rows": rng.normal(size=(N_ROWS, N_DOF)),
        "load": 1e3 * rng.normal(size=N_DOF),
    }


def split(system: dict[str, np.ndarray], cutoff_frequency: float) -> ModalModel:
    return split_modes(LinearSystem(**system), cutoff_frequency)[0]


def frequencies(system: dict[str, np.ndarray]) -> np.ndarray:
    return np.sqrt(eigh(system["stiffness"], system["mass"], eigvals_only=True)) / (2 * np.pi)


def cutoffs(system: dict[str, np.ndarray]) -> list[float]:
    f = frequencies(system)
    return [0.5 * (f[k] + f[k + 1]) for k in (0, 3, 8, N_DOF - 2)] + [2 * f[-1]]


def test_statics_are_exact_for_any_cutoff() -> None:
    system = random_system()
    forces = np.random.default_rng(4).normal(size=N_ROWS) * 1e3
    exact = np.linalg.solve(system["stiffness"], system["load"] + system["rows"].T @ forces)
    for cutoff in cutoffs(system):
        model = split(system, cutoff)
        q = (model.load + model.row_modes.T @ forces) / model.eigenvalues
        u = model.modes @ q + model.residual_shapes @ forces + model.residual_load
        np.testing.assert_allclose(u, exact, rtol=0, atol=1e-10 * np.abs(exact).max())
        g = model.row_modes @ q + model.flexibility @ forces + model.row_load
        np.testing.assert_allclose(
            g, system["rows"] @ exact, rtol=0, atol=1e-10 * np.abs(exact).max()
        )


def test_the_cutoff_counts_modes() -> None:
    system = random_system()
    f = frequencies(system)
    for k, cutoff in zip((0, 3, 8, N_DOF - 2, N_DOF - 1), cutoffs(system), strict=True):
        model = split(system, cutoff)
        np.testing.assert_allclose(model.frequencies, f[: k + 1], rtol=1e-9)
    assert split(system, 1e-6 * f[0]).eigenvalues.size == 1  # one mode stays in any case


def test_all_modes_leave_no_residual() -> None:
    model = split(random_system(), 1e9)
    assert model.eigenvalues.size == N_DOF
    assert np.all(model.flexibility == 0.0)
    assert np.all(model.residual_load == 0.0)
    assert np.all(model.row_load == 0.0)


def test_residual_flexibility_is_symmetric_and_never_negative() -> None:
    system = random_system()
    for cutoff in cutoffs(system)[:-1]:
        flexibility = split(system, cutoff).flexibility
        np.testing.assert_allclose(flexibility, flexibility.T, rtol=0, atol=1e-18)
        assert np.linalg.eigvalsh(flexibility)[0] > -1e-14 * np.abs(flexibility).max()


def test_modes_are_mass_normalised_and_damping_keeps_its_power() -> None:
    system = random_system()
    model = split(system, cutoffs(system)[2])
    np.testing.assert_allclose(
        model.modes.T @ system["mass"] @ model.modes,
        np.eye(model.eigenvalues.size),
        rtol=0,
        atol=1e-11,
    )
    v = np.random.default_rng(6).normal(size=model.eigenvalues.size)
    u = model.modes @ v
    assert v @ model.damping @ v == pytest.approx(u @ system["damping"] @ u, rel=1e-11)
    np.testing.assert_allclose(model.row_modes, system["rows"] @ model.modes, rtol=1e-13)


def test_shapes_damped_apart_span_the_same_modes() -> None:
    system = random_system()
    model = split(system, cutoffs(system)[2])
    apart = diagonalise_damping(model)
    assert np.count_nonzero(apart.damping - np.diag(np.diagonal(apart.damping))) == 0
    assert np.count_nonzero(model.damping - np.diag(np.diagonal(model.damping))) > 0
    turn = model.modes.T @ system["mass"] @ apart.modes
    n = model.eigenvalues.size
    np.testing.assert_allclose(turn.T @ turn, np.eye(n), rtol=0, atol=1e-11)
    np.testing.assert_allclose(apart.modes, model.modes @ turn, rtol=0, atol=1e-12)
    np.testing.assert_allclose(apart.row_modes, system["rows"] @ apart.modes, rtol=0, atol=1e-12)
    scale = model.eigenvalues[-1]
    whole = apart.modes.T @ system["stiffness"] @ apart.modes
    np.testing.assert_allclose(apart.stiffness, whole, rtol=0, atol=1e-11 * scale)
    whole = apart.modes.T @ system["damping"] @ apart.modes
    np.testing.assert_allclose(apart.damping, whole, rtol=0, atol=1e-12 * np.abs(whole).max())
    np.testing.assert_allclose(apart.load, apart.modes.T @ system["load"], rtol=1e-9)
    assert diagonalise_damping(apart).modes is apart.modes  # nothing is left to be done
    np.testing.assert_allclose(apart.eigenvalues, model.eigenvalues, rtol=1e-9, atol=1e-12 * scale)
    assert apart.eigenvalues is apart.eigenvalues  # each throw asks for them


@pytest.mark.parametrize("dampers", [0, 1])
def test_shapes_without_damping_span_the_same_modes(dampers: int) -> None:
    system = random_system()
    direction = np.ones((N_DOF, dampers))
    system["damping"] = 3e3 * direction @ direction.T
    model = split(system, cutoffs(system)[2])
    apart = diagonalise_damping(model)
    assert np.count_nonzero(np.diagonal(apart.damping) > 1e-9 * np.trace(model.damping)) == dampers
    assert np.trace(apart.damping) == pytest.approx(np.trace(model.damping), rel=1e-12)
    flexible = apart.row_modes @ np.linalg.solve(apart.stiffness, apart.row_modes.T)
    expected = (model.row_modes / model.eigenvalues) @ model.row_modes.T
    np.testing.assert_allclose(flexible, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("full", [True, False], ids=["full", "diagonal"])
def test_damping_that_makes_energy_is_refused(full: bool) -> None:
    system = random_system()
    model = split(system, cutoffs(system)[2])
    signs = np.ones(model.eigenvalues.size)
    signs[1] = -1.0
    damping = model.damping - 2.0 * np.max(model.damping) * np.eye(signs.size)
    wrong = replace(model, damping=damping if full else np.diag(signs))
    with pytest.raises(MechanicsError, match="not positive semidefinite.*check its sign"):
        diagonalise_damping(wrong)


def bar(supported: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    steel = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
    n = 8
    values = {
        "area": 7.7e-3, "second_moment_vertical": 3e-5, "second_moment_lateral": 5e-6,
        "torsion_constant": 2e-6, "shear_factor_vertical": 0.4, "shear_factor_lateral": 0.6,
        "product_moment": 0, "centroid_y": 0, "centroid_z": 0, "shear_centre_y": 0,
        "shear_centre_z": 0,
    }  # fmt: skip
    section = SectionProperties(**{name: value * np.ones(n) for name, value in values.items()})
    beam = assemble_beam(np.linspace(0, 4.0, n + 1), section, steel)
    stiffness = beam.stiffness.toarray()
    for dof in supported:
        stiffness[dof, dof] += 1e8
    return stiffness, beam.mass.toarray()


# one motion is left free: all of it, axial, lateral yaw about one pin, roll
FLOATING = {
    "free": (),
    "slides along x": (1, 2, 3, 49, 50),
    "moves sideways": (0, 2, 3, 50),
    "turns about a pin": (0, 1, 2, 3, 50),
    "rolls": (0, 1, 2, 49, 50),
}


def free_chain(size: int) -> tuple[np.ndarray, np.ndarray]:
    stiffness = 2.0 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1)
    stiffness[0, 0] = stiffness[-1, -1] = 1.0
    return 1e7 * stiffness, 7.0 * np.eye(size)


def undamped(stiffness: np.ndarray, mass: np.ndarray) -> ModalModel:
    n = stiffness.shape[0]
    beside = np.zeros((n, n)), np.zeros(n), np.eye(n)[:1]
    return split_modes(LinearSystem(stiffness, mass, *beside), 300.0)[0]


@pytest.mark.parametrize(
    "system",
    [
        *(pytest.param(bar(held), id=case) for case, held in FLOATING.items()),
        *(pytest.param(free_chain(n), id=f"chain {n}") for n in (2, 3, 5, 8, 13, 21, 34, 55)),
    ],
)
def test_a_floating_body_is_refused(system: tuple[np.ndarray, np.ndarray]) -> None:
    with pytest.raises(MechanicsError, match="a rail is not held"):
        undamped(*system)


def test_a_softly_held_rail_is_accepted() -> None:
    stiffness, mass = bar((0, 1, 2, 3, 49))
    stiffness[50, 50] += 200.0  # 0.15 Hz, as separate switch rails have
    assert 0.0 < undamped(stiffness, mass).frequencies[0] < 1.0
