"""Tasks of a studio process: panels, throws, files and recordings.

Only this process parses what the page sends, so bad content cannot block the server.
"""

import json
import secrets
import tempfile
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import FileError, PanelError, TurnoutError
from turnout.core.lru_cache import LRUCache
from turnout.core.scheme import Scheme
from turnout.core.stored_arrays import arrays_from_bytes, arrays_to_bytes
from turnout.core.toml import decode, parse_toml
from turnout.figures.over_time_sheet import throw_sheet
from turnout.figures.sheet import sheet_record
from turnout.measurement.chain.skeleton import skeleton
from turnout.measurement.formats.history import is_history
from turnout.metric.panel_check import (
    concern_lines,
    panel_concerns,
    piece_concerns,
    piece_lines,
)
from turnout.metric.test_piece import least_piece
from turnout.panel.load import (
    LoadedPanel,
    library_names,
    library_text,
    load_panel,
    panel_from_file,
)
from turnout.panel.new_panel import names_other_file
from turnout.throw.simulate import simulate
from turnout.web.controls import measured_record, panel_controls
from turnout.web.measured import (
    Measured,
    channel_map_of,
    differences,
    history_movement,
    plain_name,
    recorded_movements,
    recording_lines,
    sent_recording,
    shifted,
)
from turnout.web.object_map import object_map
from turnout.web.question import Question, Reply, Superseded, Task, UnknownMarkError
from turnout.web.request import (
    FileRequest,
    MapRequest,
    MarkRequest,
    PanelRequest,
    RunRequest,
    WheelRequest,
    read_request,
)
from turnout.web.scenario import command_line, panel_toml, python_script
from turnout.web.throw import (
    FILE_MESSAGE,
    FILES,
    TEXTS,
    changed_panel,
    made_file,
    made_ready,
    places_around,
    simulate_request,
    throw_reply,
    wheel_record,
)

if TYPE_CHECKING:
    from turnout.detection.detector.detector import Detector


# Sizes of the caches.
MOST_PANELS, MOST_RUNS, MOST_MEASURED, MOST_DETECTORS = 12, 3, 20, 2
LARGEST_PANEL = 4_000_000
# Thrown before the first reply: without over-travel, and with the loaded start that it brings,
# which has kernels of its own.
WARM_UP_PANELS = ("sb1", "uic60-760-1-15")


@dataclass(frozen=True, slots=True)
class Opening:
    """Initial content of a process; pickled.

    Attributes
    ----------
    panel : LoadedPanel
        The panel shown first.
    campaign : mapping of str to Measured
        Movements of a campaign by mark.
    folder : Path, optional
        Of that campaign.
    text : str
        The file of the panel, for files that the page saves.
    """

    panel: LoadedPanel
    campaign: Mapping[str, Measured]
    folder: Path | None = None
    text: str = ""

    def __call__(self) -> Callable[[Task, Question], Reply]:
        """Load or compile the kernels, so that no reply waits for that."""
        for name in WARM_UP_PANELS:
            simulate(load_panel(name), scheme=Scheme.of("quick"), throw=False)
        return TaskHandler(self).answer


class TaskHandler:
    """Panels by mark, measured movements by mark, and the last throws, in one process.

    Parameters
    ----------
    opening : Opening
        Its initial content.
    """

    def __init__(self, opening: Opening) -> None:
        self._opening = opening
        self._panels = LRUCache[LoadedPanel](MOST_PANELS)
        self._texts = LRUCache[str](MOST_PANELS)
        self._runs = LRUCache[xr.Dataset](MOST_RUNS)
        self._sent = LRUCache[Measured](MOST_MEASURED)
        self._detectors = LRUCache["Detector"](MOST_DETECTORS)
        self._ahead: deque[Callable[[], object]] = deque()
        self._tasks: Mapping[str, Callable[[Task, Question], Reply]] = {
            "panel/open": self._open_panel,
            "panel/send": self._send_panel,
            "panel/again": self._panel_again,
            "panel/concerns": self._concerns,
            "run": self._run,
            "map": self._map,
            "wheel": self._wheel,
            "file": self._file,
            "recording": self._recording,
            "limit": self._limit,
            "detector": self._detector,
            "judge": self._judge,
            "judge shown": self._judge_shown,
            "measured": self._measured,
            "ahead": self._one_ahead,
        }

    def answer(self, task: Task, question: Question) -> Reply:
        """Return the reply to a task; raise TurnoutError if it fails."""
        self._restored = dict(task.restored)
        return self._tasks[task.name](task, question)

    def _open_panel(self, task: Task, _question: Question) -> Reply:
        """Open a panel of the library, and no file."""
        name = read_request(PanelRequest, task.content).name
        names = library_names()
        if name not in names:
            message = f"no library panel is called '{name}'; there are {', '.join(names)}"
            raise FileError(message)
        return self._shown(load_panel(name), ("library", name, library_text(name)))

    def _send_panel(self, task: Task, _question: Question) -> Reply:
        """Check a panel file that the page sent as `turnout panel check` does."""
        name = plain_name(task.options["name"], "panel.toml")
        panel = _sent_panel(task.content, name)
        return self._shown(panel, ("sent", name, decode(task.content, source=name)))

    def _shown(self, panel: LoadedPanel, origin: tuple[str, str, str]) -> Reply:
        mark = panel.hash[:16]
        self._panels.put(mark, panel)
        self._texts.put(mark, origin[2])
        reply = Reply.of(panel_controls(panel, mark))
        return Reply(reply.content, kept=((mark, json.dumps(origin).encode()),))

    def _panel_again(self, task: Task, _question: Question) -> Reply:
        mark = read_request(MarkRequest, task.content).panel
        return Reply.of(panel_controls(self._panel(mark), mark))

    def _panel(self, mark: str) -> LoadedPanel:
        """Return a panel by its mark."""
        first = self._opening.panel
        if mark == first.hash[:16]:
            return first
        found = self._panels.get(mark)
        if found is None and mark in self._restored:
            kind, name, text = json.loads(self._restored[mark])
            panel = load_panel(name) if kind == "library" else _sent_panel(text.encode(), name)
            found = self._panels.put(mark, panel)
            self._texts.put(mark, text)
        if found is None:
            raise UnknownMarkError(mark, "this panel is no longer loaded; open it again")
        return found

    def _text(self, mark: str) -> str:
        """Return the file that a panel was loaded from."""
        panel = self._panel(mark)
        if panel is self._opening.panel:
            return self._opening.text
        return self._texts.get(mark) or ""

    def _concerns(self, task: Task, question: Question) -> Reply:
        """Throw a panel alone and on test pieces; return the lines of `turnout panel check`."""
        request = read_request(MarkRequest, task.content)
        panel, dataset = self._thrown(RunRequest(panel=request.panel), question, report=True)
        drives = panel.drive if dataset.attrs["complete"] else {}
        try:
            pieces = [least_piece(panel, name, report=question.check) for name in drives]
        except KeyboardInterrupt:
            raise Superseded from None
        found = [*panel_concerns(panel, dataset), *piece_concerns(panel, pieces)]
        return Reply.of({"lines": [*concern_lines(panel, found), *piece_lines(pieces)]})

    def _run(self, task: Task, question: Question) -> Reply:
        request = read_request(RunRequest, task.content)
        panel, dataset = self._thrown(request, question)
        record = throw_reply(panel, dataset, preview=request.preview)
        record["command"] = command_line(self._panel(request.panel), request)
        reply = Reply.of(record)
        if request.preview:
            return reply
        around = places_around(panel, request)
        self._ahead = deque(partial(made_ready, panel, near) for near in around)
        return Reply(reply.content, ahead=bool(self._ahead))

    def _map(self, task: Task, question: Question) -> Reply:
        """Throw objects of several sizes at several places."""
        request = read_request(MapRequest, task.content)
        panel = changed_panel(self._panel(request.run.panel), request.run)
        return Reply.of(object_map(panel, request, question))

    def _wheel(self, task: Task, _question: Question) -> Reply:
        """Roll a wheel along the closed rail of a throw."""
        request = read_request(WheelRequest, task.content)
        return Reply.of(
            wheel_record(changed_panel(self._panel(request.run.panel), request.run), request)
        )

    def _thrown(
        self, request: RunRequest, question: Question, *, report: bool = False
    ) -> tuple[LoadedPanel, xr.Dataset]:
        """Simulate the requested throw, or return it from the cache."""
        panel = changed_panel(self._panel(request.panel), request)
        key = request.model_dump_json()
        found = self._runs.get(key)
        if found is None:
            found = self._runs.put(key, simulate_request(panel, request, question, report=report))
        return panel, found

    def _one_ahead(self, _task: Task, _question: Question) -> Reply:
        """Prefetch one likely next throw."""
        with suppress(IndexError, TurnoutError):  # there is none, or it cannot be made
            self._ahead.popleft()()
        return Reply(ahead=bool(self._ahead))

    def _file(self, task: Task, question: Question) -> Reply:
        """Make a file of a throw, which is computed again if not cached."""
        kind = task.options["file"]
        request = read_request(FileRequest, task.content)
        if kind in TEXTS:
            return Reply(self._scenario(kind, request.run).encode(), FILES[kind])
        _, dataset = self._thrown(request.run, question)
        behind = self._thrown(request.behind, question)[1] if request.behind else None
        return Reply(made_file(kind, dataset, behind=behind), FILES[kind])

    def _scenario(self, kind: str, request: RunRequest) -> str:
        """Return a throw as a panel file, a command, or a script."""
        panel = self._panel(request.panel)
        if kind == "toml":
            return panel_toml(self._text(request.panel), changed_panel(panel, request), request)
        if kind == "py":
            return python_script(panel, request)
        return command_line(panel, request) + "\n"

    def _recording(self, task: Task, _question: Question) -> Reply:
        """List a recording, or, if a channel map is named, cut it into movements."""
        path = Path(task.options["path"])
        if is_history(path):
            return self._listed([history_movement(path)], [f"{path.name}: history of a throw"])
        recording, kind = sent_recording(path)
        chosen = task.options["map"]
        if not chosen:
            suggested = skeleton(recording)
            lines = [*recording_lines(recording, kind), "", *suggested.splitlines()]
            # Without a table it maps nothing, and cannot be used.
            usable = suggested if "\n[" in suggested else ""
            return Reply.of({"lines": lines, "movements": [], "suggested": usable})
        channel_map = channel_map_of(chosen, self._opening.folder)
        return self._listed(*recorded_movements(recording, channel_map))

    def _listed(self, found: list[Measured], lines: list[str]) -> Reply:
        """Give movements a mark each and list them."""
        # Other processes may need it by the same mark.
        marks = {f"sent-{secrets.token_hex(8)}": item for item in found}
        for mark, item in marks.items():
            self._sent.put(mark, item)
        movements = [measured_record(mark, item) for mark, item in marks.items()]
        content = Reply.of({"lines": lines, "movements": movements}).content
        return Reply(content, kept=tuple((m, measured_to_bytes(item)) for m, item in marks.items()))

    def _limit(self, task: Task, _question: Question) -> Reply:
        """Read a map of `turnout limit`."""
        from turnout.web.netcdf import limit_record

        return Reply.of(limit_record(Path(task.options["path"])))

    def _detector(self, task: Task, _question: Question) -> Reply:
        """Read a detector file."""
        from turnout.web.detecting import described_detector, read_detector

        path = Path(task.options["path"])
        mark = f"detector-{secrets.token_hex(8)}"
        found = self._detectors.put(mark, read_detector(path))
        content = Reply.of(described_detector(found, mark)).content
        return Reply(content, kept=((mark, path.read_bytes()),))

    def _detector_of(self, mark: str) -> "Detector":
        """Return a detector by its mark."""
        found = self._detectors.get(mark)
        if found is None and mark in self._restored:
            from turnout.web.detecting import read_detector

            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "kept.detector"
                path.write_bytes(self._restored[mark])
                found = self._detectors.put(mark, read_detector(path))
        if found is None:
            message = "this detector is no longer loaded; send its file again"
            raise UnknownMarkError(mark, message)
        return found

    def _judge(self, task: Task, _question: Question) -> Reply:
        """Judge the throws of a file."""
        from turnout.web.detecting import judged_record, sent_throws

        detector = self._detector_of(task.options["detector"])
        path = Path(task.options["path"])
        throws = sent_throws(
            path, task.options["map"], self._opening.folder, quantity=detector.quantity
        )
        return Reply.of(judged_record(detector, throws))

    def _judge_shown(self, task: Task, question: Question) -> Reply:
        """Judge the throw that the page shows."""
        from turnout.web.detecting import judged_record, run_throws

        detector = self._detector_of(task.options["detector"])
        _, dataset = self._thrown(read_request(RunRequest, task.content), question)
        throws = run_throws(dataset, quantity=detector.quantity)
        return Reply.of(judged_record(detector, throws))

    def _measured(self, task: Task, question: Question) -> Reply:
        """Return a measured movement on the time of a run."""
        request = read_request(RunRequest, task.content)
        measured = self._movement(task.options["mark"])
        _, dataset = self._thrown(request, question)
        sheet = throw_sheet(shifted(measured, dataset))
        drawn = {row.label for row in throw_sheet(dataset).rows}
        # Rows that the run lacks, such as powers beside markers, stand below.
        others = [row for row in sheet.rows if row.label not in drawn]
        apart = replace(sheet, rows=(*differences(measured, dataset), *others))
        return Reply.of(sheet_record(sheet) | {"differences": sheet_record(apart)["rows"]})

    def _movement(self, mark: str) -> Measured:
        """Return a measured movement by its mark."""
        found = self._opening.campaign.get(mark) or self._sent.get(mark)
        if found is None and mark in self._restored:
            found = self._sent.put(mark, measured_from_bytes(self._restored[mark]))
        if found is None:
            message = "this movement is no longer loaded; send its recording again"
            raise UnknownMarkError(mark, message)
        return found


def _sent_panel(content: bytes, name: str) -> LoadedPanel:
    """Read a panel file that the page sent.

    Raises
    ------
    FileError, PanelError
        With all problems.
    """
    file = parse_toml(decode(content, source=name), source=name)
    problems = [f"{key}: {FILE_MESSAGE}" for key in _other_files(file.data)]
    if problems:
        raise PanelError(problems, source=name)
    return panel_from_file(file)


def _other_files(data: Any, path: str = "") -> list[str]:
    """Find the keys of a document that name another file."""
    found = []
    items = enumerate(data) if isinstance(data, list) else data.items()
    for key, value in items:
        inner = f"{path}.{key}" if path else str(key)
        if names_other_file(str(key), value):
            found.append(inner)
        elif isinstance(value, dict | list):
            found += _other_files(value, inner)
    return found


PURPOSE = "movement of the studio"
HEADER = "header"


def measured_to_bytes(measured: Measured) -> bytes:
    """Return a measured movement as bytes.

    Parameters
    ----------
    measured : Measured
        Its dataset has texts and numbers alone.

    Examples
    --------
    >>> time = np.array([0.0, 0.1])
    >>> run = xr.Dataset({"drive_force": ("time", time)}, {"time": time}, {"kind": "measurement"})
    >>> kept = measured_from_bytes(measured_to_bytes(Measured("a", "closing", 0.0, "", run)))
    >>> kept.title, kept.dataset.identical(run)
    ('a', True)
    """
    dataset = measured.dataset
    header = {
        "fields": [measured.title, measured.direction, float(measured.size), measured.place],
        "attributes": dataset.attrs,
        "coordinates": [str(name) for name in dataset.coords],
        "variables": {
            str(name): {"dims": list(item.dims), "attributes": item.attrs}
            for name, item in dataset.variables.items()
        },
    }
    arrays: dict[str, NDArray[Any]] = {HEADER: np.array(json.dumps(header, default=_plain))}
    for name, item in dataset.variables.items():
        values = item.values
        arrays[f"values {name}"] = values.astype(str) if values.dtype.hasobject else values
    return arrays_to_bytes(arrays, PURPOSE)


def measured_from_bytes(content: bytes) -> Measured:
    """Return the movement that `measured_to_bytes` made bytes of."""
    arrays = arrays_from_bytes(content, PURPOSE)
    header = json.loads(str(arrays[HEADER]))
    variables = {
        name: (item["dims"], arrays[f"values {name}"], item["attributes"])
        for name, item in header["variables"].items()
    }
    dataset = xr.Dataset(variables, attrs=header["attributes"])
    dataset = dataset.set_coords([name for name in header["coordinates"] if name in dataset])
    title, direction, size, place = header["fields"]
    return Measured(title, direction, size, place, dataset)


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of JSON."""
    return value.tolist()
