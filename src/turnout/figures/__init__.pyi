"""Written by `python -m turnout.api.stub` from the table in __init__.py."""

from turnout.figures.along_rail_sheet import chair_sheet as chair_sheet
from turnout.figures.along_rail_sheet import gap_sheet as gap_sheet
from turnout.figures.along_rail_sheet import shade_of as shade_of
from turnout.figures.along_rail_sheet import shape_sheet as shape_sheet
from turnout.figures.calibration import plot_intervals as plot_intervals
from turnout.figures.calibration import plot_sweep as plot_grid_search
from turnout.figures.campaign import plot_overview as plot_overview
from turnout.figures.campaign import plot_stacked as plot_stacked
from turnout.figures.draw import draw_sheet as draw_sheet
from turnout.figures.gauge import plot_gauge as plot_gauge
from turnout.figures.modes import plot_modes as plot_modes
from turnout.figures.over_time_sheet import energy_sheet as energy_sheet
from turnout.figures.plan import plot_plan as plot_plan
from turnout.figures.pod import plot_pod as plot_pod
from turnout.figures.recording import plot_measured as plot_measured
from turnout.figures.sheet import Band as Band
from turnout.figures.sheet import Level as Level
from turnout.figures.sheet import Line as Line
from turnout.figures.sheet import Moment as Moment
from turnout.figures.sheet import Row as Row
from turnout.figures.sheet import Sheet as Sheet
from turnout.figures.single import plot_chair_load as plot_chair_load
from turnout.figures.single import plot_drive_force as plot_drive_force
from turnout.figures.single import plot_drive_gap as plot_drive_gap
from turnout.figures.single import plot_energy as plot_energy
from turnout.figures.single import plot_gap as plot_gap
from turnout.figures.single import plot_rail_shape as plot_rail_shape
from turnout.figures.throw import plot_throw as plot_throw
from turnout.figures.validation import plot_comparison as plot_comparison
from turnout.figures.validation import plot_error_map as plot_error_map

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
    "plot_gauge",
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
