"""A beam on chairs, dragged, rolled and lifted, against an independent brute-force program.

Reference: tests/verification/brute_force.py (all DOFs, BDF2 at 0.05 ms, full Newton on all laws).
The case: a clamped beam on six chairs with two foot points each, thrown by a rod above its feet so
that it rolls, while an eccentric vertical load swings so that feet lift and return and the normal
force at a chair varies at least fivefold within one slide.
Tolerance, root mean square over the run in parts of the group's peak: drive force, chair normal and
friction forces, see TOLERANCE; the difference falls at least eightfold from 1 ms to 0.25 ms
(sixteen would be order 2). With normal forces frozen at their static values the brute-force program
fails the same comparison. A cut-off of 300 Hz, 11 of 78 modes, meets the tolerances of 1 ms; one of
50 Hz does not.
"""

import numpy as np
import pytest
from tests.verification.brute_force import Laws, Path, brute_force
from tests.verification.hand_made import energy_residual, hand_made, run, smooth_ramp
from tests.verification.reference import DATA

from turnout.beam.assembly import assemble_beam, point_row
from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.integration import History

CHAIRS = (0.3, 0.9, 1.5, 2.1, 2.7, 3.3)
HALF_FOOT, FOOT_DEPTH = 0.06, 0.08
MU, CONTACT, STICK = 0.25, 3e6, 2e6
STIFF, SOFT, BEND = 7.5e5, 2e4, 7.7e-3
LIFTER = 2e5
END, EVERY = 1.2, 1e-3
TOLERANCE = {
    1e-3: {"drive": 1.5e-3, "normal": 1.5e-3, "friction": 1.5e-2},
    2.5e-4: {"drive": 1.5e-4, "normal": 1.5e-4, "friction": 1.5e-3},
}


def beam() -> tuple[np.ndarray, ...]:
    """Return mass, stiffness, damping, load and rows of the clamped beam.

    Rows: y at the feet of each chair, then left and right foot (down is positive) of each, then
    the rod and the vertical load.
    """
    x = np.linspace(0.0, 3.9, 14)
    values = {
        "area": 7.0e-3, "second_moment_vertical": 1.2e-5, "second_moment_lateral": 4e-6,
        "product_moment": 1e-6, "torsion_constant": 2e-6, "shear_factor_vertical": 0.4,
        "shear_factor_lateral": 0.6, "centroid_y": 0.004, "centroid_z": 0.0,
        "shear_centre_y": 0.0, "shear_centre_z": -0.02,
    }  # fmt: skip
    section = SectionProperties(**{name: value * np.ones(13) for name, value in values.items()})
    steel = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
    model = assemble_beam(x, section, steel)
    side = [point_row(model, at, "uy", z=-FOOT_DEPTH) for at in CHAIRS]
    feet = [
        -point_row(model, at, "uz", y=y, z=-FOOT_DEPTH)
        for at in CHAIRS
        for y in (HALF_FOOT, -HALF_FOOT)
    ]
    rod = point_row(model, 0.6, "uy", z=0.02)
    push = point_row(model, 1.5, "uz", y=0.03)
    free = slice(0, -6)  # clamped at the far end
    rows = np.array([*side, *feet, rod, push])[:, free]
    mass = model.mass.toarray()[free, free]
    stiffness = model.stiffness.toarray()[free, free]
    dashpots = rows[6:18]
    damping = 4.0 * mass + 5e3 * dashpots.T @ dashpots + 2e-5 * stiffness
    return mass, stiffness, damping, model.gravity_load[free], rows


def markers(time: np.ndarray) -> np.ndarray:
    """Throw by 50 mm and back by 35 mm; swing the vertical load all the while."""
    rod = 0.05 * smooth_ramp(time, start=0.0, end=0.6)
    rod -= 0.035 * smooth_ramp(time, start=0.65, end=1.15)
    swing = 0.012 * np.sin(2 * np.pi * 5.3 * time) * smooth_ramp(time, start=0.0, end=0.2)
    return np.array([rod, swing])


def as_mechanism() -> Mechanism:
    mass, stiffness, damping, load, rows = beam()
    laws = LawTableBuilder()
    laws.add_piecewise(
        18,
        breakpoints=np.array([-BEND, BEND]),
        slopes=np.array([SOFT, STIFF, SOFT]),
        input_index=0,
        base_segment=1,
    )
    laws.add_piecewise(
        19, breakpoints=np.zeros(0), slopes=np.array([LIFTER]), input_index=1, base_segment=0
    )
    for foot in range(12):
        normal = laws.add_contact(6 + foot, stiffness=CONTACT, clearance=0.0, base_closed=True)
        laws.add_friction(foot // 2, normal=normal, friction_coefficient=MU, stick_stiffness=STICK)
    return hand_made(laws, mass=mass, stiffness=stiffness, damping=damping, load=load, rows=rows)


def ours(**options: float) -> History:
    rod, swing = (lambda t: markers(t)[0]), (lambda t: markers(t)[1])
    return run(as_mechanism(), rod, swing, end=END, **options)


def reference(step: float = 5e-5, frozen: np.ndarray | None = None) -> Path:
    mass, stiffness, damping, load, rows = beam()
    laws = Laws(
        bushing_row=[18, 19],
        bushing_marker=[0, 1],
        bushing_stiff=np.array([STIFF, LIFTER]),
        bushing_soft=np.array([SOFT, LIFTER]),
        bushing_bend=np.array([BEND, 1.0]),
        contact_row=list(range(6, 18)),
        contact_stiffness=np.full(12, CONTACT),
        foot_row=[foot // 2 for foot in range(12)],
        foot_contact=list(range(12)),
        foot_coefficient=np.full(12, MU),
        foot_stiffness=np.full(12, STICK),
    )
    return brute_force(
        mass, stiffness, damping, load, rows, laws,
        markers=markers, step=step, end=END, every=round(EVERY / step), frozen=frozen,
    )  # fmt: skip


def channels(result: History | Path) -> dict[str, np.ndarray]:
    if isinstance(result, Path):
        return {
            "drive": result.bushing[:, :1],
            "normal": result.contact,
            "friction": result.friction,
        }
    return {
        "drive": -result.law_force[:, :1],
        "normal": result.law_force[:, 2:],
        "friction": result.friction_force,
    }


def difference(result: History | Path, truth: Path) -> dict[str, float]:
    """Return the worst channel's root mean square difference in parts of its group's peak."""
    got, want = channels(result), channels(truth)
    return {
        name: float(
            np.sqrt(np.mean((got[name] - want[name]) ** 2, axis=0)).max() / np.abs(want[name]).max()
        )
        for name in want
    }


STORED = DATA / "brute_force.npz"
"""The run of `reference()`, in single precision."""
KEPT = ("time", "g", "bushing", "contact", "friction")


@pytest.fixture(scope="module")
def truth() -> Path:
    with np.load(STORED) as file:
        kept = {name: file[name].astype(np.float64) for name in KEPT}
    return Path(**kept, newton_iterations=0)


@pytest.mark.long
def test_the_stored_run_is_that_of_the_program(truth: Path) -> None:
    """It is made anew by `python -m tests.verification.test_brute_force_agreement`."""
    made = reference()
    for name in KEPT:
        values = getattr(made, name)
        limit = 1e-6 * np.abs(values).max()
        np.testing.assert_allclose(getattr(truth, name), values, rtol=0, atol=limit, err_msg=name)


@pytest.fixture(scope="module")
def runs() -> dict[float, History]:
    return {step: ours(step=step, every=round(EVERY / step)) for step in TOLERANCE}


def test_the_case_is_hard(truth: Path) -> None:
    """Loads vary more than fivefold within one slide; feet lift and return; it rolls."""
    chairs = truth.contact.reshape(-1, 6, 2).sum(axis=2)
    speed = np.gradient(truth.g[:, :6], EVERY, axis=0)
    ratios = []
    for chair in range(6):
        sliding = (speed[:, chair] > 0.01) & (chairs[:, chair] > 0)
        sliding &= truth.time < 0.62  # one throw, one way
        if sliding.any():
            loads = chairs[sliding, chair]
            ratios.append(loads.max() / loads.min())
    assert sum(ratio > 5 for ratio in ratios) >= 3
    open_feet = truth.contact == 0.0
    returns = np.sum(np.diff(open_feet.astype(int), axis=0) == -1, axis=0)
    assert np.sum(returns >= 3) >= 8
    assert np.sum(open_feet.reshape(-1, 6, 2).sum(axis=2) == 1) > 200  # it rolls on one edge


@pytest.mark.long
def test_the_brute_force_program_has_converged(truth: Path) -> None:
    coarse = difference(reference(step=1e-4), truth)
    for name, value in coarse.items():
        assert value < 0.3 * TOLERANCE[2.5e-4][name], coarse


@pytest.mark.parametrize("step", sorted(TOLERANCE))
def test_it_agrees_with_brute_force(truth: Path, runs: dict[float, History], step: float) -> None:
    found = difference(runs[step], truth)
    for name, value in found.items():
        assert value < TOLERANCE[step][name], found
    assert energy_residual(runs[step]) < 1e-6


def test_it_converges_to_brute_force(truth: Path, runs: dict[float, History]) -> None:
    coarse, fine = (difference(runs[step], truth) for step in (1e-3, 2.5e-4))
    for name in coarse:
        assert fine[name] < coarse[name] / 8, (coarse, fine)


@pytest.mark.parametrize(("cutoff_frequency", "agrees"), [(300.0, True), (50.0, False)])
def test_the_cutoff_that_agrees(truth: Path, cutoff_frequency: float, agrees: bool) -> None:
    history = ours(cutoff_frequency=cutoff_frequency)
    assert history.q.shape[1] < 0.2 * history.model.modes.shape[0]
    found = difference(history, truth)
    for name, value in found.items():
        assert (value < TOLERANCE[1e-3][name]) == agrees, found
    assert energy_residual(history) < 1e-6


def test_constant_normal_forces_fail_the_comparison(truth: Path) -> None:
    constant = difference(reference(step=2e-4, frozen=truth.contact[0]), truth)
    assert constant["friction"] > 10 * TOLERANCE[1e-3]["friction"]
    assert constant["drive"] > 10 * TOLERANCE[1e-3]["drive"]


if __name__ == "__main__":
    made = reference()
    np.savez_compressed(STORED, **{name: getattr(made, name).astype("f4") for name in KEPT})
