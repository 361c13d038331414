"""Thin-walled sections against the formulas of mid-lines.

Those formulas are themselves of first order in wall over width (second where the walls have no
corners), so each tolerance is that ratio, or twice it where a corner's overlap counts twice. The
one exception says its own reason.
"""

import numpy as np
import pytest
from tests.verification.section_shapes import (
    angle,
    channel,
    i_section,
    ring,
    slit_tube,
    z_section,
)

from turnout.beam.outline import make_outline
from turnout.beam.outline_moments import area_moments, principal_moments
from turnout.beam.section_analysis import analyse_outline

RADIUS, WALL = 0.1, 0.004
CORNERS = 96


def test_closed_tube() -> None:
    hole = ring(RADIUS - 0.5 * WALL, CORNERS)
    tube = make_outline(ring(RADIUS + 0.5 * WALL, CORNERS), holes=(hole,))
    run = analyse_outline(tube)
    found = run.properties
    # 96 corners leave 2e-3 of fourth powers of the radius.
    assert found.torsion_constant[0] == pytest.approx(2 * np.pi * RADIUS**3 * WALL, rel=5e-3)
    assert found.shear_factor_vertical[0] == pytest.approx(0.5, rel=5e-3)
    assert found.shear_factor_lateral[0] == pytest.approx(0.5, rel=5e-3)
    assert abs(found.shear_centre_y[0]) < 1e-6 * RADIUS


def test_open_tube() -> None:
    run = analyse_outline(slit_tube(RADIUS, WALL, CORNERS))
    found = run.properties
    # A slit of a tenth of the wall; its two ends take 0.63 t off the length of the strip.
    length = 2 * np.pi * RADIUS - 0.1 * WALL
    strip = (length - 0.63 * WALL) * WALL**3 / 3
    assert found.torsion_constant[0] == pytest.approx(strip, rel=2e-3)
    assert found.shear_centre_y[0] == pytest.approx(-2 * RADIUS, rel=5e-3)
    assert abs(found.shear_centre_z[0]) < 1e-4 * RADIUS
    gamma = 2 * np.pi * WALL * RADIUS**5 * (np.pi**2 / 3 - 2)
    assert run.warping_constant[0] == pytest.approx(gamma, rel=1e-2)


def test_channel() -> None:
    height, width, wall = 0.2, 0.1, 0.002
    run = analyse_outline(channel(height=height, width=width, thickness=wall))
    found = run.properties
    inertia = wall * height**3 / 12 + 2 * width * wall * (0.5 * height) ** 2
    behind_web = width**2 * height**2 * wall / (4 * inertia)
    assert found.second_moment_vertical[0] == pytest.approx(inertia, rel=0.01)
    assert found.shear_centre_y[0] == pytest.approx(-behind_web, rel=0.02)
    assert abs(found.shear_centre_z[0]) < 1e-5 * height
    strips = (height + 2 * width) * wall**3 / 3
    assert found.torsion_constant[0] == pytest.approx(strips, rel=0.01)


def test_angle() -> None:
    run = analyse_outline(angle(upright=0.12, flat=0.08, thickness=0.004))
    found = run.properties
    # The forces of both legs' stresses pass through the corner.
    assert np.hypot(found.shear_centre_y[0], found.shear_centre_z[0]) < 0.5 * 0.004
    assert found.torsion_constant[0] == pytest.approx(0.2 * 0.004**3 / 3, rel=0.02)
    assert found.product_moment[0] < 0.0


def test_i_section_with_unequal_flanges() -> None:
    height, top, bottom, wall = 0.2, 0.06, 0.12, 0.002
    run = analyse_outline(i_section(height=height, top=top, bottom=bottom, thickness=wall))
    found = run.properties
    from_bottom = height * top**3 / (top**3 + bottom**3)
    assert found.shear_centre_z[0] + 0.5 * height == pytest.approx(from_bottom, rel=0.02)
    assert abs(found.shear_centre_y[0]) < 1e-5 * height
    flanges = wall / 12 * top**3 * bottom**3 / (top**3 + bottom**3)
    assert run.warping_constant[0] == pytest.approx(height**2 * flanges, rel=0.02)


def test_i_section_shear_energy_is_that_of_the_shear_flow() -> None:
    height, top, bottom, wall = 0.2, 0.06, 0.12, 0.002
    outline = i_section(height=height, top=top, bottom=bottom, thickness=wall)
    found = analyse_outline(outline, poisson_ratio=0.0).properties
    area = wall * (top + bottom + height)
    low = -height * (top + 0.5 * height) * wall / area
    web = np.linspace(low, low + height, 2001)
    inertia = wall * (bottom * low**2 + top * web[-1] ** 2 + (web[-1] ** 3 - low**3) / 3)
    flow = wall / inertia * (top * web[-1] + 0.5 * (web[-1] ** 2 - web**2))
    energy = np.trapezoid(flow**2, web) / wall
    for flange, z in ((top, web[-1]), (bottom, low)):
        energy += 2 / 3 * wall * (z / inertia) ** 2 * (0.5 * flange) ** 3
    assert found.shear_factor_vertical[0] == pytest.approx(1 / (area * energy), rel=0.02)


def test_z_section() -> None:
    height, width, wall = 0.2, 0.08, 0.002
    outline = z_section(height=height, width=width, thickness=wall)
    run = analyse_outline(outline)
    product = 2 * wall * width * (0.5 * width) * (0.5 * height)
    assert run.properties.product_moment[0] == pytest.approx(product, rel=0.02)
    assert abs(run.properties.shear_centre_y[0]) < 1e-5 * height
    assert abs(run.properties.shear_centre_z[0]) < 1e-5 * height
    greatest, least, turned = principal_moments(area_moments(outline))
    assert run.principal_angle[0] == turned < 0.0
    assert greatest * least == pytest.approx(
        run.properties.second_moment_vertical[0] * run.properties.second_moment_lateral[0]
        - run.properties.product_moment[0] ** 2,
        rel=1e-12,
    )
    assert abs(run.shear_coupling[0]) > 0.1
