"""Forces and displacements of drives, chairs, stops, links and objects, turned to the schema.

A law with force F resists its own argument; the force on the structure along its row is -F. Rows of
drives point to +y, rows of stops and objects towards the stock rail, rows of chairs down, and
those of links are their lengthening.
"""

import numpy as np
from numpy.typing import NDArray

from turnout.integrate.run import History
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.model import Panel
from turnout.panel.motion import marker_offsets

Floats = NDArray[np.float64]
Variable = tuple[tuple[str, ...], NDArray[np.generic]]


def drive_signals(panel: Panel, mechanism: Mechanism, history: History) -> dict[str, Variable]:
    """Return force on the rail (closing positive), marker position and slip of every drive."""
    columns = [mechanism.index.drive[name] for name in panel.drive]
    # 0.0 - F: no negative zeros where a drive is free
    force = 0.0 - history.law_force[:, columns].T
    limits = np.array([drive.saturation_force for drive in panel.drive.values()])
    dims = ("drive", "time")
    return {
        "drive_force": (dims, force),
        "drive_displacement": (dims, history.inputs.T - marker_offsets(panel)[:, np.newaxis]),
        "drive_slipping": (dims, np.abs(force) >= limits[:, np.newaxis]),
    }


def object_signals(mechanism: Mechanism, history: History) -> dict[str, Variable]:
    """Return the force on the foreign objects: their sum, and each where there are several."""
    columns = list(mechanism.index.object.values())
    force = history.law_force[:, columns].T
    signals: dict[str, Variable] = {"object_force": (("time",), np.sum(force, axis=0))}
    if len(columns) > 1:
        signals["single_object_force"] = (("object", "time"), force.copy())
    return signals


def chair_signals(panel: Panel, mechanism: Mechanism, history: History) -> dict[str, Variable]:
    """Return normal force and friction on the rail at every chair, summed over its foot points."""
    if not panel.chair:
        return {}
    shape = (len(panel.rail), len(panel.chair), history.time.size)
    normal, friction = np.full(shape, np.nan), np.full(shape, np.nan)
    index = mechanism.index
    for r, rail in enumerate(panel.rail):
        for c, chair in enumerate(panel.chair):
            if (rail, chair) not in index.chair:
                continue
            feet = list(index.chair[rail, chair])
            normal[r, c] = history.law_force[:, feet].sum(axis=1)
            slides = list(index.chair_friction[rail, chair])
            friction[r, c] = 0.0 - history.friction_force[:, slides].sum(axis=1)
    dims = ("rail", "chair", "time")
    return {"chair_normal_force": (dims, normal), "chair_friction_force": (dims, friction)}


def stop_signals(panel: Panel, mechanism: Mechanism, history: History) -> dict[str, Variable]:
    """Return the force at every stop and stud, positive in compression."""
    names = stop_names(panel)
    if not names:
        return {}
    force = np.full((len(panel.rail), len(names), history.time.size), np.nan)
    for r, rail in enumerate(panel.rail):
        for s, stop in enumerate(names):
            if (rail, stop) in mechanism.index.stop:
                force[r, s] = history.law_force[:, mechanism.index.stop[rail, stop]]
    return {"stop_force": (("rail", "stop", "time"), force)}


def link_signals(panel: Panel, mechanism: Mechanism, history: History) -> dict[str, Variable]:
    """Return the force in every link, positive in tension."""
    if not panel.link:
        return {}
    columns = [mechanism.index.link[name] for name in panel.link]
    return {"link_force": (("link", "time"), history.law_force[:, columns].T.copy())}


def stop_names(panel: Panel) -> list[str]:
    """Return stops by their name and studs as "stud N", in the order of the panel."""
    return [*panel.stop, *(f"stud {name}" for name in panel.stud)]
