r"""An object between two rails: its law reads a row with entries in both bodies.

Static. Two cantilevers of different length face each other, both with shear. A drive (spring k_d,
marker u) pushes the first at x_d; the object (spring k_o, clearance c) lies between x_1 of the
first and x_2 of the second. With the influence of a force at s on a place at r, both from the clamp
and s <= r, :math:`C(r, s) = s^2 (3 r - s) / 6 E I + s / \kappa G A`, the forces of drive and object
follow from

.. math:: P / k_d + C_{dd} P - C_{do} F = u, \qquad
          C_{do} P - (C_{11} + C_{22} + 1 / k_o) F = c

and F = 0 before the object is touched.

Dynamic. Two equal cantilevers with one mode each (tip amplitude 2 / sqrt(m), all others at rest in
series with the object, :math:`1 / k_e = 1 / k_o + 2 (L^3 / 3 E I - 4 / m \omega^2)`). The first
swings against the second, which stands still, with an object that just fills the gap. In contact
the half difference of the modes swings with :math:`\omega_r^2 = \omega^2 + 8 k_e / m` for
:math:`\pi / \omega_r`, while the half sum swings on with omega: the difference turns round, the
blow passes from one rail to the other, momentum and energy are kept.

Reference: these closed forms. Tolerance: 1e-8 of the largest force for the static
case; 0.2 % of force and amplitude for the blow, whose beginning the step places to half a step.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from tests.verification.agreement import Check
from tests.verification.beams_by_hand import AREA, EI, LINE_MASS, Floats, G, joined, prismatic_rail
from tests.verification.hand_made import energy_residual, linear_spring, run

from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Point

LONG, SHORT, SHEAR = 4.0, 2.5, 0.6
DRIVE_X, OBJECT_X, OTHER_X = 0.4, 1.2, 0.3
DRIVE, OBJECT, CLEARANCE = 8e5, 4e7, 0.008
TRAVEL = 0.05


@dataclass(frozen=True)
class Clamped:
    """Marker, found and exact forces of drive and object on the way there; energy residual."""

    marker: Floats
    drive: Floats
    object: Floats
    exact_drive: Floats
    exact_object: Floats
    residual: float


def influence(r: float, s: float) -> float:
    """Return the displacement at `r` for a unit force at `s`, both from the clamp [m/N]."""
    s, r = min(r, s), max(r, s)
    return s**2 * (3 * r - s) / (6 * EI) + s / (SHEAR * G * AREA)


def static_forces(marker: Floats) -> tuple[Floats, Floats]:
    """Return the closed forms of drive and object force [N]."""
    at_drive, at_object = LONG - DRIVE_X, LONG - OBJECT_X
    own = influence(at_drive, at_drive) + 1 / DRIVE
    cross = influence(at_drive, at_object)
    other = influence(SHORT - OTHER_X, SHORT - OTHER_X)
    both = influence(at_object, at_object) + other + 1 / OBJECT
    matrix = np.array([[own, -cross], [cross, -both]])
    drive, clamped = np.linalg.solve(matrix, np.stack((marker, np.full(marker.size, CLEARANCE))))
    touched = cross * marker / own > CLEARANCE
    return np.where(touched, drive, marker / own), np.where(touched, clamped, 0.0)


@cache
def clamped() -> Clamped:
    """Press a rail slowly through an object against another rail."""
    first = prismatic_rail(
        LONG,
        [Point(DRIVE_X, "uy"), Point(OBJECT_X, "uy")],
        nodes=np.array([DRIVE_X, OBJECT_X, 2.0, 3.0]),
        shear_factor=SHEAR,
    )
    second = prismatic_rail(
        SHORT,
        [Point(OTHER_X, "uy", sign=-1.0)],
        nodes=np.array([OTHER_X, 1.4]),
        shear_factor=SHEAR,
        first=first.body.count,
    )
    laws = LawTableBuilder()
    linear_spring(laws, 0, DRIVE, input_index=0)
    laws.add_contact(1, stiffness=OBJECT, clearance=CLEARANCE)
    history = run(
        joined(laws, [first, second], [[(0, 0)], [(0, 1), (1, 0)]]),
        lambda t: TRAVEL * t,
        end=1.0,
        step=5e-3,
        inertia=False,
    )
    marker = history.inputs[:, 0]
    exact_drive, exact_object = static_forces(marker)
    return Clamped(
        marker=marker,
        drive=-history.law_force[:, 0],
        object=history.law_force[:, 1],
        exact_drive=exact_drive,
        exact_object=exact_object,
        residual=energy_residual(history),
    )


LENGTH = 3.0
MASS = LINE_MASS * LENGTH
OMEGA = 1.875104068711961**2 * np.sqrt(EI / (LINE_MASS * LENGTH**4))
BETWEEN, PULL = 1e6, 5e3
SERIES = 1 / (1 / BETWEEN + 2 * (LENGTH**3 / (3 * EI) - 4 / (MASS * OMEGA**2)))
RELATIVE = np.sqrt(OMEGA**2 + 8 * SERIES / MASS)
DURATION = np.pi / RELATIVE
TIP = 4 / MASS * PULL / OMEGA**2
"""Amplitude of the swing at the tip, in its mode [m]."""


@dataclass(frozen=True)
class Blow:
    """Time from touch over the contact time; force and tips, found and exact; energy residual."""

    time: Floats
    force: Floats
    exact_force: Floats
    tips: Floats
    exact_tips: Floats
    residual: float


def passed_on(time: Floats) -> tuple[Floats, Floats]:
    """Return the object's force [N] and the tips [m] in their modes; time counts from the touch."""
    speed = TIP * OMEGA
    within = np.clip(time, 0.0, DURATION)
    after = np.maximum(time - DURATION, 0.0)
    half_sum = 0.5 * speed / OMEGA * np.sin(OMEGA * time)
    turned = speed / (2 * RELATIVE) * np.sin(RELATIVE * within)
    half_difference = np.where(
        time < 0,
        0.5 * speed / OMEGA * np.sin(OMEGA * time),
        turned - 0.5 * speed / OMEGA * np.sin(OMEGA * after),
    )
    force = 2 * SERIES * turned
    return force, np.stack((half_sum + half_difference, half_sum - half_difference), axis=1)


@cache
def blow() -> Blow:
    """Let one rail swing against an object that touches another one."""
    nodes = np.linspace(0.0, LENGTH, 31)
    first = prismatic_rail(LENGTH, [Point(0.0, "uy")], nodes=nodes)
    second = prismatic_rail(
        LENGTH,
        [Point(0.0, "uy"), Point(0.0, "uy", sign=-1.0)],
        nodes=nodes,
        first=first.body.count,
    )
    laws = LawTableBuilder()
    soft = 1.0  # a spring so soft that its force is that of a weight
    laws.add_piecewise(
        0,
        breakpoints=np.zeros(0),
        slopes=np.array([soft]),
        offset=-PULL / soft - PULL * LENGTH**3 / (3 * EI),
        disappears=0.0,
    )
    laws.add_contact(2, stiffness=BETWEEN, clearance=0.0)
    mechanism = joined(laws, [first, second], [[(0, 0)], [(1, 0)], [(0, 0), (1, 1)]])
    touch = 0.5 * np.pi / OMEGA
    step = DURATION / 2000
    history = run(
        mechanism,
        end=touch + 4 * DURATION,
        step=step,
        cutoff_frequency=1.2 * OMEGA / (2 * np.pi),
        spectral_radius=1.0,
    )
    time = history.time - touch - 0.5 * step  # let go within the first step
    force, tips = passed_on(time)
    modal = history.q @ history.model.row_modes.T
    return Blow(
        time=time / DURATION,
        force=history.law_force[:, 1],
        exact_force=force,
        tips=modal[:, :2],
        exact_tips=tips,
        residual=energy_residual(history),
    )


def checks() -> list[Check]:
    """Return what the page shows."""
    static, hit = clamped(), blow()
    late = static.marker > 0.1 * TRAVEL
    scale, drive_scale = static.exact_object.max(), static.exact_drive.max()
    off = np.abs(static.object - static.exact_object)[late].max() / scale
    drive_off = np.abs(static.drive - static.exact_drive)[late].max() / drive_scale
    hit_off = np.abs(hit.force - hit.exact_force).max() / hit.exact_force.max()
    tips_off = np.abs(hit.tips - hit.exact_tips).max() / np.abs(hit.exact_tips).max()
    return [
        Check("clamped: object force, largest difference", 100 * off, 0, 1e-6, "% of peak"),
        Check("clamped: drive force, largest difference", 100 * drive_off, 0, 1e-6, "% of peak"),
        Check("blow: object force, largest difference", 100 * hit_off, 0, 0.2, "% of peak"),
        Check("blow: rail tips, largest difference", 100 * tips_off, 0, 0.2, "% of swing"),
    ]
