"""What a process of the studio answers: panels, throws, files and recordings.

All that the page sends is read here and nowhere else, so that nothing in it can hold up the server.
"""

import pickle
import secrets
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from turnout.analysis.panel_check import concern_lines, panel_concerns
from turnout.core.lru_cache import LRUCache
from turnout.core.toml import decode, parse_toml
from turnout.errors import FileError, PanelError, TurnoutError
from turnout.panel.load import LoadedPanel, library_names, load_panel, panel_from_file
from turnout.plot.sheet import sheet_record
from turnout.plot.throw import throw_sheet
from turnout.response.simulate import simulate
from turnout.scheme import Scheme
from turnout.web.described import described, measured_record
from turnout.web.measured import (
    Measured,
    channel_map_of,
    listing,
    plain_name,
    recorded_movements,
    sent_recording,
    shifted,
)
from turnout.web.question import Question, Reply, Task, UnknownMarkError
from turnout.web.request import AskedFile, AskedMark, AskedPanel, AskedRun, read_asked
from turnout.web.throw import (
    FILE_KEYS,
    FILE_MESSAGE,
    FILES,
    answer,
    changed_panel,
    made_file,
    made_ready,
    places_around,
    thrown,
)

# So many are remembered, so that the memory does not grow with use.
MOST_PANELS, MOST_RUNS, MOST_MEASURED = 12, 3, 20
LARGEST_PANEL = 4_000_000


@dataclass(frozen=True, slots=True)
class Opening:
    """What a process begins with; it is pickled.

    Attributes
    ----------
    panel : LoadedPanel
        What the page shows first.
    campaign : mapping of str to Measured
        Movements of a campaign by mark.
    folder : Path, optional
        Of that campaign.
    """

    panel: LoadedPanel
    campaign: Mapping[str, Measured]
    folder: Path | None = None

    def __call__(self) -> Callable[[Task, Question], Reply]:
        """Load the kernels, or compile them, so that no answer has to wait for that."""
        simulate(load_panel("sb1"), scheme=Scheme.of("quick"), throw=False)
        return Desk(self).answer


class Desk:
    """Panels by mark, measured movements by mark, and the last throws, in one process.

    Parameters
    ----------
    opening : Opening
        What it begins with.
    """

    def __init__(self, opening: Opening) -> None:
        self._opening = opening
        self._panels = LRUCache[LoadedPanel](MOST_PANELS)
        self._runs = LRUCache[xr.Dataset](MOST_RUNS)
        self._sent = LRUCache[Measured](MOST_MEASURED)
        self._ahead: deque[Callable[[], object]] = deque()
        self._tasks: Mapping[str, Callable[[Task, Question], Reply]] = {
            "panel/open": self._open_panel,
            "panel/send": self._send_panel,
            "panel/again": self._panel_again,
            "panel/concerns": self._concerns,
            "run": self._run,
            "file": self._file,
            "recording": self._recording,
            "measured": self._measured,
            "ahead": self._one_ahead,
        }

    def answer(self, task: Task, question: Question) -> Reply:
        """Return the answer to a task; TurnoutError says why there is none."""
        self._restored = dict(task.restored)
        return self._tasks[task.name](task, question)

    def _open_panel(self, task: Task, _question: Question) -> Reply:
        """Open a panel of the library, and no file."""
        name = read_asked(AskedPanel, task.content).name
        names = library_names()
        if name not in names:
            message = f"no library panel is called '{name}'; there are {', '.join(names)}"
            raise FileError(message)
        return self._shown(load_panel(name), ("library", name, b""))

    def _send_panel(self, task: Task, _question: Question) -> Reply:
        """Check a panel file that the page sent as `turnout panel check` does."""
        name = plain_name(task.options["name"], "panel.toml")
        return self._shown(_sent_panel(task.content, name), ("sent", name, task.content))

    def _shown(self, panel: LoadedPanel, origin: tuple[str, str, bytes]) -> Reply:
        mark = panel.hash[:16]
        self._panels.put(mark, panel)
        reply = Reply.of(described(panel, mark))
        return Reply(reply.content, kept=((mark, pickle.dumps(origin)),))

    def _panel_again(self, task: Task, _question: Question) -> Reply:
        mark = read_asked(AskedMark, task.content).panel
        return Reply.of(described(self._panel(mark), mark))

    def _panel(self, mark: str) -> LoadedPanel:
        """Return a panel by its mark."""
        first = self._opening.panel
        if mark == first.hash[:16]:
            return first
        found = self._panels.get(mark)
        if found is None and mark in self._restored:
            kind, name, content = pickle.loads(self._restored[mark])
            panel = load_panel(name) if kind == "library" else _sent_panel(content, name)
            found = self._panels.put(mark, panel)
        if found is None:
            raise UnknownMarkError(mark, "the studio no longer knows this panel; open it again")
        return found

    def _concerns(self, task: Task, question: Question) -> Reply:
        """Throw a panel alone and warn of what `turnout panel check` warns of."""
        asked = read_asked(AskedMark, task.content)
        panel, dataset = self._thrown(AskedRun(panel=asked.panel), question)
        return Reply.of({"lines": concern_lines(panel, panel_concerns(panel, dataset))})

    def _run(self, task: Task, question: Question) -> Reply:
        asked = read_asked(AskedRun, task.content)
        panel, dataset = self._thrown(asked, question)
        reply = Reply.of(answer(panel, dataset, preview=asked.preview))
        if asked.preview:
            return reply
        around = places_around(panel, asked)
        self._ahead = deque(partial(made_ready, panel, near) for near in around)
        return Reply(reply.content, ahead=bool(self._ahead))

    def _thrown(self, asked: AskedRun, question: Question) -> tuple[LoadedPanel, xr.Dataset]:
        """Throw what is asked, or return it where it was among the last throws."""
        panel = changed_panel(self._panel(asked.panel), asked)
        key = asked.model_dump_json()
        found = self._runs.get(key)
        if found is None:
            found = self._runs.put(key, thrown(panel, asked, question))
        return panel, found

    def _one_ahead(self, _task: Task, _question: Question) -> Reply:
        """Do a piece of work for the throws that may be asked for next."""
        with suppress(IndexError, TurnoutError):  # there is none, or it cannot be made
            self._ahead.popleft()()
        return Reply(ahead=bool(self._ahead))

    def _file(self, task: Task, question: Question) -> Reply:
        """Make a file of a throw; it is computed again where it is not among the last ones."""
        kind = task.options["file"]
        asked = read_asked(AskedFile, task.content)
        _, dataset = self._thrown(asked.run, question)
        behind = self._thrown(asked.behind, question)[1] if asked.behind else None
        return Reply(made_file(kind, dataset, behind=behind), FILES[kind])

    def _recording(self, task: Task, _question: Question) -> Reply:
        """List a recording, or, where a channel map is named, cut it into movements."""
        recording, kind = sent_recording(Path(task.options["path"]))
        chosen = task.options["map"]
        if not chosen:
            return Reply.of({"lines": listing(recording, kind), "movements": []})
        channel_map = channel_map_of(chosen, self._opening.folder)
        found, lines = recorded_movements(recording, channel_map)
        # Another process may have to know it by the same mark.
        marks = {f"sent-{secrets.token_hex(8)}": item for item in found}
        for mark, item in marks.items():
            self._sent.put(mark, item)
        movements = [measured_record(mark, item) for mark, item in marks.items()]
        content = Reply.of({"lines": lines, "movements": movements}).content
        return Reply(content, kept=tuple((m, pickle.dumps(item)) for m, item in marks.items()))

    def _measured(self, task: Task, question: Question) -> Reply:
        """Return a measured movement on the time of a run."""
        asked = read_asked(AskedRun, task.content)
        measured = self._movement(task.options["mark"])
        _, dataset = self._thrown(asked, question)
        return Reply.of(sheet_record(throw_sheet(shifted(measured, dataset))))

    def _movement(self, mark: str) -> Measured:
        """Return a measured movement by its mark."""
        found = self._opening.campaign.get(mark) or self._sent.get(mark)
        if found is None and mark in self._restored:
            found = self._sent.put(mark, pickle.loads(self._restored[mark]))
        if found is None:
            message = "the studio does not know this movement; send its recording again"
            raise UnknownMarkError(mark, message)
        return found


def _sent_panel(content: bytes, name: str) -> LoadedPanel:
    """Read a panel file that the page sent.

    Raises
    ------
    FileError, PanelError
        With all that is wrong in it.
    """
    file = parse_toml(decode(content, source=name), source=name)
    alone = [f"{key}: {FILE_MESSAGE}" for key in _other_files(file.data)]
    if alone:
        raise PanelError(alone, source=name)
    return panel_from_file(file)


def _other_files(data: Any, path: str = "") -> list[str]:
    """Find the keys of a document that name another file."""
    found = []
    items = enumerate(data) if isinstance(data, list) else data.items()
    for key, value in items:
        inner = f"{path}.{key}" if path else str(key)
        if key in FILE_KEYS and isinstance(value, str):
            found.append(inner)
        elif isinstance(value, dict | list):
            found += _other_files(value, inner)
    return found
