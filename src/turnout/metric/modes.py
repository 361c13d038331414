"""Frequencies, damping and shapes of the rails of a panel, alone and together.

The kind of motion of a shape is on which rail and in which direction it is, and where it is
largest. Shapes are complex displacements of the foot line. Kinetic energies are taken rail by rail
from the sections alone: each direction at the centroid, torsion with the polar moment of inertia.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import eigh

from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import ResponseError
from turnout.core.provenance import provenance
from turnout.core.threads import one_blas_thread
from turnout.mechanism.build import build_mechanism, rail_data
from turnout.mechanism.mechanism import Mechanism, RailBody, RailData
from turnout.mechanism.reduce import reduce_rail, reduction_of
from turnout.mechanism.varied_rails import MOST_ERROR, STEP, variation_error
from turnout.metric.sliding import (
    ComplexModes,
    complex_modes,
    reduced_shapes,
    steady_sliding,
    stick_coupling,
)
from turnout.panel.load import LoadedPanel
from turnout.panel.markers import marker_offsets, marker_positions
from turnout.panel.model import Panel
from turnout.solver.condense import condense
from turnout.solver.modal import ModalModel

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

MOTIONS = ("lateral", "vertical", "torsion", "along")
RIGID = 1e-12
"""Eigenvalues below this share of the largest belong to rigid-body modes [-]."""
HEAD_HEIGHT = 0.1
"""Height above the foot at which the motion of a turning rail is evaluated as well [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyShape:
    """The shape of one rail.

    Attributes
    ----------
    data : RailData
        The rail.
    x : ndarray, shape (n,)
        Nodes [m].
    nodes : ndarray of complex, shape (n, 6)
        ux ... rz of the foot line.
    """

    data: RailData
    x: Floats
    nodes: Complexes


def kinetic_shares(shapes: list[BodyShape]) -> Floats:
    """Return the shares of kinetic energy, shape (n_bodies, 4), in the order of `MOTIONS` [-]."""
    energy = np.array([_energies(shape) for shape in shapes])
    total = energy.sum()
    shares: Floats = energy / total if total > 0 else energy
    return shares


def _energies(shape: BodyShape) -> Floats:
    data = shape.data
    middle = 0.5 * (shape.nodes[1:] + shape.nodes[:-1])
    if data.matrices is None:
        height = 0.5 * (data.axis_height[1:] + data.axis_height[:-1])
        section = data.sections
        y, z = section.centroid_y, section.centroid_z + height
        area = section.area
        polar = section.second_moment_lateral + section.second_moment_vertical
    else:  # the sections are not known: a rail of even mass, seen at half the height of its head
        ones = np.ones(middle.shape[0])
        y, z, area, polar = (
            0.0 * ones,
            0.5 * HEAD_HEIGHT * ones,
            ones,
            (0.5 * HEAD_HEIGHT) ** 2 * ones,
        )
    lateral = middle[:, 1] - z * middle[:, 3]
    vertical = middle[:, 2] + y * middle[:, 3]
    along = middle[:, 0] + z * middle[:, 4] - y * middle[:, 5]
    length = np.diff(shape.x)
    squares = (
        area * np.abs(lateral) ** 2,
        area * np.abs(vertical) ** 2,
        polar * np.abs(middle[:, 3]) ** 2,
        area * np.abs(along) ** 2,
    )
    return np.array([float(np.sum(length * square)) for square in squares])


def largest_component(shapes: list[BodyShape]) -> tuple[int, int, complex]:
    """Return body, node and displacement of the largest motion of foot or head, across the rail.

    Either the lateral or vertical displacement of the foot, or the lateral one of the head.
    """
    best = (0, 0, 0.0 + 0.0j)
    for number, shape in enumerate(shapes):
        nodes = shape.nodes
        moved = np.stack((nodes[:, 1] - HEAD_HEIGHT * nodes[:, 3], nodes[:, 1], nodes[:, 2]))
        at = np.unravel_index(int(np.argmax(np.abs(moved))), moved.shape)
        if np.abs(moved[at]) > abs(best[2]):
            best = (number, int(at[1]), complex(moved[at]))
    return best


def shapes_on_grid(shapes: list[BodyShape], x: Floats) -> Complexes:
    """Interpolate shapes to common places, shape (n_bodies, 6, n); NaN beyond a rail."""
    found = np.full((len(shapes), 6, x.size), np.nan + 0j, dtype=np.complex128)
    for number, shape in enumerate(shapes):
        inside = (x >= shape.x[0] - 1e-9) & (x <= shape.x[-1] + 1e-9)
        for direction in range(6):
            found[number, direction, inside] = np.interp(
                x[inside], shape.x, shape.nodes[:, direction]
            )
    return found


DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
FEET_FREE, ON_CHAIRS = "feet free", "on its chairs"
AT_REST, STICKING = "panel at rest, feet free to slide", "panel at rest, feet sticking"
RIGID_FREQUENCY_SHARE = 1e-3
"""Share of the lowest frequency below which an eigenvalue belongs to a rigid-body mode."""

UNITS = {
    "frequency": ("Hz", "damped natural frequency"),
    "damping_ratio": ("1", "share of critical damping"),
    "motion_share": ("1", "share of the kinetic energy by kind of motion"),
    "rail_share": ("1", "share of the kinetic energy by rail"),
    "largest_rail": ("1", "rail that moves most"),
    "largest_x": ("m", "where it moves most"),
    "shape": ("1", "displacement of the foot line, in phase with the largest"),
    "shape_quadrature": ("1", "displacement of the foot line, a quarter of a cycle ahead"),
}


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """Bodies that swing together: coupling, model and the reduced coordinates of its modes."""

    name: str
    bodies: tuple[int, ...]
    modes: ComplexModes
    shapes: Complexes


def modes(panel: LoadedPanel, *, count: int = 10) -> xr.Dataset:
    """Find the lowest modes of every rail alone and of the panel at rest.

    A rail alone stands on its fastenings, once with its feet free and once on all of its chairs,
    closed and without friction. The panel at rest has the chairs, stops and drives as they are in
    static equilibrium, and its links; its feet slide freely, or stick, each on its spring.

    Parameters
    ----------
    panel : LoadedPanel
        From `load_panel`.
    count : int
        Modes of each system.

    Returns
    -------
    xarray.Dataset
        ``frequency`` [Hz] and ``damping_ratio`` of each mode; ``motion_share`` and ``rail_share``
        of its kinetic energy; ``shape`` and ``shape_quadrature`` over rail, direction and x, scaled
        so that the largest displacement of foot or head is 1. The coordinate ``system`` says what
        swings. A rigid-body mode has the frequency 0 and NaN for its damping.

    Raises
    ------
    ResponseError
        When `count` is not positive.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> found = modes(load_panel("sb1"), count=2)
    >>> found["shape"].dims
    ('mode', 'rail', 'direction', 'x')
    """
    if count < 1:
        message = f"modes: count = {count}: must be 1 or more"
        raise ResponseError(message)
    with one_blas_thread():
        data = rail_data(panel)
        mechanism = build_mechanism(panel)
        systems = [*_rail_systems(mechanism, data, count), *_panel_systems(panel, mechanism, count)]
    dataset = _dataset(data, mechanism.rails, systems)
    attributes = {
        "title": f"Modes of {panel.name}",
        "kind": "modes",
        **provenance(),
        "schema_version": SCHEMA_VERSION,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "overrides": json.dumps(dict(panel.overrides), default=str),
        "superelement_cutoff": panel.discretisation.superelement_cutoff,
    }
    return dataset.assign_attrs(attributes)


def reduction_texts(panel: Panel) -> dict[str, str]:
    """Return size and error of the reduction of each rail, as text by the rail's name."""
    with one_blas_thread():
        return {data.name: "\n".join(_reduction_lines(data)) for data in rail_data(panel)}


def _reduction_lines(data: RailData) -> Iterator[str]:
    yield str(reduction_of(data))
    if data.matrices is None:
        share, error = 100.0 * (STEP**0.5 - 1.0), variation_error(data)
        yield (
            f"static error with both section scales {share:.0f} % higher or lower, "
            f"in the shapes of this rail: {error:.0e}, at most {MOST_ERROR:.0e}"
        )


def _rail_systems(mechanism: Mechanism, data: list[RailData], count: int) -> Iterator[_System]:
    """Yield each rail alone: feet free, off the chairs' dashpots too, and on its chairs."""
    laws = mechanism.laws
    for number, body in enumerate(mechanism.rails):
        mine = slice(body.first, body.first + body.count)
        chairs = [
            law
            for family in (mechanism.index.chair, mechanism.index.roller)
            for (rail, _), feet in family.items()
            if rail == body.name
            for law in feet
        ]
        closed = np.array([laws.slope[laws.segment_start[law] + 1] for law in chairs])
        rows = mechanism.rows[laws.row[chairs], mine]
        hung = reduce_rail(replace(data[number], dashpots=())).damping
        states = [(FEET_FREE, 0.0 * closed, hung)]
        if chairs:
            states.append((ON_CHAIRS, closed, mechanism.damping[mine, mine]))
        for name, springs, damping in states:
            model = free_model(
                mechanism.stiffness[mine, mine] + (rows.T * springs) @ rows,
                mechanism.mass[mine, mine],
                damping=damping,
            )
            title = body.name if body.name.startswith("stock rail") else f"rail {body.name}"
            if chairs:
                title += f", {name}"
            yield _system(title, (number,), model, np.zeros((0, 0)), count)


def free_model(stiffness: Floats, mass: Floats, *, damping: Floats) -> ModalModel:
    """Return all modes of a free body; it has no rows and no load.

    Parameters
    ----------
    stiffness, mass, damping : ndarray, shape (n_dof, n_dof)
        Symmetric; the mass positive definite.

    Returns
    -------
    ModalModel
        The eigenvalue of a rigid-body mode is zero.

    Examples
    --------
    >>> spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    >>> free_model(spring, np.eye(2), damping=0 * spring).eigenvalues.round(9).tolist()
    [0.0, 2.0]
    """
    eigenvalues, shapes = eigh(stiffness, mass, check_finite=True)
    eigenvalues[eigenvalues < RIGID * eigenvalues[-1]] = 0.0
    none = np.zeros((0, eigenvalues.size))
    return ModalModel(
        stiffness=np.diag(eigenvalues),
        damping=shapes.T @ damping @ shapes,
        modes=shapes,
        row_modes=none,
        flexibility=np.zeros((0, 0)),
        residual_shapes=np.zeros((eigenvalues.size, 0)),
        load=np.zeros(eigenvalues.size),
        residual_load=np.zeros(eigenvalues.size),
        row_load=np.zeros(0),
    )


def _panel_systems(panel: Panel, mechanism: Mechanism, count: int) -> Iterator[_System]:
    """Yield the panel at rest, with feet that slide and with feet that stick."""
    model = condense(mechanism, cutoff_frequency=float("inf"))
    start = marker_positions(panel, 0.0)[:, 0] + marker_offsets(panel)
    state = steady_sliding(mechanism, model, inputs=start, sense=0.0)
    if not state.settled:
        message = f"modes: the panel {panel.name} finds no static equilibrium; check its supports"
        raise ResponseError(message)
    everything = tuple(range(len(mechanism.rails)))
    yield _system(AT_REST, everything, model, state.coupling, count)
    if mechanism.laws.friction_row.size:
        yield _system(STICKING, everything, model, stick_coupling(mechanism, state), count)


def _system(
    name: str, bodies: tuple[int, ...], model: ModalModel, coupling: Floats, count: int
) -> _System:
    """Solve for the lowest modes that swing, after the rigid-body modes."""
    found = complex_modes(model, coupling)
    still = np.flatnonzero(model.eigenvalues == 0.0)
    least = RIGID_FREQUENCY_SHARE * np.sqrt(
        np.min(model.eigenvalues, where=model.eigenvalues > 0.0, initial=np.inf)
    )
    swinging = np.flatnonzero(found.eigenvalues.imag > least)[: max(count - still.size, 0)]
    swinging = swinging[np.argsort(found.eigenvalues[swinging].imag, kind="stable")]
    rigid = np.eye(model.eigenvalues.size, dtype=np.complex128)[:, still]
    chosen = ComplexModes(
        np.append(np.zeros(still.size, complex), found.eigenvalues[swinging])[:count],
        np.hstack((rigid, found.shapes[:, swinging]))[:, :count],
    )
    return _System(name, bodies, chosen, reduced_shapes(model, coupling, chosen.shapes))


def _dataset(
    data: list[RailData], rails: tuple[RailBody, ...], systems: list[_System]
) -> xr.Dataset:
    """Put the modes of all systems one after the other."""
    x = np.unique(np.round(np.concatenate([body.x for body in rails]), 9))
    names = [body.name for body in rails]
    rows: list[dict[str, object]] = []
    for system in systems:
        first = rails[system.bodies[0]].first
        for number, eigenvalue in enumerate(system.modes.eigenvalues):
            shapes = [
                BodyShape(
                    data[at],
                    rails[at].x,
                    (
                        rails[at].recovery
                        @ system.shapes[
                            rails[at].first - first : rails[at].first - first + rails[at].count,
                            number,
                        ]
                    ).reshape(-1, 6),
                )
                for at in system.bodies
            ]
            rows.append(_row(system, number, complex(eigenvalue), shapes, x, len(rails)))
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    dims = {
        "motion_share": ("mode", "motion"),
        "rail_share": ("mode", "rail"),
        "shape": ("mode", "rail", "direction", "x"),
        "shape_quadrature": ("mode", "rail", "direction", "x"),
    }
    columns["largest_rail"] = np.array(names, dtype=np.str_)[columns["largest_rail"]]
    variables = {
        key: (dims.get(key, ("mode",)), columns[key], {"units": unit, "long_name": text})
        for key, (unit, text) in UNITS.items()
    }
    coordinates = {
        "mode": np.arange(len(rows)),
        "system": ("mode", columns["system"].astype(np.str_)),
        "number": ("mode", columns["number"]),
        "rail": np.array(names, dtype=np.str_),
        "direction": np.array(DIRECTIONS, dtype=np.str_),
        "motion": np.array(MOTIONS, dtype=np.str_),
        "x": ("x", x, {"units": "m", "long_name": "position from the toe"}),
    }
    return xr.Dataset(variables, coordinates)


def _row(
    system: _System,
    number: int,
    eigenvalue: complex,
    shapes: list[BodyShape],
    x: Floats,
    n_rails: int,
) -> dict[str, object]:
    """Return one mode, scaled by its largest displacement."""
    body, node, value = largest_component(shapes)
    shares = kinetic_shares(shapes)
    everywhere = np.full((n_rails, 6, x.size), np.nan + 0j, dtype=np.complex128)
    everywhere[list(system.bodies)] = shapes_on_grid(shapes, x) / (value or 1.0)
    by_rail = np.zeros(n_rails)
    by_rail[list(system.bodies)] = shares.sum(axis=1)
    still = eigenvalue == 0.0
    return {
        "system": system.name,
        "number": number + 1,
        "frequency": eigenvalue.imag / (2.0 * np.pi),
        "damping_ratio": np.nan if still else -eigenvalue.real / abs(eigenvalue),
        "motion_share": shares.sum(axis=0),
        "rail_share": by_rail,
        "largest_rail": system.bodies[body],
        "largest_x": round(float(shapes[body].x[node]), 9),
        "shape": everywhere.real,
        "shape_quadrature": everywhere.imag,
    }
