"""Scatter of repeats, and sizes from which on objects are detected, on campaigns made by hand."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import t as student

from turnout.metric.campaign_statistics import (
    FALSE_ALARM_RATE,
    RepeatScatter,
    end_values,
    object_places,
    place_sizes,
    repeat_scatter,
)

FREE = (3500.0, 3520.0, 3480.0, 3510.0, 3490.0)


def campaign(
    *objects: tuple[str, float, float, bool], free: tuple[float, ...] = FREE
) -> xr.Dataset:
    """Return closing movements: place, size, end force of Drive 2 and whether it slipped."""
    rows = [("none", 0.0, force, False) for force in free] + list(objects)
    place, size, force, slipped = zip(*rows, strict=True)
    time = np.arange(0.0, 1.0, 0.01)
    values = np.array(force)[:, None, None] * np.ones((1, 1, time.size))
    return xr.Dataset(
        {"drive_force": (("movement", "drive", "time"), values)},
        {
            "time": time,
            "drive": ["2"],
            "movement": [str(number) for number in range(len(rows))],
            "direction": ("movement", ["closing"] * len(rows)),
            "place": ("movement", list(place)),
            "size": ("movement", list(size)),
            "slipped": ("movement", list(slipped)),
        },
    )


def test_scatter_is_that_of_throws_without_an_object() -> None:
    (drive,) = repeat_scatter(campaign(("sleeper 6", 0.031, 6000.0, True)), direction="closing")
    assert (drive.mean, drive.count) == (3500.0, 5)
    assert drive.deviation == pytest.approx(np.std(FREE, ddof=1))


def test_one_more_throw_lies_within_reach_as_often_as_it_says() -> None:
    rng = np.random.default_rng(7)
    draws = rng.normal(3500.0, 20.0, size=(4000, 6))
    # Taken back to where one in twenty lies beyond, so that 4000 draws suffice.
    usual = student.ppf(0.95, 4) / student.ppf(1 - FALSE_ALARM_RATE, 4)
    known = [RepeatScatter("2", draw[:5].mean(), draw[:5].std(ddof=1), 5) for draw in draws]
    beyond = [
        draw[5] > drive.mean + usual * drive.threshold
        for draw, drive in zip(draws, known, strict=True)
    ]
    assert np.mean(beyond) == pytest.approx(0.05, abs=0.012)


def test_one_throw_without_an_object_tells_nothing() -> None:
    dataset = campaign(("sleeper 6", 0.031, 6000.0, True), free=(3500.0,))
    assert np.isnan(repeat_scatter(dataset, direction="closing")[0].threshold)
    (place,) = place_sizes(dataset, direction="closing")
    assert np.isnan(place.detectable)
    assert place.slipped == 0.031


def test_two_throws_without_an_object_are_too_few_to_decide() -> None:
    """5.2 to 6.0 kN against 3.53 +- 0.085 kN was called not detected."""
    dataset = campaign(
        ("sleeper 6", 0.013, 5200.0, False),
        ("sleeper 6", 0.021, 6000.0, False),
        ("drive 1", 0.013, 3500.0, False),
        free=(3470.0, 3590.0),
    )
    six, one = place_sizes(dataset, direction="closing")
    assert np.isnan(six.detectable)
    assert six.undecided == 0.013
    assert np.isnan(one.undecided)


def test_reported_is_where_every_larger_object_is_reported_too() -> None:
    dataset = campaign(
        ("sleeper 6", 0.005, 3700.0, False),  # by chance
        ("sleeper 6", 0.010, 3505.0, False),
        ("sleeper 6", 0.013, 4300.0, False),
        ("sleeper 6", 0.031, 6000.0, True),
        ("drive 1", 0.013, 3000.0, False),  # less force is no object
    )
    six, one = place_sizes(dataset, direction="closing")
    assert (six.place, six.smallest, six.largest) == ("sleeper 6", 0.005, 0.031)
    assert (six.detectable, six.slipped) == (0.013, 0.031)
    assert np.isnan(one.detectable)
    assert np.isnan(one.slipped)
    assert place_sizes(dataset, direction="opening") == []


def test_places_come_in_the_order_of_the_campaign() -> None:
    dataset = campaign(("sleeper 6", 0.01, 1.0, False), ("drive 1", 0.01, 1.0, False))
    assert object_places(dataset) == ["sleeper 6", "drive 1"]
    assert end_values(dataset["drive_force"].sel(drive="2")).tolist() == [*FREE, 1.0, 1.0]
