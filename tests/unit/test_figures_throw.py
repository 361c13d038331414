"""The figure of a throw, tested by the data that it shows."""

import json

import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tests.unit.simulated import sb1_dataset, sb2_dataset

from turnout.core.errors import FileError, ResponseError
from turnout.figures.style import COLOURS, COMPARED, SHADE, rendered, title_of
from turnout.figures.throw import plot_throw


@pytest.fixture(scope="module")
def figure() -> Figure:
    return plot_throw(sb2_dataset())


def lines(ax: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {
        str(line.get_label()): (np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
        for line in ax.lines
        if not str(line.get_label()).startswith("_")
    }


def test_curves_are_the_channels_in_kilonewtons_and_millimetres(figure: Figure) -> None:
    dataset = sb2_dataset()
    objects, forces, markers, gaps = (lines(ax) for ax in figure.axes)
    np.testing.assert_allclose(objects["Object"][1], dataset["object_force"] / 1e3)
    second = dataset.sel(drive="2")
    np.testing.assert_allclose(forces["Drive 2"][1], second["drive_force"] / 1e3)
    np.testing.assert_allclose(markers["Drive 2"][1], second["drive_displacement"] * 1e3)
    np.testing.assert_allclose(gaps["TKK1"][1], dataset["sensor_gap"].sel(sensor="TKK1") * 1e3)
    np.testing.assert_array_equal(forces["Drive 1"][0], dataset["time"])


def test_a_gap_is_torn_where_the_closing_rail_changes(figure: Figure) -> None:
    shown = lines(figure.axes[3])["Drive 2\n(closing rail)"][1]
    values = sb2_dataset()["drive_gap"].sel(drive="2").values * 1e3
    torn = np.isnan(shown)
    assert np.flatnonzero(torn).tolist() == [200, 4400]
    np.testing.assert_allclose(shown[~torn], values[~torn])
    assert np.abs(np.diff(values)).max() > 50.0, "the jump that would be drawn"
    assert np.nanmax(np.abs(np.diff(shown))) < 1.0


def test_saturation_contact_and_movements_are_marked(figure: Figure) -> None:
    objects, forces = figure.axes[:2]
    levels = [float(np.asarray(line.get_ydata())[0]) for line in forces.lines if _level(line)]
    assert {-6.0, 6.0} <= set(levels)
    contact = float(sb2_dataset()["contact_time"])
    assert any(list(line.get_xdata()) == [contact, contact] for line in objects.lines)
    shaded = [patch for patch in forces.patches if patch.get_facecolor()[0] == float(SHADE)]
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in shaded]  # type: ignore[attr-defined]
    np.testing.assert_allclose(spans, [(0.2, 3.4), (4.4, 7.8)])


def _level(line: object) -> bool:
    values = np.asarray(line.get_ydata())  # type: ignore[attr-defined]
    return values.size == 2 and bool(values[0] == values[1])


def test_a_slip_is_marked_where_it_begins() -> None:
    dataset = sb2_dataset().copy(deep=True)
    dataset["drive_slipping"].loc[{"drive": "2"}] = dataset["time"].values >= 7.5
    forces = lines(plot_throw(dataset).axes[1])
    x, y = forces["Slip begins"]
    expected = dataset["drive_force"].sel(drive="2").sel(time=7.5, method="nearest") / 1e3
    assert x.tolist() == [7.5]
    assert y.tolist() == [pytest.approx(float(expected))]
    assert "Slip begins" not in lines(plot_throw(sb2_dataset()).axes[1])


def test_drives_differ_in_colour_and_in_dashes(figure: Figure) -> None:
    first, second = (
        line for line in figure.axes[1].lines if str(line.get_label()).startswith("Drive")
    )
    assert first.get_color() == COLOURS[0] != second.get_color()
    assert first.get_linestyle() != second.get_linestyle()


def test_without_an_object_there_is_no_axes_for_it() -> None:
    figure = plot_throw(sb1_dataset())
    assert len(figure.axes) == 3
    assert "no object" in str(figure.get_suptitle())


def test_a_comparison_is_drawn_behind(figure: Figure) -> None:
    assert not [line for line in figure.axes[1].lines if line.get_color() == COMPARED]
    other = sb2_dataset().assign_attrs(overrides='{"chair.friction_coefficient": 0.3}')
    compared = plot_throw(sb2_dataset(), compare=other)
    grey = [line for line in compared.axes[1].lines if line.get_color() == COMPARED]
    assert len(grey) == 2
    np.testing.assert_allclose(grey[0].get_ydata(), other["drive_force"].sel(drive="1") / 1e3)
    assert "grey: sb2 (chair.friction_coefficient = 0.3)" in str(compared.get_suptitle())


def test_title_names_panel_object_and_outcome() -> None:
    assert title_of(sb2_dataset()) == "sb2: 13 mm at sleeper 6, undetected object"
    partial = sb2_dataset().assign_attrs(complete=False, outcome="not converged")
    assert title_of(partial).endswith("NOT COMPLETE (not converged)")


def test_a_measurement_without_gaps_is_drawn() -> None:
    """A measurement has fewer channels and attributes of its own."""
    measured = sb2_dataset()[["drive_force", "object_force"]].drop_attrs()
    measured = measured.assign_coords(drive=sb2_dataset()["drive"])
    assert len(plot_throw(measured).axes) == 2


def test_nothing_to_draw_is_said() -> None:
    with pytest.raises(ResponseError, match="nothing to draw"):
        plot_throw(xr.Dataset(coords={"time": [0.0, 1.0]}))


@pytest.mark.parametrize(
    ("suffix", "start"), [(".png", b"\x89PNG"), (".PDF", b"%PDF"), (".svg", b"<?xml")]
)
def test_files_by_suffix(figure: Figure, suffix: str, start: bytes) -> None:
    assert rendered(figure, suffix).startswith(start)


def test_another_suffix_is_refused(figure: Figure) -> None:
    with pytest.raises(FileError, match=r"must end in \.png, \.pdf, \.svg"):
        rendered(figure, ".bmp")


def other_program(run: xr.Dataset) -> xr.Dataset:
    """The run as another program would give it, for one drive, at uneven times."""
    theirs = run[["drive_force", "drive_gap"]].isel(time=[0, 10, 50, 200, 500]).isel(drive=[0])
    return theirs.assign_attrs(title="other.csv")


def test_overlay_is_drawn_under_its_twin_and_named() -> None:
    run = sb2_dataset()
    figure = plot_throw(run, overlay=other_program(run))
    named = {
        line.get_label(): line
        for ax in figure.axes
        for line in ax.lines
        if "\n" in line.get_label()
    }
    theirs = next(line for label, line in named.items() if label == "Drive 1,\nother.csv")
    np.testing.assert_allclose(
        theirs.get_ydata(), run["drive_force"].values[0, [0, 10, 50, 200, 500]] / 1e3
    )
    ours = next(line for ax in figure.axes for line in ax.lines if line.get_label() == "Drive 1")
    assert theirs.get_color() == ours.get_color()
    assert theirs.get_zorder() < ours.get_zorder()
    assert not any("Drive 2" in label and "other.csv" in label for label in named)


def test_overlay_without_drives_keeps_the_colours_of_the_run() -> None:
    run = sb2_dataset()
    theirs = run[["sensor_gap"]].drop_vars("drive", errors="ignore")
    figure = plot_throw(run, overlay=theirs.assign_attrs(title="gaps.csv"))
    lines = {line.get_label(): line for ax in figure.axes for line in ax.lines}
    for name in run["sensor"].values:
        assert lines[f"{name},\ngaps.csv"].get_color() == lines[str(name)].get_color()


def test_overlay_of_a_drive_that_the_run_has_not_is_refused() -> None:
    run = sb2_dataset()
    theirs = other_program(run).assign_coords(drive=["3"])
    with pytest.raises(ResponseError, match="overlay other.csv: drive '3' is not in the run.*1, 2"):
        plot_throw(run, overlay=theirs)


def test_a_long_title_stays_inside_the_figure() -> None:
    """A pinned throw with many changed values once ran over the right edge."""
    pinned = sb1_dataset().copy()
    changes = {f"chair.{number}.friction_coefficient": 0.25 for number in range(8)}
    pinned.attrs = {**pinned.attrs, "overrides": json.dumps(changes)}
    drawn = plot_throw(sb1_dataset(), compare=pinned)
    drawn.draw_without_rendering()
    (title,) = [text for text in drawn.texts if "grey: " in text.get_text()]
    whole, edge = title.get_window_extent(), drawn.bbox
    assert whole.x0 >= edge.x0
    assert whole.x1 <= edge.x1
    assert whole.y0 >= drawn.axes[0].get_window_extent().y1
