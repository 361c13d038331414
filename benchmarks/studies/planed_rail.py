"""The planed 60E1A1 computed here, beside values of an independent program.

`python -m benchmarks.studies.planed_rail` writes docs/figures/sections.txt and sections.png.
"""

import argparse
import tomllib
from pathlib import Path

import numpy as np

from benchmarks.page import DOCS
from turnout.beam.rail_outlines import planed_rail
from turnout.beam.section_analysis import SectionAnalysis, analyse_outlines
from turnout.beam.section_taper import PlanedOutline

FIGURES = DOCS / "figures"
UNITS = {"_mm": 1e-3, "_cm2": 1e-4, "_cm4": 1e-8}
# The independent program had no Poisson effect in its shear factors.
POISSON_RATIO = 0.0
# Columns of the page: quantity, decimals.
COLUMNS = (
    ("area", 1),
    ("second_moment_vertical", 0),
    ("second_moment_lateral", 0),
    ("product_moment", 0),
    ("torsion_constant", 0),
    ("centroid_z", 1),
    ("centroid_y", 1),
    ("shear_centre_z", 1),
    ("shear_centre_from_centroid_y", 1),
    ("shear_factor_vertical", 2),
    ("shear_factor_lateral", 2),
)


def reference() -> dict[str, np.ndarray]:
    """Return the independent program's columns in SI units."""
    path = Path(__file__).parents[2] / "tests" / "verification" / "planed_60e1a1.toml"
    columns = {}
    for key, values in tomllib.loads(path.read_text(encoding="utf-8")).items():
        unit = next((unit for unit in UNITS if key.endswith(unit)), "")
        columns[key.removesuffix(unit)] = np.array(values, dtype=float) * UNITS.get(unit, 1.0)
    return columns


def cuts(*, least_thickness: float | None = None) -> list[PlanedOutline]:
    """Cut the rail at the places of the reference."""
    offsets = reference()["running_edge_offset"]
    return planed_rail("60E1A1", running_edge_offsets=offsets, least_thickness=least_thickness)


def columns_of(analysis: SectionAnalysis) -> dict[str, np.ndarray]:
    """Return computed values under the reference's names."""
    found = analysis.properties
    arm = found.shear_centre_y - found.centroid_y
    return {name: getattr(found, name, arm) for name, _ in COLUMNS}


def page() -> str:
    """Write the two tables of the documentation, as Markdown."""
    wanted = reference()
    found = columns_of(
        analyse_outlines([cut.outline for cut in cuts()], poisson_ratio=POISSON_RATIO)
    )
    offsets = wanted["running_edge_offset"]
    head = "| w [mm] | A [cm²] | $I_y$ | $I_z$ | $I_{yz}$ | J [cm⁴] "
    head += "| $z_C$ [mm] | $y_C$ | $z_S$ | $y_S - y_C$ | $\\kappa_z$ | $\\kappa_y$ |"
    rule = "|---|" + "---|" * len(COLUMNS)
    values, changes = [head, rule], [head.replace(" [mm]", "").replace(" [cm²]", ""), rule]
    for row, offset in enumerate(offsets):
        cells, percents = [f"{1e3 * offset:.0f}"], [f"{1e3 * offset:.0f}"]
        for name, decimals in COLUMNS:
            value = found[name][row]
            cells.append(f"{value / _unit(name):.{decimals}f}")
            percents.append(f"{100 * (value / wanted[name][row] - 1):+.1f}")
        values.append("| " + " | ".join(cells) + " |")
        changes.append("| " + " | ".join(percents) + " |")
    changes[0] = changes[0].replace(" [cm⁴]", "")
    return (
        "\n".join(
            [
                "Computed:",
                "",
                *values,
                "",
                "Change from the independent program, per cent:",
                "",
                *changes,
            ]
        )
        + "\n"
    )


def main() -> None:
    """Write the tables and the figure."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    from turnout.figures.sections import plot_section_outlines

    (FIGURES / "sections.txt").write_text(page(), encoding="utf-8")
    sections = cuts()
    analysis = analyse_outlines([cut.outline for cut in sections])
    figure = plot_section_outlines(
        [cut.outline for cut in sections],
        titles=[f"w = {1e3 * cut.running_edge_offset:.0f} mm" for cut in sections],
        properties=analysis.properties,
        behind=[cut.stock_rail for cut in sections],
    )
    figure.savefig(FIGURES / "sections.png", dpi=120)


def _unit(name: str) -> float:
    if "factor" in name:
        return 1.0
    return 1e-4 if name == "area" else 1e-8 if "moment" in name or "torsion" in name else 1e-3


if __name__ == "__main__":
    main()
