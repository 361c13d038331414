"""The equations of docs/theory, written out by hand as they stand there, against the code.

Tolerances are rounding: the pages and the code must say the same, not nearly the same. Nothing of
the code's own formulas is used here. A block is dragged, lifted off its chair and set down, by two
springs with markers: it sticks, slips both ways and hangs free.
"""

import itertools
from dataclasses import dataclass, fields

import numpy as np
import pytest
from tests.verification.hand_made import LEDGER, STORED, hand_made, linear_spring, run

from turnout.beam.element import element_matrices
from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties
from turnout.calibration.comparison import Noise
from turnout.law.table import LawTableBuilder
from turnout.mechanism.object_rows import offnode_row
from turnout.solver.integration import History

ROUNDING = 1e-12
STEEL = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
SPAN, WEIGHT = 0.3, 9.81
SKEW = dict(
    zip(
        [field.name for field in fields(SectionProperties)],
        [7.7e-3, 3.0e-5, 5.0e-6, -1.6e-6, 2.2e-6, 0.39, 0.55, 0.012, 0.08, 0.005, 0.046],
        strict=True,
    )
)


@dataclass
class Element:
    """docs/theory/beams.md for one element and its nodal displacements."""

    nodes: np.ndarray

    def __post_init__(self) -> None:
        s = SKEW
        lateral, vertical = s["second_moment_lateral"], s["second_moment_vertical"]
        self.I = np.array([[lateral, s["product_moment"]], [s["product_moment"], vertical]])
        self.EI = STEEL.youngs_modulus * self.I
        factors = [s["shear_factor_lateral"], s["shear_factor_vertical"]]
        self.G = STEEL.youngs_modulus / (2.0 * (1.0 + STEEL.poisson_ratio))
        self.GA = self.G * s["area"] * np.diag(factors)
        self.ends = [self.section(self.nodes[:6]), self.section(self.nodes[6:])]
        (_, d1, p1, _), (_, d2, p2, _) = self.ends
        F = SPAN**3 / 12.0 * np.linalg.inv(self.EI) + SPAN * np.linalg.inv(self.GA)
        self.s = d2 - d1 - SPAN / 2.0 * (p1 + p2)
        self.Q = np.linalg.solve(F, self.s)

    @staticmethod
    def section(u: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, float]:
        ux, uy, uz, rx, ry, rz = u
        axial = ux + ry * SKEW["centroid_z"] - rz * SKEW["centroid_y"]
        d = np.array([uy - rx * SKEW["shear_centre_z"], uz + rx * SKEW["shear_centre_y"]])
        return axial, d, np.array([rz, -ry]), rx

    def twice_strain_energy(self) -> float:
        (u1, _, p1, r1), (u2, _, p2, r2) = self.ends
        axial = STEEL.youngs_modulus * SKEW["area"] / SPAN * (u2 - u1) ** 2
        torsion = self.G * SKEW["torsion_constant"] / SPAN * (r2 - r1) ** 2
        return float(axial + torsion + (p2 - p1) @ self.EI @ (p2 - p1) / SPAN + self.s @ self.Q)

    def at(self, xi: float) -> tuple[float, np.ndarray, np.ndarray, float]:
        """Return u_C, d_C, psi and r_x."""
        (u1, d1, p1, r1), (u2, d2, p2, r2) = self.ends
        b = np.linalg.solve(self.EI, self.Q)
        middle = 0.5 * (p1 + p2) + SPAN**2 / 8.0 * b
        psi = middle + xi / SPAN * (p2 - p1) - xi**2 / 2.0 * b
        d = 0.5 * (d1 + d2) + xi * middle + 0.5 * (xi**2 / SPAN - SPAN / 4.0) * (p2 - p1)
        d = d - xi**3 / 6.0 * b + xi * np.linalg.solve(self.GA, self.Q)
        right = xi / SPAN + 0.5
        rx = (1.0 - right) * r1 + right * r2
        arm_y = SKEW["centroid_y"] - SKEW["shear_centre_y"]
        arm_z = SKEW["centroid_z"] - SKEW["shear_centre_z"]
        return (1.0 - right) * u1 + right * u2, d + rx * np.array([-arm_z, arm_y]), psi, rx

    def integrals(self) -> tuple[float, float]:
        """Return the form of the mass, and the work of the weight."""
        mass = work = 0.0
        for point, weight in zip(*np.polynomial.legendre.leggauss(7), strict=True):
            axial, d, psi, rx = self.at(0.5 * SPAN * point)
            form = SKEW["area"] * (axial**2 + d @ d) + psi @ self.I @ psi
            form += np.trace(self.I) * rx**2
            mass += 0.5 * SPAN * weight * STEEL.density * form
            work -= 0.5 * SPAN * weight * STEEL.density * WEIGHT * SKEW["area"] * d[1]
        return mass, work


def test_the_beam_is_that_of_its_page() -> None:
    sections = SectionProperties(**{name: np.array([value]) for name, value in SKEW.items()})
    formed = element_matrices([SPAN], sections, STEEL, gravity=WEIGHT)
    stiffness, mass, load = (of_all[0] for of_all in formed)
    for u in np.random.default_rng(1).standard_normal((5, 12)):
        by_hand = Element(u)
        kinetic, work = by_hand.integrals()
        assert by_hand.twice_strain_energy() == pytest.approx(u @ stiffness @ u, rel=ROUNDING)
        assert kinetic == pytest.approx(u @ mass @ u, rel=ROUNDING)
        assert work == pytest.approx(load @ u, rel=ROUNDING)


def test_a_law_is_that_of_its_page() -> None:
    breaks, k = np.array([-0.02, 0.01, 0.03]), np.array([5.0, 40.0, 7.0, 90.0])
    laws = LawTableBuilder()
    laws.add_piecewise(0, breakpoints=breaks, slopes=k)
    table = laws.table()
    f, w = np.zeros(4), np.zeros(4)  # segment 1 holds e = 0
    for s, other, e in ((2, 1, breaks[1]), (3, 2, breaks[2]), (0, 1, breaks[0])):
        f[s] = f[other] + (k[other] - k[s]) * e
        w[s] = w[other] + 0.5 * (k[other] - k[s]) * e**2 + (f[other] - f[s]) * e
    assert table.intercept == pytest.approx(f, rel=ROUNDING, abs=1e-15)
    assert table.potential == pytest.approx(w, rel=ROUNDING, abs=1e-15)


def test_an_object_between_nodes_moves_as_on_its_page() -> None:
    length, s, z = 0.15, 0.3, 0.06
    u = np.random.default_rng(2).standard_normal(12)
    at, weights = offnode_row(np.array([2.0, 2.0 + length]), x=2.0 + s * length, z=z)
    r = 1.0 - s
    page = r**2 * (1 + 2 * s) * u[1] + length * s * r**2 * u[5]
    page += s**2 * (1 + 2 * r) * u[7] - length * s**2 * r * u[11] - z * (r * u[3] + s * u[9])
    assert weights @ u[at] == pytest.approx(page, rel=ROUNDING)


def test_noise_is_that_of_its_page() -> None:
    noise = Noise(white=3.0, slow=5.0, slow_length=0.3, missed=7.0, missed_length=0.1)
    t = 0.02 * np.arange(12)
    apart = np.abs(t[:, np.newaxis] - t)
    page = 9.0 * np.eye(12) + 25.0 * np.exp(-apart / 0.3) + 49.0 * np.exp(-apart / 0.1)
    factor = noise.factor(t)
    assert factor @ factor.T == pytest.approx(page, rel=ROUNDING)


MASS, FOOT, DRIVE, LIFT = 80.0, 2e6, 3e5, 1e5
MU, STICK = 0.3, 8e5
DAMPING = np.array([[60.0, 10.0], [10.0, 90.0]])
STEP, COUNT, RADIUS = 2e-3, 500, 0.7


def drag(time: np.ndarray) -> np.ndarray:
    """Drag there and back [m]."""
    return 0.01 * np.sin(2 * np.pi * 1.7 * time) ** 3


def lift(time: np.ndarray) -> np.ndarray:
    """Lift the block off, and set it down [m]."""
    return 0.006 * (1.0 - np.cos(2 * np.pi * 2.3 * time))


def thrown() -> History:
    """Drag the block by the code; rows are the drive, the foot on its chair and the lift."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, DRIVE, input_index=0)
    foot = laws.add_contact(1, stiffness=FOOT, clearance=0.0, base_closed=True)
    linear_spring(laws, 2, LIFT, input_index=1)
    laws.add_friction(0, normal=foot, friction_coefficient=MU, stick_stiffness=STICK)
    mechanism = hand_made(
        laws,
        mass=[MASS, MASS],
        rows=[[1.0, 0.0], [0.0, -1.0], [0.0, 1.0]],
        damping=DAMPING,
        load=[0.0, -MASS * WEIGHT],
    )
    return run(mechanism, drag, lift, end=COUNT * STEP, step=STEP, spectral_radius=RADIUS)


@dataclass
class Pages:
    """The block by friction.md, time-stepping.md and energy.md, in its own coordinates."""

    def __post_init__(self) -> None:
        radius = RADIUS
        self.alpha_m = (2 * radius - 1) / (radius + 1)
        self.alpha_f = radius / (radius + 1)
        self.gamma = 0.5 - self.alpha_m + self.alpha_f
        self.beta = 0.25 * (self.gamma + 0.5) ** 2
        self.u = np.array([0.0, -MASS * WEIGHT / (FOOT + LIFT)])
        self.v, self.acceleration, self.a = np.zeros(2), np.zeros(2), np.zeros(2)
        self.anchor, self.friction, self.normal = 0.0, 0.0, -FOOT * self.u[1]
        self.pushes = self.drives(self.u, np.zeros(2))
        self.book = dict.fromkeys(LEDGER, 0.0)
        self.states: set[str] = set()

    @staticmethod
    def drives(u: np.ndarray, markers: np.ndarray) -> np.ndarray:
        return np.array([DRIVE, LIFT]) * (u - markers)

    def candidates(self, markers: np.ndarray) -> list[tuple[str, np.ndarray]]:
        """Solve the equation at the end of the step for every contact set."""
        h, kappa = STEP, (1 - self.alpha_f) / (1 - self.alpha_m)
        known = (self.alpha_f * self.acceleration - self.alpha_m * self.a) / (1 - self.alpha_m)
        self.u_pred = self.u + h * self.v + h * h * ((0.5 - self.beta) * self.a + self.beta * known)
        self.v_pred = self.v + h * ((1 - self.gamma) * self.a + self.gamma * known)
        iota, nu = 1 / (kappa * self.beta * h * h), self.gamma / (self.beta * h)
        self.iota, self.nu = iota, nu
        A = (iota * MASS) * np.eye(2) + nu * DAMPING + np.diag([DRIVE, LIFT])
        p = iota * MASS * self.u_pred + DAMPING @ (nu * self.u_pred - self.v_pred)
        p += np.array([DRIVE * markers[0], LIFT * markers[1] - MASS * WEIGHT])
        found = []
        for closed, foot in itertools.product((True, False), ("stick", "forward", "backward")):
            matrix, side = A.copy(), p.copy()
            if closed:
                matrix[1, 1] += FOOT
            if closed and foot == "stick":
                matrix[0, 0] += STICK
                side[0] += STICK * self.anchor
            elif closed:
                matrix[0, 1] += (1.0 if foot == "forward" else -1.0) * MU * -FOOT
            found.append((foot if closed else "open", np.linalg.solve(matrix, side)))
        return found

    def step(self, old: np.ndarray, markers: np.ndarray) -> None:
        for state, u in self.candidates(markers):
            normal, trial = max(-FOOT * u[1], 0.0), STICK * (u[0] - self.anchor)
            sense = np.sign(trial)
            wanted = (
                "stick" if abs(trial) <= MU * normal else "forward" if sense > 0 else "backward"
            )
            if state == (wanted if normal > 0 else "open"):
                break
        else:
            pytest.fail("no contact set agrees with itself")
        self.states.add(state)
        force = trial if state == "stick" else sense * MU * normal
        self.account(u, normal, force, (trial - force) / STICK, old, markers)

    def account(
        self,
        u: np.ndarray,
        normal: float,
        force: float,
        slip: float,
        old: np.ndarray,
        markers: np.ndarray,
    ) -> None:
        way = u - self.u
        acceleration = self.iota * (u - self.u_pred)
        v = self.v_pred + self.nu * (u - self.u_pred)
        mean = 0.5 * (v + self.v)
        pushes = self.drives(u, markers)
        self.book["markers"] -= 0.5 * (pushes + self.pushes) @ (markers - old)
        kept = force if self.friction * slip < 0 else self.friction
        self.book["friction"] += 0.5 * (kept + force) * slip
        self.book["segments"] += 0.5 * (self.friction - kept) * slip
        self.book["damping"] += mean @ DAMPING @ way
        half = 0.5 * (acceleration + self.acceleration)
        self.book["algorithmic"] += MASS * (half @ way - mean @ (v - self.v))
        if (normal > 0) != (self.normal > 0):  # e = -u_z of the chair
            stored = 0.5 * (normal**2 - self.normal**2) / FOOT
            self.book["segments"] += 0.5 * (normal + self.normal) * -way[1] - stored
        total = (1 - self.alpha_f) * acceleration + self.alpha_f * self.acceleration
        self.a = (total - self.alpha_m * self.a) / (1 - self.alpha_m)
        self.u, self.v, self.acceleration = u, v, acceleration
        self.normal, self.friction, self.pushes = normal, force, pushes
        self.anchor += slip

    def stored(self) -> np.ndarray:
        """Return kinetic energy, and strain, contact and gravity together [J]."""
        springs = 0.5 * self.pushes**2 / np.array([DRIVE, LIFT])
        feet = 0.5 * self.normal**2 / FOOT + 0.5 * self.friction**2 / STICK
        rest = springs.sum() + feet + MASS * WEIGHT * self.u[1]
        return np.array([0.5 * MASS * self.v @ self.v, rest])


def test_a_dragged_block_moves_and_books_as_on_the_pages() -> None:
    history, pages = thrown(), Pages()
    assert (history.halved, history.time.size) == (0, COUNT + 1)
    markers = np.array([drag(history.time), lift(history.time)]).T
    start = pages.stored()
    ledger, moved, friction, stored = [], [], [], []
    for n in range(COUNT):
        pages.step(markers[n], markers[n + 1])
        ledger.append(list(pages.book.values()))
        moved.append(pages.u.copy())
        friction.append(pages.friction)
        stored.append(pages.stored() - start)
    assert pages.states == {"stick", "forward", "backward", "open"}
    g = np.array(moved)
    assert history.g[1:, [0, 2]] == pytest.approx(g, rel=1e-9, abs=1e-12)
    assert history.friction_force[1:, 0] == pytest.approx(np.array(friction), rel=1e-9, abs=1e-6)
    for column, name in enumerate(LEDGER):
        page = np.array(ledger)[:, column]
        assert history.ledger[1:, column] == pytest.approx(page, rel=1e-8, abs=1e-9), name
    change = history.stored[1:] - history.stored[0]
    kinetic = STORED.index("kinetic")
    rest = np.delete(change, kinetic, axis=1).sum(axis=1)
    page = np.array(stored)
    assert change[:, kinetic] == pytest.approx(page[:, 0], rel=1e-8, abs=1e-9)
    assert rest == pytest.approx(page[:, 1], rel=1e-8, abs=1e-9)
