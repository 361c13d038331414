r"""Another program for the gauge beside a closed rail: beams, contact and friction of its own.

What it takes of turnout are the numbers of the panel and the section properties along its switch
rails, as any program would from a drawing. All else is its own:

- a beam is a cantilever of constant section whose tip flexibility is integrated from the forces of
  its sections, moments about the centroid, torque about the shear centre, and turned into a
  stiffness matrix by equilibrium; no shape functions, no modes, no reduction;
- the ways of the rails from closed to open, and the lengths of links that follow;
- all laws at once, as the minimum of a convex energy over the forces on their rows, with the
  flexibility of all four rails;
- Coulomb friction by a return mapping to the end of each step; limits follow the normal forces of
  the minimum before until they no longer change;
- markers and loads in small steps: the switch opens from rest without friction and closes again,
  then the load of a wheel moves from node to node.
"""

import copy
from dataclasses import dataclass, field

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from tests.verification.independent_switch import markers

from turnout.core.threads import one_blas_thread
from turnout.mechanism.rail_sections import foot_spans, section_values, station_columns
from turnout.panel.load import LoadedPanel
from turnout.panel.profile import evaluate_profile

Floats = NDArray[np.float64]

MESH = 0.15
"""Length of a beam [m]."""
HELD = 1e9
"""Stiffness that keeps feet on their chairs while the way of a rail is found [N/m]."""
THROWN, ROLLED = 120, 5
"""Steps of each movement, and of the wheel from one node to the next place."""
ITERATIONS, STEPS = 60, 60
"""Changes of the limits of friction, and Newton steps of each, at most."""
FORCE_CHANGE, SETTLED, HALVED = 0.02, 1e-10, 20
"""Change of a limit [N] and of a displacement [m] that counts as none; halvings of a step."""
COLUMNS = ("area", "second_moment_lateral", "second_moment_vertical", "product_moment")
COLUMNS += ("torsion_constant", "shear_factor_lateral", "shear_factor_vertical")
COLUMNS += ("centroid_offset", "centroid_height", "shear_centre_offset", "shear_centre_height")


def beam_stiffness(section: dict[str, float], length: float, young: float, shear: float) -> Floats:
    """Return the stiffness of a beam between two nodes on its reference line, shape (12, 12).

    Parameters
    ----------
    section : dict of str to float
        The `COLUMNS`, y in panel axes.
    length, young, shear : float
        [m], [N/m^2], [N/m^2]
    """
    area, lateral, vertical, product, torsion = (section[name] for name in COLUMNS[:5])
    soft = [1.0 / (section[name] * shear * area) for name in COLUMNS[5:7]]
    y_c, z_c, y_s, z_s = (section[name] for name in COLUMNS[7:])
    bending = np.linalg.inv(young * np.array([[lateral, product], [product, vertical]]))
    points, weights = np.polynomial.legendre.leggauss(3)
    flexibility = np.zeros((6, 6))
    for at, weight in zip(0.5 * length * (points + 1.0), 0.5 * length * weights, strict=True):
        arm = length - at  # from the section to the node at the tip, where F and M act
        # moments about a point (y, z) of the section: M + (arm, -y, -z) x F
        moment_y = np.array([-z_c, 0.0, -arm, 0.0, 1.0, 0.0])
        moment_z = np.array([y_c, arm, 0.0, 0.0, 0.0, 1.0])
        torque = np.array([0.0, z_s, -y_s, 1.0, 0.0, 0.0])
        both = np.array([-moment_z, moment_y])
        flexibility += weight * (
            both.T @ bending @ both + np.outer(torque, torque) / shear / torsion
        )
        flexibility += weight * np.diag([1.0 / young / area, *soft, 0.0, 0.0, 0.0])
    at_root = -np.eye(6)  # forces at the root that hold those at the tip
    at_root[4, 2], at_root[5, 1] = length, -length
    balanced = np.concatenate((at_root, np.eye(6)))
    found: Floats = balanced @ np.linalg.solve(flexibility, balanced.T)
    return found


@dataclass(eq=False)
class Beam:
    """One rail: nodes, stiffness with linear supports, weight, and which coordinates are free."""

    x: Floats
    matrix: sp.lil_array
    weight: Floats
    clamped: list[int] = field(default_factory=list)

    def row(self, x: float, kind: str, *, y: float = 0.0, z: float = 0.0) -> Floats:
        """Return the displacement of a point of a section as a row over the coordinates."""
        node = int(np.argmin(abs(self.x - x)))
        assert abs(self.x[node] - x) < 1e-6, f"no node at {x}"
        found = np.zeros(self.weight.size)
        at = 6 * node
        if kind == "ux":
            found[[at, at + 4, at + 5]] = 1.0, z, -y
        elif kind == "uy":
            found[[at + 1, at + 3]] = 1.0, -z
        elif kind == "uz":
            found[[at + 2, at + 3]] = 1.0, y
        else:
            found[at + ("rx", "ry", "rz").index(kind) + 3] = 1.0
        return found

    def support(self, stiffness: float, row: Floats) -> None:
        """Add a linear spring along a row."""
        at = np.flatnonzero(row)
        self.matrix[np.ix_(at, at)] += stiffness * np.outer(row[at], row[at])

    def solved(self, right: Floats) -> Floats:
        """Return displacements under loads, shape (n, m)."""
        free = np.setdiff1d(np.arange(self.weight.size), self.clamped)
        found = np.zeros(right.shape)
        matrix = sp.csc_array(self.matrix.tocsc()[free][:, free])
        found[free] = splu(matrix).solve(right[free])
        return found


def beam_of(panel: LoadedPanel, sections: dict[str, Floats], x: Floats) -> Beam:
    """Assemble a rail from the sections at the middles of its beams, in panel axes."""
    young = panel.material.youngs_modulus
    shear = young / (2.0 + 2.0 * panel.material.poisson_ratio)
    matrix, weight = sp.lil_array((6 * x.size, 6 * x.size)), np.zeros(6 * x.size)
    for number, length in enumerate(np.diff(x)):
        section = {name: float(values[number]) for name, values in sections.items()}
        own = slice(6 * number, 6 * number + 12)
        matrix[own, own] += beam_stiffness(section, float(length), young, shear)
        half = -0.5 * panel.gravity * panel.material.density * section["area"] * length
        for node in (number, number + 1):
            weight[6 * node + 2] += half
            weight[6 * node + 3] += half * section["centroid_offset"]
    return Beam(x, matrix, weight)


def springs_of(beam: Beam, item: object, *, y: float, z: float) -> None:
    """Add a fastening, or a record with the same six stiffnesses."""
    for kind, name in zip(
        ("ux", "uy", "uz", "rx", "ry", "rz"), ("x", "y", "z", "roll", "pitch", "yaw"), strict=True
    ):
        stiffness = getattr(item, f"stiffness_{name}")
        if stiffness:
            beam.support(stiffness, beam.row(item.x, kind, y=y, z=z))  # type: ignore[attr-defined]


def in_panel_axes(values: dict[str, Floats], side: float) -> dict[str, Floats]:
    """Turn columns whose y points to the stock rail."""
    turned = ("product_moment", "centroid_offset", "shear_centre_offset")
    return {name: (side if name in turned else 1.0) * values[name] for name in COLUMNS}


def side_of(panel: LoadedPanel, rail: str) -> float:
    """Return 1.0 for a rail that closes to +y, else -1.0."""
    return 1.0 if panel.rail[rail].closes == "+y" else -1.0


def switch_beam(panel: LoadedPanel, rail: str) -> Beam:
    """Return a switch rail with its fastenings and the brackets of its rods."""
    record, side = panel.rail[rail], side_of(panel, rail)
    x = np.round(np.arange(record.start, record.end + 1e-9, MESH), 9)
    values = section_values(panel, rail, 0.5 * (x[1:] + x[:-1]))
    beam = beam_of(panel, in_panel_axes(values, side), x)
    for item in panel.fastening.values():
        spans = foot_spans(panel, rail, [item.x])
        middle = 0.0 if spans is None else 0.5 * float(spans.sum())
        springs_of(beam, item, y=side * middle, z=item.height)
    for drive in panel.drive.values():
        if drive.rail == rail:
            beam.support(drive.roll_stiffness, beam.row(drive.x, "rx"))
    beam.clamped = list(range(6 * x.size - 6, 6 * x.size))
    return beam


def stock_beam(panel: LoadedPanel, rail: str) -> Beam:
    """Return the stock rail of a switch rail; its section is symmetric, heights from its foot."""
    record = next(item for item in panel.stock_rail.values() if item.faces == rail)
    x = np.round(np.arange(record.start, record.end + 1e-9, MESH), 9)
    columns = station_columns(panel, record.section)
    sections = {name: np.full(x.size - 1, columns[name][0]) for name in COLUMNS}
    beam = beam_of(panel, in_panel_axes(sections, side_of(panel, rail)), x)
    for item in panel.stock_fastening.values():
        springs_of(beam, item, y=0.0, z=item.height - record.foot_height)
    last = 6 * x.size
    beam.clamped = [*range(6), *range(last - 6, last)]
    return beam


@dataclass(eq=False)
class Laws:
    """Rows of laws and their numbers: contacts, drives, links, feet that slide.

    Attributes
    ----------
    contact : list of (row, stiffness, clearance)
        That resist what exceeds the clearance.
    spring : list of (row, stiffness, free, most, beyond, drive)
        Linear up to a force, with another stiffness beyond; `drive` numbers its marker, or -1.
    slide : list of (row, contact, coefficient, stiffness)
        Friction along a row with the limit of a contact.
    """

    contact: list[tuple[int, float, float]] = field(default_factory=list)
    spring: list[tuple[int, float, float, float, float, int]] = field(default_factory=list)
    slide: list[tuple[int, int, float, float]] = field(default_factory=list)


class Switch:
    """A whole switch of two blades and two stock rails on the rows of its laws.

    Parameters
    ----------
    panel : LoadedPanel
        Like the default panel: two rails with fit gaps and stock rails, drives on the first.
    size, at : float
        Of a spring-like object beside the instrumented rail, and its place [m]; 0 for none.
    """

    def __init__(self, panel: LoadedPanel, *, size: float = 0.0, at: float = 0.0) -> None:
        self.panel, self.rows, self.laws = panel, list[list[tuple[str, Floats]]](), Laws()
        self.blades = {rail: switch_beam(panel, rail) for rail in panel.rail}
        self.stocks = {rail: stock_beam(panel, rail) for rail in panel.rail}
        self.first = panel.instrumented_rail
        self.other = next(rail for rail in panel.rail if rail != self.first)
        self.way = self._ways()
        for rail in (self.first, self.other):
            self._add_chairs(rail)
            self._add_stops(rail)
        self._add_drives_and_links()
        if size:
            given = panel.object_defaults
            gap = float(self.gap(self.first, np.array([at]))[0])
            self._contact(self.first, at, given.height, float(given.stiffness or 0.0), gap - size)
            self.object = len(self.laws.contact) - 1
        side, blade = side_of(panel, self.first), self.blades[self.first]
        gauge = panel.gauge
        assert gauge is not None
        self.edge = [
            self._row((self.first, side * blade.row(x, "uy", z=gauge.height))) for x in blade.x
        ]
        self.down = [self._row((self.first, -blade.row(x, "uz"))) for x in blade.x]
        self.flexibility, self.resting = self._flexible()

    def gap(self, rail: str, x: Floats) -> Floats:
        """Return the gap of a rail to its stock rail where both are free of force [m]."""
        record = self.panel.rail[rail]
        assert record.fit_gap is not None
        height = self.panel.object_defaults.height
        beam, way = self.blades[rail], self.way[rail]
        moved = [float(beam.row(at, "uy", z=height) @ way) for at in x]
        fit: Floats = evaluate_profile(record.fit_gap, x)
        return fit + record.fraction * np.array(moved)

    def _ways(self) -> dict[str, Floats]:
        """Return the way of each rail from closed to open, as if it opened to +y."""
        ends: dict[str, float] = {}
        found = {}
        for rail in (self.first, self.other):
            beam = switch_beam(self.panel, rail)
            side, held = side_of(self.panel, rail), []
            for chair in self.panel.chair.values():
                spans = foot_spans(self.panel, rail, [chair.x])
                assert spans is not None
                for edge in spans[0]:
                    beam.support(HELD, beam.row(chair.x, "uz", y=side * float(edge)))
            if rail == self.first:
                for drive in self.panel.drive.values():
                    held.append((beam.row(drive.x, "uy", z=drive.height), drive.stroke))
            else:
                for name, link in self.panel.link.items():
                    held.append((beam.row(link.x, "uy", z=link.height), ends[name]))
            rows = np.array([row for row, _ in held])
            yielded = beam.solved(rows.T)
            forces = np.linalg.solve(rows @ yielded, np.array([way for _, way in held]))
            found[rail] = yielded @ forces
            for name, link in self.panel.link.items():
                ends[name] = float(beam.row(link.x, "uy", z=link.height) @ found[rail])
        return found

    def _row(self, *parts: tuple[str, Floats]) -> int:
        self.rows.append(list(parts))
        return len(self.rows) - 1

    def _add_chairs(self, rail: str) -> None:
        beam, side = self.blades[rail], side_of(self.panel, rail)
        for chair in self.panel.chair.values():
            slide = self._row((rail, beam.row(chair.x, "uy", z=chair.foot_height)))
            spans = foot_spans(self.panel, rail, [chair.x])
            assert spans is not None
            for edge in spans[0]:
                foot = -beam.row(chair.x, "uz", y=side * float(edge), z=chair.foot_height)
                row = self._row((rail, foot))
                self.laws.contact.append((row, chair.normal_stiffness, chair.clearance))
                number = len(self.laws.contact) - 1
                friction = (chair.friction_coefficient, chair.stick_stiffness)
                self.laws.slide.append((slide, number, *friction))

    def _add_stops(self, rail: str) -> None:
        for item in (*self.panel.stop.values(), *self.panel.stud.values()):
            gap = float(self.gap(rail, np.array([item.x]))[0]) + item.clearance
            self._contact(rail, item.x, item.height, item.stiffness, gap)

    def _contact(self, rail: str, x: float, z: float, stiffness: float, clearance: float) -> None:
        """Add a contact between a rail and its stock rail."""
        side = side_of(self.panel, rail)
        foot = next(s.foot_height for s in self.panel.stock_rail.values() if s.faces == rail)
        own = side * self.blades[rail].row(x, "uy", z=z)
        stock = -side * self.stocks[rail].row(x, "uy", z=z - foot)
        row = self._row((rail, own), (f"stock {rail}", stock))
        self.laws.contact.append((row, stiffness, clearance))

    def _add_drives_and_links(self) -> None:
        first, other = self.blades[self.first], self.blades[self.other]
        for number, drive in enumerate(self.panel.drive.values()):
            row = self._row((self.first, first.row(drive.x, "uy", z=drive.height)))
            limits = (drive.saturation_force, drive.saturated_stiffness)
            self.laws.spring.append((row, drive.stiffness, 0.0, *limits, number))
        closed, opened = self.panel.rail[self.first].fraction, self.panel.rail[self.other].fraction
        for name, link in self.panel.link.items():
            ends = [beam.row(link.x, "uy", z=link.height) for beam in (first, other)]
            row = self._row((self.first, ends[0]), (self.other, -ends[1]))
            stroke = next(d.stroke for d in self.panel.drive.values() if abs(d.x - link.x) < 1e-6)
            # first rail closed: its stress-free share of the stroke towards +y; the other one open
            free = closed * stroke - (1.0 - opened) * stroke
            assert name
            self.laws.spring.append((row, link.stiffness, free, np.inf, 0.0, -1))

    def _flexible(self) -> tuple[Floats, Floats]:
        """Return displacements of rows for forces along rows, and under the weight."""
        count = len(self.rows)
        flexible, resting = np.zeros((count, count)), np.zeros(count)
        beams = dict(self.blades) | {f"stock {rail}": beam for rail, beam in self.stocks.items()}
        for name, beam in beams.items():
            on = np.zeros((count, beam.weight.size))
            for number, parts in enumerate(self.rows):
                for owner, row in parts:
                    if owner == name:
                        on[number] += row
            moved = beam.solved(np.concatenate((on.T, beam.weight[:, np.newaxis]), axis=1))
            flexible += on @ moved[:, :-1]
            resting += on @ moved[:, -1]
        return flexible, resting


class State:
    """Displacements of the rows of a switch, and where its feet are anchored."""

    def __init__(self, switch: Switch) -> None:
        laws = switch.laws
        self.switch, self.count = switch, switch.edge[0]
        self.flexible = switch.flexibility[: self.count, : self.count]
        self.force, self.free = np.zeros(self.count), switch.resting[: self.count].copy()
        self.contact = [np.array(column) for column in zip(*laws.contact, strict=True)]
        self.spring = [np.array(column) for column in zip(*laws.spring, strict=True)]
        self.slide = [np.array(column) for column in zip(*laws.slide, strict=True)]
        self.anchor, self.limit = np.zeros((2, self.slide[0].size))
        self.present = np.ones(self.contact[0].size, dtype=bool)
        self.marker, self.load = np.zeros(0), np.zeros(switch.resting.size)

    @property
    def g(self) -> Floats:
        """Displacements of the rows that have laws, shape (n,) [m]."""
        return self.free + self.flexible @ self.force

    @property
    def edge(self) -> Floats:
        """Displacements of the running edge at the nodes of the first rail [m]."""
        at = self.switch.edge
        from_laws = self.switch.flexibility[at, : self.count] @ self.force
        return self.switch.resting[at] + from_laws + self.switch.flexibility[at] @ self.load

    def rest(self, marker: Floats) -> None:
        """Find the equilibrium without friction, and anchor the feet there."""
        self.marker = marker
        self._minimise()
        self.anchor = self.g[self.slide[0]]

    def move(self, marker: Floats, load: Floats) -> None:
        """Find the equilibrium at the end of a step, and move the anchors of feet that slid.

        Parameters
        ----------
        marker : ndarray, shape (n_drives,)
            From where the instrumented rail is free of force, positive closing [m].
        load : ndarray, shape (n_rows,)
            Given forces along the rows [N].
        """
        self.marker, self.load = marker, load
        switch = self.switch
        self.free = (switch.resting + switch.flexibility @ load)[: self.count]
        row, on, coefficient, stiffness = self.slide
        for _ in range(ITERATIONS):
            before = self.limit
            self._minimise()
            self.limit = coefficient * self._normal()[on]
            if np.abs(self.limit - before).max() < FORCE_CHANGE:
                break
        else:
            pytest.fail("the limits of friction do not settle")
        at, reach = self.g[row], self.limit / stiffness
        self.anchor = np.clip(self.anchor, at - reach, at + reach)

    def _normal(self) -> Floats:
        """Return the forces of the contacts [N]."""
        row, stiffness, clearance = self.contact
        return np.where(self.present, stiffness * np.maximum(self.g[row] - clearance, 0.0), 0.0)

    def _minimise(self) -> None:
        """Find the forces of least energy for the present limits of friction.

        Every law is then the slope of a convex energy, so a Newton iteration finds the only
        minimum if no step goes beyond the minimum along its own line. Forces are the unknowns:
        displacements follow from them.
        """
        unit = np.eye(self.count)
        for _ in range(STEPS):
            force, slope = self._laws(self.force)
            residual = self.flexible @ (self.force - force)
            change = np.linalg.solve(unit - self.flexible * slope, -residual)
            if np.abs(change).max() < SETTLED:
                return
            step = force + slope * change - self.force
            self.force = self.force + self._share(step) * step
        pytest.fail("the energy has no minimum that a Newton iteration finds")

    def _share(self, step: Floats) -> float:
        """Return the share of a step up to the least energy along it, at most 1."""

        def rise(share: float) -> float:
            trial = self.force + share * step
            return float(self.flexible @ (trial - self._laws(trial)[0]) @ step)

        low, high = 0.0, 1.0
        if rise(high) <= 0.0:
            return high
        for _ in range(HALVED):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if rise(middle) > 0.0 else (middle, high)
        return high

    def _laws(self, trial: Floats) -> tuple[Floats, Floats]:
        """Return forces of the laws and their slopes where given forces on the rows bring these."""
        g = self.free + self.flexible @ trial
        force, slope = np.zeros(g.size), np.zeros(g.size)
        row, stiffness, clearance = self.contact
        over = g[row] - clearance
        closed = self.present & (over > 0.0)
        np.subtract.at(force, row, np.where(closed, stiffness * over, 0.0))
        np.subtract.at(slope, row, np.where(closed, stiffness, 0.0))
        row, stiffness, rest, most, beyond, drive = self.spring
        pulled = np.where(drive >= 0, np.append(self.marker, 0.0)[drive.astype(int)], 0.0)
        of_slide = (self.slide[0], self.slide[3], self.anchor, self.limit, 0.0 * self.limit)
        of_spring = (row, stiffness, rest + pulled, most, beyond)
        for rows, k, zero, bound, after in (of_spring, of_slide):
            e = g[rows] - zero
            inside = np.abs(k * e) <= bound
            turn = np.where(inside, np.abs(e), np.where(np.isfinite(bound), bound, 0.0) / k)
            np.subtract.at(force, rows, np.sign(e) * (k * turn + after * (np.abs(e) - turn)))
            np.subtract.at(slope, rows, np.where(inside, k, after))
        return force, slope


def thrown(switch: Switch, *, trapped: bool) -> State:
    """Return a switch at rest after it was thrown open, without friction before, and closed again.

    Parameters
    ----------
    switch : Switch
        The switch.
    trapped : bool
        Whether its object is placed when the rail stands open.
    """
    panel, state = switch.panel, State(switch)
    nothing = np.zeros(switch.resting.size)
    start, end = panel.movement["return"].start, panel.schedule.end
    opening = np.linspace(0.0, panel.movement["throw"].duration + 0.2, THROWN + 1)
    if trapped:
        state.present[switch.object] = False
    with one_blas_thread():
        state.rest(markers(panel, opening[:1], 0.0)[0])
        for marker in markers(panel, opening[1:], 0.0):
            state.move(marker, nothing)
        state.present[:] = True
        for marker in markers(panel, np.linspace(start, end, THROWN + 1), 0.0):
            state.move(marker, nothing)
    return state


def rolled(state: State, *, lateral: float, vertical: float, places: Floats) -> Floats:
    """Roll a wheel over the first rail of a switch at rest; return the gauge at nodes [m].

    Parameters
    ----------
    state : State
        From `thrown`; it is not changed.
    lateral, vertical : float
        Load at the running edge [N].
    places : ndarray, shape (n_places,)
        Nodes to which the wheel comes one after the other [m].

    Returns
    -------
    ndarray, shape (n_places, n_nodes)
    """
    state, switch = copy.copy(state), state.switch
    nodes = [int(np.argmin(np.abs(switch.blades[switch.first].x - place))) for place in places]
    found, before = [], np.zeros(switch.resting.size)
    with one_blas_thread():
        for node in nodes:
            after = np.zeros(before.size)
            after[switch.edge[node]], after[switch.down[node]] = lateral, vertical
            for share in np.arange(1, ROLLED + 1) / ROLLED:
                state.move(state.marker, (1.0 - share) * before + share * after)
            found.append(gauge_of(state))
            before = after
    return np.array(found)


def gauge_of(state: State) -> Floats:
    """Return the gauge at the nodes of the first rail [m]."""
    switch = state.switch
    gauge, blade = switch.panel.gauge, switch.blades[switch.first]
    assert gauge is not None
    found: Floats = gauge.nominal - switch.gap(switch.first, blade.x) + state.edge
    return found
