"""Channels made of samples with times: even, rounded, with holes, and not even at all."""

import numpy as np
import pytest

from turnout.core.errors import MeasurementError
from turnout.measurement.recording import RecordedChannel, Recording, on_grid, time_grid


def channel_of(values: np.ndarray) -> RecordedChannel:
    return RecordedChannel("a", "", values, rate=0.0)


@pytest.mark.parametrize(("decimals", "rate"), [(9, 1000.0), (3, 1000.0), (4, 3000.0)])
def test_a_rounded_time_column_is_even(decimals: int, rate: float) -> None:
    time = np.round(5.0 + np.arange(10_000) / rate, decimals)
    channel, problem = on_grid(time_grid(time), channel_of(np.arange(10_000.0)))
    assert problem == ""
    assert channel.rate == pytest.approx(rate, rel=1e-4)
    assert channel.start == 5.0
    np.testing.assert_array_equal(channel.values, np.arange(10_000.0))


def test_times_coarser_than_the_samples_tell_no_rate() -> None:
    with pytest.raises(ValueError, match="5117 of its 10000 times repeat, the first is 0 s"):
        time_grid(np.round(np.arange(10_000) / 2048, 3))


@pytest.mark.parametrize("lost", [[1], [5000], [9998], [40, 41, 42, 7000]])
def test_missing_samples_become_nan(lost: list[int]) -> None:
    time = np.delete(np.arange(10_000) / 1000, lost)
    channel, problem = on_grid(time_grid(time), channel_of(time.copy()))
    assert np.flatnonzero(np.isnan(channel.values)).tolist() == lost
    assert channel.values.size == 10_000
    assert channel.rate == pytest.approx(1000, rel=1e-9)
    assert f"at {lost[0] / 1000:.6g} s" in problem
    assert problem.startswith(f"{len(lost)} sample")


@pytest.mark.parametrize("count", [5, 6, 8, 10, 11, 15])
def test_missing_samples_of_a_short_channel(count: int) -> None:
    lost = count // 2
    time = np.delete(np.round(np.arange(count) * 0.04, 2), lost)
    channel, problem = on_grid(time_grid(time), channel_of(time.copy()))
    assert channel.rate == pytest.approx(25.0)
    assert np.flatnonzero(np.isnan(channel.values)).tolist() == [lost]
    assert problem == f"1 sample is missing at {lost * 0.04:.6g} s"


def test_rounded_times_have_the_step_of_a_whole_rate() -> None:
    time = np.array([0.0, 1.0, 3.0, 4.0, 6.0, 7.0, 9.0, 10.0]) / 1e3  # 2 in 3 ms
    assert time_grid(time).step == pytest.approx(1.0 / 700, rel=2e-3)
    assert time_grid(np.round(np.arange(60) / 30, 2)).step == pytest.approx(1.0 / 30)


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ([0.0], "at least 2 samples"),
        ([0.0, np.nan, 0.2], "time of sample 2 is no number"),
        ([0.0, 0.2, 0.1], "goes from 0.2 to 0.1 s"),
        ([0.0, 0.0, 0.0], "2 of its 3 times repeat"),
        ([0.0, 1e-320, 2e-320], "no sample rate"),
        ([0.0, 0.04, 0.12], "it jumps from 0.04 to 0.12 s"),
        ([0.0, 0.04, 0.16], "it jumps from 0.04 to 0.16 s"),
        ([0.0, 0.001, 0.002, 0.004, 0.005], "samples may be missing or times are rounded"),
        ([0.0, 0.1, 0.2, 90.0], "jumps from 0.2 to 90 s"),
        ([0.0, 0.1, 0.11, 0.12, 0.22, 0.32, 0.42, 0.52, 0.62], "less than a step"),
    ],
)
def test_times_that_are_no_grid(time: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        time_grid(np.array(time))


def test_a_channel_that_is_not_there() -> None:
    channel = RecordedChannel("Rod 1", "mV/V", np.zeros(5), rate=10.0, start=1.0)
    assert channel.duration == 0.5
    assert channel.time[-1] == pytest.approx(1.4)
    recording = Recording({"Rod 1": channel}, "throw.csv")
    with pytest.raises(
        MeasurementError, match=r"throw.csv: 1 problem\n.*'rod1'; nearest is 'Rod 1'"
    ):
        recording.channel("rod1")
