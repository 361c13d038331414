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


def rail_stations(panel: Panel, rail: str) -> Floats:
    """Return the ends of a rail and the stations of its section between them, rising [m]."""
    import numpy as np

    record = panel.rail[rail]
    places = [record.start, *section_stations(panel, rail).tolist(), record.end]
    found: Floats = np.unique(np.round(places, 6))
    return found
