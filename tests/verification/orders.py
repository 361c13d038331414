r"""Orders of the whole chain in element length and in step, on the panel of benchmark SB1.

Element. Lateral frequencies of the mechanism that `build_mechanism` makes of the panel, against the
Timoshenko beam on point springs (drives, fastenings): between springs the transfer matrix of the
exact equations, at a spring a jump of shear and moment; a frequency is a zero of the determinant
of free ends. The elements hold shear constant along their length: order 2. With the shear factor
of the rail the share of second order is below that of fourth down to elements of 50 mm, and the
error then 1e-7; so the order is measured with a shear factor of 0.02, the error with that of the
rail. The superelements keep modes up to 50 kHz, so that the reduction is out of the way.

Step. Throw without friction, which leaves a linear system with a smooth marker; the force of a
drive on the way, against an explicit Runge-Kutta solution of the same modal equations with rtol
1e-11. The generalised-alpha scheme has order 2 whatever its spectral radius.

Tolerance: the order 2 +- 0.1 in the asymptotic range.
"""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from tests.verification.agreement import Check
from tests.verification.beams_by_hand import AREA, I_LATERAL, RHO, E, Floats, G

from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.markers import marker_positions
from turnout.solver.condense import condense
from turnout.solver.integration import integrate

ELEMENT_LENGTHS = (0.3, 0.15, 0.075)
MODES = 4
RADII = (0.5, 0.9)
STEPS = (1e-3, 5e-4, 2.5e-4)
INSTANT = 2.4
SHEAR, SOFT_IN_SHEAR = 0.6, 0.02
CUTOFF = 100.0


def springs() -> list[tuple[float, float, float]]:
    """Return place [m], lateral [N/m] and yaw stiffness [N m/rad] of what holds the rail of SB1."""
    drives = [(0.3, 750e3, 0.0), (6.9, 810e3, 0.0)]
    return drives + [(9.7 + 0.6 * i, 5e7, 1e5) for i in range(8)]


def determinant(omega: float, shear_factor: float) -> float:
    """Return what vanishes at a lateral frequency of the free rail on its springs."""
    shear, bending = shear_factor * G * AREA, E * I_LATERAL
    inertia, line_mass = RHO * I_LATERAL * omega**2, RHO * AREA * omega**2
    # states: deflection w, slope, moment / EI, shear / EI
    field = np.array(
        [
            [0.0, 1.0, 0.0, bending / shear],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, -inertia / bending, 0.0, -1.0],
            [-line_mass / bending, 0.0, 0.0, 0.0],
        ]
    )
    rates, shapes = np.linalg.eig(field)
    inverse = np.linalg.inv(shapes)

    def carried(states: Floats, length: float) -> Floats:
        """Carry states along a piece without springs."""
        return np.real((shapes * np.exp(rates * length)) @ (inverse @ states))

    # the two motions that leave the toe free, carried to the heel
    states, at = np.eye(4)[:, :2], 0.0
    for x, lateral, yaw in springs():
        states = carried(states, x - at)
        jump = np.eye(4)
        jump[3, 0], jump[2, 1] = lateral / bending, yaw / bending
        states, at = jump @ states, x
        basis, triangle = np.linalg.qr(states)
        states = basis * np.sign(triangle.diagonal())  # the same motions, distinguished
    states = carried(states, 14.0 - at)
    return float(np.linalg.det(states[2:]))


@cache
def exact_frequencies(shear_factor: float) -> Floats:
    """Return the lowest lateral frequencies of the beam on springs [Hz]."""
    grid = np.linspace(0.2, 60.0, 400)

    def residual(frequency: float) -> float:
        return determinant(2 * np.pi * frequency, shear_factor)

    values = np.array([residual(f) for f in grid])
    lefts = np.flatnonzero(values[:-1] * values[1:] < 0)[:MODES]
    return np.array([brentq(residual, *grid[left : left + 2], xtol=1e-12) for left in lefts])


@cache
def frequency_errors(element_length: float, shear_factor: float = SOFT_IN_SHEAR) -> Floats:
    """Return relative errors of the lowest lateral frequencies of the panel."""
    panel = load_panel("sb1").with_overrides(
        {
            "discretisation.element_length": element_length,
            "discretisation.superelement_cutoff": 5e4,
            "section.prismatic.shear_factor_lateral": shear_factor,
        }
    )
    found = condense(build_mechanism(panel), cutoff_frequency=200.0).frequencies
    exact = exact_frequencies(shear_factor)
    nearest = np.argmin(np.abs(found[:, None] - exact), axis=0)
    return found[nearest] / exact - 1


def element_rates() -> Floats:
    """Return observed orders in the element length, (2, modes)."""
    errors = np.array([frequency_errors(length) for length in ELEMENT_LENGTHS])
    return np.log2(errors[:-1] / errors[1:])


@cache
def smooth_throw() -> tuple[LoadedPanel, Mechanism]:
    """Return panel and mechanism of a throw in which no law changes its segment."""
    panel = load_panel("sb1").with_overrides(
        {"chair.friction_coefficient": 0.0, "stop.clearance": 1.0}
    )
    return panel, build_mechanism(panel)


@cache
def exact_force() -> float:
    """Return the force of Drive 2 on the way from the modal equations by Runge-Kutta [N]."""
    panel, mechanism = smooth_throw()
    model = condense(mechanism, cutoff_frequency=CUTOFF)
    laws = [mechanism.index.drive[name] for name in panel.drive]
    rows = mechanism.laws.row[laws]
    stiffness = np.array([drive.stiffness for drive in panel.drive.values()])
    # the drives' springs are in the linear system; their markers add k u along the rows
    modes, n = model.row_modes[rows], model.eigenvalues.size

    def motion(t: float, y: Floats) -> Floats:
        push = stiffness * marker_positions(panel, t)[:, 0]
        q, v = y[:n], y[n:]
        pull = modes.T @ push + model.load - model.damping @ v - model.eigenvalues * q
        return np.concatenate((v, pull))

    start = np.concatenate((model.load / model.eigenvalues, np.zeros(n)))
    y = start
    for span in ((0.0, 1.0), (1.0, INSTANT)):
        y = solve_ivp(motion, span, y, rtol=1e-11, atol=1e-14, method="DOP853").y[:, -1]
    marker = marker_positions(panel, INSTANT)[:, 0]
    push = np.zeros(model.row_load.size)
    push[rows] = stiffness * marker
    g = model.row_modes @ y[:n] + model.flexibility @ push + model.row_load
    return float(stiffness[1] * (marker[1] - g[rows[1]]))


@cache
def force_error(step: float, spectral_radius: float) -> float:
    """Return the error of Drive 2's force on the way through the throw [N]."""
    panel, mechanism = smooth_throw()
    scheme = Scheme(
        step=step, output_interval=step, cutoff_frequency=CUTOFF, spectral_radius=spectral_radius
    )
    history = integrate(mechanism, scheme, inputs=lambda t: marker_positions(panel, t), end=INSTANT)
    law = mechanism.index.drive["2"]
    return float(-history.law_force[-1, law] - exact_force())


def step_rates(spectral_radius: float) -> Floats:
    """Return observed orders in the step."""
    errors = np.abs([force_error(step, spectral_radius) for step in STEPS])
    return np.log2(errors[:-1] / errors[1:])


def checks() -> list[Check]:
    """Return what the page shows."""
    error = np.abs(frequency_errors(ELEMENT_LENGTHS[1], SHEAR)).max()
    found = [Check("frequencies with 150 mm elements, largest error", 100 * error, 0, 0.001, "%")]
    for mode, rate in enumerate(element_rates()[-1], 1):
        what = f"order in the element length, lateral frequency {mode}"
        found.append(Check(what, float(rate), 1.9, 2.1, ""))
    for radius in RADII:
        what = f"order in the step, drive force, spectral radius {radius:g}"
        found.append(Check(what, float(step_rates(radius)[-1]), 1.9, 2.1, ""))
    return found
