r"""A rail hits an elastic stop: contact time, force, momentum, and what the step takes away.

Swinging cantilever. One mode (omega_1, tip amplitude 2 / sqrt(m)) swings through its rest position
against a stop of stiffness k at the tip; all other modes follow at rest and lie in series with the
stop: :math:`1 / k_e = 1 / k + L^3 / 3 E I - 4 / m \omega_1^2`. In contact the mode has
:math:`\omega_c^2 = \omega_1^2 + 4 k_e / m`, so that contact lasts :math:`\pi / \omega_c` whatever
the speed, and the mode swings back as far as it came. Restitution e is the root of the energy after
over that before contact. A step in which contact begins at the share s of it takes the mean of the
forces at its ends, which costs :math:`(\omega_k h)^2 s (1 - s)` of the energy, with
:math:`\omega_k^2 = 4 k_e / m`; the step in which it ends gives as much back, at its own s. Over all
pairs of places 1 - e has the mean zero and the rms

.. math:: \frac{(\omega_k h)^2}{2} \sqrt{2 \left(\frac{1}{30} - \frac{1}{36}\right)},

to which a spectral radius below 1 adds a loss of third order: restitution tends to 1 at order 2.

Rod. A free rail of length L runs lengthwise at speed v against a stop of stiffness k (Saint-Venant;
Goldsmith, Impact, 1960, ch. 3). With :math:`Z = A \sqrt{E \rho}`, :math:`\tau = Z / k` and
:math:`T = 2 L / c` the force is

.. math:: F = Z v (1 - e^{-t / \tau}), \quad t < T; \qquad
          F = Z v \left[\left(2 - e^{-T / \tau} + 2 s / \tau\right) e^{-s / \tau} - 1\right],
          \quad s = t - T,

until it vanishes: all modes together, none of them with a contact time of its own.

Reference: these closed forms with Euler-Bernoulli's omega_1 L^2 sqrt(rho A / E I) = 1.8751^2.
Tolerance: 0.1 % for the single mode, 3 % for the rms of 1 - e at 80 steps a contact, 2 +- 0.1 for
its order; for the rod (mesh of 0.3 m; the drive that brings it takes 0.3 % of the force) 0.5 % of
the contact time, 0.2 % of the impulse, 2e-5 between impulse and momentum, 1e-4 of the energy.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from tests.verification.agreement import Check
from tests.verification.beams_by_hand import (
    AREA,
    EI,
    LINE_MASS,
    RHO,
    E,
    Floats,
    joined,
    prismatic_rail,
)
from tests.verification.hand_made import energy_residual, linear_spring, run

from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Point, ReducedRail, Support
from turnout.solver.integration import History

LENGTH = 3.0
MASS = LINE_MASS * LENGTH
OMEGA = 1.875104068711961**2 * np.sqrt(EI / (LINE_MASS * LENGTH**4))
STOP, PULL = 1e6, 5e3
SERIES = 1 / (1 / STOP + LENGTH**3 / (3 * EI) - 4 / (MASS * OMEGA**2))
CONTACT = np.sqrt(OMEGA**2 + 4 * SERIES / MASS)
DURATION = np.pi / CONTACT
AMPLITUDE = 2 / np.sqrt(MASS) * PULL / OMEGA**2
DIVISIONS = (20, 40, 80)
PLACES = (np.arange(8) + 0.5) / 8


@dataclass(frozen=True)
class Impact:
    """Found and exact force over time, and figures of one impact."""

    time: Floats
    force: Floats
    exact: Floats
    duration: float
    residual: float


@cache
def cantilever() -> ReducedRail:
    """Return the rail that swings, with its tip."""
    return prismatic_rail(LENGTH, [Point(0.0, "uy")], nodes=np.linspace(0.0, LENGTH, 9))


def swing(*, step: float, spectral_radius: float, end: float, clearance: float = 0.0) -> History:
    """Pull a cantilever back by a force at its tip, let it go at t = 0, keep one mode."""
    laws = LawTableBuilder()
    soft = 1.0  # a spring so soft that its force is that of a weight
    laws.add_piecewise(
        0,
        breakpoints=np.zeros(0),
        slopes=np.array([soft]),
        offset=-PULL / soft - PULL * LENGTH**3 / (3 * EI),
        disappears=0.0,
    )
    laws.add_contact(0, stiffness=STOP, clearance=clearance)
    return run(
        joined(laws, [cantilever()], [[(0, 0)]]),
        end=end,
        step=step,
        cutoff_frequency=1.2 * OMEGA / (2 * np.pi),
        spectral_radius=spectral_radius,
    )


@cache
def single_mode() -> Impact:
    """Return the force on the stop beside the half sine."""
    touch = 0.5 * np.pi / OMEGA
    history = swing(step=DURATION / 2000, spectral_radius=1.0, end=touch + 2 * DURATION)
    phase = np.clip(history.time - touch, 0.0, DURATION)
    speed = AMPLITUDE * OMEGA
    exact = SERIES * 2 / np.sqrt(MASS) * speed / CONTACT * np.sin(CONTACT * phase)
    force = history.law_force[:, 1]
    return Impact(
        time=(history.time - touch) / DURATION,
        force=force,
        exact=exact,
        duration=float(np.sum(force > 0)) * DURATION / 2000,
        residual=energy_residual(history),
    )


@cache
def lost_restitution(divisions: int, spectral_radius: float = 0.5) -> Floats:
    """Return 1 - e for 64 pairs of places in a step at which contact begins and ends."""
    lost = []
    for begin in PLACES:
        for rest in PLACES:
            step = DURATION / (divisions + rest)
            history = swing(
                step=step,
                spectral_radius=spectral_radius,
                end=0.5 * np.pi / OMEGA + 1.5 * DURATION,
                clearance=2 / np.sqrt(MASS) * AMPLITUDE * OMEGA * begin * step,
            )
            energy = history.stored.sum(axis=1)
            touching = np.flatnonzero(history.law_force[:, 1] > 0)
            before, after = energy[touching[0] - 1], energy[touching[-1] + 1]
            lost.append(1 - np.sqrt(after / before))
    return np.array(lost)


def restitution_errors() -> Floats:
    """Return the rms of 1 - e over the places, for each step."""
    return np.array([np.sqrt(np.mean(lost_restitution(n) ** 2)) for n in DIVISIONS])


def scatter(divisions: int) -> float:
    """Return the closed form of the rms of 1 - e without algorithmic loss."""
    square = 4 * SERIES / MASS * np.mean((DURATION / (divisions + PLACES)) ** 2)
    return float(0.5 * square * np.sqrt(2 * (1 / 30 - 1 / 36)))


def restitution_rates() -> Floats:
    """Return observed orders of 1 - e in the step."""
    steps = 1 / (np.array(DIVISIONS) + 0.5)
    values = restitution_errors()
    return np.log(values[:-1] / values[1:]) / np.log(steps[:-1] / steps[1:])


ROD, SPEED, DRIVE = 12.0, 0.3, 2e5
WAVE = np.sqrt(E / RHO)
IMPEDANCE = AREA * np.sqrt(E * RHO)
RETURN = 2 * ROD / WAVE
RISE = 0.2 * RETURN


def rod_force(time: Floats) -> Floats:
    """Return the closed form of the force after contact begins [N]."""
    s = time - RETURN
    first = 1 - np.exp(-time / RISE)
    later = (2 - np.exp(-RETURN / RISE) + 2 * s / RISE) * np.exp(-s / RISE) - 1
    value = np.where(s < 0, first, np.where(time < rod_duration(), later, 0.0))
    return IMPEDANCE * SPEED * np.where(time > 0, value, 0.0)


def rod_duration() -> float:
    """Return the closed form of the contact time [s]."""

    def later(s: float) -> float:
        return float((2 - np.exp(-RETURN / RISE) + 2 * s / RISE) * np.exp(-s / RISE) - 1)

    return RETURN + float(brentq(later, RISE, 20 * RISE))


@dataclass(frozen=True)
class RodImpact:
    """Impact of the rod.

    Impulse of the stop less that of the drive, momentum that the rod gives up
    [N s], change of energy as a share of what it brought [-].
    """

    impact: Impact
    impulse: float
    exact_impulse: float
    momentum: float
    energy_change: float


@cache
def rod() -> RodImpact:
    """Bring a free rail to speed with a soft drive, which runs on as it hits a stop."""
    ends = [
        Support(Point(x, direction), 1e7) for x in (0.0, ROD) for direction in ("uy", "uz", "rx")
    ]
    rail = prismatic_rail(
        ROD,
        [Point(0.0, "ux", sign=-1.0), Point(0.5 * ROD, "ux", sign=-1.0)],
        nodes=np.linspace(0.0, ROD, 41),
        clamped=False,
        shear_factor=0.6,
        supports=ends,
    )
    along = np.zeros(rail.body.recovery.shape[0])
    along[0::6] = -1.0
    weight = rail.mass @ np.linalg.lstsq(rail.body.recovery, along)[0]
    # three half swings of rail and drive, after which the rail runs with the drive and no swing
    ramp = 3 * np.pi / np.sqrt(DRIVE / (LINE_MASS * ROD))

    def marker(t: Floats) -> Floats:
        rising = 0.5 * (t - ramp / np.pi * np.sin(np.pi * t / ramp))
        return SPEED * np.where(t < ramp, rising, t - 0.5 * ramp)

    touch = ramp + 5 * RETURN
    laws = LawTableBuilder()
    linear_spring(laws, 1, DRIVE, input_index=0)
    laws.add_contact(0, stiffness=IMPEDANCE / RISE, clearance=float(marker(np.array(touch))))
    mechanism = joined(laws, [rail], [[(0, 0)], [(0, 1)]])
    step = RETURN / 200
    history = run(mechanism, marker, end=touch + 3 * RETURN, step=step, spectral_radius=1.0)
    force = history.law_force[:, 1]
    touching = np.flatnonzero(force > 0)
    first, last = touching[0] - 1, touching[-1] + 1
    momentum = weight @ history.model.modes @ history.q.T
    gained = (momentum[first + 1] - momentum[first - 1]) - (momentum[last + 1] - momentum[last - 1])
    times = history.time - 0.5 * (history.time[first] + history.time[first + 1])
    fine = np.linspace(0.0, rod_duration(), 20001)
    impact = Impact(
        time=times,
        force=force,
        exact=rod_force(times),
        duration=touching.size * step,
        residual=energy_residual(history),
    )
    energy = history.stored.sum(axis=1) - history.ledger[:, 0]
    moving = 0.5 * LINE_MASS * ROD * SPEED**2
    pushed = -float(history.law_force[first : last + 1, 0].sum() * step)
    return RodImpact(
        impact=impact,
        impulse=float(force.sum() * step) - pushed,
        exact_impulse=float(np.trapezoid(rod_force(fine), fine)),
        momentum=float(gained / (2 * step)),
        energy_change=float((energy[last] - energy[first]) / moving),
    )


def checks() -> list[Check]:
    """Return what the page shows."""
    mode, long = single_mode(), rod()
    off = np.abs(mode.force - mode.exact).max() / mode.exact.max()
    rod_off = np.abs(long.impact.force - long.impact.exact).max() / long.impact.exact.max()
    lossless = lost_restitution(DIVISIONS[-1], 1.0)
    spread = 100 * (np.sqrt(np.mean(lossless**2)) / scatter(DIVISIONS[-1]) - 1)
    late = 100 * (mode.duration / DURATION - 1)
    peak = 100 * (mode.force.max() / mode.exact.max() - 1)
    rod_late = 100 * (long.impact.duration / rod_duration() - 1)
    impulse = 100 * (long.impulse / long.exact_impulse - 1)
    momentum = 100 * (long.momentum / long.impulse - 1)
    orders = [
        Check(f"restitution: order in the step, {n} steps a contact", rate, 1.9, 2.1, "")
        for n, rate in zip(DIVISIONS[1:], restitution_rates(), strict=True)
    ]
    return [
        Check("single mode: contact time", late, -0.1, 0.1, "%"),
        Check("single mode: peak force", peak, -0.1, 0.1, "%"),
        Check("single mode: force, largest difference", 100 * off, 0, 0.4, "% of peak"),
        Check("single mode, spectral radius 1: rms of 1 - e", spread, -3, 3, "%"),
        Check("single mode, default: rms of 1 - e", restitution_errors()[-1], 0, 1e-4, ""),
        *orders,
        Check("rod: contact time", rod_late, -0.5, 0.5, "%"),
        Check("rod: force, largest difference", 100 * rod_off, 0, 2, "% of peak"),
        Check("rod: impulse", impulse, -0.2, 0.2, "%"),
        Check("rod: momentum less impulse", momentum, -2e-3, 2e-3, "%"),
        Check("rod: energy after less before", 100 * long.energy_change, -0.01, 0.01, "%"),
    ]
