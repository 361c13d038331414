"""A panel's plan in characters: what stands where along each rail."""

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from turnout.panel.layout import extent, stands_at

if TYPE_CHECKING:
    from turnout.panel.model import Panel
    from turnout.panel.rail_records import Rail

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
        The panel.

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
    sensors = blank().put((s.x, key) for key, s in panel.sensor.items() if s.rail == name)
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
