r"""Track gauge under a wheel that rolls along the closed switch rail, without inertia.

The switch is thrown from event to event, and rests as the throw leaves it: friction in the chairs,
drives at their over-travel, objects in the gap. Then a wheel comes onto the closed rail at one end
and rolls to the other. It presses on this rail alone, with two constant forces at its place,

- the flange force Y towards the stock rail, at the running edge, 14 mm below the running surface,
- the vertical force Q downwards.

From place to place the forces pass on in proportion to the way, so that they move in straight
lines, as markers do; the quasi-static integrator follows these exactly: every contact that opens or
closes, every foot that sticks or slips. What a foot has slid stays slid, so it matters from which
end the wheel comes.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import ResponseError
from turnout.core.problems import choices
from turnout.core.provenance import provenance
from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.mechanism.build import build_loaded, build_mechanism
from turnout.mechanism.laws import SOFT_STIFFNESS
from turnout.mechanism.mechanism import Mechanism, Point
from turnout.panel.foreign_object import ForeignObject, PlacedObject, resolve_objects
from turnout.panel.layout import SIDE
from turnout.panel.load import LoadedPanel
from turnout.panel.place import place_name
from turnout.solver.energy import energy_balance
from turnout.solver.integration import History, integrate
from turnout.solver.outcome import NotConverged
from turnout.solver.start import PriorMotion
from turnout.throw.dataset import gauge_rules, object_record
from turnout.throw.gauge import gauge_along
from turnout.throw.recovery import RX, recover_motion, row_motion
from turnout.throw.route import closed_rail, throws
from turnout.throw.simulate import as_objects, marker_inputs, prior_motion

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]
Course = Literal["facing", "trailing"]
COURSES = ("facing", "trailing")

SMALLEST_STEP, LARGEST_STEP = 0.02, 0.3
"""From one place of the wheel to the next [m]."""
LARGEST_FORCE, LARGEST_OFFSET = 500e3, 0.1
"""Beyond any wheel's [N], and beyond the head of a rail [m]."""
SCHEME = Scheme.of("quasi-static")
_VARIABLES = {
    "gauge_at_rest": ("m", "track gauge beside the closed rail at rest"),
    "gauge": ("m", "track gauge beside the closed rail under the wheel"),
    "rail_roll": ("rad", "roll of the rail from its stress-free position, head to stock rail"),
    "drive_force": ("N", "drive force on the rail, closing"),
    "object_force": ("N", "force on the foreign objects, compression"),
    "lateral_force": ("N", "flange force on the rail, towards the stock rail"),
    "vertical_force": ("N", "vertical force of the wheel on the rail, downwards"),
    "wheel": ("m", "position of the wheel from the toe"),
    "x": ("m", "position from the toe"),
}
"""Unit and meaning of the variables of `gauge_under_wheel`."""


def gauge_under_wheel(
    panel: LoadedPanel,
    *,
    lateral: float | Sequence[float],
    vertical: float | Sequence[float] = 0.0,
    foreign_object: ForeignObject | Sequence[ForeignObject] | None = None,
    rail: str | None = None,
    step: float = LARGEST_STEP,
    course: Course = "facing",
    offset: float = 0.0,
) -> "xr.Dataset":
    r"""Return the gauge beside a closed rail at rest and under a wheel that rolls along it.

    Parameters
    ----------
    panel : LoadedPanel
        With data of its gauge, ``[gauge]``. Drives that are machines stand as their markers do, and
        friction has its level in motion.
    lateral : float or sequence of float
        Flange force Y towards the stock rail [N], from 0 to `LARGEST_FORCE`.
    vertical : float or sequence of float
        Vertical force Q on the rail [N], in the same range; each is combined with each Y.
    foreign_object : ForeignObject or sequence of them, optional
        What is trapped, in addition to the objects of the panel itself.
    rail : str, optional
        The switch rail, closed by the last movement that closes it; default that of the first
        object, else the instrumented rail.
    step : float
        Largest distance from one place of the wheel to the next [m], `SMALLEST_STEP` to
        `LARGEST_STEP`.
    course : {"facing", "trailing"}
        Whether the wheel rolls from the toe to the last slide chair, or back.
    offset : float
        Place of Q on the rail's head, from the running edge towards the stock rail [m]. Default the
        running edge, where a flange that presses on the rail touches it.

    Returns
    -------
    xarray.Dataset
        `gauge_at_rest` by node x; `gauge` [m] and `rail_roll` [rad] by load, place of the wheel and
        node; `drive_force`, positive closing, and `object_force` [N] by load and place of the
        wheel. `lateral_force` and `vertical_force` are the loads.

    Raises
    ------
    ResponseError
        For a panel without data of its gauge, a rail that is not closed by the schedule, and values
        that are not allowed, all at once.
    PanelError
        When a foreign object does not fit the panel.
    NotConverged
        Where there is no equilibrium with sliding feet next to the last one.

    Notes
    -----
    A force F is that of a spring of stiffness k so soft that its end is :math:`F / k` away; the
    motion of the rail changes it by less than 0.02 N. The energy in these springs is part of the
    balance, but not of the scale that its residual is judged by: `energy_residual` is the largest
    of all loads, `energy_scale` that of the throw.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("uic60-760-1-15")
    >>> found = gauge_under_wheel(panel, lateral=4e4, vertical=5e4)  # doctest: +SKIP
    >>> float(found["gauge"].min())  # doctest: +SKIP
    """
    objects = resolve_objects(panel, as_objects(foreign_object))
    rail = rail or (objects[0].rail if objects else panel.instrumented_rail)
    loads = _checked(panel, rail, lateral, vertical, step=step, course=course, offset=offset)
    panel = _as_markers(_refined(panel, step))
    rest = _rest_time(panel, rail)
    objects = _objects_at(objects, rest)
    places = _places(panel, rail, step, objects)
    rolled = places if course == "facing" else places[::-1]
    with one_blas_thread():
        mechanism = build_loaded(panel, objects, _points(panel, rail, rolled, offset))
        runs = [
            _Run(panel, rail, rest, mechanism, rolled, np.array(load)).rolled() for load in loads
        ]
    return _dataset(runs, loads, course=course, offset=offset, objects=objects)


def _checked(
    panel: LoadedPanel,
    rail: str,
    lateral: float | Sequence[float],
    vertical: float | Sequence[float],
    *,
    step: float,
    course: str,
    offset: float,
) -> list[tuple[float, float]]:
    """Return each pair of lateral and vertical force; refuse what is not allowed, all at once."""
    problems = []
    if panel.gauge is None:
        problems.append(
            f"panel {panel.name} has no [gauge]: give gauge.nominal and gauge.height, the height "
            "of the running edge above the foot"
        )
    if rail not in panel.rail or not panel.rail[rail].has_stock_rail:
        known = choices([name for name, record in panel.rail.items() if record.has_stock_rail])
        problems.append(f"rail {rail}: is no switch rail beside a stock rail; there are {known}")
    given = {"lateral": np.atleast_1d(lateral), "vertical": np.atleast_1d(vertical)}
    for name, values in given.items():
        wrong = [f"{value:g} N" for value in values if not 0.0 <= value <= LARGEST_FORCE]
        towards = "towards the stock rail" if name == "lateral" else "downwards"
        if wrong or not values.size:
            most = f"at most {1e-3 * LARGEST_FORCE:g} kN"
            said = ", ".join(wrong) or "none"
            problems.append(f"{name} = {said}: a force {towards} must be at least 0, {most}")
    if not SMALLEST_STEP <= step <= LARGEST_STEP:
        allowed = f"must be {SMALLEST_STEP:g} to {LARGEST_STEP:g} m"
        problems.append(f"step = {step:g} m: {allowed}")
    if not abs(offset) <= LARGEST_OFFSET:
        problems.append(f"offset = {offset:g} m: must be within {LARGEST_OFFSET:g} m of the edge")
    if course not in COURSES:
        problems.append(f"course = {course!r}: allowed are {', '.join(COURSES)}")
    if problems:
        raise ResponseError("gauge under a wheel: " + "; ".join(problems))
    return [(float(y), float(q)) for q in given["vertical"] for y in given["lateral"]]


def _as_markers(panel: LoadedPanel) -> LoadedPanel:
    """Return a panel whose drives are markers, which stand where locked machines do."""
    if all(drive.machine is None for drive in panel.drive.values()):
        return panel
    drives = {k: drive.model_copy(update={"machine": None}) for k, drive in panel.drive.items()}
    return panel.model_copy(update={"drive": drives})


def _refined(panel: LoadedPanel, step: float) -> LoadedPanel:
    """Return a panel with nodes at least as dense as the places of the wheel."""
    if panel.discretisation.element_length <= step:
        return panel
    finer = panel.discretisation.model_copy(update={"element_length": step})
    return panel.model_copy(update={"discretisation": finer})


def _rest_time(panel: LoadedPanel, rail: str) -> float:
    """Return the end of the last rest in which a rail is closed, in whole steps [s]."""
    moved = throws(panel)
    first = moved[0].start if moved else math.inf
    rests = [first] if closed_rail(panel, panel.schedule.starts) == rail else []
    rests += [throw.until for throw in moved if closed_rail(panel, throw.to) == rail]
    if len(panel.rail) == 1:
        rests = [first] if panel.schedule.starts == "closed" else []
        rests += [throw.until for throw in moved if throw.to == "closed"]
    if not rests:
        message = f"rail {rail} is never closed: add a movement that closes it"
        raise ResponseError(message)
    until = min(rests[-1], panel.schedule.end)
    return SCHEME.step * math.floor(until / SCHEME.step + 1e-6)


def _objects_at(objects: Sequence[PlacedObject], rest: float) -> tuple[PlacedObject, ...]:
    """Return the objects of a throw until a time, of which those that are there then stay."""
    return tuple(
        replace(item, disappears=math.inf) if item.disappears > rest else item
        for item in objects
        if item.appears < rest
    )


def _places(panel: LoadedPanel, rail: str, step: float, objects: Sequence[PlacedObject]) -> Floats:
    """Return nodes of a rail from its toe to its last chair, at most a step apart [m]."""
    rails = build_mechanism(panel, objects).rails
    nodes = next(body.x for body in rails if body.name == rail)
    chairs = [c.x for c in panel.chair.values() if c.rails is None or rail in c.rails]
    if panel.rail[rail].heel == "clamped":
        nodes = nodes[:-1]
    nodes = nodes[nodes <= max(chairs, default=nodes[-1]) + 1e-9]
    found = [0]
    while found[-1] < nodes.size - 1:
        reach = int(np.searchsorted(nodes, nodes[found[-1]] + step + 1e-9, side="right")) - 1
        found.append(max(reach, found[-1] + 1))
    places: Floats = nodes[found]
    return places


def _points(
    panel: LoadedPanel, rail: str, places: Floats, offset: float
) -> list[tuple[str, Point]]:
    """Return the points at which the wheel presses: laterally at each place, then vertically."""
    side = SIDE[panel.rail[rail].closes]
    height = 0.0 if panel.gauge is None else panel.gauge.height
    aside = [Point(float(x), "uy", z=height, sign=side) for x in places]
    down = [Point(float(x), "uz", y=side * offset, sign=-1.0) for x in places]
    return [(rail, point) for point in (*aside, *down)]


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """A throw to a rest, and a wheel that rolls from there with one load.

    `places` are in the order in which it comes to them; `load` is its lateral and its vertical
    force [N].
    """

    panel: LoadedPanel
    rail: str
    rest: float
    mechanism: Mechanism
    places: Floats
    load: Floats

    def inputs(self, time: Floats) -> Floats:
        """Return markers and ends of the springs that press, shape (n_inputs, n) [m]."""
        count = self.places.size
        came = (time - self.rest) / SCHEME.step - 1.0
        share = np.maximum(1.0 - np.abs(came - np.arange(count)[:, np.newaxis]), 0.0)
        pressed = np.concatenate([force * share for force in self.load]) / SOFT_STIFFNESS
        return np.concatenate((self.markers(np.minimum(time, self.rest)), pressed))

    def markers(self, time: Floats) -> Floats:
        return marker_inputs(self.panel, time)

    def prior(self) -> PriorMotion | None:
        """Return the motion before the throw, without a wheel."""
        given = prior_motion(self.panel)
        if given is None:
            return None
        absent = 2 * self.places.size

        def inputs(time: Floats) -> Floats:
            return np.concatenate((given.inputs(time), np.zeros((absent, time.size))))

        return replace(given, inputs=inputs)

    def rolled(self) -> "_Rolled":
        """Throw the switch, roll the wheel, and return the run at rest and at each place."""
        history = integrate(
            self.mechanism,
            SCHEME,
            inputs=self.inputs,
            end=self.rest + SCHEME.step * self.places.size,
            prior=self.prior(),
        )
        if not history.outcome.complete:
            raise NotConverged(history.outcome)
        first = round(self.rest / SCHEME.step)
        _, scale = energy_balance(history.stored[: first + 1], history.ledger[: first + 1])
        return _Rolled(self, history, first + np.arange(self.places.size + 1), scale)


@dataclass(frozen=True, slots=True, eq=False)
class _Rolled:
    """A run, the instants at rest and with the wheel at each place, and the throw's energy [J]."""

    run: _Run
    history: History
    at: NDArray[np.int64]
    scale: float

    def along(self) -> tuple[Floats, Floats, Floats]:
        """Return nodes [m], gauge [m] and roll at them, shape (n_places + 1, n_nodes)."""
        run = self.run
        motion = recover_motion(run.mechanism, self.history)
        body = motion.rails[run.rail]
        start, parts = gauge_along(run.panel, motion, run.rail, body.x)
        gauge = start - row_motion(motion, parts, at=self.at).T
        turned = -SIDE[run.panel.rail[run.rail].closes] * body.recovery[RX::6]
        return body.x, gauge, row_motion(motion, [(body, turned)], at=self.at).T

    def forces(self, laws: Sequence[int]) -> Floats:
        """Return forces with which laws resist, shape (n_places + 1, n_laws) [N]."""
        return self.history.law_force[self.at][:, list(laws)]


def _unused_friction(panel: LoadedPanel) -> str:
    """Return a remark on friction of the panel that does not count here; empty if all does."""
    curves = [curve for chair in panel.chair.values() for curve in chair.friction_curves]
    if all(curve.is_constant for curve in curves):
        return ""
    ratio = max(curve.static_ratio for curve in curves)
    at_rest = f"that at rest, up to {ratio:g} times as high, and " if ratio > 1.0 else ""
    return f"chairs have their level in motion: {at_rest}its course over speed does not count"


def _dataset(
    rolled: Sequence[_Rolled],
    loads: Sequence[tuple[float, float]],
    *,
    course: str,
    offset: float,
    objects: Sequence[PlacedObject],
) -> "xr.Dataset":
    import xarray as xr

    run = rolled[0].run
    panel, index, order = run.panel, run.mechanism.index, np.argsort(run.places)
    along = [one.along() for one in rolled]
    x = along[0][0]
    drives = np.array([-one.forces(list(index.drive.values()))[1:] for one in rolled])
    trapped = np.array([one.forces(list(index.object.values()))[1:].sum(axis=1) for one in rolled])
    lateral, vertical = np.array(loads).T
    found = xr.Dataset(
        {
            "gauge_at_rest": ("x", along[0][1][0]),
            "gauge": (("load", "wheel", "x"), np.array([g[1:][order] for _, g, _ in along])),
            "rail_roll": (("load", "wheel", "x"), np.array([r[1:][order] for *_, r in along])),
            "drive_force": (("load", "wheel", "drive"), drives[:, order]),
            "object_force": (("load", "wheel"), trapped[:, order]),
        },
        {
            "x": x,
            "wheel": run.places[order],
            "place": ("x", np.array([place_name(panel, at) for at in x])),
            "lateral_force": ("load", lateral),
            "vertical_force": ("load", vertical),
            "drive": np.array(list(panel.drive)),
            "saturation_force": ("drive", [d.saturation_force for d in panel.drive.values()]),
        },
        {
            "kind": "wheel",
            "title": f"Gauge of {panel.name} under a wheel",
            **provenance(),
            "schema_version": SCHEMA_VERSION,
            "panel": panel.name,
            "panel_hash": panel.hash,
            "overrides": json.dumps(dict(panel.overrides), default=str),
            "foreign_objects": json.dumps([object_record(panel, item) for item in objects]),
            "rail": run.rail,
            "course": course,
            "vertical_force_offset": offset,
            **gauge_rules(panel),
            "friction_remark": _unused_friction(panel),
            "energy_residual": max(one.history.outcome.energy_residual for one in rolled),
            "energy_scale": rolled[0].scale,
            "scheme": SCHEME.describe(),
        },
    )
    for name, (unit, meaning) in _VARIABLES.items():
        found[name].attrs.update(units=unit, long_name=meaning)
    return found
