"""The figure of outlines, by its data."""

import numpy as np
import pytest

from turnout.beam.outline import make_outline, move
from turnout.beam.section_analysis import analyse_outlines
from turnout.figures.sections import plot_section_outlines

PLATE = make_outline(
    [[0, 0], [0.1, 0], [0.1, 0.2], [0, 0.2]],
    holes=([[0.02, 0.03], [0.06, 0.03], [0.06, 0.1], [0.02, 0.1]],),
)
OUTLINES = [PLATE, move(PLATE, y=-0.05), move(PLATE, z=0.01)]


def test_each_outline_has_its_panel_in_millimetres() -> None:
    figure = plot_section_outlines(OUTLINES, titles=["a", "b", "c"], columns=2)
    panels = [ax for ax in figure.axes if ax.patches]
    assert [ax.get_title() for ax in panels] == ["a", "b", "c"]
    for ax, outline in zip(panels, OUTLINES, strict=True):
        (patch,) = ax.patches
        vertices = patch.get_path().vertices
        np.testing.assert_allclose(vertices[:4], 1e3 * outline.points)
        assert len(vertices) == 10, "the hole is drawn, too"
        assert ax.get_xlim() == pytest.approx((-58.0, 108.0))
        assert ax.get_aspect() == 1.0


def test_centroid_and_shear_centre_are_marked() -> None:
    properties = analyse_outlines(OUTLINES).properties
    figure = plot_section_outlines(
        OUTLINES, titles=["a", "b", "c"], properties=properties, behind=OUTLINES
    )
    for index, ax in enumerate(figure.axes):
        marks = {line.get_label(): line.get_xydata()[0] for line in ax.lines[:2]}
        assert marks["centroid"][0] == pytest.approx(1e3 * properties.centroid_y[index])
        assert marks["shear centre"][1] == pytest.approx(1e3 * properties.shear_centre_z[index])
        assert len(ax.patches) == 2
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "centroid",
        "shear centre",
        "running edge",
    ]
