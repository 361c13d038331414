"""The commands `turnout detect ...`: train a detector, teach it a switch, judge throws."""

import stat
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.options import (
    File,
    PanelOptions,
    WorkersOption,
    argument,
    gives,
    option,
)
from turnout.cli.output import FINDINGS, Output, json_text, note, refuse, resumable
from turnout.cli.watch import cores, watched
from turnout.core.value_text import count_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from turnout.detection.detector.detector import Detector
    from turnout.detection.detector.knowledge import Knowledge
    from turnout.detection.detector.recorded import Recorded
    from turnout.detection.detector.throw_verdict import Verdict

VERDICT_UNITS = {
    **{"x": "m", "size": "m", "middle": "m", "low": "m", "high": "m", "limit": "m"},
    **{"force": "N", "time": "s", "false_alarm_rate": "1", "log_ratio": "1", "threshold": "1"},
    **{"odds": "1", "above": "1", "fit": "1", "friction": "1", "places": "1"},
    **{"kinds": "1", "scatter": "1"},
    "peaks": "N",
}

DetectorArgument = Annotated[Path, argument("FILE", "Detector that `turnout detect train` wrote.")]
RecordingsArgument = Annotated[
    list[Path],
    argument(
        "RECORDINGS...",
        "Campaign folders, datasets (.nc), tables (.csv), or recordings with --channels.",
    ),
]
ChannelsOption = Annotated[
    Path | None, option("--channels MAP.toml", "Channel map of the recordings.", default=...)
]
RateOption = Annotated[
    float, option("--far RATE", "False alarms a sound throw: 1e-3 or 1e-4.", default=...)
]


def known_rate(far: float) -> float:
    """Return a rate of false alarms for which thresholds are known."""
    from turnout.detection.alarm_threshold import RATES

    if far not in RATES:
        allowed = ", ".join(f"{rate:g}" for rate in RATES)
        refuse(f"--far {far:g}: thresholds are known for {allowed}")
    return far


def read_recordings(
    recordings: "Sequence[Path]", channels: Path | None, detector: "Detector"
) -> "list[Recorded]":
    """Return the throws of recordings; FileError if one holds none.

    Where one names another panel than the detector's, a note goes to stderr.
    """
    from turnout.detection.detector.another_switch import panel_remark
    from turnout.detection.detector.reading import read_throws

    found = []
    for path in recordings:
        throws = read_throws(path, channels=channels, quantity=detector.quantity)
        if not throws:
            refuse(f"{path}: holds no closing movement; only these are judged")
        if remark := panel_remark(throws, detector.knowledge.about):
            note(f"{path}: {remark}")
        found += throws
    return found


def verdict_units(found: "Detector") -> dict[str, str]:
    """Return units by key of verdicts."""
    unit = found.knowledge.setting.unit
    return {**VERDICT_UNITS, "force": unit, "peaks": unit}


LARGEST_USUAL_SCATTER = 1.2
"""Scatter of the throws of a switch from which on it is mentioned [-]."""
app = typer.Typer(
    help="Detect trapped objects from drive forces: train, learn a switch, judge throws.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("train", short_help="Train a detector for a panel on simulated throws.")
@gives(
    "detect train",
    quiet=True,
    width=16,
    out=File("--out -o FILE.detector", "The detector.", default=Path("switch.detector")),
)
def train_command(
    output: Output,
    panel: PanelOptions,
    study: Path | None = option("--study FILE.toml", "Population in place of the reference case."),
    sound: int | None = option("--sound N", "Sound throws; default 4000.", min=420),
    objects: int | None = option(
        "--objects N",
        "Throws with objects, the first 800 also as objects that yield, such as ice; default 3000.",
        min=200,
    ),
    defects: int | None = option("--defects N", "Throws of each other cause; default 400.", min=40),
    switches: int | None = option("--switches N", "Switches thrown 26 times; default 80.", min=10),
    channels: str = option(
        "--channels KIND", "What is judged: force, or current or power.", default="force"
    ),
    discrepancy: float = option(
        "--discrepancy SHARE",
        "Assumed difference of model and switch, share of the peak force [-].",
        default=0.05,
    ),
    folder: Path = option(
        "--folder DIR",
        "Keeps the throws; run the same command to continue.",
        default=Path("detector-throws"),
    ),
    workers: WorkersOption = 0,
) -> None:
    """Throw a population of switches with and without objects, and learn to distinguish them."""
    from turnout.calibration.load_study import load_study
    from turnout.core.progress import Pace
    from turnout.detection.detector.allowances import Allowances
    from turnout.detection.detector.detector import Detector
    from turnout.detection.detector.train_detector import train_detector
    from turnout.detection.detector.training_sets import Counts

    allowances = Allowances(discrepancy=discrepancy)
    counts = {"sound": sound, "objects": objects, "defects": defects, "switches": switches}
    given = panel.given()
    with (
        resumable(f"throws so far are in {folder}, run the same command to continue"),
        watched("throws", quiet=output.quiet) as watch,
    ):
        knowledge = train_detector(
            folder,
            panel=given,
            study=None if study is None else load_study(study),
            counts=replace(Counts(), **{name: item for name, item in counts.items() if item}),
            allowances=allowances,
            quantity=_quantity(channels),
            workers=workers or cores(),
            pace=Pace(watch.sweep),
        )
    output.show(*training_lines(knowledge))
    output.save(output["out"], Detector(knowledge).save)
    output.json(_described, knowledge)


def _quantity(channels: str) -> str:
    from turnout.detection.conditions import UNITS

    if channels not in UNITS:
        refuse(f"--channels {channels}: allowed are {', '.join(UNITS)}")
    return channels


def _described(knowledge: "Knowledge") -> dict[str, Any]:
    from turnout.detection.detector.judging import UNUSUAL

    return {
        "about": dict(knowledge.about),
        "allowances": knowledge.setting.allowances,
        "calibrated": knowledge.calibrated,
        "signatures": len(knowledge.signatures.kind),
        "causes": ["object", *(name for name in knowledge.causes if name != UNUSUAL)],
        "kinds": [] if knowledge.object_kinds is None else list(knowledge.object_kinds.names),
    }


def training_lines(knowledge: "Knowledge") -> list[str]:
    """Return panel, throws, origin and thresholds of a trained detector as lines."""
    from turnout.detection.conditions import SIMULATED

    about = knowledge.about
    counts = ", ".join(f"{count} {name}" for name, count in about["throws"].items())
    lines = [f"panel           {about['panel']}", f"throws          {counts}"]
    lines.append(f"origin          {SIMULATED}")
    for item in knowledge.calibrated:
        limits = ", ".join(f"{rate}: {value:.2f}" for rate, value in item.thresholds.items())
        lines.append(
            f"thresholds      {item.part}, {item.history} throws known: {limits} "
            f"(from {item.throws} throws of {item.switches} switches in {item.groups} groups that "
            "share no section)"
        )
    return lines


@app.command("learn", short_help="Learn a switch from its own throws without an object.")
@gives(
    "detect learn", out=File("--out -o FILE.detector", "The detector of the switch.", default=...)
)
def learn_command(
    output: Output,
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    channels: ChannelsOption = None,
    reset: bool = option("--reset", "Forget what was learned, as after an adjustment."),
    unchecked: bool = option("--unchecked", "Learn throws that are not called sound, too."),
) -> None:
    """Add sound throws of one switch to its detector; throws not called sound are left out."""
    from turnout.detection.detector.another_switch import misfit_remark
    from turnout.detection.detector.detector import Detector

    found = Detector.load(detector)
    if reset:
        found.clear_history()
    throws = read_recordings(recordings, channels, found)
    before = found.known.throws
    verdicts = found.learn(throws, check=not unchecked)
    if found.known.throws == before:
        remark = misfit_remark([item.status for item in verdicts], found.knowledge.about)
        refuse(_nothing_learned(verdicts, output["out"]) + (f"; {remark}" if remark else ""))
    known = found.known
    output.show(*(item.lines()[0] for item in verdicts if item.status != "sound"))
    output.show(f"{known.throws} sound throws known")
    if known.scatter > LARGEST_USUAL_SCATTER:
        output.show(
            f"they scatter more than is assumed (variance x {known.scatter:.1f}), which "
            "limits allow for: small objects are harder to detect"
        )
    output.save(output["out"], found.save)
    judged = [asdict(item) for item in verdicts]
    output.json(
        lambda: {"verdicts": judged, "throws": known.throws, "scatter": known.scatter},
        units=verdict_units(found),
    )


def _nothing_learned(verdicts: "Sequence[Verdict]", out: Path | None) -> str:
    first = verdicts[0].lines()[0] if verdicts else "none was found"
    return (
        f"none of {len(verdicts)} throws is called sound, so nothing was learned and {out} is not "
        f"written; {first}"
    )


@app.command("run", short_help="Judge recorded throws.")
@gives("detect run")
def detect_run_command(
    output: Output,
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
    strict: bool = option("--strict", "Exit code 1 where a throw is not called sound."),
) -> None:
    """Judge throws: object or none, its place and size, gaps without sensors, other causes."""
    from turnout.detection.conditions import TRAINED
    from turnout.detection.detector.another_switch import misfit_remark
    from turnout.detection.detector.detector import Detector

    found = Detector.load(detector, false_alarm_rate=known_rate(far))
    verdicts = found.predict(read_recordings(recordings, channels, found))
    remark = misfit_remark([item.status for item in verdicts], found.knowledge.about)
    output.show(*(line for item in verdicts for line in item.lines()))
    output.show(_summary(verdicts), TRAINED, *([remark] if remark else []))
    output.json(
        lambda: {"verdicts": [asdict(item) for item in verdicts], "remark": remark},
        units=verdict_units(found),
    )
    if strict and any(item.status != "sound" for item in verdicts):
        raise typer.Exit(FINDINGS)


def _summary(verdicts: "Sequence[Verdict]") -> str:
    counts = Counter(item.status for item in verdicts)
    return f"{count_text(len(verdicts), 'throw')}: " + ", ".join(
        f"{n} {name}" for name, n in counts.items()
    )


@app.command("report", short_help="Write an HTML page about judged throws.")
@gives("detect report", json=False, out=File("--out -o FILE.html", "The page.", default=...))
def detect_report_command(
    output: Output,
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
) -> None:
    """Judge throws and write one HTML file: findings, a row a throw, trend of friction."""
    from turnout.detection.detector.detector import Detector
    from turnout.figures.report.detection import detection_page
    from turnout.figures.report.page import page_html

    found = Detector.load(detector, false_alarm_rate=known_rate(far))
    verdicts = found.predict(read_recordings(recordings, channels, found))
    about = {
        "detector": str(detector),
        "panel": str(found.knowledge.about.get("panel", "")),
        "throws known": str(found.known.throws),
    }
    rows = [asdict(item) for item in verdicts]
    page = detection_page(rows, about=about, quantity=found.quantity)
    output.write(output["out"], page_html(page))


SETTLED = 2.0
"""A recording is read when it was seen unchanged for so long, whatever its date [s]."""


@app.command("watch", short_help="Judge recordings as they come into a folder.")
def watch_command(
    detector: DetectorArgument,
    folder: Path = argument("FOLDER", "Where recordings arrive."),
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
    every: float = option("--every S", "Seconds between looks.", default=2.0, min=0.1),
    once: bool = option("--once", "Judge what is there, then end."),
    as_json: bool = option("--json", "Print each verdict as one JSON object; see docs."),
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
