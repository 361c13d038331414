"""The static equilibrium at the start, of mechanisms whose energy has one lowest point.

Without friction every law here stiffens or softens but never pulls back, so the energy is convex
and the equilibrium unique. Reference: for one degree of freedom the root of the force by brentq,
else a damped Newton descent of the energy on all degrees of freedom, written here. Tolerance 1e-9
of the largest displacement.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.verification.hand_made import ALL_MODES, hand_made, linear_spring

from turnout.core.errors import MechanicsError
from turnout.core.scheme import Scheme
from turnout.law.table import LawTable, LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.integration import History, integrate
from turnout.solver.start import equilibrium_segments

SOFT, BEND = 1e3, 0.01


def start(mechanism: Mechanism, *, cutoff_frequency: float = ALL_MODES) -> History:
    return integrate(
        mechanism,
        Scheme(cutoff_frequency=cutoff_frequency),
        inputs=lambda t: np.zeros((0, t.size)),
        end=1e-3,
    )


def law_line(table: LawTable, law: int, g: float) -> tuple[float, float]:
    """Return force and slope of a law at row `g`."""
    e = g - table.offset[law]
    first, last = table.segment_start[law], table.segment_start[law + 1]
    at = first + np.searchsorted(table.segment_upper[first : last - 1], e)
    return table.slope[at] * e + table.intercept[at], table.slope[at]


def descend(mechanism: Mechanism) -> np.ndarray:
    """Find the lowest energy by Newton steps that are halved until the force falls."""
    table, rows = mechanism.laws, mechanism.rows
    u = np.zeros(rows.shape[1])

    def unbalanced(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        g, force, tangent = rows @ u, np.zeros(rows.shape[0]), np.zeros(rows.shape[0])
        for law, row in enumerate(table.row):
            f, k = law_line(table, law, g[row])
            force[row] += f
            tangent[row] += k
        residual = mechanism.stiffness @ u + rows.T @ force - mechanism.load
        return residual, mechanism.stiffness + (rows.T * tangent) @ rows

    for _ in range(500):
        residual, tangent = unbalanced(u)
        if np.abs(residual).max() < 1e-9:
            return u
        direction = -np.linalg.solve(tangent, residual)
        share = 1.0
        # along a descent of a convex energy the slope at the new point may not turn round much
        while direction @ unbalanced(u + share * direction)[0] > -0.5 * direction @ residual:
            share *= 0.5
        u = u + share * direction
    message = "the reference found no equilibrium"
    raise RuntimeError(message)


def rail_like(seed: int, *, n_rows: int) -> Mechanism:
    """Return springs with contacts, half of which the linear system takes as closed."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(6, 6))
    laws = LawTableBuilder()
    for row in range(n_rows):
        laws.add_contact(
            row,
            stiffness=10 ** rng.uniform(4, 6.5),
            clearance=0.01 * rng.normal(),
            base_closed=row % 2 == 0,
        )
    return hand_made(
        laws,
        mass=np.eye(6),
        rows=rng.normal(size=(n_rows, 6)),
        stiffness=1e4 * (a @ a.T / 6 + 0.3 * np.eye(6)),
        load=100 * rng.normal(size=6),
    )


@pytest.mark.parametrize("seed", range(12))
def test_contacts_settle_at_the_lowest_energy(seed: int) -> None:
    mechanism = rail_like(seed, n_rows=4 + seed)
    expected = mechanism.rows @ descend(mechanism)
    for cutoff_frequency in (ALL_MODES, 20.0):
        history = start(mechanism, cutoff_frequency=cutoff_frequency)
        assert history.outcome.complete, history.outcome.message()
        np.testing.assert_allclose(
            history.g[0], expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )


# support, bushing and stop stiffness [N/m], clearance of the stop [m], load [N]
ONE_MASS = {
    "bushing holds": (1.7e3, 2.88e5, 4.27e5, 0.044, 1900.0),
    "stop holds": (300.0, 2.0e4, 4e6, 0.02, 4000.0),
    "pulled off a far stop": (1.7e3, 2.88e5, 4.27e5, 0.044, -1900.0),
    "pulled beyond the bend": (300.0, 8.82e5, 4.675e6, 0.032, -9000.0),
    "softened, stop open": (6.5e3, 4.07e5, 9.3e4, 0.041, 1400.0),
}


@pytest.mark.parametrize("base_closed", [False, True])
@pytest.mark.parametrize("case", ONE_MASS)
def test_a_bushing_and_a_stop_find_their_equilibrium(case: str, base_closed: bool) -> None:
    support, bushing, stop, clearance, load = ONE_MASS[case]
    laws = LawTableBuilder()
    laws.add_piecewise(
        0,
        breakpoints=np.array([-BEND, BEND]),
        slopes=np.array([SOFT, bushing, SOFT]),
        base_segment=1,
    )
    laws.add_contact(0, stiffness=stop, clearance=clearance, base_closed=base_closed)
    mechanism = hand_made(laws, mass=[1.0], stiffness=np.array([[support]]), load=[load])

    def unbalanced(x: float) -> float:
        return load - support * x - sum(law_line(mechanism.laws, law, x)[0] for law in (0, 1))

    history = start(mechanism)
    assert history.outcome.complete, history.outcome.message()
    expected = brentq(unbalanced, -20.0, 20.0, xtol=1e-15, rtol=1e-14)
    assert history.g[0, 0] == pytest.approx(expected, rel=1e-9)


def test_a_normal_law_in_tension_gives_no_friction() -> None:
    """Friction on a spring that pulls its foot off is refused, or there is none."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e5, input_index=0)
    normal = linear_spring(laws, 1, 1e6)
    laws.add_friction(0, normal=normal, friction_coefficient=0.3, stick_stiffness=1e6)
    mechanism = hand_made(
        laws, mass=[1.0, 1.0], damping=np.diag([300.0, 300.0]), load=[0.0, -1000.0]
    )
    try:
        history = integrate(
            mechanism,
            Scheme(cutoff_frequency=ALL_MODES),
            inputs=lambda t: 0.01 * t[None, :],
            end=0.5,
        )
    except MechanicsError:
        return
    assert np.all(history.law_force[:, 1] < 0.0)
    np.testing.assert_allclose(history.friction_force, 0.0, atol=1e-9)
    assert -history.law_force[-1, 0] == pytest.approx(300.0 * 0.01, rel=1e-2)  # the dashpot's


def test_a_start_without_equilibrium_is_an_outcome_with_nothing_kept() -> None:
    """A load that no finite number can carry is reported, and no instant is stored."""
    laws = LawTableBuilder()
    laws.add_contact(0, stiffness=1e6, clearance=0.0, base_closed=True)
    mechanism = hand_made(laws, mass=[1.0], load=[np.inf])
    history = start(mechanism)
    assert not history.outcome.complete
    assert history.outcome.code.name == "NO_EQUILIBRIUM"
    assert history.time.size == history.g.shape[0] == 0
    assert "no static equilibrium" in history.outcome.message()


def test_the_search_of_segments_ends_where_they_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step within the segments ends at the minimum, though rounding goes on beside it."""
    mechanism, solved, lstsq = rail_like(0, n_rows=12), [], np.linalg.lstsq
    monkeypatch.setattr(
        "turnout.solver.start.np.linalg.lstsq",
        lambda *given: (solved.append(1), lstsq(*given))[1],
    )
    held = np.zeros_like(mechanism.stiffness)
    held[::3, ::3] = 1e12 * np.eye(len(held[::3]))
    stiff = replace(mechanism.matrices, stiffness=mechanism.stiffness + held)
    mechanism = replace(mechanism, matrices=stiff)
    acting = np.ones(mechanism.laws.row.size, dtype=np.int64)
    equilibrium_segments(mechanism, inputs=np.zeros(0), present=acting)
    assert len(solved) <= 5
