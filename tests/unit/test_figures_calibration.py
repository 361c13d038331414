"""The figure of a grid search holds the measurement and the tried values."""

import numpy as np
import xarray as xr

from turnout.figures.calibration import plot_sweep

TIME = np.linspace(0.0, 3.0, 31)


def curves(count: int) -> xr.Dataset:
    values = np.linspace(1e3, 2e3, count)
    forces = values[:, None, None] * np.ones((1, 2, 1)) * TIME
    return xr.Dataset(
        {
            "measured_drive_force": (("drive", "time"), 1500.0 * np.ones((2, 1)) * TIME),
            "drive_force": (("value", "drive", "time"), forces),
            "misfit": ("value", np.abs(values - 1.5e3)),
        },
        {"time": TIME, "drive": ["1", "2"], "value": values},
        {"parameter": "drive.1.stiffness", "unit": "N/m", "movement": "a (closing, no object)"},
    )


def test_measured_and_simulated_lines_are_in_kilonewtons() -> None:
    figure = plot_sweep(curves(3))
    first = figure.axes[0].get_lines()
    np.testing.assert_allclose(first[0].get_ydata(), 1.5 * TIME)
    assert [line.get_label() for line in first[:4]] == [
        "measured",
        "1 kN/m",
        "1.5 kN/m (best)",
        "2 kN/m",
    ]


def test_of_many_values_the_best_and_the_ends_are_drawn() -> None:
    labels = [line.get_label() for line in plot_sweep(curves(11)).axes[0].get_lines()]
    assert "1.5 kN/m (best)" in labels
    assert {"1 kN/m", "2 kN/m"} <= set(labels)
    assert len([text for text in labels if text.endswith(("kN/m", "(best)"))]) <= 5
