"""Cross-sections along each rail, as text and as a figure.

The figure of `turnout panel sections`: outlines where there are any, else properties.
Cross-sections along each rail as a table of text.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from turnout.panel.load import LoadedPanel


def section_figure(panel: "LoadedPanel", rail: str) -> Any:
    """Draw the section of a switch rail along it.

    Parameters
    ----------
    panel : LoadedPanel
        Its rails have outlines or tabulated sections.
    rail : str
        Name of a switch rail.

    Returns
    -------
    matplotlib.figure.Figure
        The outline at each station with the stock rail beside it, the running edge, centroid and
        shear centre; for a section that is a table, its properties along the rail.
    """
    from turnout.mechanism.rail_sections import rail_stations, section_values

    section = panel.rail[rail].section
    if section in panel.outline_section or section in panel.planed_section:
        return _outlines(panel, rail)
    from turnout.figures.sections import plot_section_values

    x = rail_stations(panel, rail)
    title = f"{panel.name}: section '{section}' of rail {rail}"
    return plot_section_values(x, section_values(panel, rail, x), title=title)


def _outlines(panel: "LoadedPanel", rail: str) -> Any:
    from turnout.figures.sections import plot_section_outlines
    from turnout.mechanism.rail_sections import in_panel_axes, section_outlines, station_columns

    section = panel.rail[rail].section
    pairs = section_outlines(panel, section)
    beside = [stock for _, stock in pairs if stock is not None]
    figure = plot_section_outlines(
        [outline for outline, _ in pairs],
        titles=_titles(panel, rail),
        # In outlines y is positive away from the stock rail, in columns towards it.
        properties=in_panel_axes(station_columns(panel, section), side=-1.0),
        behind=beside if len(beside) == len(pairs) else (),
    )
    title = f"{panel.name}: section '{section}' of rail {rail}, y positive away from the stock rail"
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _titles(panel: "LoadedPanel", rail: str) -> list[str]:
    """Name each station by the offset of the running edges, and by its place along the rail."""
    from turnout.panel.profile import running_edge_position

    record = panel.rail[rail]
    planed = panel.planed_section.get(record.section)
    if planed is None:
        return ["all along"]
    titles = []
    for offset in planed.running_edge_offset:
        text = f"w = {1e3 * offset:g} mm"
        if record.running_edge is not None:
            x = running_edge_position(record.running_edge, offset)
            text += f", x = {x:.2f} m" if x >= record.start else ", ahead of the toe"
        titles.append(text)
    return titles


# Column of the section table: heading, size of its unit in SI, format.
COLUMNS: dict[str, tuple[str, float, str]] = {
    "area": ("A cm2", 1e-4, "8.2f"),
    "second_moment_vertical": ("Iy cm4", 1e-8, "8.0f"),
    "second_moment_lateral": ("Iz cm4", 1e-8, "8.0f"),
    "product_moment": ("Iyz cm4", 1e-8, "8.0f"),
    "torsion_constant": ("J cm4", 1e-8, "8.0f"),
    "centroid_height": ("zc mm", 1e-3, "8.1f"),
    "centroid_offset": ("yc mm", 1e-3, "8.1f"),
    "shear_centre_height": ("zs mm", 1e-3, "8.1f"),
    "shear_centre_offset": ("ys mm", 1e-3, "8.1f"),
    "shear_factor_vertical": ("kz", 1.0, "8.2f"),
    "shear_factor_lateral": ("ky", 1.0, "8.2f"),
    "foot_edge_stock": ("foot mm", 1e-3, "8.1f"),
    "foot_edge_track": ("to mm", 1e-3, "8.1f"),
}


SI_UNITS = {"cm2": "m^2", "cm4": "m^4", "mm": "m"}


def section_lines(panel: "LoadedPanel") -> Iterator[str]:
    """Yield the lines of `turnout panel sections`: a row per station, linear between them."""
    shown: dict[tuple[str, ...], str] = {}
    for heading, rows in _tables(panel):
        rail, _, _ = heading.partition(",")
        first = shown.setdefault(rows, rail)
        if first == rail:
            yield heading
            yield from rows
        else:
            yield f"{heading}: as {first}"
    yield (
        "y positive towards the rail's own stock rail, for a stock rail away from its switch rail; "
        "z from the foot; k: shear area over area"
    )


def section_record(panel: "LoadedPanel") -> "tuple[dict[str, Any], dict[str, str]]":
    """Return section properties along each switch rail and of each stock rail, with SI units."""
    from turnout.mechanism.rail_sections import rail_stations, section_values, station_columns

    rails = {
        name: {"section": rail.section, "x": x, **section_values(panel, name, x)}
        for name, rail in panel.rail.items()
        for x in [rail_stations(panel, name)]
    }
    stocks = {
        name: {
            "section": item.section,
            **{key: v[0] for key, v in station_columns(panel, item.section).items()},
        }
        for name, item in panel.stock_rail.items()
    }
    units = {
        "x": "m",
        **{
            key: SI_UNITS[heading.split()[-1]]
            for key, (heading, _, _) in COLUMNS.items()
            if heading.split()[-1] in SI_UNITS
        },
    }
    return {"panel": panel.name, "rails": rails, "stock_rails": stocks}, units


def _tables(panel: "LoadedPanel") -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield heading and rows for every switch rail, then for every flexible stock rail."""
    from turnout.mechanism.rail_sections import rail_stations, section_values, station_columns

    for name, rail in panel.rail.items():
        x = rail_stations(panel, name)
        rows = _rows(x, section_values(panel, name, x), density=panel.material.density)
        yield f"rail {name}, section {rail.section}", rows
    for name, stock in panel.stock_rail.items():
        values = {key: column[:1] for key, column in station_columns(panel, stock.section).items()}
        rows = _rows([stock.start], values, density=panel.material.density)
        yield f"stock rail {name}, section {stock.section}, the same all along", rows


def _rows(
    x: "npt.ArrayLike", values: "dict[str, npt.NDArray[np.float64]]", *, density: float
) -> tuple[str, ...]:
    """Write the headings and a row a place."""
    import numpy as np

    columns = {key: column for key, column in COLUMNS.items() if key in values}
    headings = [heading for heading, _, _ in columns.values()]
    rows = [f"{'x m':>8}{'kg/m':>8}" + "".join(f"{heading:>8}" for heading in headings)]
    for row, place in enumerate(np.asarray(x, dtype=float)):
        cells = [
            f"{values[column][row] / factor:{form}}"
            for column, (_, factor, form) in columns.items()
        ]
        rows.append(f"{place:8.3f}{density * values['area'][row]:8.1f}" + "".join(cells))
    return tuple(rows)
