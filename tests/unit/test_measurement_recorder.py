"""What a recorder makes of forces, against closed forms and an independent solution."""

import numpy as np
import pytest
from scipy.signal import bessel, butter, lsim

from turnout.core.errors import MeasurementError
from turnout.core.toml import parse_toml
from turnout.measurement.chain.apply import map_hash, parse_channel_map
from turnout.measurement.chain.channel_map import ChannelMap
from turnout.measurement.chain.recorder import (
    LowPass,
    Recorder,
    between_samples,
    low_passed,
    stated_recorder,
)

TIME = np.arange(4000) * 1e-3
MAP = '[drive_force.1]\ncolumn = "Rod 1"\nkind = "scaled"\n'


def step(at: float) -> np.ndarray:
    return 5.0 + 2.0 * (at <= TIME)


def test_a_step_through_one_pole_is_an_exponential() -> None:
    T, h = 1.0 / (2.0 * np.pi * 6.0), 1e-3
    seen = low_passed(TIME, step(1.0), LowPass(kind="rc", order=1, corner=6.0))
    # The step is a line from one sample to the next.
    late = TIME - 1.0 + h
    after = late >= h - 1e-9
    rising = T / h * (np.exp(h / T) - 1.0)
    exact = np.where(after, 7.0 - 2.0 * rising * np.exp(-late / T), 5.0)
    np.testing.assert_allclose(seen, exact, rtol=1e-12)


def test_a_step_through_a_butterworth_filter_of_two_poles() -> None:
    w = 2.0 * np.pi * 6.0 / np.sqrt(2.0)
    seen = low_passed(TIME, step(1.0), LowPass(corner=6.0))
    late = np.maximum(TIME - 0.9995, 0.0)
    exact = 7.0 - 2.0 * np.exp(-w * late) * (np.cos(w * late) + np.sin(w * late))
    np.testing.assert_allclose(seen, exact, atol=1e-3)
    # The overshoot of two poles at 45 degrees.
    assert seen.max() - 7.0 == pytest.approx(2.0 * np.exp(-np.pi), rel=5e-4)


@pytest.mark.parametrize(("kind", "order"), [("butterworth", 2), ("butterworth", 4), ("rc", 1)])
def test_at_the_corner_amplitude_and_phase_are_those_of_the_filter(kind: str, order: int) -> None:
    """The phase at the corner is 45 degrees a pole."""
    time = np.arange(20_000) * 1e-3
    seen = low_passed(
        time, np.sin(2 * np.pi * 2.0 * time), LowPass(kind=kind, order=order, corner=2.0)
    )
    settled = slice(10_000, 20_000)
    lag = 2 * np.pi * 2.0 * time[settled] - order * np.pi / 4.0
    np.testing.assert_allclose(seen[settled], np.sqrt(0.5) * np.sin(lag), atol=2e-5)


def test_a_ramp_lags_by_the_delay_at_rest() -> None:
    """sqrt(2) over the angular corner for two poles of Butterworth, one over it for one pole."""
    for low_pass, delay in (
        (LowPass(corner=3.0), np.sqrt(2.0)),
        (LowPass(kind="rc", order=1, corner=3.0), 1.0),
    ):
        seen = low_passed(TIME, TIME, low_pass)
        assert TIME[-1] - seen[-1] == pytest.approx(delay / (2.0 * np.pi * 3.0), rel=1e-6)


@pytest.mark.parametrize("order", [1, 2, 5, 8])
@pytest.mark.parametrize(("kind", "made"), [("butterworth", butter), ("bessel", bessel)])
def test_any_signal_goes_through_as_an_independent_solution_says(kind, made, order) -> None:
    values = np.cumsum(np.random.default_rng(order).standard_normal(400))
    values -= values[0]
    time = np.arange(400) * 4e-3
    more = {"norm": "mag"} if made is bessel else {}
    system = made(order, 2 * np.pi * 6.0, analog=True, **more)
    _, expected, _ = lsim(system, values, time)
    seen = low_passed(time, values + 300.0, LowPass(kind=kind, order=order, corner=6.0))
    np.testing.assert_allclose(seen, expected + 300.0, atol=1e-6 * np.ptp(values))


def test_a_corner_far_above_the_samples_changes_nothing() -> None:
    values = np.sin(TIME)
    for kind, order in (("butterworth", 8), ("bessel", 8), ("rc", 1)):
        seen = low_passed(TIME, values, LowPass(kind=kind, order=order, corner=1e5))
        np.testing.assert_allclose(seen, values, atol=1e-5)


def test_lines_between_samples_are_those_of_all_phases() -> None:
    """A parabola between samples T apart lies T^2 / 6 too high in the mean: F'' T^2 / 12."""
    rate = 20.0
    seen = between_samples(TIME, TIME**2, rate)
    inner = slice(200, 3800)
    # At its end the signal is taken as constant: nothing lies above it there.
    assert seen[-1] < TIME[-1] ** 2
    assert between_samples(TIME, step(1.0), rate)[-1] == pytest.approx(7.0)
    np.testing.assert_allclose(seen[inner] - TIME[inner] ** 2, 1.0 / rate**2 / 6.0, rtol=1e-3)
    force = np.exp(np.sin(3.0 * TIME))
    lines = [
        np.interp(TIME, at, np.interp(at, TIME, force))
        for phase in np.arange(50)
        for at in [np.arange(1e-3 * phase, TIME[-1], 1.0 / rate)]
    ]
    np.testing.assert_allclose(
        between_samples(TIME, force, rate)[inner], np.mean(lines, axis=0)[inner], atol=1e-4
    )


@pytest.mark.parametrize("rate", [20.0, 50.0, 57.0])
def test_samples_as_far_apart_as_those_of_a_fit_are_not_smoothed_further(rate: float) -> None:
    """A recorder of 50 samples a second was found as one of 57: lines between 4 ms smooth too."""
    time = np.arange(1000) * 4e-3
    late = slice(500, 900)
    recorder = Recorder(low_pass=LowPass(corner=6.0), rate=rate)
    # Two poles of Butterworth only delay a parabola, lines between samples T apart lift it.
    delayed = 0.5 * (time - np.sqrt(2.0) / (2.0 * np.pi * 6.0)) ** 2
    lifted = recorder.applied(time, 0.5 * time**2) - delayed
    np.testing.assert_allclose(lifted[late], 1.0 / rate**2 / 12.0, rtol=0.01)


@pytest.mark.parametrize("average", [0.02, 0.0225])
def test_a_mean_over_the_past_of_a_parabola_is_exact_between_samples_too(average: float) -> None:
    time = np.arange(1000) * 4e-3
    seen = Recorder(average=average).applied(time, 0.5 * time**2)
    exact = (time**3 - (time - average) ** 3) / (6.0 * average)
    np.testing.assert_allclose(seen[10:], exact[10:], rtol=1e-9)


RESPONSES = [Recorder(average=0.02), Recorder(rate=50.0), Recorder(rate=100.0)]


@pytest.mark.parametrize("recorder", RESPONSES)
def test_a_step_does_not_ring(recorder: Recorder) -> None:
    """A spline through a step of 4000 N behind an RC of 40 Hz went to -42 N before it."""
    time = np.arange(1000) * 4e-3
    rc = LowPass(kind="rc", order=1, corner=40.0)
    for values in (4e3 * (time >= 2.0), low_passed(time, 4e3 * (time >= 2.0), rc)):
        seen = recorder.applied(time, values)
        assert seen.min() >= -1e-6
        assert seen.max() <= 4e3 + 1e-6


@pytest.mark.parametrize(
    "recorder", [*RESPONSES, Recorder(average=0.02, low_pass=LowPass(corner=6.0))]
)
def test_what_follows_a_missing_sample_is_missing_and_what_lies_before_is_not(
    recorder: Recorder,
) -> None:
    time = np.arange(200) * 4e-3
    values = np.sin(9.0 * time)
    whole, lost = recorder.applied(time, values), values.copy()
    lost[100] = np.nan
    seen = recorder.applied(time, lost)
    assert np.isnan(seen[100:]).all()
    # Lines between samples look ahead by their interval.
    np.testing.assert_allclose(seen[:94], whole[:94], atol=2e-3)
    assert np.isnan(Recorder(average=0.02, rate=50.0).recorded(time, lost)[105:]).all()
    for first in (0, 1):
        lost[first] = np.nan
        assert np.isnan(recorder.applied(time, lost)[first:]).all()


def mapped(text: str) -> ChannelMap:
    return parse_channel_map(parse_toml(text + MAP, source="map"))


def test_what_the_map_states_is_what_a_dataset_says() -> None:
    whole = mapped(
        'recorded_average = "20 ms"\nrecorded_rate = "25 Hz"\n'
        'recorded_filter = { kind = "rc", corner = "6 Hz" }\n'
    )
    stated = whole.recorder()
    assert stated == Recorder(
        low_pass=LowPass(kind="rc", order=1, corner=6.0), average=0.02, rate=25.0
    )
    assert stated_recorder(stated.attributes()) == stated
    assert "an RC low-pass of order 1 at 6 Hz" in stated.text
    plain = mapped("")
    assert not plain.recorder()
    assert plain.recorder().attributes() == {}
    # Campaigns that state nothing are not read again.
    assert map_hash(plain) != map_hash(whole)
    # Samples as close as these change nothing.
    assert not mapped('recorded_rate = "1 kHz"\n').recorder()


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ('recorded_filter = { kind = "cheby", corner = "6 Hz" }', "recorded_filter.kind"),
        ('recorded_filter = { corner = "6" }', "recorded_filter.corner"),
        ('recorded_filter = { corner = "-6 Hz" }', "recorded_filter.corner"),
        ("recorded_filter = { order = 2 }", "recorded_filter.corner"),
        ('recorded_filter = { order = 9, corner = "6 Hz" }', "recorded_filter.order"),
        ('recorded_filter = { kind = "rc", order = 2, corner = "6 Hz" }', "one pole"),
        ('recorded_filter = { corner = "6 Hz", poles = 2 }', "poles"),
        ('recorded_filter = "6 Hz"', "recorded_filter"),
        ('recorded_rate = "20 s"', "recorded_rate"),
        ('recorded_rate = "0 Hz"', "recorded_rate"),
        ('recorded_average = "1 us"', "recorded_average"),
        ("clock_uncertainty = 2", "a share: 0.02 for 2 %"),
        ('clock_uncertainty = "10 ppm"', "1e-5 for 10 ppm"),
        ("gain_uncertainty = 0.01", "into the table of a channel"),
        # In the wrong table it says where it belongs.
        (f'{MAP}recorded_average = "0.1 s"', "above the first table"),
        (f"{MAP}gain_uncertainty = 2", "a share: 0.02 for 2 %"),
        (
            '[drive_current.1]\ncolumn = "C"\nkind = "scaled"\ngain_uncertainty = 0.1',
            "force channels",
        ),
    ],
)
def test_what_no_recorder_does_is_refused_by_name(line: str, match: str) -> None:
    rest = "" if line.startswith(MAP) else MAP
    with pytest.raises(MeasurementError, match=match):
        parse_channel_map(parse_toml(f"{line}\n{rest}", source="map"))
