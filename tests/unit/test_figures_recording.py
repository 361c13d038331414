"""Figures of recordings, by their data."""

import numpy as np
import pytest
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.recording import MOST_ROWS, Trace, plot_columns, plot_measured


def test_columns_fill_their_axes() -> None:
    time = np.arange(100) / 100
    traces = [Trace("a", "V", time, 500 + np.sin(time)), Trace("b", "", time + 1, time)]
    figure = plot_columns(traces, title="throw.csv")
    first, second = figure.axes
    assert first.get_ylim()[0] > 499
    assert first.get_ylabel() == "a\n[V]"
    assert second.get_ylabel() == "b\n[-]"
    assert second.get_xlim() == (0.0, 1.99)
    np.testing.assert_array_equal(first.lines[0].get_ydata(), traces[0].values)


def test_more_columns_than_fit() -> None:
    trace = Trace("a", "V", np.arange(3.0), np.arange(3.0))
    figure = plot_columns([trace] * (MOST_ROWS + 3), title="x")
    assert len(figure.axes) == MOST_ROWS
    assert figure.get_suptitle() == "x (and 3 more channels)"


def test_forces_and_currents() -> None:
    time = np.arange(50) / 10
    dataset = xr.Dataset(
        {
            "drive_force": (("drive", "time"), np.stack((1000 * time, 0 * time))),
            "drive_force_unfiltered": (("drive", "time"), np.stack((1001 * time, 0 * time))),
            "drive_current": (("drive", "time"), np.stack((time, np.full(50, np.nan)))),
            "object_force": ("time", np.full(50, np.nan)),
        },
        {"time": time, "drive": ["1", "2"]},
    )
    forces, currents = plot_measured(dataset, title="x").axes
    drawn = {line.get_label(): line for line in forces.lines}
    np.testing.assert_allclose(drawn["Drive 1"].get_ydata(), time)
    assert [text.get_text() for text in forces.get_legend().get_texts()] == [
        *("Drive 1", "unfiltered", "Drive 2")
    ]
    assert [text.get_text() for text in currents.get_legend().get_texts()] == ["Drive 1"]


def test_the_power_of_a_motor_alone() -> None:
    time = np.arange(50) / 25
    dataset = xr.Dataset(
        {"drive_power": (("drive", "time"), [100.0 * time])}, {"time": time, "drive": ["1"]}
    )
    (power,) = plot_measured(dataset).axes
    assert power.get_ylabel() == "Motor power\n[W]"
    np.testing.assert_allclose(power.lines[0].get_ydata(), 100.0 * time)


def test_nothing_to_draw() -> None:
    with pytest.raises(ResponseError, match="no channels"):
        plot_columns([])
    nothing = xr.Dataset({"object_force": ("time", np.full(3, np.nan))}, {"time": np.arange(3.0)})
    with pytest.raises(ResponseError, match="no force, current or power"):
        plot_measured(nothing)
