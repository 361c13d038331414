"""The screen of `turnout panel show`: the plan in characters, values, and results of throws."""

import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from turnout.cli.watch import watched
from turnout.figures.report.values import assumption_lines, value_groups, value_lines
from turnout.mechanism.rest import resting_gap
from turnout.metric.summary import ending_fault, wheel_texts
from turnout.panel.layout import extent, stands_at
from turnout.panel.lock_rule import rules_text
from turnout.panel.unusual import unusual_values
from turnout.throw.checks import checks, direction_of, margins
from turnout.throw.slip import last_instant_at

if TYPE_CHECKING:
    import xarray as xr

    from turnout.metric.test_piece import PieceLimit, PieceResult
    from turnout.panel.load import LoadedPanel
    from turnout.panel.model import Panel
    from turnout.panel.records import Rail


HEADING, COLUMNS = 14, 86
LEGEND = (
    "o chair, # fastening, : stop of the close fit, ^ stud, | link, numbers: sleepers and drives"
)


class _Row:
    """One line of characters over the length of the panel."""

    def __init__(self, start: float, end: float) -> None:
        self._start, self._step = start, (end - start) / (COLUMNS - 1)
        self._cells = [" "] * COLUMNS

    def column(self, x: float) -> int:
        return min(max(round((x - self._start) / self._step), 0), COLUMNS - 1)

    def line(self, start: float, end: float, mark: str) -> "_Row":
        first, last = self.column(start), self.column(end)
        self._cells[first : last + 1] = [mark] * (last + 1 - first)
        return self

    def put(self, places: Iterable[tuple[float, str]]) -> "_Row":
        """Write a text centred at each place; texts that would touch another one are left out."""
        for x, text in places:
            first = min(max(self.column(x) - (len(text) - 1) // 2, 0), COLUMNS - len(text))
            around = self._cells[max(first - 1, 0) : first + len(text) + 1]
            if len(text) == 1 or all(cell in " :|" for cell in around):
                self._cells[first : first + len(text)] = text
        return self

    def __str__(self) -> str:
        return "".join(self._cells)


def plan_lines(panel: "Panel") -> Iterator[str]:
    """Yield a plan of a panel in characters, +y (the instrumented rail closes) upwards.

    Parameters
    ----------
    panel : Panel
        Checked panel; positions are printed in m, openings in mm.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> lines = list(plan_lines(load_panel("uic60-760-1-15")))
    >>> [line.split()[:2] for line in lines if line.startswith("drive")]
    [['drive', '1']]
    """
    start, end = extent(panel)
    rails = sorted(panel.rail.items(), key=lambda item: item[1].closes)  # "+y" comes first

    def shown(heading: str, row: _Row) -> Iterator[str]:
        if str(row).strip():
            yield f"{heading[: HEADING - 1]:<{HEADING}}{row}".rstrip()

    def blank() -> _Row:
        return _Row(start, end)

    yield from shown("x [m]", blank().put(_ticks(start, end)))
    yield from shown("sleeper", blank().put((s.x, name) for name, s in panel.sleeper.items()))
    for number, (name, rail) in enumerate(rails):
        rows = _side(panel, name, rail, blank)
        for heading, row in rows if rail.closes == "+y" else reversed(rows):
            yield from shown(heading, row)
        if number == 0:
            middle = blank().put((link.x, "|") for link in panel.link.values())
            yield from shown("link", middle)
            backs = blank().put((item.x, name) for name, item in panel.back_drive.items())
            yield from shown("back drive", backs)
            drives = blank().put((drive.x, name) for name, drive in panel.drive.items())
            yield from shown("drive", drives)
    yield LEGEND


def _side(
    panel: "Panel", name: str, rail: "Rail", blank: Callable[[], _Row]
) -> list[tuple[str, _Row]]:
    """Return the lines of one switch rail, from its stock rail to the middle of the track."""
    stock = blank()
    flexible = [item for item in panel.stock_rail.values() if item.faces == name]
    for item in flexible:
        stock.line(item.start, item.end, "=")
    if not flexible and rail.has_stock_rail:
        stock.line(*extent(panel), "=")
    against = blank()
    against.put((item.x, ":") for item in panel.stop.values() if stands_at(item, name))
    against.put((item.x, "^") for item in panel.stud.values() if stands_at(item, name))
    supports = blank()
    supports.put((item.x, "o") for item in panel.chair.values() if stands_at(item, name))
    supports.put((item.x, "#") for item in panel.fastening.values() if stands_at(item, name))
    sensors = blank().put((s.x, key) for key, s in panel.sensor.items() if stands_at(s, name))
    return [
        ("stock rail", stock),
        ("stops, studs", against),
        (f"{name}", blank().line(rail.start, rail.end, "-")),
        ("chairs", supports),
        ("TKK", sensors),
    ]


def _ticks(start: float, end: float) -> Iterator[tuple[float, str]]:
    step = 2 if end - start > 10 else 1
    first = -(-start // step) * step
    for number in range(int((end - first) // step) + 1):
        yield first + number * step, f"{first + number * step:g}"


WIDTH = 100
GAPS_IN_A_LINE, GAP_WIDTH = 12, 7
NEEDS_THROW = "needs throws of the switch: add --throw"


@dataclass(frozen=True, slots=True)
class CheckThrows:
    """Results of a panel's throws: the one without an object, and those on test pieces."""

    dataset: "xr.Dataset"
    pieces: Sequence["PieceResult"]
    limits: Sequence["PieceLimit"] = ()


def panel_lines(
    panel: "LoadedPanel",
    *,
    name: str = "",
    thrown: CheckThrows | None = None,
    values: bool = False,
) -> Iterator[str]:
    """Yield the lines that `turnout panel show` prints.

    Parameters
    ----------
    panel : LoadedPanel
        Loaded panel with the origin of every number.
    name : str
        In the heading; default that of the panel.
    thrown : Thrown, optional
        Adds results that need throws.
    values : bool
        Whether every value is listed, or only those that are assumed.
    """
    yield f"{name or panel.name}  (hash {panel.hash[:12]})"
    yield from textwrap.wrap(" ".join(panel.description.split()), WIDTH)
    yield from ("", "PLAN, the closing direction of the instrumented rail upwards")
    yield from plan_lines(panel)
    yield ""
    if thrown is not None and (fault := ending_fault(thrown.dataset)):
        yield f"THROW {fault}"
        thrown = thrown if thrown.dataset.sizes["time"] else None
    yield from _unusual(panel)
    yield from _closed_gap(panel, thrown)
    yield ""
    yield from _margins(thrown)
    yield ""
    yield from _rooms(panel, thrown)
    yield from _pieces(panel, thrown)
    yield ""
    yield from _bushing_note(panel)
    yield ""
    if values:
        yield "VALUES, with where each comes from"
        yield from value_lines(panel)
    else:
        yield "ASSUMPTIONS stated in the file (all values with their origins: --values)"
        yield from list(assumption_lines(panel)) or ["none stated"]


def _unusual(panel: "LoadedPanel") -> Iterator[str]:
    found = unusual_values(panel)
    if found:
        yield "UNUSUAL VALUES, which no switch has: check value and unit"
        yield from (f"  {item.text}" for item in found)
        yield ""


def places_of_gap(panel: "LoadedPanel") -> "np.ndarray":
    """Return the places of gaps, chairs and drives, ascending [m]."""
    places = [item.x for family in (panel.chair, panel.drive) for item in family.values()]
    return np.unique(np.round(places, 9))


def closed_gaps(
    panel: "LoadedPanel", thrown: CheckThrows | None
) -> "tuple[np.ndarray, dict[str, np.ndarray]]":
    """Return places [m], and the gap of each rail that has a stock rail when it lies closed [m].

    Simulated if the panel was thrown; else estimated from the strokes within 3 mm.
    """
    if thrown is None:
        x = places_of_gap(panel)
        gaps = {name: resting_gap(panel, name, x, closed=True) for name in panel.rail}
        return x, {name: gap for name, gap in gaps.items() if gap is not None}
    if not thrown.dataset.sizes["time"]:
        return np.empty(0), {}
    ends = {
        name: last_instant_at(thrown.dataset, to="closed" if rail.closes == "+y" else "open")
        for name, rail in panel.rail.items()
        if rail.has_stock_rail
    }
    return thrown.dataset["x"].values, {n: end["gap"].sel(rail=n).values for n, end in ends.items()}


def _closed_gap(panel: "LoadedPanel", thrown: CheckThrows | None) -> Iterator[str]:
    yield "CLOSED GAP [mm]" + (
        ", estimated from the strokes within 3 mm; simulated with --throw"
        if thrown is None
        else " at contact height, simulated, each rail when it lies closed"
    )
    x, rails = closed_gaps(panel, thrown)
    if not rails:
        yield "no rail has a stock rail"
        return
    for first in range(0, x.size, GAPS_IN_A_LINE):
        part = slice(first, first + GAPS_IN_A_LINE)
        yield f"  {'x [m]':<12}" + "".join(f"{place:{GAP_WIDTH}.2f}" for place in x[part])
        for name, gap in rails.items():
            cells = "".join(f"{_gap(value):>{GAP_WIDTH}}" for value in gap[part])
            yield f"  {name[:11]:<12}{cells}"


def _margins(thrown: CheckThrows | None) -> Iterator[str]:
    yield "FORCE MARGINS of the throw without an object"
    if thrown is None:
        yield f"  {NEEDS_THROW}"
        return
    yield f"  {'drive':<8}{'direction':<12}{'largest':>10}{'slip level':>12}{'margin':>11}{'':>9}"
    for item in margins(checks(thrown.dataset)):
        note = "   near its slip level" if item.tight else ""
        yield (
            f"  {item.drive:<8}{direction_of(item.movement):<12}{item.value / 1e3:7.2f} kN"
            f"{item.limit / 1e3:9.2f} kN{_zero(item.margin / 1e3):8.2f} kN"
            f"{_zero(100 * item.share, 1):7.1f} %{note}"
        )


def _rooms(panel: "LoadedPanel", thrown: CheckThrows | None) -> Iterator[str]:
    """Yield the least flangeway, and the least gauge of a panel with data of it."""
    texts = {} if thrown is None else wheel_texts(thrown.dataset)
    unknown = "not known: the rails need running_edge, head_width and fit_gap"
    rooms = [("flangeway", "open")] + ([] if panel.gauge is None else [("gauge", "closed")])
    for kind, state in rooms:
        yield f"LEAST {kind.upper()} of the {state} rail"
        yield f"  {NEEDS_THROW if thrown is None else texts.get(kind, unknown)}"
        yield ""


def _pieces(panel: "LoadedPanel", thrown: CheckThrows | None) -> Iterator[str]:
    sizes = sorted({1e3 * limit for limit in panel.gap_limits().values()})
    size = " and ".join(f"{value:g} mm" for value in sizes)
    yield f"TEST PIECE of {size} at each drive; lock rule '{panel.lock.rule}'"
    if thrown is None:
        yield f"  {NEEDS_THROW}"
        return
    yield (
        f"  {'drive':<8}{'locks':<18}{'force there':>12}{'on the piece':>15}"
        f"{'largest of any drive':>23}{'raw gap':>12}"
    )
    for piece in thrown.pieces:
        if piece.fault:
            yield f"  {piece.drive:<8}no result: {piece.fault}"
            continue
        answer = "no" if piece.seen else "YES, not seen"
        yield (
            f"  {piece.drive:<8}{answer:<18}{_zero(piece.drive_force / 1e3):9.2f} kN"
            f"{_zero(piece.piece_force / 1e3):12.2f} kN{piece.largest_force / 1e3:20.2f} kN"
            f"{_gap(piece.gap):>9}{' mm' if piece.gap >= 0 else ''}"
        )
    yield from (f"  {item.text}" for item in thrown.limits)


def _zero(value: float, digits: int = 2) -> float:
    """Round, without a negative zero."""
    return round(value, digits) + 0.0


def _gap(value: float) -> str:
    """Return a gap in millimetres, one below zero as closed."""
    return "closed" if value < 0.0 else f"{_zero(1e3 * value):.2f}"


def _bushing_note(panel: "LoadedPanel") -> Iterator[str]:
    text = (
        "Gaps are raw. A drive at the end of its stroke holds the rail through its bushing, which "
        "stretches by force / stiffness: "
    )
    drives = sorted(panel.drive.items(), key=lambda item: item[1].extension is not None)
    parts = [
        f"drive {name} by its table"
        if drive.extension is not None
        else f"drive {name} by {1e6 / drive.stiffness:.2f} mm for each kN"
        for name, drive in drives
    ]
    text += f"{', '.join(parts)}. Lock is refused: {rules_text()}."
    yield from textwrap.wrap(text, WIDTH)


def thrown_alone(panel: "LoadedPanel", *, quiet: bool = False) -> "xr.Dataset":
    """Throw a panel without a foreign object; a run that ends early comes back as it is."""
    from turnout.throw.simulate import simulate

    with watched(f"throwing {panel.name}", quiet=quiet) as watch:
        return simulate(panel, throw=False, report=watch.report)


def thrown_on_pieces(panel: "LoadedPanel") -> "list[PieceResult]":
    """Throw a panel on a test piece at each of its drives."""
    from turnout.core.errors import PanelError
    from turnout.metric.test_piece import PieceResult, check_piece

    results = []
    for drive, size in panel.gap_limits().items():
        text = f"throwing {panel.name} on {1e3 * size:g} mm at drive {drive}"
        with watched(text) as watch:
            try:
                results.append(check_piece(panel, drive, report=watch.report))
            except PanelError as error:
                results.append(PieceResult.without(drive, size, "; ".join(error.problems)))
    return results


def least_pieces(panel: "LoadedPanel", *, quiet: bool = False) -> "list[PieceLimit]":
    """Find the least piece at each drive that keeps a panel from locking."""
    from turnout.metric.test_piece import least_piece

    found = []
    for drive in panel.drive:
        text = f"finding the piece that {panel.name} refuses at drive {drive}"
        with watched(text, quiet=quiet) as watch:
            found.append(least_piece(panel, drive, report=watch.report))
    return found


def check_throws(panel: "LoadedPanel") -> CheckThrows:
    """Throw a panel without an object, then on test pieces."""
    return CheckThrows(thrown_alone(panel), thrown_on_pieces(panel), least_pieces(panel))


PANEL_UNITS = {
    **{"x": "m", "closed_gap": "m", "least_flangeway": "m", "least_flangeway_x": "m"},
    **{"least_gauge": "m", "least_gauge_x": "m"},
    **{"force": "N", "limit": "N", "size": "m", "largest": "m", "gap": "m"},
    **{"drive_force": "N", "piece_force": "N", "largest_force": "N"},
}


def panel_record(
    panel: "LoadedPanel", thrown: CheckThrows | None = None, case: str | None = None
) -> dict[str, Any]:
    """Return a panel, or `case` of a study, all values with origins, and results of throws."""
    x, gaps = closed_gaps(panel, thrown)
    record: dict[str, Any] = {
        "case": case,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "description": " ".join(panel.description.split()),
        "values": [
            {"group": heading, "key": leaf.below, "value": leaf.text, "origin": leaf.origin}
            for heading, leaves in value_groups(panel)
            for leaf in leaves
        ],
        "x": x,
        "closed_gap": {name: gaps.get(name) for name in panel.rail},
        "throw": None,
    }
    if thrown is not None:
        dataset, ended = thrown.dataset, bool(thrown.dataset.sizes["time"])
        record["throw"] = {
            "complete": bool(dataset.attrs["complete"]),
            "outcome": dataset.attrs["outcome"],
            "margins": [
                {
                    "drive": item.drive,
                    "direction": direction_of(item.movement),
                    "force": item.margin,
                    "limit": item.limit,
                }
                for item in margins(checks(dataset))
            ],
            "least_flangeway": float(dataset["least_flangeway"]) if ended else None,
            "least_flangeway_x": float(dataset["least_flangeway_x"]) if ended else None,
            **{
                name: float(dataset[name])
                for name in ("least_gauge", "least_gauge_x")
                if ended and name in dataset
            },
            "pieces": thrown.pieces,
            "limits": thrown.limits,
        }
    return record
