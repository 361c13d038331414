"""Figures of results, drawn with matplotlib: save them, or let a notebook show them.

Figures on one pair of axes are ``plot_x(dataset, *, ax=None) -> Axes``: with `ax` they are drawn
there. Figures of several rows or tables return a Figure of their own. Those made of rows of lines
are plain data first, a `Sheet`, which `draw_sheet` draws; make one for figures in the same style.
"""

from turnout.core.lazy import loader

NAMES = {
    # One run, one pair of axes
    "plot_drive_force": "turnout.figures.single",
    "plot_drive_gap": "turnout.figures.single",
    "plot_rail_shape": "turnout.figures.single",
    "plot_gap": "turnout.figures.single",
    "plot_chair_load": "turnout.figures.single",
    "plot_energy": "turnout.figures.single",
    "plot_intervals": "turnout.figures.calibration",
    # Figures of several axes
    "plot_throw": "turnout.figures.throw",
    "plot_measured": "turnout.figures.recording",
    "plot_modes": "turnout.figures.modes",
    "plot_gauge": "turnout.figures.gauge",
    "plot_plan": "turnout.figures.plan",
    "plot_overview": "turnout.figures.campaign",
    "plot_stacked": "turnout.figures.campaign",
    "plot_grid_search": "turnout.figures.calibration:plot_sweep",
    "plot_comparison": "turnout.figures.validation",
    "plot_error_map": "turnout.figures.validation",
    "plot_pod": "turnout.figures.pod",
    # Figures as data
    "Sheet": "turnout.figures.sheet",
    "Row": "turnout.figures.sheet",
    "Line": "turnout.figures.sheet",
    "Level": "turnout.figures.sheet",
    "Band": "turnout.figures.sheet",
    "Moment": "turnout.figures.sheet",
    "draw_sheet": "turnout.figures.draw",
    "shade_of": "turnout.figures.along_rail_sheet",
    "energy_sheet": "turnout.figures.over_time_sheet",
    "shape_sheet": "turnout.figures.along_rail_sheet",
    "gap_sheet": "turnout.figures.along_rail_sheet",
    "chair_sheet": "turnout.figures.along_rail_sheet",
}
"""Module of each public name; `__all__`, the loader and the stub follow from it."""

__all__ = sorted(NAMES)  # noqa: PLE0605 - follows from the table
__getattr__ = loader("turnout.figures", NAMES)


def __dir__() -> list[str]:
    return list(__all__)
