"""Simulate how a railway switch is thrown, with or without a trapped foreign object.

>>> import turnout
>>> panel = turnout.load_panel("uic60-760-1-15")
>>> obj = turnout.ForeignObject(size=0.013, at="sleeper 6")
>>> dataset = turnout.simulate(panel, foreign_object=obj)  # doctest: +SKIP

Everything is loaded when it is first asked for, so that importing turnout costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from turnout.errors import (
        FileError,
        MachineError,
        MechanicsError,
        PanelError,
        ResponseError,
        SolverError,
        TurnoutError,
    )
    from turnout.integrate.outcome import NotConverged
    from turnout.integrate.scheme import Scheme
    from turnout.machine.load import LoadedMachines, load_machines
    from turnout.machine.throw import MachineThrow, throw_one_mass
    from turnout.panel.foreign_object import ForeignObject
    from turnout.panel.load import LoadedPanel, load_panel
    from turnout.plot.modes import plot_modes
    from turnout.plot.throw import plot_throw
    from turnout.report.view import view
    from turnout.response.machine import machine_dataset
    from turnout.response.modes import modes
    from turnout.response.save import Save
    from turnout.response.simulate import simulate
    from turnout.response.store import open_response, save_response

    __version__: str

_HOME = {
    "FileError": "turnout.errors",
    "ForeignObject": "turnout.panel.foreign_object",
    "LoadedMachines": "turnout.machine.load",
    "LoadedPanel": "turnout.panel.load",
    "MachineError": "turnout.errors",
    "MachineThrow": "turnout.machine.throw",
    "MechanicsError": "turnout.errors",
    "NotConverged": "turnout.integrate.outcome",
    "PanelError": "turnout.errors",
    "ResponseError": "turnout.errors",
    "Save": "turnout.response.save",
    "Scheme": "turnout.integrate.scheme",
    "SolverError": "turnout.errors",
    "TurnoutError": "turnout.errors",
    "load_machines": "turnout.machine.load",
    "load_panel": "turnout.panel.load",
    "machine_dataset": "turnout.response.machine",
    "modes": "turnout.response.modes",
    "open_response": "turnout.response.store",
    "plot_modes": "turnout.plot.modes",
    "plot_throw": "turnout.plot.throw",
    "save_response": "turnout.response.store",
    "simulate": "turnout.response.simulate",
    "throw_one_mass": "turnout.machine.throw",
    "view": "turnout.report.view",
}

__all__ = [
    "FileError",
    "ForeignObject",
    "LoadedMachines",
    "LoadedPanel",
    "MachineError",
    "MachineThrow",
    "MechanicsError",
    "NotConverged",
    "PanelError",
    "ResponseError",
    "Save",
    "Scheme",
    "SolverError",
    "TurnoutError",
    "__version__",
    "load_machines",
    "load_panel",
    "machine_dataset",
    "modes",
    "open_response",
    "plot_modes",
    "plot_throw",
    "save_response",
    "simulate",
    "throw_one_mass",
    "view",
]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it, once."""
    if name == "__version__":
        from turnout.files.provenance import version

        value: Any = version()
    elif name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
    else:
        message = f"module 'turnout' has no attribute '{name}'"
        raise AttributeError(message)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
