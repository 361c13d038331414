"""Features of forces made by hand, of a simulated run, and of a campaign."""

import json

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb2_dataset

from turnout.core.errors import ResponseError
from turnout.core.moving_average import moving_average
from turnout.metric.features import FEATURES, features, movement_features

TIME = np.arange(0.0, 3.0, 1e-3)
# Friction of 300 N from 0.2 s on, from 1.5 s on a rise of 2 kN/s to 1500 N, held until the end.
EFFORT = np.interp(TIME, [0.0, 0.2, 1.5, 2.1], [0.0, 300.0, 300.0, 1500.0])
TRAVEL = np.clip(0.05 * TIME, 0.0, 0.11)


def named(values: np.ndarray) -> dict[str, float]:
    return dict(zip(FEATURES, values.tolist(), strict=True))


def run_of(effort: np.ndarray, *, closing: bool = True) -> xr.Dataset:
    sign, to = (1.0, "closed") if closing else (-1.0, "open")
    moves = [{"name": "m", "to": to, "start": 0.0, "end": 2.2}]
    return xr.Dataset(
        {
            "drive_force": (("drive", "time"), sign * effort[np.newaxis]),
            "drive_displacement": (("drive", "time"), sign * TRAVEL[np.newaxis]),
        },
        {"time": TIME, "drive": ["1"], "saturation_force": ("drive", [1400.0])},
        {"movements": json.dumps(moves)},
    )


def test_a_rise_made_by_hand() -> None:
    found = named(movement_features(TIME, EFFORT, travel=TRAVEL, limit=1400.0))
    assert found["plateau_force"] == pytest.approx(300.0)
    assert found["buildup_onset"] == pytest.approx(1.5 + 120.0 / 2000.0, abs=2e-3)
    assert found["buildup_slope"] == pytest.approx(2000.0, rel=0.01)
    assert found["peak_force"] == pytest.approx(1500.0)
    assert found["peak_time"] == pytest.approx(2.1)
    assert found["end_force"] == pytest.approx(1500.0)
    assert found["duration"] == pytest.approx(2.2, abs=2e-3)
    assert found["slip_time"] == pytest.approx(2.05, abs=2e-3)
    # 0.1 s until 300 N are reached, held, the rise, held until the marker rests: at 50 mm/s
    work = 0.05 * (0.5 * 0.2 * 300 + 1.3 * 300 + 0.6 * 900 + 0.1 * 1500)
    assert found["marker_work"] == pytest.approx(work, rel=2e-3)


def test_vibration_is_that_about_a_mean_that_may_rise() -> None:
    """Of a swing of 5 Hz the mean over 0.3 s takes sin(pi 1.5) / (pi 1.5), of a rise all of it."""
    swing = 100.0 * TIME + 40.0 * np.sin(2 * np.pi * 5.0 * TIME)
    found = named(movement_features(TIME, swing, length=2.0))
    assert found["vibration"] == pytest.approx(
        40.0 / np.sqrt(2) * (1 + 1 / (1.5 * np.pi)), rel=0.01
    )
    assert named(movement_features(TIME, 100.0 * TIME, length=2.0))["vibration"] < 1e-9


@pytest.mark.parametrize("closing", [True, False])
def test_effort_counts_in_the_direction_of_the_movement(closing: bool) -> None:
    found = features(run_of(EFFORT, closing=closing)).sel(drive="1")
    mine, other = ("closing", "opening") if closing else ("opening", "closing")
    expected = movement_features(TIME, EFFORT, travel=TRAVEL, limit=1400.0)
    for number, name in enumerate(FEATURES):
        assert float(found[name].sel(direction=mine)) == pytest.approx(expected[number]), name
        assert np.isnan(found[name].sel(direction=other)), name


def test_friction_alone_does_not_build_up() -> None:
    found = named(movement_features(TIME, np.minimum(EFFORT, 300.0), travel=TRAVEL))
    assert np.isnan(found["buildup_onset"])
    assert np.isnan(found["buildup_slope"])
    assert np.isnan(found["slip_time"])
    assert found["peak_force"] == pytest.approx(300.0)


def test_without_markers_the_motor_tells_when_a_drive_has_arrived() -> None:
    current = np.where(TIME < 1.9, 2.0, 0.0)
    found = named(movement_features(TIME, EFFORT, current=current))
    assert found["duration"] == pytest.approx(1.9, abs=2e-3)
    assert np.isnan(found["marker_work"])
    assert np.isnan(movement_features(TIME[:2], EFFORT[:2])).all()


def test_a_campaign_has_the_features_of_its_movements() -> None:
    padded = np.concatenate((np.zeros(100), EFFORT, np.full(50, np.nan)))
    time = (np.arange(padded.size) - 100) * 1e-3
    campaign = xr.Dataset(
        {"drive_force": (("movement", "drive", "time"), np.stack([[padded], [-padded]]))},
        {
            "time": time,
            "drive": ["2"],
            "movement": ["a", "b"],
            "direction": ("movement", ["closing", "opening"]),
        },
    )
    found = features(campaign)
    assert found["peak_force"].dims == ("movement", "drive")
    np.testing.assert_allclose(found["peak_force"].values, 1500.0)
    np.testing.assert_allclose(found["peak_time"].values, 2.1, atol=1e-9)


def test_a_trapped_object_shows_in_the_drive_behind_it() -> None:
    found = features(sb2_dataset()).sel(direction="closing")
    run = sb2_dataset()
    after = run["drive_force"].sel(time=slice(4.4, None))
    np.testing.assert_allclose(found["peak_force"].values, after.max("time").values, rtol=1e-12)
    assert (found["buildup_slope"].sel(drive="2") > 0).all()


@pytest.mark.parametrize(
    ("dataset", "words"),
    [
        (xr.Dataset(), "no drive_force"),
        (run_of(EFFORT).drop_attrs(), "names no movement"),
    ],
)
def test_what_has_no_features_is_refused(dataset: xr.Dataset, words: str) -> None:
    with pytest.raises(ResponseError, match=words):
        features(dataset)


@pytest.mark.parametrize(("sign", "braking"), [(1.0, 0.0), (-1.0, 0.0), (-1.0, 9.0), (1.0, 9.0)])
def test_noise_of_a_standing_motor_is_no_motion(sign: float, braking: float) -> None:
    """A clamp with 10 mA of noise and a zero 5 mA off; an opening drive may be counted negative."""
    noise = 0.005 + 0.01 * np.random.default_rng(3).standard_normal(TIME.size)
    after = braking * np.exp(-np.clip(TIME - 1.9, 0.0, None) / 0.02)
    current = sign * np.where(TIME < 1.9, 1.1, -after) + noise
    found = named(movement_features(TIME, EFFORT, current=current))
    assert found["duration"] == pytest.approx(1.9, abs=2e-3)
    still = named(movement_features(TIME, EFFORT, current=noise))
    assert np.isnan(still["duration"])


def test_the_throw_time_of_a_campaign_is_that_of_the_unfiltered_current() -> None:
    time = np.arange(-1.0, 4.0, 0.005)
    raw = np.where((time > 0.0) & (time < 3.3), 1.1, 0.0)
    raw[(time >= 3.3) & (time < 3.35)] = -9.0
    noise = 0.01 * np.random.default_rng(4).standard_normal(time.size)
    rows = {
        "drive_force": np.interp(time, [0.0, 0.3, 3.3], [0.0, 500.0, 900.0]),
        "drive_current": moving_average(raw + noise, rate=200.0),
        "drive_current_unfiltered": raw + noise,
    }
    campaign = xr.Dataset(
        {name: (("movement", "drive", "time"), row[None, None]) for name, row in rows.items()},
        {"time": time, "drive": ["1"], "movement": ["a"], "direction": ("movement", ["closing"])},
    )
    assert float(features(campaign)["duration"][0, 0]) == pytest.approx(3.3, abs=6e-3)
    filtered = features(campaign.drop_vars("drive_current_unfiltered"))
    assert float(filtered["duration"][0, 0]) == pytest.approx(3.3, abs=0.06)


def test_a_wound_clutch_that_turns_the_motor_back_is_no_motion() -> None:
    """After the cut-off -8 A brake the motor, then the clutch turns it back: +0.7 A for 30 ms."""
    wound, driven_back = (np.where(TIME < 1.9, 1.1, 0.0) for _ in range(2))
    wound[(TIME >= 1.9) & (TIME < 1.95)], wound[(TIME >= 1.95) & (TIME < 1.98)] = -8.0, 0.7
    driven_back[(TIME >= 0.3) & (TIME < 0.6)] = 0.4
    for current in (wound, driven_back):
        found = named(movement_features(TIME, EFFORT, current=current))
        assert found["duration"] == pytest.approx(1.9, abs=2e-3)


@pytest.mark.parametrize("count", [3, 9, 1063])
def test_work_is_that_of_the_trapezoidal_rule(count: int) -> None:
    effort, travel = np.random.default_rng(count).normal(size=(2, 3, count))
    found = np.array(
        [
            named(movement_features(np.arange(count), e, travel=t))["marker_work"]
            for e, t in zip(effort, travel, strict=True)
        ]
    )
    np.testing.assert_allclose(found, np.trapezoid(effort, travel, axis=1), rtol=1e-13)


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "i4"])
def test_numbers_of_any_type_are_taken(dtype: str) -> None:
    """A recorder's are often in single precision, a file's in another order of bytes."""
    effort = np.round(EFFORT).astype(dtype)
    effort.flags.writeable = False
    found = features(run_of(effort)).sel(drive="1", direction="closing")
    wanted = features(run_of(np.round(EFFORT))).sel(drive="1", direction="closing")
    for name in FEATURES:
        assert float(found[name]) == pytest.approx(float(wanted[name]), nan_ok=True), name


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("count", [5, 8, 14, 300])
def test_instants_are_those_of_a_plain_search(missing: bool, count: int) -> None:
    random = np.random.default_rng(3)
    time = 0.01 * np.arange(count)
    effort = 40.0 * random.normal(size=(8, time.size)).cumsum(axis=1)
    travel = np.minimum(1e-3 * random.random(effort.shape).cumsum(axis=1), 0.1)
    if missing:
        effort[random.random(effort.shape) < 0.02] = np.nan
        effort[0, 3], effort[1] = np.inf, np.nan
    for row, path in zip(effort, travel, strict=True):
        found = named(movement_features(time, row, travel=path, limit=300.0))
        if not np.isfinite(row).any():
            assert all(np.isnan(value) for value in found.values())
            continue
        expected = plainly(time, row, path)
        assert {name: found[name] for name in expected} == pytest.approx(expected, nan_ok=True)


def plainly(time: np.ndarray, effort: np.ndarray, travel: np.ndarray) -> dict[str, float]:
    known = [n for n in range(time.size) if np.isfinite(effort[n])]
    at = max(known, key=lambda n: effort[n])
    moving = [n for n in range(time.size) if abs(travel[n] - travel[-1]) > 1e-9]
    duration = time[min(moving[-1] + 1, time.size - 1)] if moving else 0.0
    middle = effort[(time >= 0.25 * duration) & (time < 0.75 * duration)]
    plateau = np.median(middle) if middle.size else np.nan
    slips = [n for n in range(time.size) if effort[n] >= 300.0]
    smooth = moving_average(effort, rate=100.0)
    top = int(np.argmax(smooth))
    rise = smooth[top] - plateau
    below = [n for n in range(top + 1) if smooth[n] <= plateau + 0.1 * rise]
    onset = slope = np.nan
    if rise >= 50.0 and below:
        first = below[-1]
        last = next(n for n in range(first, top + 1) if smooth[n] >= plateau + 0.9 * rise)
        onset, slope = time[first], (smooth[last] - smooth[first]) / (time[last] - time[first])
    return {
        "buildup_onset": onset,
        "buildup_slope": slope,
        "peak_force": effort[at],
        "peak_time": time[at],
        "plateau_force": plateau,
        "duration": duration,
        "slip_time": time[slips[0]] if slips else np.nan,
    }
