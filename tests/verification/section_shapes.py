"""Outlines with closed-form properties, and the closed forms that are series."""

import numpy as np

from turnout.beam.outline import Outline, make_outline

TERMS = np.arange(1, 400)


def rectangle(width: float, height: float) -> Outline:
    """Centred on the origin."""
    y, z = 0.5 * width, 0.5 * height
    return make_outline([[-y, -z], [y, -z], [y, z], [-y, z]])


def rectangle_torsion(long: float, short: float) -> float:
    """Sum the series of Saint-Venant (Timoshenko and Goodier, Theory of Elasticity)."""
    odd = TERMS[::2]
    series = np.sum(np.tanh(0.5 * np.pi * odd * long / short) / odd**5)
    return long * short**3 * (1 / 3 - 64 / np.pi**5 * short / long * float(series))


def rectangle_shear_factor(depth: float, width: float, poisson_ratio: float) -> float:
    """By energy, for a force along `depth` (Renton, Int. J. Solids Struct. 27(15), 1991)."""
    aspect = width / depth
    series = float(np.sum(np.tanh(np.pi * TERMS / aspect) / TERMS**5))
    extra = aspect**4 * (1 / 5 - 18 / np.pi**5 * aspect * series)
    return 1.0 / (6 / 5 + (poisson_ratio / (1 + poisson_ratio)) ** 2 * extra)


def circle_shear_factor(poisson_ratio: float) -> float:
    """By energy, from the stress in Timoshenko and Goodier's bending of a circular bar."""
    nu = poisson_ratio
    return 6 * (1 + nu) ** 2 / (7 + 14 * nu + 8 * nu**2)


def ring(radius: float, corners: int, *, start: float = 0.0, end: float = 2 * np.pi) -> np.ndarray:
    """Corners on a circle; the last one is left out only where it would meet the first."""
    closed = end - start >= 2 * np.pi
    angle = np.linspace(start, end, corners, endpoint=not closed)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def slit_tube(radius: float, thickness: float, corners: int) -> Outline:
    """A tube of mean `radius`, slit along the side of positive y by a twentieth of the wall."""
    half = 0.05 * thickness / radius
    arcs = [
        ring(radius + side * 0.5 * thickness, corners, start=half, end=2 * np.pi - half)
        for side in (1, -1)
    ]
    return make_outline(np.concatenate([arcs[0], arcs[1][::-1]]))


def i_section(*, height: float, top: float, bottom: float, thickness: float) -> Outline:
    """Flanges of two widths, `height` between their mid-lines, all walls alike, web at y = 0."""
    t, h = 0.5 * thickness, 0.5 * height
    right = [
        *([0.5 * bottom, -h - t], [0.5 * bottom, -h + t], [t, -h + t]),
        *([t, h - t], [0.5 * top, h - t], [0.5 * top, h + t]),
    ]
    return make_outline([*right, *([-y, z] for y, z in reversed(right))])


def channel(*, height: float, width: float, thickness: float) -> Outline:
    """Mid-line of the web at y = 0, flanges to positive y; dimensions of the mid-lines."""
    t, h, b = 0.5 * thickness, 0.5 * height, width
    return make_outline(
        [[-t, -h - t], [b, -h - t], [b, -h + t], [t, -h + t]]
        + [[t, h - t], [b, h - t], [b, h + t], [-t, h + t]]
    )


def angle(*, upright: float, flat: float, thickness: float) -> Outline:
    """Mid-lines of both legs meet at the origin; they go to positive z and positive y."""
    t = 0.5 * thickness
    return make_outline([[-t, -t], [flat, -t], [flat, t], [t, t], [t, upright], [-t, upright]])


def z_section(*, height: float, width: float, thickness: float) -> Outline:
    """Top flange to positive y, bottom flange to negative; dimensions of the mid-lines."""
    t, h, b = 0.5 * thickness, 0.5 * height, width
    half = [[-t, -h + t], [-b, -h + t], [-b, -h - t], [t, -h - t]]
    return make_outline([*half, *([-y, -z] for y, z in half)])
