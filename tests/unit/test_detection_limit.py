"""The map of what can be seen, from throws to figure."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.detection_throws import toy_throws

from turnout.detection.limit.limit_map import limit_map, rows_of, size_weights, smallest_seen
from turnout.detection.reference import Conditions, reference_study
from turnout.detection.throws import objects_study, of_kind, places_of, sizes_beyond
from turnout.plot.limit import plot_limit
from turnout.plot.style import rendered


def a90(**conditions: object) -> np.ndarray:
    found = limit_map(toy_throws(), Conditions(**conditions), closing=0.8)  # type: ignore[arg-type]
    return found["a90"].sel(channel="both drives").to_numpy()


def test_what_is_not_touched_is_detected_at_the_rate_of_false_alarms() -> None:
    found = limit_map(toy_throws(), Conditions(), closing=0.8)
    below = found["pod"].sel(place="sleeper 1", channel="both drives").sel(size=slice(0, 0.9e-3))
    np.testing.assert_allclose(below, 1e-3, rtol=1e-9)


def test_probability_grows_with_the_size_and_with_a_second_drive() -> None:
    found = limit_map(toy_throws(), Conditions(), closing=0.8)
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
    figure = plot_limit(limit_map(toy_throws(), Conditions(), closing=0.8))
    ax = figure.axes[0]
    assert ax.get_xlim() == (0.3, 0.6)
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert any("not touched" in text for text in named)
    assert rendered(figure, ".png").startswith(b"\x89PNG")
