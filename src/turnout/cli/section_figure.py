"""The figure of `turnout panel sections`: outlines where there are any, else properties."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from turnout.panel.load import LoadedPanel


def section_figure(panel: "LoadedPanel", rail: str) -> Any:
    """Draw the section of a switch rail along it.

    Parameters
    ----------
    panel : LoadedPanel
        The panel.
    rail : str
        Name of a switch rail.

    Returns
    -------
    matplotlib.figure.Figure
        The outline at each station with the stock rail beside it, the running edge, centroid and
        shear centre; for a section that is a table, its properties along the rail.
    """
    from turnout.response.sections import rail_stations, section_values

    section = panel.rail[rail].section
    if section in panel.outline_section or section in panel.planed_section:
        return _outlines(panel, rail)
    from turnout.plot.section_values import plot_section_values

    x = rail_stations(panel, rail)
    title = f"{panel.name}: section '{section}' of rail {rail}"
    return plot_section_values(x, section_values(panel, rail, x), title=title)


def _outlines(panel: "LoadedPanel", rail: str) -> Any:
    from turnout.plot.section_outlines import plot_section_outlines
    from turnout.response.sections import in_panel_axes, section_outlines, station_columns

    section = panel.rail[rail].section
    pairs = section_outlines(panel, section)
    beside = [stock for _, stock in pairs if stock is not None]
    figure = plot_section_outlines(
        [outline for outline, _ in pairs],
        titles=_titles(panel, rail),
        # Outlines count y away from the stock rail, columns towards it.
        properties=in_panel_axes(station_columns(panel, section), side=-1.0),
        behind=beside if len(beside) == len(pairs) else (),
    )
    title = f"{panel.name}: section '{section}' of rail {rail}, y positive away from the stock rail"
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _titles(panel: "LoadedPanel", rail: str) -> list[str]:
    """Name each station by the offset of the running edges, and by where the rail has it."""
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
