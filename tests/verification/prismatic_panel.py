r"""A panel that is one prismatic rail, clamped at its heel: a cantilever with closed frequencies.

Timoshenko's beam, with A the transfer matrix of deflection, slope, moment and shear force over the
length for the angular frequency omega,

.. math::

    w' = \psi + Q / \kappa G A, \quad \psi' = M / E I, \quad
    M' = -Q - \rho I \omega^2 \psi, \quad Q' = -\rho A \omega^2 w ,

swings where moment and shear force at the free end vanish for some moment and shear force at the
clamp.
"""

from pathlib import Path

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from turnout.panel.load import LoadedPanel, load_panel

E, NU, RHO = 210e9, 0.3, 7850.0
AREA, I_LATERAL, I_VERTICAL, KAPPA, LENGTH = 92e-4, 663e-8, 1708e-8, 0.6, 6.0
TEXT = """
schema_version = 1
name = "cantilever"
gravity = "9.81 m/s^2"
instrumented_rail = "A"
[material]
youngs_modulus = "210 GPa"
poisson_ratio = 0.3
density = "7850 kg/m^3"
[damping]
ratio = 0.0
frequencies = ["2 Hz", "12 Hz"]
[discretisation]
element_length = "0.1 m"
superelement_cutoff = "2000 Hz"
[section.whole]
x = ["0 m"]
area = ["92 cm^2"]
second_moment_vertical = ["1708 cm^4"]
second_moment_lateral = ["663 cm^4"]
torsion_constant = ["531 cm^4"]
shear_factor_vertical = [0.6]
shear_factor_lateral = [0.6]
centroid_height = ["0 mm"]
[rail.A]
closes = "+y"
stress_free = "closed"
end = "6 m"
heel = "clamped"
section = "whole"
[drive.1]
x = "0.3 m"
rail = "A"
stroke = "100 mm"
stiffness = "750 kN/m"
saturation_force = "6 kN"
saturated_stiffness = "1 kN/m"
[schedule]
starts = "closed"
end = "1 s"
[object_defaults]
rail = "A"
height = "0 mm"
stiffness = "40 kN/mm"
[lock]
gap_limit = "5 mm"
"""


def prismatic_panel(folder: Path) -> LoadedPanel:
    """Write the panel file and load it."""
    path = folder / "cantilever.toml"
    path.write_text(TEXT, encoding="utf-8")
    return load_panel(path)


def cantilever_frequencies(second_moment: float, count: int) -> np.ndarray:
    """Return the lowest frequencies of the cantilever bending in one plane [Hz]."""
    shear = KAPPA * E / (2 * (1 + NU)) * AREA

    def residual(frequency: float) -> float:
        square = (2 * np.pi * frequency) ** 2
        rates = np.zeros((4, 4))
        rates[0, 1], rates[0, 3] = 1.0, 1.0 / shear
        rates[1, 2] = 1.0 / (E * second_moment)
        rates[2, 1], rates[2, 3] = -RHO * second_moment * square, -1.0
        rates[3, 0] = -RHO * AREA * square
        scale = np.diag([1.0, 1.0, 1e7, 1e7])
        ends = expm(np.linalg.solve(scale, rates @ scale) * LENGTH)
        return float(np.linalg.det(ends[2:, 2:]))

    found: list[float] = []
    grid = np.geomspace(0.2, 400.0, 600)
    values = [residual(f) for f in grid]
    for left, right, a, b in zip(grid, grid[1:], values, values[1:], strict=False):
        if a * b < 0 and len(found) < count:
            found.append(brentq(residual, left, right, xtol=1e-10, rtol=1e-12))
    return np.array(found)
