"""Channels of a run in the terms of the schema: forces, displacements, energies, fastenings.

Forces and displacements of drives, chairs, stops, links and objects, turned to the schema.

A law with force F resists its own argument; the force on the structure along its row is -F. Rows of
drives point to +y, rows of stops and objects towards the stock rail, rows of chairs down, and
those of links are their lengthening.

The energy balance of a run in the terms of the schema. Forces of the fastenings on the switch
rails, from the motion of the rails at their places.

Forces are those of the springs; the share of the dampers, which is small while a switch is thrown,
is left out. A force acts at the place of the fastening, a moment turns the section.
"""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.build_rails import fastening_offset
from turnout.mechanism.drive_machines import slip_force
from turnout.mechanism.mechanism import LawIndex, Mechanism, RailBody
from turnout.mechanism.object_laws import named_obstructions
from turnout.panel.markers import marker_offsets
from turnout.panel.model import Panel
from turnout.panel.records import Fastening
from turnout.solver.energy import (
    ALGORITHMIC,
    CONTACT,
    DAMPING,
    FRICTION,
    GRAVITY,
    KINETIC,
    MARKERS,
    OBJECTS,
    SEGMENTS,
    STRAIN,
    SWITCHED,
    energy_balance,
    unaccounted_energy,
)
from turnout.solver.integration import History
from turnout.throw.output_rows import OutputRows, RowBlock, stack_rows, sums_of_columns
from turnout.throw.recovery import Motion, row_motion

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Channel = tuple[tuple[str, ...], NDArray[np.generic]]


def drive_signals(panel: Panel, mechanism: Mechanism, history: History) -> dict[str, Channel]:
    """Return force on the rail (closing positive), marker position and slip of every drive."""
    columns = [mechanism.index.drive[name] for name in panel.drive]
    force = np.empty((len(columns), history.time.size))
    np.subtract(0.0, history.forces(columns).T, out=force)  # no negative zeros of free drives
    return drive_channels(panel, force, history.inputs)


def drive_channels(panel: Panel, force: Floats, inputs: Floats) -> dict[str, Channel]:
    """Return `drive_signals` from forces on the rail, shape (n_drives, n_times) [N].

    `inputs` are the marker positions, shape (n_times, n_drives) [m].
    """
    displacement = np.empty(force.shape)  # a drive in a piece, as features sum it
    np.subtract(inputs.T, marker_offsets(panel)[:, np.newaxis], out=displacement)
    dims = ("drive", "time")
    return {
        "drive_force": (dims, force),
        "drive_displacement": (dims, displacement),
        "drive_slipping": (dims, is_slipping(force, slip_forces(panel))),
    }


def slip_forces(panel: Panel) -> Floats:
    """Return the force at which each drive slips, shape (n_drives,) [N]."""
    return np.array([slip_force(panel, name) for name in panel.drive])


def is_slipping(force: Floats, limits: Floats) -> Flags:
    """Return True for each instant at which a drive is at the force at which it slips.

    Parameters
    ----------
    force : ndarray, shape (..., n_times)
        [N]
    limits : ndarray, shape (...)
        [N]
    """
    bounds = limits[..., np.newaxis]
    found = force >= bounds
    found |= force <= -bounds  # makes no array of magnitudes
    return found


def object_channels(index: LawIndex, force: Floats) -> dict[str, Channel]:
    """Return the force on the foreign objects: their sum, and each of several.

    Parameters
    ----------
    index : LawIndex
        For what is part of which object.
    force : ndarray, shape (..., n_laws, n_times)
        Of the laws of all objects in the order of the index, also of many throws with the same
        `object_rows` [N].
    """
    total = force[..., 0, :] if force.shape[-2] == 1 else np.sum(force, axis=-2)
    signals: dict[str, Channel] = {"object_force": (("time",), total)}
    rows = object_rows(index)
    if len(rows) > 1:
        single = [force[..., own, :].sum(axis=-2) for own in rows]
        signals["single_object_force"] = (("object", "time"), np.stack(single, axis=-2))
    return signals


def object_rows(index: LawIndex) -> list[list[int]]:
    """Return the laws of each object, as indices among the laws of all objects."""
    row = {law: number for number, law in enumerate(index.object.values())}
    return [[row[law] for law in laws] for laws in index.object_laws.values()]


def force_block(panel: Panel, mechanism: Mechanism, *, objects: bool, links: bool) -> RowBlock:
    """Return forces of drives and, if wanted, of all laws of objects and of links.

    On the rail "drive_force", on objects "object" and in links "link_force", of their laws [N].
    """
    index = mechanism.index
    drives = [index.drive[name] for name in panel.drive]
    of_objects = list(index.object.values()) if objects else []
    of_links = [index.link[name] for name in panel.link] if links else []
    on_rail = sums_of_columns("law_force", ([law] for law in drives), sign=-1.0)
    others = sums_of_columns("law_force", ([law] for law in of_objects + of_links))
    parts = {"drive_force": (0, (len(drives),))}
    if objects:
        parts["object"] = (len(drives), (len(of_objects),))
    if of_links:
        parts["link_force"] = (len(drives) + len(of_objects), (len(of_links),))
    return RowBlock(stack_rows([on_rail, others]), parts)


def object_memory(mechanism: Mechanism, history: History) -> dict[str, Channel]:
    """Return the state of the foreign objects at the end, if any of them remembers.

    The size of an object in several parts is that of its largest part.
    """
    obstructions, index = history.obstructions, mechanism.index
    rows = named_obstructions(obstructions, index.object)
    if not rows:
        return {}
    left = np.full(len(index.object_parts), np.nan)
    broken = np.zeros(left.size, dtype=np.int64)
    for number, parts in enumerate(index.object_parts.values()):
        own = [rows[part] for part in parts if part in rows]
        if own:
            left[number] = np.max(obstructions.size[own] - lasting_dents(mechanism, history)[own])
            broken[number] = np.sum(obstructions.broken[own])
    return {"object_left": (("object",), left), "object_broken": (("object",), broken)}


def has_broken(mechanism: Mechanism, history: History) -> bool:
    """Return True if a foreign object broke; bonds of frozen chairs do not count."""
    rows = named_obstructions(history.obstructions, mechanism.index.object)
    return bool(np.any(history.obstructions.broken[list(rows.values())] > 0))


def lasting_dents(mechanism: Mechanism, history: History) -> Floats:
    """Return the compression of every obstruction that stays without force [m]."""
    obstructions, laws = history.obstructions, mechanism.laws
    found = np.zeros(obstructions.law.size)
    for row, law in enumerate(obstructions.law.tolist()):
        first, end = laws.segment_start[law], laws.segment_start[law + 1]
        e = obstructions.deepest[row]
        if e > 0.0:
            at = first + np.searchsorted(laws.segment_upper[first : end - 1], e)
            force = laws.slope[at] * e + laws.intercept[at]
            if obstructions.broken[row] and obstructions.crushed[row]:
                most = obstructions.size[row] - obstructions.least[row]
                force = max(obstructions.crushed[row], obstructions.unloading[row] * (e - most))
            found[row] = max(0.0, e - force / obstructions.unloading[row])
    return found


def chair_block(panel: Panel, mechanism: Mechanism) -> RowBlock:
    """Return normal force and friction on the rail at every chair, summed over plate and roller."""
    index, chairs = mechanism.index, list(itertools.product(panel.rail, panel.chair))
    normal = _sums_at("law_force", chairs, _joined(index.chair, index.roller))
    frictions = _joined(index.chair_friction, index.roller_friction)
    friction = _sums_at("friction_force", chairs, frictions, sign=-1.0)
    shape = len(panel.rail), len(panel.chair)
    parts = {"chair_normal_force": (0, shape), "chair_friction_force": (len(chairs), shape)}
    return RowBlock(stack_rows([normal, friction]), parts)


def _joined(
    plates: Mapping[tuple[str, str], tuple[int, ...]],
    rollers: Mapping[tuple[str, str], tuple[int, ...]],
) -> Mapping[tuple[str, str], tuple[int, ...]]:
    """Return the laws of feet on the plate and on the roller of every chair."""
    return (
        {key: (*own, *rollers.get(key, ())) for key, own in plates.items()} if rollers else plates
    )


def _sums_at(
    history: str,
    places: Sequence[tuple[str, str]],
    laws: Mapping[tuple[str, str], Sequence[int]],
    *,
    sign: float = 1.0,
) -> OutputRows:
    """Return the sum of the forces of all laws at each place; of places without any it is NaN."""
    return sums_of_columns(history, (laws.get(place, ()) for place in places), sign=sign)


def stop_block(panel: Panel, mechanism: Mechanism) -> RowBlock:
    """Return the force at every stop and stud, positive in compression."""
    places = list(itertools.product(panel.rail, stop_names(panel)))
    laws = {place: (law,) for place, law in mechanism.index.stop.items()}
    shape = len(panel.rail), len(panel.stop) + len(panel.stud)
    return RowBlock(_sums_at("law_force", places, laws), {"stop_force": (0, shape)})


def stop_names(panel: Panel) -> list[str]:
    """Return stops by their name and studs as "stud N", in the order of the panel."""
    return [*panel.stop, *(f"stud {name}" for name in panel.stud)]


_STORED = {
    "energy_kinetic": KINETIC,
    "energy_strain": STRAIN,
    "energy_contact": CONTACT,
    "energy_gravity": GRAVITY,
}
_LEDGER = {
    "work_markers": MARKERS,
    "energy_friction": FRICTION,
    "energy_damping": DAMPING,
    "energy_object_switched": SWITCHED,
    "energy_object_dissipated": OBJECTS,
}
ENERGIES = (*_STORED, *_LEDGER, "energy_numerical", "energy_residual")
"""Channels that `energy_channels` makes."""


def energy_channels(stored: Floats, ledger: Floats) -> dict[str, Channel]:
    """Return all energies; stored ones as change from the first instant.

    `energy_residual` is the only one that is a remainder: the stored change less what was put in
    and not taken out. The others come each from its own history.

    Parameters
    ----------
    stored : ndarray, shape (n_times, 4)
        Columns of `turnout.solver.energy`, kinetic first [J].
    ledger : ndarray, shape (n_times, 7)
        Columns of `turnout.solver.energy`, work of markers first [J].

    Returns
    -------
    dict
        Channel name to dimensions and values.
    """
    # Rows over time, which later reading takes one after the other.
    stores, sums = np.ascontiguousarray((stored - stored[:1]).T), np.ascontiguousarray(ledger.T)
    rows = {name: stores[row] for name, row in _STORED.items()}
    rows |= {name: sums[row] for name, row in _LEDGER.items()}
    rows["energy_numerical"] = sums[ALGORITHMIC] + sums[SEGMENTS]
    rows["energy_residual"] = unaccounted_energy(stored, ledger)[1]
    return {name: (("time",), values) for name, values in rows.items()}


def energy_scale(stored: Floats, ledger: Floats) -> float:
    """Return the largest sum of marker work and stored change of a run, for ratios [J]."""
    return float(energy_balance(stored, ledger)[1])


AXES = ("x", "y", "z")
FASTENINGS = ("fastening_force", "fastening_moment")


def fastening_signals(panel: Panel, motion: Motion) -> dict[str, Channel]:
    """Return force and moment of every fastening on the switch rails.

    NaN where a fastening does not hold a rail, or is part of matrices of another program.
    """
    shape = (len(panel.rail), len(panel.fastening), len(AXES), motion.history.time.size)
    force, moment = np.full(shape, np.nan), np.full(shape, np.nan)
    for r, rail in enumerate(panel.rail):
        body = motion.rails[rail]
        for f, fastening in enumerate(panel.fastening.values()):
            if body.with_supports or (fastening.rails is not None and rail not in fastening.rails):
                continue
            offset = fastening_offset(panel, rail, fastening)
            rows = _rows(body, fastening, offset=offset)
            moved = row_motion(motion, [(body, rows)])
            spring = np.array(
                [
                    *(fastening.stiffness_x, fastening.stiffness_y, fastening.stiffness_z),
                    *(fastening.stiffness_roll, fastening.stiffness_pitch, fastening.stiffness_yaw),
                ]
            )
            resisted = 0.0 - spring[:, np.newaxis] * moved
            force[r, f], moment[r, f] = resisted[:3], resisted[3:]
    dims = ("rail", "fastening", "axis", "time")
    return {"fastening_force": (dims, force), "fastening_moment": (dims, moment)}


def _rows(body: RailBody, fastening: Fastening, *, offset: float) -> Floats:
    """Return rows to the motion of the rail at a fastening, shape (6, count)."""
    node = int(np.argmin(np.abs(body.x - fastening.x)))
    rows: Floats = body.recovery[6 * node : 6 * node + 6].copy()
    rows[0] += fastening.height * rows[4] - offset * rows[5]
    rows[1] -= fastening.height * rows[3]
    rows[2] += offset * rows[3]
    return rows
