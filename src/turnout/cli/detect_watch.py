"""The command `turnout detect watch`."""

import stat
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.detect_options import (
    ChannelsOption,
    DetectorArgument,
    RateOption,
    known_rate,
    read_recordings,
    verdict_units,
)
from turnout.cli.options import argument, option
from turnout.cli.output import json_text, note, refuse

if TYPE_CHECKING:
    from turnout.detection.detector.detector import Detector

SETTLED = 2.0
"""A recording is read when it was seen unchanged for so long, whatever its date [s]."""


def watch_command(
    detector: DetectorArgument,
    folder: Annotated[Path, argument("FOLDER", "Where recordings arrive.")],
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
    every: Annotated[float, option("--every S", "Seconds between looks.", min=0.1)] = 2.0,
    once: Annotated[bool, option("--once", "Judge what is there, then end.")] = False,
    as_json: Annotated[
        bool, option("--json", "Print each verdict as one JSON object; see docs.")
    ] = False,
) -> None:
    """Judge each new file of a folder once, until interrupted; a bad file stops nothing."""
    from turnout.detection.detector.detector import Detector

    found = Detector.load(detector, false_alarm_rate=known_rate(far))
    if not folder.is_dir():
        refuse(f"{folder}: no such folder; name the one that recordings come into")
    seen: dict[str, tuple[tuple[int, int], float]] = {}
    done: set[tuple[str, tuple[int, int]]] = set()
    away = False
    while True:
        now = time.monotonic()
        try:
            files, away = _files(folder), False
        except OSError as error:  # such as a share that is not reached for a while
            if not away:
                note(f"{folder}: cannot be read now ({error.strerror}); looking again")
            files, away = [], True
        for path, state in files:
            if seen.get(path.name, (None, 0.0))[0] != state:
                seen[path.name] = (state, now)
            settled = once or now - seen[path.name][1] >= SETTLED
            if settled and (path.name, state) not in done:
                done.add((path.name, state))
                _judge_file(found, path, channels, as_json=as_json)
        if once:
            return
        time.sleep(every)


def _files(folder: Path) -> list[tuple[Path, tuple[int, int]]]:
    """Return files with their size and time of change; one that was moved away is left out."""
    found = []
    for path in sorted(folder.iterdir()):
        try:
            state = path.stat()
        except OSError:
            continue
        if stat.S_ISREG(state.st_mode) and not path.name.startswith("."):
            found.append((path, (state.st_size, state.st_mtime_ns)))
    return found


def _judge_file(found: "Detector", path: Path, channels: Path | None, *, as_json: bool) -> None:
    from turnout.core.errors import TurnoutError
    from turnout.detection.detector.throw_verdict import cannot_judge

    try:
        verdicts = found.predict(read_recordings([path], channels, found))
    except (TurnoutError, OSError) as error:
        verdicts = [cannot_judge(path.name, str(error))]
    except Exception as error:  # noqa: BLE001 - whatever a file holds, the next ones are judged
        verdicts = [cannot_judge(path.name, f"{type(error).__name__} while it was judged: {error}")]
    for item in verdicts:
        if as_json:
            text = json_text("detect watch", {"verdict": asdict(item)}, units=verdict_units(found))
            typer.echo(" ".join(text.split()))
        else:
            typer.echo("\n".join(item.lines()))
