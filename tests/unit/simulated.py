"""Runs that several tests use, each computed once a session."""

from dataclasses import dataclass
from functools import cache

import xarray as xr

from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.markers import marker_positions
from turnout.solver.integration import History, integrate
from turnout.throw.simulate import simulate

OBJECT = ForeignObject("13 mm", "sleeper 6")


@dataclass(frozen=True)
class Run:
    """A run with all that its dataset was made from."""

    panel: LoadedPanel
    mechanism: Mechanism
    history: History


@cache
def sb2_panel() -> LoadedPanel:
    return load_panel("sb2")


@cache
def sb2_run() -> Run:
    """The whole panel with an object, as arrays of the solver."""
    panel = sb2_panel()
    mechanism = build_mechanism(panel, resolve_objects(panel, [OBJECT]))
    history = integrate(
        mechanism,
        Scheme(output_interval=4e-3),
        inputs=lambda time: marker_positions(panel, time),
        end=panel.schedule.end,
    )
    return Run(panel, mechanism, history)


@cache
def sb2_dataset() -> xr.Dataset:
    """The whole panel with an object; no test may change it."""
    return simulate(sb2_panel(), foreign_object=OBJECT)


@cache
def sb1_panel() -> LoadedPanel:
    """One rail, cut short so that a run takes a moment."""
    return load_panel("sb1").with_overrides(
        {
            "schedule.end": 2.5,
            "movement.return.start": 1.6,
            "movement.return.duration": 0.6,
            "movement.throw.start": 0.2,
            "movement.throw.duration": 1.0,
        }
    )


@cache
def sb1_dataset() -> xr.Dataset:
    return simulate(sb1_panel())
