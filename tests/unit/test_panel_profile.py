"""Profiles, running edge and section tables along a rail."""

import numpy as np
import pytest

from turnout.mechanism.rail_sections import section_values
from turnout.panel.load import load_panel
from turnout.panel.profile import (
    evaluate_profile,
    running_edge_distance,
    running_edge_offset,
    running_edge_position,
    section_stations,
)
from turnout.panel.records import Profile


def profile(x: list[float], value: list[float], interpolation: str) -> Profile:
    data = {"x": x, "value": value, "interpolation": interpolation}
    return Profile.model_validate(data, context={"si": True})


def test_cubic_profile_reproduces_a_cubic_and_holds_its_ends() -> None:
    def cubic(x: np.ndarray) -> np.ndarray:
        return 0.1 - 0.02 * x + 0.003 * x**2 + 0.0005 * x**3

    stations = np.array([0.0, 1.0, 2.5, 4.0, 5.0])
    table = profile(stations.tolist(), cubic(stations).tolist(), "cubic")
    x = np.linspace(0.0, 5.0, 51)
    np.testing.assert_allclose(evaluate_profile(table, x), cubic(x), rtol=1e-12)
    held = evaluate_profile(table, [-3.0, 9.0])
    np.testing.assert_allclose(held, cubic(np.array([0.0, 5.0])), rtol=1e-12)


def test_linear_profile_constant_and_short_cubics() -> None:
    assert evaluate_profile(profile([0.0, 2.0], [0.0, 1.0], "linear"), [0.5])[0] == 0.25
    assert evaluate_profile(profile([0.0, 2.0], [0.0, 1.0], "cubic"), [0.5])[0] == 0.25
    assert evaluate_profile(profile([1.0], [0.3], "cubic"), [0.5])[0] == 0.3
    parabola = profile([0.0, 1.0, 2.0], [0.0, 1.0, 4.0], "cubic")
    assert evaluate_profile(parabola, [0.5])[0] == pytest.approx(0.25, abs=1e-14)
    np.testing.assert_array_equal(evaluate_profile(0.02, [0.0, 9.0]), [0.02, 0.02])


def test_running_edge_and_its_inverse() -> None:
    edge = load_panel("sb2").rail["A"].running_edge
    assert edge is not None
    for offset in (0.003, 0.02, 0.072):
        x = running_edge_position(edge, offset)
        assert running_edge_offset(edge, [x])[0] == pytest.approx(offset, rel=1e-12)
    # domain table: w = 20 mm at 3.42 m, 72 mm at 8.37 m
    assert running_edge_position(edge, 0.020) == pytest.approx(3.42, abs=0.01)
    assert running_edge_position(edge, 0.072) == pytest.approx(8.37, abs=0.01)
    behind = running_edge_offset(edge, [-9.0, -2.1, 0.0])
    np.testing.assert_array_equal(behind, [0.0029] * 3)


def test_sections_are_linear_in_the_running_edge_offset() -> None:
    panel = load_panel("sb2")
    edge = panel.rail["A"].running_edge
    assert edge is not None
    middle = running_edge_position(edge, 0.025), running_edge_position(edge, 0.0275)
    values = section_values(panel, "A", [0.0, *middle, 18.6])
    tip = 25.4e-4 + (28.2e-4 - 25.4e-4) * 2.9 / 3.0
    expected = [tip, 57.7e-4, (57.7e-4 + 64.4e-4) / 2, 92.8e-4]
    np.testing.assert_allclose(values["area"], expected, rtol=1e-12)
    np.testing.assert_array_equal(values["product_moment"], 0.0)
    np.testing.assert_array_equal(values["shear_centre_height"], values["centroid_height"])


def test_columns_left_out_follow_the_centroid() -> None:
    panel = load_panel("sb2", overrides={"section.tongue.centroid_offset": [0.01] * 13})
    values = section_values(panel, "A", [1.0, 5.0])
    np.testing.assert_allclose(values["shear_centre_offset"], 0.01)
    own = panel.with_overrides({"section.tongue.shear_centre_offset": [0.02] * 13})
    np.testing.assert_allclose(section_values(own, "A", [1.0])["shear_centre_offset"], 0.02)


def test_stations_are_where_a_property_has_a_kink() -> None:
    panel = load_panel("sb2")
    x = section_stations(panel, "A")
    assert np.all(np.diff(x) > 0)
    assert np.all((x > 0.0) & (x < 18.6))
    for a, b in zip([0.0, *x], [*x, 18.6], strict=True):
        edge = panel.rail["A"].running_edge
        assert edge is not None
        w = running_edge_offset(edge, np.linspace(a + 1e-9, b - 1e-9, 5))
        area = section_values(panel, "A", np.linspace(a + 1e-9, b - 1e-9, 5))["area"]
        line = np.interp(w, [w[0], w[-1]], [area[0], area[-1]]) if w[-1] > w[0] else area[0]
        np.testing.assert_allclose(area, line, rtol=1e-9)
    assert section_stations(load_panel("sb1"), "switch").size == 0


def test_stations_by_position() -> None:
    panel = load_panel(
        "sb1",
        overrides={
            "section.prismatic": {
                key: [value[0], 2 * value[0]]
                for key, value in load_panel("sb1").section["prismatic"].model_dump().items()
                if value is not None and key != "x"
            }
            | {"x": [2.0, 6.0]}
        },
    )
    np.testing.assert_array_equal(section_stations(panel, "switch"), [2.0, 6.0])
    area = section_values(panel, "switch", [0.0, 4.0, 14.0])["area"]
    np.testing.assert_allclose(area, np.array([1.0, 1.5, 2.0]) * 9.3e-3, rtol=1e-12)


def test_a_running_edge_that_meets_the_stock_rail_at_an_angle() -> None:
    """The published switch: no thickness at the toe, 175 mm at its heel, entry angle 20 minutes."""
    edge = load_panel("60e1-441-1-12").rail["straight"].running_edge
    assert edge is not None
    thin = edge.model_copy(update={"minimum": 0.0})
    toe, near, heel = running_edge_distance(thin, [0.0, 0.001, 10.125])
    assert toe == pytest.approx(0.0, abs=1e-4)
    assert heel == pytest.approx(0.175, abs=2e-4)
    assert (near - toe) / 0.001 == pytest.approx(np.tan(np.radians(20 / 60)), rel=1e-3)
    assert running_edge_position(edge, float(heel)) == pytest.approx(10.125)
