"""Cross-sections along each rail as a table of text."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from turnout.panel.load import LoadedPanel

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


def section_lines(panel: "LoadedPanel") -> Iterator[str]:
    """Yield what `turnout panel sections` prints: a row a station, between them linear."""
    from turnout.response.sections import rail_stations, section_values

    for name, rail in panel.rail.items():
        x = rail_stations(panel, name)
        values = section_values(panel, name, x)
        yield f"rail {name}, section {rail.section}"
        columns = {key: column for key, column in COLUMNS.items() if key in values}
        headings = [heading for heading, _, _ in columns.values()]
        yield f"{'x m':>8}{'kg/m':>8}" + "".join(f"{heading:>8}" for heading in headings)
        for row, place in enumerate(x):
            mass = panel.material.density * values["area"][row]
            cells = [
                f"{values[column][row] / factor:{form}}"
                for column, (_, factor, form) in columns.items()
            ]
            yield f"{place:8.3f}{mass:8.1f}" + "".join(cells)
    yield "y positive towards the rail's own stock rail, z from the foot; k: shear area over area"
