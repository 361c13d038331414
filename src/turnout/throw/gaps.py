"""Open distances between switch rails and stock rails."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turnout.core.lru_cache import SharedResults
from turnout.mechanism.mechanism import Mechanism, RailBody
from turnout.mechanism.travel import unloaded_gap
from turnout.panel.layout import SIDE
from turnout.panel.model import Panel
from turnout.panel.profile import contact_height
from turnout.panel.records import StockRail
from turnout.solver.condense import CondensedRails
from turnout.solver.record import SeenRows
from turnout.throw.output_rows import OutputRows, RowBlock, stack_rows
from turnout.throw.recovery import (
    Bound,
    CondensedShapes,
    Motion,
    Parts,
    RowTerms,
    condensed_shapes,
    core_blocks,
    histories_of,
    lateral_rows,
    object_shapes,
    output_rows,
    row_block_of,
    row_terms,
    stack_terms,
    terms_without_objects,
    with_objects,
)
from turnout.throw.route import closed_in_turn, closed_rail, first_instants

Floats = NDArray[np.float64]
AnyFloat = TypeVar("AnyFloat", np.float32, np.float64)
GapPlace = tuple[str, Floats, Floats]
"""Rail, places along it and heights of some points [m]."""


_rows = SharedResults[list[Floats]](64)
_watched = SharedResults[tuple[SeenRows, Sequence[Bound]]](64)


def _frozen(values: ArrayLike) -> Floats:
    """Return an array that many share and none may change."""
    array = np.asarray(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def stock_gap(panel: Panel, motion: CondensedShapes, rail: str, x: Floats) -> Floats:
    """Return the gap of the unloaded rail, shape (n,) [m]; NaN without a stock rail."""
    gap = unloaded_gap(panel, motion.shapes.get(rail), rail, x)
    return np.full(np.shape(x), np.nan) if gap is None else gap


def shape_block(panel: Panel, motion: Motion, x: Floats) -> RowBlock:
    """Return lateral displacements of all rails at contact height, and the open distances there.

    Parameters
    ----------
    panel, motion
        Panel and run.
    x : ndarray, shape (n_points,)
        Places along the rails [m].

    Returns
    -------
    RowBlock
        "lateral_displacement", positive in +y, and "gap" [m]; NaN beyond a rail.
    """
    moved, open_distances = list[OutputRows](), list[OutputRows]()
    for name in panel.rail:
        start, parts = gap_rows(panel, motion, name, x, contact_height(panel, name, x))
        towards = row_terms(motion, parts[:1])
        less = row_terms(motion, parts) if parts[1:] else towards
        moved.append(output_rows(motion, towards, sign=SIDE[panel.rail[name].closes]))
        open_distances.append(output_rows(motion, less, start=start, sign=-1.0))
    shape = len(moved), x.size
    parts_of = {"lateral_displacement": (0, shape), "gap": (len(moved) * x.size, shape)}
    return RowBlock(stack_rows(moved + open_distances), parts_of)


def gap_rows(
    panel: Panel, motion: CondensedShapes, rail: str, x: Floats, z: Floats
) -> tuple[Floats, Parts]:
    """Return open distances of the unloaded rail, and rows by which coordinates lessen them.

    Returns
    -------
    start : ndarray, shape (n_points,)
        [m]
    parts : sequence of (RailBody, ndarray)
        Rows, shape (n_points, body.count), over the coordinates of the rail and of stock rails that
        bend with it; shared and therefore not writeable.
    """
    record = panel.rail[rail]
    faced, involved = bodies_at_gap(panel, motion, rail)

    def made() -> list[Floats]:
        side = SIDE[record.closes]
        rows = [side * lateral_rows(involved[0], x, z)]
        for stock, body in zip(faced, involved[1:], strict=True):
            inside = np.clip(x, stock.start, stock.end)  # beyond its ends it is held
            rows.append(-side * lateral_rows(body, inside, z - stock.foot_height))
        return [_frozen(row) for row in rows]

    rows = _rows.get(
        [body.recovery for body in involved],
        [record.closes, *faced, x.tobytes(), z.tobytes()],
        made,
    )
    return stock_gap(panel, motion, rail, x), list(zip(involved, rows, strict=True))


def gap_places(panel: Panel) -> list[GapPlace]:
    """Return the places of the gaps of `split_gaps`: at drives on both rails, so at sensors.

    A sensor on one rail alone is there twice.
    """
    x = np.array([drive.x for drive in panel.drive.values()])
    z = np.array([drive.height for drive in panel.drive.values()])
    rails = [closed_rail(panel, position) for position in ("closed", "open")]
    sensors = [
        (sensor.rail or rail, np.array([sensor.x]), np.array([sensor.height]))
        for rail in rails
        for sensor in panel.sensor.values()
    ]
    return [*((rail, x, z) for rail in rails), *sensors]


def gaps_key(panel: Panel) -> tuple[Hashable, ...]:
    """Return a key of all that gaps, gauge and their places follow from beside rails of a run."""
    # drives by their places: a study may vary what they are with each throw
    at = tuple([(name, item.x, item.height) for name, item in panel.drive.items()])
    families = ("rail", "stock_rail", "stop", "stud", "sensor", "object_defaults", "gauge")
    shaped = panel.key_of(*families)
    return panel.instrumented_rail, at, shaped


def split_gaps(panel: Panel, gaps: Floats, time: Floats) -> tuple[Floats, Floats]:
    """Return gaps at drives and at sensors of open distances at the `gap_places` one by one.

    The gap at a drive's rod, or at a pair of sensors, is that of the rail that should be closed:
    the one which the present or last movement closes, before the first movement the one that is
    closed where the schedule starts. A panel with one rail has no choice.

    Parameters
    ----------
    panel : Panel
    gaps : ndarray, shape (n_places, n_times)
        [m]
    time : ndarray, shape (n_times,)
        [s]

    Returns
    -------
    at_drives : ndarray, shape (n_drives, n_times)
        [m]
    at_sensors : ndarray, shape (n_sensors, n_times)
        [m]
    """
    starts = first_instants(panel, time)[np.newaxis]
    at_drives, at_sensors = split_gaps_of(panel, [gaps], starts, kind=np.float64)
    return at_drives[0], at_sensors[0]


def split_gaps_of(
    panel: Panel, gaps: Sequence[Floats], starts: NDArray[np.int64], *, kind: type[AnyFloat]
) -> tuple[NDArray[AnyFloat], NDArray[AnyFloat]]:
    """Return `split_gaps` of many throws of the same movements, as numbers of a kind.

    Shorter ones are filled up with NaN.

    Parameters
    ----------
    panel : Panel
        Of one of them.
    gaps : sequence of ndarray, shape (n_places, n_times)
        Open distances of each [m].
    starts : ndarray of int, shape (n, n_movements)
        The first instant of each movement among those of its throw.
    kind : type
        ``numpy.float32`` or ``numpy.float64``.

    Returns
    -------
    at_drives, at_sensors : ndarray, shapes (n, n_drives, n_times), (n, n_sensors, n_times)
        [m]
    """
    closes = closed_in_turn(panel)
    sizes = np.array([one.shape[1] for one in gaps])
    edges = np.zeros((len(gaps), len(closes) + 1), dtype=np.int64)
    edges[:, 1:-1], edges[:, -1] = np.minimum(starts, sizes[:, np.newaxis]), sizes

    def of_closed(family: slice, count: int) -> NDArray[AnyFloat]:
        found = np.empty((len(gaps), count, sizes.max()), dtype=kind)
        for one, own, bounds in zip(gaps, found, edges.tolist(), strict=True):
            # at any instant one of the two is wanted closed
            first, second = one[family][:count], one[family][count:]
            for begin, end, closed in zip(bounds, bounds[1:], closes, strict=False):
                own[:, begin:end] = (first if closed else second)[:, begin:end]
            own[:, one.shape[1] :] = np.nan
        return found

    drives, sensors = len(panel.drive), len(panel.sensor)
    return of_closed(slice(2 * drives), drives), of_closed(slice(2 * drives, None), sensors)


def place_block(panel: Panel, motion: Motion) -> RowBlock:
    """Return the open distances at all `gap_places`, which `split_gaps` takes: "places" [m]."""
    start, terms, rest = _seen_together(panel, motion, gap_places(panel))
    less = with_objects(motion, terms, rest)
    rows = output_rows(motion, less, start=start, sign=-1.0)
    return RowBlock(rows, {"places": (0, start.shape)})


def gaps_over_time(panel: Panel, motion: Motion) -> Floats:
    """Return the open distances at all `gap_places`, shape (n_places, n_times) [m]."""
    values = ("gaps", gaps_key(panel))
    block = row_block_of(motion, values, lambda: place_block(panel, motion))
    return block.over_time(histories_of(motion.history))["places"]


def watched_gaps(panel: Panel, mechanism: Mechanism) -> Callable[[CondensedRails], SeenRows]:
    """Return the argument of `SaveAt` for the gaps at the `gap_places` of a mechanism."""
    places = gap_places(panel)

    named = [mechanism.shapes, mechanism.core]
    key = gaps_key(panel)

    def made(shapes: CondensedShapes) -> tuple[SeenRows, Sequence[Bound]]:
        start, less, rest = _seen_together(panel, shapes, places)
        stored = np.zeros(less.shapes.shape) if less.stored is None else less.stored
        parts = (-stored, -less.modes, -less.shapes, start - less.load)
        return SeenRows(*(_frozen(part) for part in parts)), rest

    def seen(condensed: CondensedRails) -> SeenRows:
        known: SeenRows | None = condensed.kept.get(key)
        if known is None:
            shapes, core = condensed_shapes(mechanism, condensed), core_blocks(condensed)
            values = (*key, condensed.row_stiffness.size)
            found, rest = _watched.get([*core, *named], values, lambda: made(shapes))
            known = replace(found, of_objects=-object_shapes(shapes, rest))
            condensed.kept[key] = known
        return known

    return seen


def _seen_together(
    panel: Panel, motion: CondensedShapes, places: Sequence[GapPlace]
) -> tuple[Floats, RowTerms, Sequence[Bound]]:
    """Return unloaded distances of some points of several rails, and rows that lessen them.

    They are without objects, whose forces displace the rows that are last.
    """
    starts, terms, order = list[Floats](), list[RowTerms](), list[Floats]()
    rest = list[Bound]()
    ends = np.cumsum([x.size for _, x, _ in places])
    for rail in dict.fromkeys(rail for rail, _, _ in places):  # large matrices once a rail
        mine = [number for number, place in enumerate(places) if place[0] == rail]
        x, z = (np.concatenate([places[number][axis] for number in mine]) for axis in (1, 2))
        start, parts = gap_rows(panel, motion, rail, x, z)
        own, left = terms_without_objects(motion, parts)
        starts.append(start)
        terms.append(own)
        order += [np.arange(ends[number] - places[number][1].size, ends[number]) for number in mine]
        for number, coordinates, rows in left:
            whole = np.zeros((ends[-1], rows.shape[1]))
            whole[np.concatenate(order[-len(mine) :])] = rows
            rest.append((number, coordinates, whole))
    by_place = np.argsort(np.concatenate(order))
    return np.concatenate(starts)[by_place], stack_terms(terms).of(by_place), rest


def bodies_at_gap(
    panel: Panel, motion: CondensedShapes, rail: str
) -> tuple[list[StockRail], list[RailBody]]:
    """Return the stock rails that bend beside a rail, and all that take part in its gap."""
    faced = [(name, stock) for name, stock in panel.stock_rail.items() if stock.faces == rail]
    bodies = [motion.rails[rail], *(motion.rails[f"stock rail {name}"] for name, _ in faced)]
    return [stock for _, stock in faced], bodies
