"""The figure of section properties along a rail, by its data; and the command that draws it."""

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.cli.panel import COLUMNS
from turnout.figures.sections import ROWS, plot_section_values
from turnout.mechanism.rail_sections import section_values
from turnout.panel.load import load_panel

X = np.array([0.0, 3.6, 8.0])


def test_lines_are_the_columns_in_units_of_the_axis() -> None:
    values = section_values(load_panel("sb2"), "A", X)
    figure = plot_section_values(X, values, title="tongue")
    assert len(figure.axes) == len(ROWS)
    for ax, (label, unit, columns) in zip(figure.axes, ROWS, strict=True):
        assert ax.get_ylabel() == label
        lines = {line.get_label(): line for line in ax.lines}
        for column, name in columns.items():
            np.testing.assert_array_equal(lines[name].get_xdata(), X)
            np.testing.assert_allclose(lines[name].get_ydata(), values[column] / unit)


def test_units_are_those_of_the_printed_table() -> None:
    for label, unit, columns in ROWS:
        for column in columns:
            heading, printed, _ = COLUMNS[column]
            assert printed == unit
            assert heading.split()[-1].rstrip("234") in label


def test_the_command_draws(tmp_path: Path) -> None:
    path = tmp_path / "sections.svg"
    result = CliRunner().invoke(app, ["panel", "sections", "sb2", "--plot", str(path)])
    assert result.exit_code == 0, result.output
    assert path.read_bytes().startswith(b"<?xml")
    assert f"{path} (" in result.stdout
