"""The map of what can be seen, from throws to figure."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.detection_throws import toy_map, toy_throws

from turnout.cli.limit import write_map
from turnout.cli.output import Output
from turnout.detection.floor import touch_floor, touched
from turnout.detection.limit.limit_map import limit_map, rows_of, size_weights, smallest_seen
from turnout.detection.reference import Conditions, reference_study
from turnout.detection.throws import objects_study, of_kind, places_of, sizes_beyond
from turnout.figures.limit import LEVELS, labels_of, level_sizes, plot_limit
from turnout.figures.style import rendered


def a90(**conditions: object) -> np.ndarray:
    found = limit_map(toy_throws(), Conditions(**conditions), closing=0.8)  # type: ignore[arg-type]
    return found["a90"].sel(channel="both drives").to_numpy()


def test_what_is_not_touched_is_detected_at_the_rate_of_false_alarms() -> None:
    found = toy_map()
    below = found["pod"].sel(place="sleeper 1", channel="both drives").sel(size=slice(0, 0.9e-3))
    np.testing.assert_allclose(below, 1e-3, rtol=1e-9)


def test_probability_grows_with_the_size_and_with_a_second_drive() -> None:
    found = toy_map()
    assert np.all(np.diff(found["pod"], axis=-1) >= -1e-12)
    both, one = (found["pod"].sel(channel=name) for name in ("both drives", "drive 1"))
    assert np.all(both.to_numpy() >= one.to_numpy() - 1e-12)
    assert np.all(found["a90_low"] <= found["a90"])
    assert np.all(found["a90"] <= found["a90_high"])


def test_a90_moves_the_way_it_must() -> None:
    usual = a90()
    assert np.all(a90(history=20) < usual)
    assert np.all(a90(discrepancy=0.1) > usual)
    assert np.all(a90(false_alarm_rate=1e-4) > usual)


def test_a90_beyond_what_was_thrown_is_not_given() -> None:
    throws = dataclasses.replace(toy_throws(), change=0.0 * toy_throws().change)
    found = limit_map(throws, Conditions(), closing=0.8)
    assert np.isnan(found["a90"]).all()
    assert rows_of(found)[0]["a90"] is None


def test_an_object_without_room_in_some_states_leaves_the_rest() -> None:
    throws = toy_throws()
    change = throws.change.copy()
    change[::2, :, -1] = np.nan
    found = limit_map(dataclasses.replace(throws, change=change), Conditions(), closing=0.8)
    assert np.isfinite(found["pod"]).all()


def test_weights_below_the_gap_are_zero_and_sum_to_one_beyond_the_first_thrown_size() -> None:
    weights = size_weights(np.linspace(0, 0.02, 41), np.array([0.003, 0.006, 0.012]), gap=0.002)
    assert np.all(weights[:5] == 0.0)
    np.testing.assert_allclose(weights[6:].sum(axis=1), 1.0)


def test_the_smallest_size_is_that_after_the_last_one_below() -> None:
    pod, sizes = np.array([[0.95, 0.5, 0.92, 0.99]]), np.array([1.0, 2.0, 3.0, 4.0])
    assert smallest_seen(pod, sizes).tolist() == [3.0]


def test_objects_are_thrown_in_the_states_of_the_sound_throws() -> None:
    study = reference_study(count=3)
    places = list(places_of(study.panel))
    assert len(places) == 13
    rows = dict(zip(places, sizes_beyond(np.zeros(13)).tolist(), strict=True))
    objects = objects_study(study, rows)
    assert objects.count == 3 * 13 * 4
    with_object, without = objects.scenario(52), study.scenario(1)
    assert with_object.overrides == without.overrides
    assert with_object.foreign_objects[0].size == pytest.approx(0.7e-3)


def test_objects_of_another_kind_lie_beside_those_that_stay_as_they_are() -> None:
    study = reference_study(count=3)
    rows = dict.fromkeys(places_of(study.panel), (5e-3, 9e-3))
    usual, ice = objects_study(study, rows), objects_study(study, rows, kind="ice")
    assert usual.scenario(30).foreign_objects[0].kind == "spring"
    found = ice.scenario(30)
    assert found.foreign_objects[0].kind == "ice"
    assert found.foreign_objects[0].size == usual.scenario(30).foreign_objects[0].size
    assert found.overrides == usual.scenario(30).overrides
    assert (of_kind("objects", "ice"), of_kind("objects", "spring")) == ("objects-ice", "objects")
    given = limit_map(replace(toy_throws(), kind="ice"), Conditions(), closing=0.8)
    assert given.attrs["object_kind"] == "ice"
    title = plot_limit(given).get_suptitle()
    assert title.endswith(", ice")


def test_figure_shows_the_blade_and_the_floor() -> None:
    figure = plot_limit(toy_map())
    ax = figure.axes[0]
    assert ax.get_xlim() == (0.3, 0.6)
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert any("not touched" in text for text in named)
    assert rendered(figure, ".png").startswith(b"\x89PNG")


def test_the_edge_of_nine_of_ten_is_a90_between_places_too() -> None:
    found = toy_map()
    at = found.sel(channel="both drives")
    edges = level_sizes(at)
    np.testing.assert_array_equal(edges[LEVELS.index(0.9)], at["a90"])
    assert np.all(np.diff(edges, axis=0) >= 0.0)
    filled = {item.get_label(): item for item in plot_limit(found).axes[0].collections}
    drawn = filled["_0.9"].get_paths()[0].vertices
    for point in np.column_stack([at["x"], 1e3 * at["a90"]]):
        assert np.any(np.all(np.isclose(drawn, point), axis=1))
    assert len({round(float(value), 9) for value in drawn[:, 0]}) == at.sizes["place"]


def test_what_is_not_reached_ends_at_what_was_thrown_and_is_marked() -> None:
    found = toy_map().copy(deep=True)
    found["pod"][:, 0] = np.minimum(found["pod"][:, 0], 0.6)
    found["a90"][:, 0] = np.nan
    at = found.sel(channel="both drives")
    assert level_sizes(at)[LEVELS.index(0.9), 0] == at["largest_size"][0]
    ax = plot_limit(found).axes[0]
    marks = {line.get_label(): line for line in ax.get_lines()}
    beyond = marks["a90 beyond what was thrown"]
    assert beyond.get_xdata() == [at["x"][0]]
    assert beyond.get_ydata()[0] < ax.get_ylim()[1]


def test_places_that_lie_together_have_one_label() -> None:
    found = toy_map()
    names = ["drive 1", "drive 2", *(f"sleeper {n}" for n in range(1, 12))]
    x = np.array([0.3, 0.3, *(0.6 * n for n in range(1, 12))])
    at, joined = labels_of(x, names)
    assert joined[:2] == ["D1, D2", "1"]
    assert len(at) == len(joined) == 12
    together = found.assign_coords(x=("place", np.full(found.sizes["place"], 0.3)))
    assert rendered(plot_limit(together), ".png").startswith(b"\x89PNG")


def test_columns_of_the_screen_stand_apart(capsys: pytest.CaptureFixture[str]) -> None:
    found = limit_map(toy_throws(), Conditions(), closing=0.8)
    found["a90"] = 11.1e-3 + 0.0 * found["a90"]
    found["a90_low"], found["a90_high"] = found["a90"], np.nan * found["a90"]
    write_map(found, None, Output("limit", files={"out": None, "plot": None}))
    assert " 11.1   11.1 ... beyond  " in capsys.readouterr().out


# ---- the touch floor


def test_the_floor_touches_in_nine_of_ten_states() -> None:
    gap = np.random.default_rng(2).uniform(0.0, 0.01, (1000, 3))
    floor = touch_floor(gap)
    np.testing.assert_allclose((floor > gap).mean(axis=0), 0.9, atol=2e-3)


def test_a_closed_place_has_no_floor_and_throws_that_failed_do_not_count() -> None:
    gap = np.array([[-1e-5, 2e-3], [-2e-5, np.nan], [-1e-5, 2e-3]])
    np.testing.assert_allclose(touch_floor(gap), [0.0, 2e-3])


def test_touch_is_a_force_at_any_time() -> None:
    assert touched([0.0, 5.0, 5.5]).tolist() == [False, False, True]
