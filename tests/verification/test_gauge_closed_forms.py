r"""Gauge under a wheel against closed forms: a cantilever, and a beam on springs.

A force Y at the height h above the shear centre of a clamped beam moves the running edge, both
places from the clamp and s <= r, by

.. math:: \Delta G(r, s) = Y \left[ \frac{s^2 (3 r - s)}{6 E I} + \frac{s}{\kappa G A}
          + \frac{h^2 s}{G J} \right],

and a vertical force Q at the offset e towards the stock rail by :math:`Q e h s / G J`. A long beam
on springs k per length yields, with :math:`\lambda^4 = k / 4 E I`,

.. math:: \Delta G(x) = \frac{Y \lambda}{2 k} e^{-\lambda |x|} (\cos \lambda x + \sin \lambda |x|).

Reference: these closed forms. Tolerance: 1e-6 of the largest for the cantilever, whose beams are
exact; 0.3 % for the springs, which stand 0.1 m apart under a beam with a little shear (0.1 %).
"""

from pathlib import Path

import numpy as np
from tests.verification.prismatic_panel import (
    AREA,
    I_LATERAL,
    I_VERTICAL,
    KAPPA,
    LENGTH,
    NU,
    TEXT,
    E,
)

from turnout.mechanism.laws import SOFT_STIFFNESS
from turnout.panel.load import LoadedPanel, load_panel
from turnout.throw.wheel import gauge_under_wheel

G, TORSION, HEIGHT = E / (2 * (1 + NU)), 531e-8, 0.1
FAR = """
stock_rail_gap = "400 mm"
independent_shape = true
"""
GAUGE = """
[gauge]
nominal = "1435 mm"
height = "100 mm"
"""
SPRINGS = """
[fastening]
x = { start = "0 m", step = "0.1 m", count = 240 }
stiffness_x = "100 kN/m"
stiffness_y = "100 kN/m"
stiffness_z = "1 MN/m"
stiffness_roll = "1 MN m/rad"
"""


def written(folder: Path, text: str) -> LoadedPanel:
    path = folder / "beam.toml"
    text = text.replace('"750 kN/m"', '"0.01 N/m"').replace('"1 kN/m"', '"0.01 N/m"')
    path.write_text(text, encoding="utf-8")
    return load_panel(path)


def beside_a_stock_rail(text: str) -> str:
    """Put the rail so far from a stock rail that it never touches it."""
    return text.replace('section = "whole"\n', f'section = "whole"{FAR}', 1)


def cantilever(folder: Path) -> LoadedPanel:
    return written(folder, beside_a_stock_rail(TEXT).replace("9.81", "0") + GAUGE)


def influence(r: np.ndarray, s: np.ndarray, second_moment: float) -> np.ndarray:
    near, far = np.minimum(r, s), np.maximum(r, s)
    return near**2 * (3 * far - near) / (6 * E * second_moment) + near / (KAPPA * G * AREA)


def test_cantilever(tmp_path: Path) -> None:
    """With the springs that press at all places of the wheel, which resist by 0.1 % together."""
    offset = 0.02
    found = gauge_under_wheel(cantilever(tmp_path), lateral=700.0, vertical=2000.0, offset=offset)
    at, wheel = LENGTH - found["x"].to_numpy(), LENGTH - found["wheel"].to_numpy()

    def lateral_and_roll(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, s = r[:, np.newaxis], wheel[np.newaxis]
        turned = np.minimum(r, s) / (G * TORSION)
        roll = np.concatenate((HEIGHT * turned, offset * turned), axis=1)
        bent = influence(r, s, I_LATERAL)
        return np.concatenate((bent, 0.0 * bent), axis=1) + HEIGHT * roll, roll

    lateral, roll = lateral_and_roll(wheel)
    sunk = influence(wheel[:, np.newaxis], wheel[np.newaxis], I_VERTICAL)
    flexible = np.concatenate(
        (lateral, np.concatenate((0.0 * sunk, sunk), axis=1) + offset * roll), axis=0
    )
    given = np.concatenate((700.0 * np.eye(wheel.size), 2000.0 * np.eye(wheel.size)))
    forces = np.linalg.solve(np.eye(given.shape[0]) + SOFT_STIFFNESS * flexible, given)
    moved = found["gauge"].isel(load=0) - found["gauge_at_rest"]
    turned = found["rail_roll"].isel(load=0)
    for ours, rows in zip((moved, turned), lateral_and_roll(at), strict=True):
        exact = (rows @ forces).T
        np.testing.assert_allclose(ours, exact, rtol=0, atol=1e-6 * exact.max())


def test_a_long_beam_on_springs(tmp_path: Path) -> None:
    text = TEXT.replace('end = "6 m"', 'end = "24 m"').replace('heel = "clamped"', 'heel = "free"')
    text = beside_a_stock_rail(text) + SPRINGS + GAUGE
    panel = written(tmp_path, text.replace('height = "100 mm"', 'height = "0 mm"'))
    y, k = 5000.0, 1e6
    found = gauge_under_wheel(panel, lateral=y)
    middle = found["gauge"].isel(load=0).sel(wheel=12.0, method="nearest")
    decay = (k / (4 * E * I_LATERAL)) ** 0.25
    way = decay * np.abs(found["x"].to_numpy() - float(middle["wheel"]))
    exact = y * decay / (2 * k) * np.exp(-way) * (np.cos(way) + np.sin(way))
    moved = (middle - found["gauge_at_rest"]).to_numpy()
    np.testing.assert_allclose(moved, exact, rtol=0, atol=3e-3 * exact.max())


def test_nothing_moves_without_a_wheel(tmp_path: Path) -> None:
    found = gauge_under_wheel(cantilever(tmp_path), lateral=0.0)
    np.testing.assert_allclose(
        found["gauge"].isel(load=0), np.broadcast_to(found["gauge_at_rest"], (21, 61)), atol=1e-12
    )
