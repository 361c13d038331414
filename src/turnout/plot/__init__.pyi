"""Written by `python -m turnout.api.stub` from the table in __init__.py."""

from turnout.plot.calibration import plot_intervals as plot_intervals
from turnout.plot.calibration import plot_sweep as plot_grid_search
from turnout.plot.campaign import plot_overview as plot_overview
from turnout.plot.campaign import plot_stacked as plot_stacked
from turnout.plot.draw import draw_sheet as draw_sheet
from turnout.plot.modes import plot_modes as plot_modes
from turnout.plot.plan import plot_plan as plot_plan
from turnout.plot.pod import plot_pod as plot_pod
from turnout.plot.rail_sheet import chair_sheet as chair_sheet
from turnout.plot.rail_sheet import gap_sheet as gap_sheet
from turnout.plot.rail_sheet import shade_of as shade_of
from turnout.plot.rail_sheet import shape_sheet as shape_sheet
from turnout.plot.recording import plot_measured as plot_measured
from turnout.plot.sheet import Band as Band
from turnout.plot.sheet import Level as Level
from turnout.plot.sheet import Line as Line
from turnout.plot.sheet import Moment as Moment
from turnout.plot.sheet import Row as Row
from turnout.plot.sheet import Sheet as Sheet
from turnout.plot.single import plot_chair_load as plot_chair_load
from turnout.plot.single import plot_drive_force as plot_drive_force
from turnout.plot.single import plot_drive_gap as plot_drive_gap
from turnout.plot.single import plot_energy as plot_energy
from turnout.plot.single import plot_gap as plot_gap
from turnout.plot.single import plot_rail_shape as plot_rail_shape
from turnout.plot.throw import plot_throw as plot_throw
from turnout.plot.throw_sheet import energy_sheet as energy_sheet
from turnout.plot.validation import plot_comparison as plot_comparison
from turnout.plot.validation import plot_error_map as plot_error_map

__all__ = [
    "Band",
    "Level",
    "Line",
    "Moment",
    "Row",
    "Sheet",
    "chair_sheet",
    "draw_sheet",
    "energy_sheet",
    "gap_sheet",
    "plot_chair_load",
    "plot_comparison",
    "plot_drive_force",
    "plot_drive_gap",
    "plot_energy",
    "plot_error_map",
    "plot_gap",
    "plot_grid_search",
    "plot_intervals",
    "plot_measured",
    "plot_modes",
    "plot_overview",
    "plot_plan",
    "plot_pod",
    "plot_rail_shape",
    "plot_stacked",
    "plot_throw",
    "shade_of",
    "shape_sheet",
]
