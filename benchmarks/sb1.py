"""SB1 for programs that know nothing of turnout: matrices, stations, laws, and how to be judged.

Every law of SB1 acts on the lateral or vertical displacement of one of its 16 stations (chairs), so
that a program needs a linear system, the places of those displacements in it, and `evaluate`.
Lateral y is positive towards the stock rail; resisting forces are positive where they act against
the growth of their displacement.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import xarray as xr
from numba import njit
from numpy.typing import NDArray
from tests.verification.agreement import Check, sb1_checks
from tests.verification.reference import thinned

from turnout.mechanism.build import build_mechanism, rail_data
from turnout.mechanism.structure import rail_structure
from turnout.panel.foreign_object import ForeignObject, PlacedObject, resolve_objects
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.markers import marker_positions
from turnout.panel.profile import stock_rail_gap

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PLACE, SIZE = "x = 3.9 m", 0.013
CASES = ("A", "B")
STICK, FORWARD, BACKWARD = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Stations:
    """Parts that act at the chairs, one entry each; -1 stands for nothing.

    `lateral` and `vertical` are places in the coordinates of a system (`vertical` -1: the normal
    force is `weight` all the time), `drive` the number of a drive, `object` 1 where the object is.
    """

    lateral: Ints
    vertical: Ints
    weight: Floats
    drive: Ints
    object: Ints
    gap: Floats
    normal_stiffness: float
    friction_coefficient: float
    stick_stiffness: float
    stop_stiffness: float
    object_stiffness: float
    object_size: float
    drive_stiffness: Floats
    drive_limit: Floats
    saturated_stiffness: float

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """Return the arguments of `evaluate`."""
        numbers = np.array(
            [
                self.normal_stiffness,
                self.friction_coefficient,
                self.stick_stiffness,
                self.stop_stiffness,
                self.object_stiffness,
                self.object_size,
                self.saturated_stiffness,
            ]
        )
        places = np.array([self.lateral, self.vertical, self.drive, self.object])
        return (
            places,
            np.array([self.gap, self.weight]),
            np.array([self.drive_stiffness, self.drive_limit]),
            numbers,
        )


@dataclass(frozen=True, slots=True)
class LinearSystem:
    """``M a + C v + K u = load`` in full or reduced coordinates, with the stations in it."""

    mass: sp.csr_array
    damping: sp.csr_array
    stiffness: sp.csr_array
    load: Floats
    stations: Stations


@dataclass(frozen=True, slots=True)
class Answer:
    """Results of a program; n instants.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Instants [s].
    drive, object, friction : ndarray, shapes (2, n), (n,), (16, n)
        Force of the drives on the rail, of the object, of the chairs' friction on the rail [N].
    work : dict of str to float
        Counts worth reporting: steps, iterations, factorisations.
    """

    time: Floats
    drive: Floats
    object: Floats
    friction: Floats
    work: dict[str, float]


def panel_of(case: str) -> tuple[LoadedPanel, list[PlacedObject]]:
    """Return the panel of a case with the object in it."""
    panel = load_panel("sb1")
    given = [ForeignObject(SIZE, PLACE)] if case == "B" else []
    return panel, resolve_objects(panel, given)


def full_system(case: str) -> LinearSystem:
    """Return the beams with six coordinates a node and lumped masses, on their fastenings."""
    panel, objects = panel_of(case)
    data = rail_data(panel, objects)[0]
    structure = rail_structure(data)
    length = np.diff(data.x)
    section, density = data.sections, data.material.density
    values = [section.area] * 3
    vertical, lateral = section.second_moment_vertical, section.second_moment_lateral
    values += [vertical + lateral, vertical, lateral]
    shares = [0.5 * density * length * value for value in values]
    lumped = np.array([np.r_[s, 0.0] + np.r_[0.0, s] for s in shares]).T.ravel()
    node = np.searchsorted(data.x, [chair.x - 1e-6 for chair in panel.chair.values()])
    return LinearSystem(
        mass=sp.csr_array(sp.diags_array(lumped)),
        damping=structure.damping,
        stiffness=structure.stiffness,
        load=structure.load,
        stations=_stations(panel, objects, 6 * node + 1, 6 * node + 2),
    )


def reduced_system(case: str) -> LinearSystem:
    """Return turnout's own superelement, the matrices that it works on."""
    panel, objects = panel_of(case)
    mechanism = build_mechanism(panel, objects)
    place = np.argmax(np.abs(mechanism.rows), axis=1)
    picked = np.zeros_like(mechanism.rows)
    picked[np.arange(place.size), place] = mechanism.rows[np.arange(place.size), place]
    assert np.allclose(picked, mechanism.rows)
    laws, index = mechanism.laws, mechanism.index
    contact = [index.chair["switch", name][0] for name in panel.chair]
    slide = [index.chair_friction["switch", name][0] for name in panel.chair]
    return LinearSystem(
        mass=sp.csr_array(mechanism.mass),
        damping=sp.csr_array(mechanism.damping),
        stiffness=sp.csr_array(mechanism.stiffness),
        load=mechanism.load,
        stations=_stations(
            panel, objects, place[laws.friction_row[slide]], place[laws.row[contact]]
        ),
    )


def lateral_system(whole: LinearSystem, weight: Floats) -> LinearSystem:
    """Return the lateral part of the full system alone, under constant normal forces.

    A section without eccentricity bends in its planes apart, so what is vertical stays at rest.
    """
    kept = np.sort(np.r_[1 : whole.load.size : 6, 5 : whole.load.size : 6])
    stations = whole.stations
    values = {name: getattr(stations, name) for name in Stations.__dataclass_fields__}
    values["lateral"] = np.searchsorted(kept, stations.lateral)
    values["vertical"] = np.full(kept.size, -1)[: stations.lateral.size]
    values["weight"] = weight
    return LinearSystem(
        *(matrix[kept][:, kept] for matrix in (whole.mass, whole.damping, whole.stiffness)),
        load=whole.load[kept],
        stations=Stations(**values),
    )


def _stations(
    panel: LoadedPanel, objects: list[PlacedObject], lateral: Ints, vertical: Ints
) -> Stations:
    chairs, drives = list(panel.chair.values()), list(panel.drive.values())
    x = np.array([chair.x for chair in chairs])
    drive, trapped = np.full(x.size, -1), np.full(x.size, -1)
    for number, item in enumerate(drives):
        drive[int(np.argmin(np.abs(x - item.x)))] = number
    for thing in objects:
        trapped[int(np.argmin(np.abs(x - thing.x)))] = 1
    rail = panel.rail["switch"]
    first = chairs[0]
    return Stations(
        lateral=lateral.astype(np.int64),
        vertical=vertical.astype(np.int64),
        weight=np.zeros(x.size),
        drive=drive.astype(np.int64),
        object=trapped.astype(np.int64),
        gap=np.array([float(stock_rail_gap(rail, at) or 0.0) for at in x]),
        normal_stiffness=first.normal_stiffness,
        friction_coefficient=first.friction_coefficient,
        stick_stiffness=first.stick_stiffness,
        stop_stiffness=next(iter(panel.stop.values())).stiffness,
        object_stiffness=objects[0].stiffness if objects else 0.0,
        object_size=objects[0].size if objects else 0.0,
        drive_stiffness=np.array([item.stiffness for item in drives]),
        drive_limit=np.array([item.saturation_force for item in drives]),
        saturated_stiffness=drives[0].saturated_stiffness,
    )


def markers_of(case: str, times: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return marker positions, shape (2, n) [m], and presence of the object, shape (n,)."""
    panel, objects = panel_of(case)
    there = np.zeros(times.size, dtype=bool)
    for item in objects:
        there |= (times >= item.appears - 1e-9) & (times <= item.disappears + 1e-9)
    return marker_positions(panel, times), there


@njit(cache=True)  # type: ignore[untyped-decorator]
def evaluate(places, stands, drives, numbers, y, z, anchor, marker, there, out, signs):  # type: ignore[no-untyped-def]
    """Evaluate all laws at lateral and vertical displacements of the stations.

    ``out`` gets, by rows: lateral and vertical resistance, its derivatives yy, yz, zz, then
    friction, drive, object and normal force. ``signs`` gets the segment of every law by rows:
    contact, friction, stop, drive, object.
    """
    normal_stiffness, coefficient, stick, stop, item, size, soft = numbers
    for s in range(y.size):
        weight, slope = stands[1, s], 0.0
        if places[1, s] >= 0:
            pressed = -z[s]
            slope = normal_stiffness if pressed > 0.0 else 0.0
            weight = slope * pressed
        limit = coefficient * weight
        force, cross = stick * (y[s] - anchor[s]), 0.0
        stiffness, state = stick, STICK
        if force > limit:
            force, cross, stiffness, state = limit, -coefficient * slope, 0.0, FORWARD
        elif force < -limit:
            force, cross, stiffness, state = -limit, coefficient * slope, 0.0, BACKWARD
        out[5, s], out[8, s] = force, weight
        signs[0, s], signs[1, s] = slope > 0.0, state
        beyond = y[s] - stands[0, s]
        signs[2, s] = beyond > 0.0
        if beyond > 0.0:
            force, stiffness = force + stop * beyond, stiffness + stop
        drive = places[2, s]
        if drive >= 0:
            stretch, stiff = y[s] - marker[drive], drives[0, drive]
            reach = drives[1, drive] / stiff
            pull, side = stiff * stretch, 0
            if abs(stretch) > reach:
                side = 1 if stretch > 0.0 else 2
                pull = np.sign(stretch) * (drives[1, drive] + soft * (abs(stretch) - reach))
                stiff = soft
            out[6, s], signs[3, s] = -pull, side
            force, stiffness = force + pull, stiffness + stiff
        out[7, s], signs[4, s] = 0.0, 0
        if places[3, s] > 0 and there and beyond + size > 0.0:
            out[7, s], signs[4, s] = item * (beyond + size), 1
            force, stiffness = force + out[7, s], stiffness + item
        out[0, s], out[1, s], out[2, s] = force, -weight, stiffness
        out[3, s], out[4, s] = cross, slope


def at_rest(system: LinearSystem) -> Floats:
    """Return the static coordinates with all chairs closed, which they are in SB1 [m]."""
    springs = np.zeros(system.load.size)
    springs[system.stations.vertical] = system.stations.normal_stiffness
    for drive, stiffness in enumerate(system.stations.drive_stiffness):
        springs[system.stations.lateral[system.stations.drive == drive]] += stiffness
    matrix = sp.csc_matrix(system.stiffness + sp.diags_array(springs))
    rest: Floats = sp.linalg.spsolve(matrix, system.load)
    assert np.all(rest[system.stations.vertical] < 0)
    return rest


def checks(case: str, answer: Answer) -> list[Check]:
    """Judge an answer as turnout's own are judged."""
    return sb1_checks(
        xr.Dataset(
            {
                "drive_force": (("drive", "time"), answer.drive),
                "object_force": (("time",), answer.object),
                "chair_friction_force": (("rail", "chair", "time"), answer.friction[np.newaxis]),
            },
            coords={"time": answer.time, "drive": ["1", "2"], "rail": ["switch"]},
        ),
        thinned(f"sb1_{case}"),
    )


def agreement(found: list[Check]) -> tuple[float, float, bool]:
    """Return worst rms of drives and object [%], worst plateau [%], and True if all agree.

    The friction of single chairs is no part of the benchmark's agreement.
    """
    forces = [c for c in found if not c.what.startswith("chair")]
    rms = max(float(c.value) for c in forces if "rms" in c.what)
    plateau = max(float(abs(c.value)) for c in forces if "rms" not in c.what)
    return rms, plateau, all(c.passed for c in forces)
