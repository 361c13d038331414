"""The rungs of the battery: reference, checks and figure of each.

Every check is made by functions that tests call; the tests assert what the page shows.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from tests.verification import (
    flutter,
    friction_bed,
    friction_block,
    impact,
    orders,
    stick_slip,
    two_rails,
)
from tests.verification import test_beam_dynamics as dynamics
from tests.verification import test_beam_statics as statics
from tests.verification import test_laws_bushing as bushing
from tests.verification import test_laws_contact as contact
from tests.verification.agreement import Check
from tests.verification.hand_made import energy_residual

from benchmarks.studies import battery_figures
from turnout.beam.assembly import point_row


@dataclass(frozen=True)
class Rung:
    """A rung: name of its figure, text of the page, checks, figure."""

    name: str
    title: str
    reference: str
    where: str
    checks: Callable[[], list[Check]]
    figure: Callable[[], Figure]
    caption: str


def beam_checks() -> list[Check]:
    """Compare cantilever, frequencies and taper with their closed forms."""
    beam = statics.cantilever(statics.CENTRED, statics.NODES["uneven"])
    row = point_row(beam, statics.LENGTH, "uy")
    inertia, factor, area = (
        statics.CENTRED[name] for name in ("second_moment_lateral", "shear_factor_lateral", "area")
    )
    exact = statics.LENGTH**3 / (3 * statics.E * inertia)
    exact += statics.LENGTH / (factor * statics.G * area)
    tip = 100 * (row @ statics.deflection(beam, row) / exact - 1)
    slender, pinned = dynamics.slender_errors, dynamics.pinned_errors
    taper = statics.TestTaper()

    def rate(coarse: float, fine: float) -> float:
        return float(np.log2(coarse / fine))

    return [
        Check("cantilever with shear: tip", tip, -1e-8, 1e-8, "%"),
        Check(
            "slender cantilever, 12 elements: first frequency",
            100 * slender(12)[0],
            0,
            2e-3,
            "%",
        ),
        Check(
            "slender cantilever: order in the element length",
            rate(slender(6)[0], slender(12)[0]),
            3.9,
            4.1,
            "",
        ),
        Check(
            "stout pinned beam: order in the element length",
            rate(pinned(32)[0], pinned(64)[0]),
            1.9,
            2.1,
            "",
        ),
        Check(
            "taper with offsets, 36 compliances: order",
            rate(taper.error(32), taper.error(64)),
            1.9,
            2.1,
            "",
        ),
    ]


def law_checks() -> list[Check]:
    """Compare bushing and bouncing mass with their closed forms."""
    history = bushing.held_mass(0.08, cycles=False)
    exact = bushing.static_force(history.inputs[:, 0])
    off = 100 * np.abs(-history.law_force[:, 0] - exact).max() / exact.max()
    fall = contact.dropped(0.05, step=2e-5, end=0.35, spectral_radius=1.0)
    height = 0.05 - contact.MASS * contact.GRAVITY / 1e6
    speed, rest = np.sqrt(2 * contact.GRAVITY * height), contact.GRAVITY / contact.OMEGA**2
    peak = contact.CONTACT * (rest + np.hypot(rest, speed / contact.OMEGA))
    found = fall.law_force[: int(0.15 / 2e-5), 1].max()
    residual = max(energy_residual(history), energy_residual(fall))
    return [
        Check("bilinear bushing: force, largest difference", off, 0, 0.01, "% of peak"),
        Check("dropped mass: peak force of contact", 100 * (found / peak - 1), -0.2, 0.2, "%"),
        Check("energy residual of these", residual, 0, 1e-6, "of scale"),
    ]


RUNGS = (
    Rung(
        "beams",
        "Beams",
        "cantilever with shear and force-based theory (exact), Euler-Bernoulli and Timoshenko "
        "frequencies; orders 4 and 2 in the element length, 2 with a taper",
        "`test_beam_statics.py`, `test_beam_dynamics.py`",
        beam_checks,
        battery_figures.beams,
        "Relative errors over the number of elements. Dashed: the order of theory.",
    ),
    Rung(
        "friction",
        "Friction of a block",
        "Jenkins element, Masing's rule, Coulomb's limit with the momentary normal force",
        "`friction_block.py`, `test_friction_block.py`",
        friction_block.checks,
        battery_figures.friction,
        "Lines: turnout. Dots: closed form.",
    ),
    Rung(
        "stick_slip",
        "Stick-slip: oscillator and block on a belt",
        "harmonic motion, joined where the foot gives way or takes hold",
        "`stick_slip.py`, `test_friction_oscillator.py`",
        stick_slip.checks,
        battery_figures.stick_slip_paths,
        "Lines: turnout with 100 steps a period. Dots: closed form.",
    ),
    Rung(
        "friction_bed",
        "Cantilever dragged over a friction bed",
        "slip length 2 P / q - 1 / beta of an Euler-Bernoulli beam on an elastic-plastic bed; the "
        "derivation is at the top of the file",
        "`friction_bed.py`, `test_friction_bed.py`",
        friction_bed.checks,
        battery_figures.bed,
        "Left: slip length over the push. Middle: the rail at the last push, scaled by the slip "
        "q / k at which the bed gives way. Right: errors over the spacing of the chairs.",
    ),
    Rung(
        "laws",
        "Bilinear bushing, unilateral contact",
        "springs in series; ballistics and half sine under gravity. Lift-off and return of a "
        "shaken mass and objects that come and go are in the same tests",
        "`test_laws_bushing.py`, `test_laws_contact.py`",
        law_checks,
        battery_figures.laws,
        "Lines: turnout. Dots: closed form.",
    ),
    Rung(
        "impact",
        "Impact of a rail on a stop",
        "half sine of a single mode; Saint-Venant's rod against an elastic stop; closed form of "
        "what a lossless scheme scatters, restitution to 1 at order 2",
        "`impact.py`, `test_impact.py`",
        impact.checks,
        battery_figures.impacts,
        "Left: cantilever with one mode. Middle: rod of 12 m. Right: rms of 1 - e over where in a "
        "step the contact begins and ends.",
    ),
    Rung(
        "two_rails",
        "Object between two rails",
        "influence coefficients of two cantilevers with shear; two single modes and a blow",
        "`two_rails.py`, `test_two_rails.py`",
        two_rails.checks,
        battery_figures.between,
        "Left: a drive presses one rail through the object against the other. Middle and right: "
        "one rail swings against an object that touches another. Dots: closed form.",
    ),
    Rung(
        "orders",
        "Orders of the whole chain",
        "lateral frequencies of the panel SB1 against the Timoshenko beam on point springs; force "
        "of a drive against Runge-Kutta; order 2",
        "`orders.py`, `test_orders.py`",
        orders.checks,
        battery_figures.chain,
        "Left: lateral frequencies of SB1, with the rail's shear factor and one of 0.02. Right: "
        "force of Drive 2 in a throw without friction.",
    ),
    Rung(
        "flutter",
        "Flutter by friction",
        "eigenvalues of a mass on a plate whose normal force varies; growth in time of a panel "
        "with an unsymmetric section and without dashpots",
        "`flutter.py`, `test_flutter.py`",
        flutter.checks,
        battery_figures.flutter,
        "Left: line: complex modes, dots: closed form. Right: envelope of the chair forces while "
        "the panel is thrown at half speed; dashed: the growth that complex modes predict.",
    ),
)
