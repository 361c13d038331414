"""The figure of modes, by its data."""

import numpy as np
import pytest
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.modes import AMPLITUDE, plot_modes
from turnout.metric.modes import modes
from turnout.panel.load import load_panel


@pytest.fixture(scope="module")
def found() -> xr.Dataset:
    return modes(load_panel("uic60-760-1-15-symmetric"), count=3)


def test_panel_is_drawn_mode_by_mode(found: xr.Dataset) -> None:
    figure = plot_modes(found)
    plan, elevation = figure.axes
    assert "feet free to slide" in figure.get_suptitle()
    assert [label.get_text().split(":")[0] for label in plan.get_yticklabels()] == ["1", "2", "3"]
    foot = next(line for line in plan.lines if line.get_label() == "curved")
    first = found.isel(mode=found["system"].values == "panel at rest, feet free to slide").isel(
        mode=0
    )
    expected = AMPLITUDE * first["shape"].sel(rail="curved", direction="uy").dropna("x").values
    np.testing.assert_allclose(foot.get_ydata(), expected)
    assert np.abs(foot.get_ydata()).max() == pytest.approx(AMPLITUDE, rel=1e-3)
    assert len(elevation.lines) == 3 * (1 + 2)
    assert elevation.get_legend() is None
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["straight", "curved"]


def test_rail_alone_is_drawn_alone_on_given_axes(found: xr.Dataset) -> None:
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots(1, 2)
    assert plot_modes(found, system="rail curved, feet free", ax=list(axes)) is figure
    labels = {line.get_label() for line in axes[0].lines}
    assert "curved" in labels
    assert "straight" not in labels


def test_unknown_system_is_refused_with_those_there_are(found: xr.Dataset) -> None:
    with pytest.raises(ResponseError, match="rail curved, on its chairs"):
        plot_modes(found, system="rail C")
