"""What the server remembers: panels, measured movements, the last throws."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr

from turnout.errors import FileError, PanelError
from turnout.files.provenance import version
from turnout.files.toml import decode, parse_toml
from turnout.measurement.campaign import Campaign
from turnout.panel.foreign_object import resolve_objects
from turnout.panel.load import LoadedPanel, library_names, load_panel, panel_from_file
from turnout.plot.moving_plan import plan_record
from turnout.response.compilation import must_compile
from turnout.web.controls import controls
from turnout.web.measured import Measured, campaign_movements
from turnout.web.request import AskedRun
from turnout.web.throw import changed_panel, made_ready, places_around, thrown
from turnout.web.worker import Question

# So many are remembered, so that the memory does not grow with use.
MOST_PANELS, MOST_RUNS, MOST_MEASURED = 12, 3, 60
LARGEST_PANEL = 4_000_000
V = TypeVar("V")
K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Opened:
    """A campaign and the folder that it is read from."""

    folder: Path
    campaign: Campaign


class Studio:
    """Panels by mark, measured movements by mark, and the last throws.

    Parameters
    ----------
    panel : LoadedPanel
        What is shown first.
    opened : Opened, optional
        A campaign to lay over throws.
    """

    def __init__(self, panel: LoadedPanel, opened: Opened | None = None) -> None:
        self.opened = opened
        self._panels: OrderedDict[str, LoadedPanel] = OrderedDict()
        self._runs: OrderedDict[str, xr.Dataset] = OrderedDict()
        self._sent: OrderedDict[str, Measured] = OrderedDict()
        found = list(campaign_movements(opened.campaign)) if opened else []
        self._campaign = {f"campaign-{number}": item for number, item in enumerate(found)}
        self._count = 0
        self._first = panel

    def start(self) -> dict[str, Any]:
        """Return what the page needs when it opens."""
        return {
            "version": version(),
            "compiling": must_compile(),
            "library": list(library_names()),
            "panel": self.described(self.add_panel(self._first)),
            "campaign": self._campaign_record(),
        }

    def add_panel(self, panel: LoadedPanel) -> str:
        """Remember a panel; return its mark."""
        mark = panel.hash[:16]
        _remember(self._panels, mark, panel, most=MOST_PANELS)
        return mark

    def open_panel(self, name: str) -> str:
        """Open a panel of the library, and no file; return its mark."""
        names = library_names()
        if name not in names:
            message = f"no library panel is called '{name}'; there are {', '.join(names)}"
            raise FileError(message)
        return self.add_panel(load_panel(name))

    def sent_panel(self, content: bytes, name: str) -> str:
        """Check a panel file that the page sent as `turnout panel check` does; return its mark.

        Raises
        ------
        FileError, PanelError
            With all that is wrong in it.
        """
        if len(content) > LARGEST_PANEL:
            message = f"{name}: too large ({len(content)} bytes, at most {LARGEST_PANEL} are read)"
            raise FileError(message)
        file = parse_toml(decode(content, source=name), source=name)
        alone = [f"{key}: {_ALONE}" for key in _other_files(file.data)]
        if alone:
            raise PanelError(alone, source=name)
        return self.add_panel(panel_from_file(file))

    def panel(self, mark: str) -> LoadedPanel:
        """Return a panel by its mark."""
        if mark not in self._panels:
            message = "the studio no longer knows this panel; open it again"
            raise FileError(message)
        self._panels.move_to_end(mark)
        return self._panels[mark]

    def described(self, mark: str) -> dict[str, Any]:
        """Return what the page shows of a panel before a throw."""
        panel = self.panel(mark)
        places = [f"sleeper {name}" for name in panel.sleeper]
        places += [f"drive {name}" for name in panel.drive]
        places += [f"sensor {name}" for name in panel.sensor]
        own = resolve_objects(panel)
        return {
            "mark": mark,
            "name": panel.name,
            "source": panel.source,
            "hash": panel.hash[:12],
            "description": " ".join(panel.description.split()),
            "plan": plan_record(panel),
            "controls": controls(panel),
            "places": [{"name": name, "x": _x_of(panel, name)} for name in places],
            "own_objects": [{"name": o.name, "size": o.size, "x": o.x} for o in own],
        }

    def run(self, asked: AskedRun, question: Question) -> tuple[LoadedPanel, xr.Dataset]:
        """Throw what is asked, or return it where it was among the last throws."""
        panel = changed_panel(self.panel(asked.panel), asked)
        key = asked.model_dump_json()
        if key not in self._runs:
            _remember(self._runs, key, thrown(panel, asked, question), most=MOST_RUNS)
        self._runs.move_to_end(key)
        return panel, self._runs[key]

    def ahead(self, asked: AskedRun) -> list[Callable[[], None]]:
        """Return what to do while nothing is asked, for the throws that may be asked for next."""
        panel = changed_panel(self.panel(asked.panel), asked)
        return [partial(made_ready, panel, near) for near in places_around(panel, asked)]

    def add_measured(self, measured: Measured) -> str:
        """Remember a measured movement; return its mark."""
        self._count += 1
        mark = f"sent-{self._count}"
        _remember(self._sent, mark, measured, most=MOST_MEASURED)
        return mark

    def measured(self, mark: str) -> Measured:
        """Return a measured movement by its mark."""
        found = self._campaign.get(mark) or self._sent.get(mark)
        if found is None:
            message = "the studio does not know this movement; send its recording again"
            raise FileError(message)
        return found

    def _campaign_record(self) -> dict[str, Any] | None:
        if self.opened is None:
            return None
        campaign = self.opened.campaign
        return {
            "title": campaign.sheet.title,
            "synthetic": campaign.sheet.synthetic,
            "movements": [measured_record(k, item) for k, item in self._campaign.items()],
            "excluded": [
                f"{item.run.name}: {'; '.join(item.reasons)}" for item in campaign.excluded
            ],
            "files": sorted({run.file for run in campaign.sheet.runs}),
        }


_ALONE = "names another file, which a sent panel cannot bring; start with `turnout studio --panel`"


def measured_record(mark: str, item: Measured) -> dict[str, Any]:
    """Return what the page lists of a measured movement."""
    known = item.size == item.size  # NaN is not known
    return {
        "mark": mark,
        "title": item.title,
        "direction": item.direction,
        "size": item.size if known else None,
        "place": item.place,
    }


def _other_files(data: Any, path: str = "") -> list[str]:
    """Find the keys of a document that name another file."""
    found = []
    for key, value in data.items() if isinstance(data, dict) else ():
        inner = f"{path}.{key}" if path else str(key)
        if key in ("matrices", "table_file") and isinstance(value, str):
            found.append(inner)
        found += _other_files(value, inner)
    return found


def _x_of(panel: LoadedPanel, place: str) -> float:
    family, _, name = place.partition(" ")
    return float(getattr(panel, family)[name].x)


def _remember(store: OrderedDict[K, V], key: K, value: V, *, most: int) -> None:
    store[key] = value
    store.move_to_end(key)
    while len(store) > most:
        store.popitem(last=False)
