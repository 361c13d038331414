r"""Steady circuit of a three-phase machine as a recorder at its supply sees it.

Behind the sum R of line and stator resistance lies a Gamma circuit whose main branch saturates:
with the voltage U between lines, the active power P and u = U/sqrt(3), p = P/3 of a phase

.. math::

    i_a = p/u, \quad E^2 = (u - R i_a)^2 + (R i_b)^2, \quad
    u\, i_b = q_m (E/E_0)^{n+1} + X_l\,\bigl(p_i/E\bigr)^2, \quad p_i = p - R i^2

where i_a and i_b are the active and the reactive part of the current i, E the voltage behind R,
X_l the leakage reactance and n = d ln i/d ln psi of the main branch. What the rotor does with p_i
(iron loss, copper, friction, load) does not enter: the current is a function of U and P alone.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SOLVED = 1e-12
"""Newton's steps end below this share of the reactive current [-]."""
MOST_STEPS = 40


@dataclass(frozen=True, slots=True)
class SupplyCircuit:
    """A three-phase machine behind R, through one point of operation.

    Attributes
    ----------
    voltage, power, current : float
        Point that the circuit goes through: between lines [V], active [W], of a line [A].
    resistance : float
        Line and stator, of a phase [ohm].
    saturation : float
        n = d ln i/d ln psi of the main branch at that point; 1 does not saturate [-].
    leakage : float
        X_l of the Gamma circuit, all leakage on the rotor's side [ohm].
    """

    voltage: float
    power: float
    current: float
    resistance: float
    saturation: float
    leakage: float

    def current_at(self, voltage: Floats, power: Floats) -> Floats:
        """Return the current of a line, NaN where the circuit has no such point [A].

        Parameters
        ----------
        voltage, power : ndarray, shape (n,)
            Between lines, rms [V]; active, of all phases [W].

        Examples
        --------
        >>> circuit = SupplyCircuit(voltage=391.0, power=390.0, current=2.4, resistance=12.0,
        ...                         saturation=4.2, leakage=15.0)
        >>> per_volt = np.diff(circuit.current_at(np.array([390.5, 391.5]), np.full(2, 390.0)))
        >>> per_watt = np.diff(circuit.current_at(np.full(2, 391.0), np.array([389.5, 390.5])))
        >>> print(round(1e3 * per_volt[0], 1), round(1e5 * per_watt[0], 1))
        27.3 -60.0
        """
        r, x_l = self.resistance, self.leakage
        e_0, q_m, b_0 = self._reference()
        u, p = np.asarray(voltage) / math.sqrt(3.0), np.asarray(power) / 3.0
        along, b = u - r * p / u, np.full(np.shape(u + p), b_0)
        for _ in range(MOST_STEPS):
            e = np.hypot(along, r * b)
            inside = p - r * ((p / u) ** 2 + b**2)
            rotor, main = inside / e, q_m * (e / e_0) ** (self.saturation + 1.0)
            slope_e = r * r * b / e
            slope_rotor = (-2.0 * r * b - rotor * slope_e) / e
            left = u * b - x_l * rotor**2 - main
            slope = u - 2.0 * x_l * rotor * slope_rotor
            slope = slope - (self.saturation + 1.0) * main / e * slope_e
            step = left / slope
            b = b - np.clip(step, -0.2 * b_0, 0.2 * b_0)
            if not np.any(np.abs(step) > SOLVED * b_0):
                break
        solved = (np.abs(step) <= 1e-6 * b_0) & (b > 0.0) & (slope > 0.0)
        return np.asarray(np.where(solved, np.hypot(p / u, b), np.nan))

    def _reference(self) -> tuple[float, float, float]:
        """Return E_0 [V], q_m of the main branch [var] and the reactive current [A] of a phase."""
        u, p = self.voltage / math.sqrt(3.0), self.power / 3.0
        b = math.sqrt(max(self.current**2 - (p / u) ** 2, 0.0))
        e = math.hypot(u - self.resistance * p / u, self.resistance * b)
        rotor = (p - self.resistance * self.current**2) / e
        return e, u * b - self.leakage * rotor**2, b

    def rotor_impedances(
        self, voltage: Floats, current: Floats, power: Floats
    ) -> tuple[Complexes, Complexes]:
        """Return R_r/s + j X_l of the rotor's branch from the power of an inrush [ohm].

        The voltage behind R is low then: the main branch takes at least what it does by n, and at
        most what it would without saturation.

        Parameters
        ----------
        voltage, current, power : ndarray, shape (n,)
            Between lines [V], of a line [A], active, of all phases [W].

        Returns
        -------
        without_saturation, by_saturation : ndarray of complex, shape (n,)
        """
        e_0, q_m, _ = self._reference()
        p = power / 3.0 - self.resistance * current**2
        q = np.sqrt(np.maximum((voltage / math.sqrt(3.0) * current) ** 2 - (power / 3.0) ** 2, 0.0))
        e = np.hypot(p, q) / current
        one, other = (q - q_m * (e / e_0) ** k for k in (2.0, self.saturation + 1.0))
        return np.asarray(e**2 / (p - 1j * one)), np.asarray(e**2 / (p - 1j * other))
