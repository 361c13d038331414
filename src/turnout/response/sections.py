"""Cross-sections along the rails of a panel, for those who show them."""

from turnout.mechanism.rail_sections import (
    Floats,
    in_panel_axes,
    section_outlines,
    section_values,
    station_columns,
)
from turnout.panel.model import Panel
from turnout.panel.profile import section_stations

__all__ = [
    "in_panel_axes",
    "rail_stations",
    "section_outlines",
    "section_values",
    "station_columns",
]

NEAR = 1e-3  # m


def rail_stations(panel: Panel, rail: str) -> Floats:
    """Return the ends of a rail and the stations of its section between them, rising [m].

    A station within a millimetre of an end is left out: it would be the same row of a table.
    """
    import numpy as np

    record = panel.rail[rail]
    stations = np.unique(np.round(section_stations(panel, rail), 6))
    inside = (stations > record.start + NEAR) & (stations < record.end - NEAR)
    return np.concatenate([[record.start], stations[inside], [record.end]])
