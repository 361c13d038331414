r"""Friction that couples modes: a mass on a plate in closed form, and a panel that flutters.

The mass. It slides along x on a plate (contact stiffness k_n, pressed down along y by N_0); springs
k_1 along x, k_2 along y and k_c between them hold it in a frame that moves with it. With friction
:math:`\mu k_n y` against the sliding

.. math::

    m \ddot x + c \dot x + k_1 x + (k_c + \mu k_n) y = 0, \qquad
    m \ddot y + c \dot y + k_c x + (k_2 + k_n) y = 0

with eigenvalues :math:`s` from :math:`m s^2 + c s + \kappa = 0`,

.. math:: \kappa = \frac{a + d}{2} \pm \sqrt{\frac{(a - d)^2}{4} + k_c (k_c + \mu k_n)},
          \quad a = k_1, \; d = k_2 + k_n .

Without damping it flutters once the root is of a negative number, that is for
:math:`\mu > -((a - d)^2 / 4 + k_c^2) / k_c k_n` with k_c < 0.

The panel. The symmetric one with the product of inertia and the shear centre of its section, beams
damped by 2 % at 30 and 140 Hz, friction 0.5 and chairs without dashpots, thrown at half speed from
55 % to 80 % of the opening movement. All modes keep their inertia, steps of 0.1 ms.

Reference: the closed form; the time integration, which knows nothing of eigenvalues. Tolerance:
1e-9 for the mass; for the panel 0.5 % of the frequency and 10 % of the growth rate, taken with the
feet that slide and stick in the run: some near the heel stick, where the prediction lets all slide.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import butter, hilbert, sosfiltfilt
from tests.verification.agreement import Check
from tests.verification.hand_made import hand_made
from tests.verification.runs import STUDIED, SYMMETRIC

from turnout.core.scheme import Scheme
from turnout.law.table import LawTableBuilder
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.metric.sliding import (
    ComplexModes,
    Floats,
    complex_modes,
    law_coupling,
    steady_sliding,
)
from turnout.metric.stability import sliding_places
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.records import Profile
from turnout.solver.condense import condense
from turnout.solver.integration import History, integrate
from turnout.solver.modal import ModalModel

MASS, DASHPOT, PLATE, PRESS = 2.0, 3.0, 4e5, 200.0
ALONG, ACROSS, BETWEEN = 6e5, 3e5, -9e4
CRITICAL = ((ALONG - ACROSS - PLATE) ** 2 / 4 + BETWEEN**2) / (-BETWEEN * PLATE)


def mass_on_plate(friction: float, *, dashpot: float = DASHPOT) -> Mechanism:
    """Return the mass: coordinates x and y (down), the plate folded in."""
    laws = LawTableBuilder()
    plate = laws.add_contact(1, stiffness=PLATE, clearance=0.0, base_closed=True)
    laws.add_friction(0, normal=plate, friction_coefficient=friction, stick_stiffness=1e6)
    return hand_made(
        laws,
        mass=[MASS, MASS],
        stiffness=np.array([[ALONG, BETWEEN], [BETWEEN, ACROSS]]),
        damping=np.diag([dashpot, dashpot]),
        load=[0.0, PRESS],
    )


def exact_eigenvalues(friction: float, *, dashpot: float = DASHPOT) -> np.ndarray:
    """Return the two eigenvalues with positive imaginary part, by magnitude [1/s]."""
    a, d = ALONG, ACROSS + PLATE
    root = np.sqrt(complex((a - d) ** 2 / 4 + BETWEEN * (BETWEEN + friction * PLATE)))
    found = []
    for kappa in ((a + d) / 2 - root, (a + d) / 2 + root):
        half = np.sqrt(dashpot**2 - 4 * MASS * kappa)
        found += [(-dashpot + sign * half) / (2 * MASS) for sign in (1, -1)]
    upper = np.array([s for s in found if s.imag > 0])
    return upper[np.lexsort((upper.real, np.round(np.abs(upper), 6)))]


COLUMNS = {
    "product_moment": ("cm^4", (64, 75, 81, 88, 94, 99, 103, 106, 110, 117, 130, 153, 163)),
    "shear_centre_height": (
        "mm",
        (17.4, 18.5, 23.3, 25.2, 27.0, 28.6, 30.5, 32.5, 34.7, 36.5, 38.1, 40.3, 40.9),
    ),
    "shear_centre_offset": (
        "mm",
        (13.5, 13.8, 19.3, 20.2, 20.2, 19.6, 19.2, 18.6, 16.1, 13.1, 9.6, 5.1, 4.7),
    ),
}
"""Of the planed 60E1A1 over the offset of the running edge, y towards the stock rail."""


def unsymmetric_panel(*, friction: float, dashpot: str) -> LoadedPanel:
    """Return the studied panel with the unsymmetry of its section and 2 % of damping."""
    settings = [
        f"section.tongue.{name}={{ unit = '{unit}', values = {list(values)} }}"
        for name, (unit, values) in COLUMNS.items()
    ]
    settings += [
        "damping.frequencies=['30 Hz', '140 Hz']",
        f"chair.friction_coefficient={friction}",
        f"chair.damping={dashpot}",
    ]
    return load_panel(SYMMETRIC, overrides=STUDIED | typed_shapes()).with_settings(settings)


def typed_shapes() -> dict[str, object]:
    """Return the shapes of the study as it typed them: those of SB2.

    Computed, a closed rail touches all its stops at once, where 10 um more or less decide which of
    them hold it; modes near the limit of stability are distinguished by that.
    """
    opened = load_panel("sb2").rail["B"].stock_rail_gap
    assert isinstance(opened, Profile)
    return {
        "rail.fit_gap": None,
        "rail.straight.stock_rail_gap": 0.0,
        "rail.curved.stock_rail_gap": opened.model_dump(),
    }


FROM, TO, DURATION, RAMP = 0.55, 0.8, 1.5, 0.3
WINDOW = (1.2, 1.33)
"""Where the vibration has risen from what flips of feet leave, and no foot lifts for it yet [s]."""


@dataclass(frozen=True)
class Slide:
    """A throw of a part of the opening movement, and its mechanism."""

    mechanism: Mechanism
    model: ModalModel
    history: History

    def modes(self, at: int) -> ComplexModes:
        """Return the complex modes with the branches that laws and feet are on at an instant."""
        laws, history = self.mechanism.laws, self.history
        slope = np.array([self._slope(law, at) for law in range(laws.row.size)])
        force = history.friction_force[at]
        normal = np.maximum(history.law_force[at, laws.friction_normal], 0.0)
        limit = laws.friction_coefficient * normal
        stuck = np.abs(force) < limit * (1 - 1e-7)
        return complex_modes(
            self.model,
            law_coupling(
                self.mechanism,
                slope=slope,
                weight=np.where(stuck, 0.0, np.sign(force) * laws.friction_coefficient),
                stick=np.where(stuck, laws.stick_stiffness, 0.0),
            ),
        )

    def _slope(self, law: int, at: int) -> float:
        laws = self.mechanism.laws
        e = self.history.g[at, laws.row[law]] - laws.offset[law]
        if laws.input_index[law] >= 0:
            e -= self.history.inputs[at, laws.input_index[law]]
        first, last = laws.segment_start[law], laws.segment_start[law + 1]
        return laws.slope[first + np.searchsorted(laws.segment_upper[first : last - 1], e)]

    def band(self) -> Floats:
        """Return the chair forces between 85 and 110 Hz, shape (n_times, n_feet) [N]."""
        feet = [law for laws in self.mechanism.index.chair.values() for law in laws]
        rate = 1.0 / (self.history.time[1] - self.history.time[0])
        sos = butter(4, [85, 110], btype="band", fs=rate, output="sos")
        return sosfiltfilt(sos, self.history.law_force[:, feet], axis=0)

    def found(self) -> tuple[float, float]:
        """Return frequency [Hz] and growth rate [1/s] within the window, from chair forces."""
        time = self.history.time
        inside = (time >= WINDOW[0]) & (time <= WINDOW[1])
        band = self.band()
        leading = band[:, np.argmax(np.abs(band[inside]).max(axis=0))]
        phase = np.unwrap(np.angle(hilbert(leading)))[inside]
        envelope = np.sqrt(np.sum(np.abs(hilbert(band, axis=0)) ** 2, axis=1))[inside]
        turns = np.polyfit(time[inside], phase, 1)[0] / (2 * np.pi)
        return float(turns), float(np.polyfit(time[inside], np.log(envelope), 1)[0])


@cache
def slide(dashpot: str) -> Slide:
    """Throw the panel through a part of its opening movement at half speed."""
    panel = unsymmetric_panel(friction=0.5, dashpot=dashpot)
    mechanism = build_mechanism(panel)
    first, last = (
        p.inputs[:, None] for p in sliding_places(panel, shares=(FROM, TO)) if p.sense < 0
    )

    def markers(time: Floats) -> Floats:
        share = np.minimum(time / RAMP, 1.0)
        risen = RAMP * (share**3 - 0.5 * share**4) + np.maximum(time - RAMP, 0.0)
        return first + (last - first) * risen / (DURATION * 4 / 3)

    scheme = Scheme(step=1e-4, cutoff_frequency=1e6, output_interval=5e-4, spectral_radius=0.9)
    history = integrate(mechanism, scheme, inputs=markers, end=DURATION)
    return Slide(mechanism, condense(mechanism, cutoff_frequency=1e6), history)


def mass_eigenvalues(friction: float) -> np.ndarray:
    """Return the eigenvalues of the mass on its plate as complex modes find them, by magnitude."""
    mechanism = mass_on_plate(friction)
    model = condense(mechanism, cutoff_frequency=1e6)
    state = steady_sliding(mechanism, model, inputs=np.zeros(0), sense=1.0)
    found = complex_modes(model, state.coupling).eigenvalues
    return found[np.lexsort((found.real, np.round(np.abs(found), 6)))]


@cache
def predicted() -> tuple[float, float]:
    """Return mean frequency [Hz] and growth rate [1/s] of the window, from contacts as they are."""
    run = slide("0 N s/m")
    pairs = []
    for at in range(*np.searchsorted(run.history.time, WINDOW), 10):
        modes = run.modes(int(at))
        worst = int(np.argmax(modes.growth_rate))
        pairs.append((modes.frequencies[worst], modes.growth_rate[worst]))
    frequency, rate = np.mean(pairs, axis=0)
    return float(frequency), float(rate)


def left_with_dashpots() -> float:
    """Return the largest vibration after the window's begin, as a share of that without them."""
    bare, damped = slide("0 N s/m"), slide("3.75 kN s/m")
    late = bare.history.time > WINDOW[0]
    return float(np.abs(damped.band()[late]).max() / np.abs(bare.band()[late]).max())


def checks() -> list[Check]:
    """Compare complex modes with the closed form and with the time integration."""
    shares = (0.2, 0.9, 1.2, 2.0)
    off = max(
        np.abs(mass_eigenvalues(s * CRITICAL) / exact_eigenvalues(s * CRITICAL) - 1).max()
        for s in shares
    )
    (frequency, rate), (seen, grown) = predicted(), slide("0 N s/m").found()
    return [
        Check("mass on a plate: eigenvalues, largest difference", 100 * off, 0, 1e-7, "%"),
        Check(
            "panel: frequency in time against modes", 100 * (seen / frequency - 1), -0.5, 0.5, "%"
        ),
        Check("panel: growth rate in time against modes", 100 * (grown / rate - 1), -10, 10, "%"),
        Check("panel: growth rate in time", grown, 7, 14, "1/s"),
        Check("panel with dashpots: what is left", 100 * left_with_dashpots(), 0, 2, "%"),
    ]
