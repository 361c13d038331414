"""Figures of results, drawn with matplotlib: save them, or let a notebook show them.

Figures on one pair of axes are ``plot_x(dataset, *, ax=None) -> Axes``: with `ax` they are drawn
there. Figures of several rows or tables return a Figure of their own. Those made of rows of lines
are plain data first, a `Sheet`, which `draw_sheet` draws; make one for figures in the same style.
"""

from turnout.lazy import loader

NAMES = {
    # One run, one pair of axes
    "plot_drive_force": "turnout.plot.single",
    "plot_drive_gap": "turnout.plot.single",
    "plot_rail_shape": "turnout.plot.single",
    "plot_gap": "turnout.plot.single",
    "plot_chair_load": "turnout.plot.single",
    "plot_energy": "turnout.plot.single",
    "plot_intervals": "turnout.plot.calibration",
    # Figures of several axes
    "plot_throw": "turnout.plot.throw",
    "plot_measured": "turnout.plot.recording",
    "plot_modes": "turnout.plot.modes",
    "plot_plan": "turnout.plot.plan",
    "plot_overview": "turnout.plot.campaign",
    "plot_stacked": "turnout.plot.campaign",
    "plot_grid_search": "turnout.plot.calibration:plot_sweep",
    "plot_comparison": "turnout.plot.validation",
    "plot_error_map": "turnout.plot.validation",
    "plot_pod": "turnout.plot.pod",
    # Figures as data
    "Sheet": "turnout.plot.sheet",
    "Row": "turnout.plot.sheet",
    "Line": "turnout.plot.sheet",
    "Level": "turnout.plot.sheet",
    "Band": "turnout.plot.sheet",
    "Moment": "turnout.plot.sheet",
    "draw_sheet": "turnout.plot.draw",
    "shade_of": "turnout.plot.rail_sheet",
    "energy_sheet": "turnout.plot.throw_sheet",
    "shape_sheet": "turnout.plot.rail_sheet",
    "gap_sheet": "turnout.plot.rail_sheet",
    "chair_sheet": "turnout.plot.rail_sheet",
}
"""Every public name and where it is defined; `__all__`, the loader and the stub follow from it."""

__all__ = sorted(NAMES)  # noqa: PLE0605 - follows from the table
__getattr__ = loader("turnout.plot", NAMES)


def __dir__() -> list[str]:
    return list(__all__)
