"""Markers: levels, shapes, order, against the reference and closed forms."""

from pathlib import Path

import numpy as np
import pytest

from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.markers import (
    marker_offsets,
    marker_positions,
    movement_end,
    movement_fraction,
    ordered_movements,
    prior_movement,
    prior_positions,
    start_offset,
)

TABLE = ([0.0, 1.0, 2.2, 3.2], [0.0, 0.1, 0.7, 1.0])
SHAPES = ("raised cosine", "smoothstep", "linear", "table")


def shaped(shape: str, **more: object) -> LoadedPanel:
    overrides: dict[str, object] = {"movement.shape": shape, **more}
    if shape == "table":
        overrides |= {
            "movement.table_time": TABLE[0],
            "movement.table_fraction": TABLE[1],
        }
    return load_panel("sb2", overrides=overrides)


def test_markers_are_those_of_the_reference(reference_dir: Path) -> None:
    data = np.load(reference_dir / "sb2" / "none.npz")
    markers = marker_positions(load_panel("sb2"), data["time"])
    # The reference is positive in the opening direction, and stored in single precision.
    np.testing.assert_allclose(-markers[0], data["marker1"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(-markers[1], data["marker2"], rtol=0, atol=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_rises_from_0_to_1_in_the_drives_own_time(shape: str) -> None:
    movement = shaped(shape).movement["return"]
    for drive, total in (("1", 3.2), ("2", 3.4)):
        time = np.linspace(0.0, total, 1001)
        fraction = movement_fraction(movement, time, drive=drive)
        assert fraction[0] == 0.0
        assert fraction[-1] == pytest.approx(1.0, abs=1e-14)
        assert np.all(np.diff(fraction) >= 0)
        held = movement_fraction(movement, [-1.0, total, 99.0], drive=drive)
        np.testing.assert_allclose(held, [0.0, 1.0, 1.0], atol=1e-14)


def test_raised_cosine_has_constant_speed_between_smooth_ends() -> None:
    movement = shaped("raised cosine").movement["throw"]
    time = np.linspace(0.0, 3.2, 320_001)
    speed = np.gradient(movement_fraction(movement, time, drive="1"), time)
    expected = np.full_like(time, 1.0 / 2.9)
    for ends in (time, 3.2 - time):
        ramp = ends < 0.3
        expected[ramp] = 0.5 / 2.9 * (1.0 - np.cos(np.pi * ends[ramp] / 0.3))
    np.testing.assert_allclose(speed[1:-1], expected[1:-1], rtol=0, atol=1e-5)


S, TURN = np.linspace(0.0, 1.0, 33), 2.0 * np.pi


@pytest.mark.parametrize(
    ("shape", "more", "totals", "expected"),
    [
        ("raised cosine", {"movement.ramp": 0.0}, {"1": 3.2, "2": 3.4}, S),  # the linear shape
        ("raised cosine", {"movement.ramp": 1.6}, {"1": 3.2}, S - np.sin(TURN * S) / TURN),
        ("smoothstep", {}, {"1": 3.2, "2": 3.4}, 3.0 * S**2 - 2.0 * S**3),
        ("table", {}, {"1": 3.2, "2": 3.4}, np.interp(3.2 * S, *TABLE)),
    ],
    ids=["no ramp", "longest ramp", "smoothstep", "table"],
)
def test_shapes_have_their_closed_forms_in_the_drives_own_time(
    shape: str, more: dict[str, object], totals: dict[str, float], expected: np.ndarray
) -> None:
    movement = shaped(shape, **more).movement["return"]
    for drive, total in totals.items():
        fraction = movement_fraction(movement, S * total, drive=drive)
        np.testing.assert_allclose(fraction, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "levels"),
    [
        # rest, after the first movement, after the second: starts closed, starts open
        ("sb2", [0.0, -0.115 - 0.001, 0.002]),
        ("sb1", [0.0, 0.120 + 0.002, -0.001]),
    ],
)
def test_over_travel_is_added_only_where_a_movement_goes(name: str, levels: list[float]) -> None:
    panel = load_panel(
        name, overrides={"drive.1.over_travel_open": 0.001, "drive.1.over_travel_closed": 0.002}
    )
    first, second = (movement for _, movement in ordered_movements(panel))
    times = [0.0, movement_end(panel, first), movement_end(panel, second)]
    np.testing.assert_allclose(marker_positions(panel, times)[0], levels, rtol=0, atol=1e-15)


def test_order_of_movements_in_the_file_does_not_matter() -> None:
    panel = load_panel("sb2")
    turned = panel.model_copy(update={"movement": dict(reversed(list(panel.movement.items())))})
    time = np.linspace(0.0, 8.5, 100)
    np.testing.assert_array_equal(marker_positions(panel, time), marker_positions(turned, time))
    assert [name for name, _ in ordered_movements(turned)] == ["throw", "return"]


def test_a_drive_on_the_other_rail_moves_the_same_way_in_panel_axes() -> None:
    panel = load_panel("sb2")
    both = load_panel("sb2", overrides={"drive.2.rail": "B"})
    time = np.linspace(0.0, 8.5, 100)
    np.testing.assert_array_equal(marker_positions(panel, time), marker_positions(both, time))


@pytest.mark.parametrize(
    ("starts", "closes", "stress_free", "expected"),
    [
        ("closed", "+y", "closed", 0.0),
        ("closed", "+y", "open", 1.0),
        ("open", "+y", "open", 0.0),
        ("open", "+y", "closed", -1.0),
        ("closed", "-y", "open", 0.0),
        ("closed", "-y", "closed", 1.0),
        ("open", "-y", "closed", 0.0),
        ("open", "-y", "open", -1.0),
    ],
)
def test_offset_of_the_start_from_the_stress_free_position(
    starts: str, closes: str, stress_free: str, expected: float
) -> None:
    panel = load_panel("sb2")
    rail = panel.rail["A"].model_copy(update={"closes": closes, "stress_free": stress_free})
    changed = panel.model_copy(
        update={
            "rail": {"A": rail},
            "schedule": panel.schedule.model_copy(update={"starts": starts}),
        }
    )
    assert start_offset(changed, "A", 1.0) == expected
    strokes = np.array([drive.stroke for drive in panel.drive.values()])
    np.testing.assert_array_equal(marker_offsets(changed), expected * strokes)


def test_a_loaded_start_follows_the_last_movement_to_it() -> None:
    panel = load_panel("uic60-760-1-15")
    movement = prior_movement(panel)
    assert movement == panel.movement["return"]
    positions = prior_positions(panel, movement, [0.0, 3.2, 3.4, 9.0])
    np.testing.assert_allclose(positions[:, 0], [-0.117, -0.087], atol=1e-12)
    np.testing.assert_array_equal(positions[:, -1], marker_positions(panel, [0.0])[:, 0])
    assert positions[1, 1] < positions[1, 2] == positions[1, 3]
    # A schedule that never returns turns its first movement around; other starts follow none.
    away = panel.model_copy(update={"movement": {"throw": panel.movement["throw"]}})
    turned = prior_movement(away)
    assert turned is not None
    assert (turned.to, turned.duration) == ("closed", panel.movement["throw"].duration)
    assert prior_movement(load_panel("sb2")) is None
    assert prior_movement(panel.model_copy(update={"movement": {}})) is None
