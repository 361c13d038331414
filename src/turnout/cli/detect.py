"""The commands `turnout detect ...`: train a detector, teach it a switch, judge throws."""

import stat
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.json_output import JsonOption, json_text, print_json
from turnout.cli.options import (
    CalibrationOption,
    PanelArgument,
    QuietOption,
    SetOption,
    check_outputs,
    write_and_report,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from turnout.detection.detector.detector import Detector
    from turnout.detection.detector.knowledge import Knowledge
    from turnout.detection.detector.recorded import Recorded
    from turnout.detection.detector.throw_verdict import Verdict
    from turnout.sweep.run import SweepProgress

EXIT_NOT_SOUND = 1
VERDICT_UNITS = {
    **{"x": "m", "size": "m", "middle": "m", "low": "m", "high": "m", "limit": "m"},
    **{"force": "N", "time": "s", "false_alarm_rate": "1", "log_ratio": "1", "threshold": "1"},
    **{"odds": "1", "above": "1", "fit": "1", "friction": "1", "places": "1"},
    **{"kinds": "1", "scatter": "1"},
    "peaks": "N",
}
WORTH_SAYING = 1.2
"""Scatter of the throws of a switch from which on it is mentioned [-]."""
SETTLED = 2.0
"""A recording is read when it was seen unchanged for so long, whatever its date [s]."""

app = typer.Typer(
    help="Detect trapped objects from drive forces: train, learn a switch, judge throws.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
DetectorArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="Detector that `turnout detect train` wrote.")
]
RecordingsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDINGS...",
        help="Campaign folders, datasets (.nc), tables (.csv), or recordings with --channels.",
    ),
]
ChannelsOption = Annotated[
    Path | None,
    typer.Option("--channels", metavar="MAP.toml", help="Channel map of the recordings."),
]
RateOption = Annotated[
    float,
    typer.Option("--far", metavar="RATE", help="False alarms a sound throw: 1e-3 or 1e-4."),
]


@app.command("train", short_help="Train a detector for a panel on simulated throws.")
def train_command(
    panel: PanelArgument = None,
    calibration: CalibrationOption = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    study: Annotated[
        Path | None,
        typer.Option(
            "--study", metavar="FILE.toml", help="Population in place of the reference case."
        ),
    ] = None,
    sound: Annotated[
        int | None,
        typer.Option("--sound", metavar="N", min=420, help="Sound throws; default 4000."),
    ] = None,
    objects: Annotated[
        int | None,
        typer.Option(
            "--objects",
            metavar="N",
            min=200,
            help="Throws with objects, the first 800 also as stone, ice, snow and wood; "
            "default 3000.",
        ),
    ] = None,
    defects: Annotated[
        int | None,
        typer.Option(
            "--defects", metavar="N", min=40, help="Throws of each other cause; default 400."
        ),
    ] = None,
    switches: Annotated[
        int | None,
        typer.Option(
            "--switches", metavar="N", min=10, help="Switches thrown 26 times; default 80."
        ),
    ] = None,
    channels: Annotated[
        str,
        typer.Option(
            "--channels", metavar="KIND", help="What is judged: force, or current or power."
        ),
    ] = "force",
    discrepancy: Annotated[
        float,
        typer.Option(
            "--discrepancy",
            metavar="SHARE",
            help="Assumed difference of model and switch, share of the peak force [-].",
        ),
    ] = 0.05,
    folder: Annotated[
        Path,
        typer.Option(
            "--folder", metavar="DIR", help="Keeps the throws; run the same command to continue."
        ),
    ] = Path("detector-throws"),
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE.detector", help="The detector.")
    ] = Path("switch.detector"),
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=0, help="Processes; default one a core.")
    ] = 0,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Throw a population of switches with and without objects, and learn to distinguish them."""
    check_outputs({"--out": out}, {"--out": (".detector",)})
    from turnout.cli.options import opened_panel
    from turnout.cli.sweep import cores
    from turnout.detection.detector.allowances import Allowances
    from turnout.detection.detector.detector import Detector
    from turnout.detection.detector.train_detector import train_detector
    from turnout.detection.detector.training_sets import Counts
    from turnout.study.load_study import load_study

    allowances = Allowances(discrepancy=discrepancy)
    counts = {"sound": sound, "objects": objects, "defects": defects, "switches": switches}
    given = None
    if panel is not None or calibration is not None or settings:
        given = opened_panel(panel, settings, calibration)
    knowledge = train_detector(
        folder,
        panel=given,
        study=None if study is None else load_study(study),
        counts=replace(Counts(), **{name: item for name, item in counts.items() if item}),
        allowances=allowances,
        quantity=channels,
        workers=workers or cores(),
        watch=_watching(quiet=quiet),
        report=None if quiet else _calibrating,
    )
    Detector(knowledge).save(out)
    if as_json:
        print_json("detect train", _described(knowledge), written=[out])
        return
    for line in _training_lines(knowledge):
        typer.echo(line)
    typer.echo(f"wrote           {out}")


def _described(knowledge: "Knowledge") -> dict[str, Any]:
    from turnout.detection.detector.judging import UNUSUAL

    return {
        "about": dict(knowledge.about),
        "allowances": asdict(knowledge.setting.allowances),
        "calibrated": [asdict(item) for item in knowledge.calibrated],
        "signatures": len(knowledge.signatures.kind),
        "causes": ["object", *(name for name in knowledge.causes if name != UNUSUAL)],
        "kinds": [] if knowledge.object_kinds is None else list(knowledge.object_kinds.names),
    }


def _training_lines(knowledge: "Knowledge") -> list[str]:
    about = knowledge.about
    counts = ", ".join(f"{count} {name}" for name, count in about["throws"].items())
    lines = [f"panel           {about['panel']}", f"throws          {counts}"]
    for item in knowledge.calibrated:
        limits = ", ".join(f"{rate}: {value:.2f}" for rate, value in item.thresholds.items())
        lines.append(
            f"thresholds      {item.part}, {item.history} throws known: {limits} "
            f"(from {item.throws} throws of {item.switches} switches in {item.groups} groups that "
            "share no section)"
        )
    return lines


def _watching(*, quiet: bool) -> "Callable[[str], Callable[[SweepProgress], None]]":
    from turnout.cli.sweep import SweepWatch

    shown: list[SweepWatch] = []

    def watch(name: str) -> "Callable[[SweepProgress], None]":
        for before in shown:
            before.__exit__()
        shown[:] = [SweepWatch(f"throws: {name}", quiet=quiet).__enter__()]

        def report(state: "SweepProgress") -> None:
            shown[0].report(state)
            if state.done == state.total:
                shown[0].__exit__()

        return report

    return watch


def _calibrating(what: str, done: int, total: int) -> None:
    if done == total or done % 20 == 0:
        typer.echo(f"{what}: {done} of {total} histories", err=True)


@app.command("learn", short_help="Learn a switch from its own throws without an object.")
def learn_command(
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE.detector", help="The detector of the switch."),
    ],
    channels: ChannelsOption = None,
    reset: Annotated[
        bool, typer.Option("--reset", help="Forget what was learned, as after an adjustment.")
    ] = False,
    unchecked: Annotated[
        bool, typer.Option("--unchecked", help="Learn throws that are not called sound, too.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Add sound throws of one switch to its detector; what is not called sound is left out."""
    check_outputs({"--out": out}, {"--out": (".detector",)})
    from turnout.detection.detector.detector import Detector

    found = Detector.load(detector)
    if reset:
        found.clear_history()
    throws = _read(recordings, channels, found.quantity)
    verdicts = found.learn(throws, check=not unchecked)
    found.save(out)
    if as_json:
        known = found.known
        record = {"verdicts": [asdict(item) for item in verdicts], "throws": known.throws}
        record["scatter"] = known.scatter
        print_json("detect learn", record, units=_units(found), written=[out])
        return
    for item in verdicts:
        if item.status != "sound":
            typer.echo(item.lines()[0])
    typer.echo(f"{found.known.throws} sound throws known")
    if found.known.scatter > WORTH_SAYING:
        typer.echo(
            f"they scatter more than is assumed (variance x {found.known.scatter:.1f}), which "
            "limits allow for: small objects are harder to detect"
        )
    typer.echo(f"wrote           {out}")


@app.command("run", short_help="Judge recorded throws.")
def run_command(
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 where a throw is not called sound.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Judge throws: object or not, where, how large, gaps without sensors, other causes."""
    from turnout.detection.detector.detector import Detector

    found = Detector.load(detector, false_alarm_rate=_rate(far))
    verdicts = found.predict(_read(recordings, channels, found.quantity))
    if as_json:
        record = {"verdicts": [asdict(item) for item in verdicts]}
        print_json("detect run", record, units=_units(found))
    else:
        for item in verdicts:
            typer.echo("\n".join(item.lines()))
        typer.echo(_summary(verdicts))
    if strict and any(item.status != "sound" for item in verdicts):
        raise typer.Exit(EXIT_NOT_SOUND)


def _summary(verdicts: "Sequence[Verdict]") -> str:
    counts: dict[str, int] = {}
    for item in verdicts:
        counts[item.status] = counts.get(item.status, 0) + 1
    return f"{len(verdicts)} throws: " + ", ".join(f"{n} {name}" for name, n in counts.items())


def _rate(far: float) -> float:
    from turnout.detection.detector.calibrating import RATES
    from turnout.errors import FileError

    if far not in RATES:
        allowed = ", ".join(f"{rate:g}" for rate in RATES)
        message = f"--far {far:g}: thresholds are known for {allowed}"
        raise FileError(message)
    return far


def _read(recordings: "Sequence[Path]", channels: Path | None, quantity: str) -> "list[Recorded]":
    from turnout.detection.detector.reading import read_throws

    return [
        throw
        for path in recordings
        for throw in read_throws(path, channels=channels, quantity=quantity)
    ]


def _units(found: "Detector") -> dict[str, str]:
    unit = found.knowledge.setting.unit
    return {**VERDICT_UNITS, "force": unit, "peaks": unit}


@app.command("watch", short_help="Judge recordings as they come into a folder.")
def watch_command(
    detector: DetectorArgument,
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where recordings arrive.")],
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
    every: Annotated[
        float, typer.Option("--every", metavar="S", min=0.1, help="Seconds between looks.")
    ] = 2.0,
    once: Annotated[bool, typer.Option("--once", help="Judge what is there, then end.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print each verdict as one JSON object; see docs.")
    ] = False,
) -> None:
    """Judge each new file of a folder once, until interrupted; a bad file stops nothing."""
    from turnout.detection.detector.detector import Detector
    from turnout.errors import FileError

    found = Detector.load(detector, false_alarm_rate=_rate(far))
    if not folder.is_dir():
        message = f"{folder}: no such folder; name the one that recordings come into"
        raise FileError(message)
    seen: dict[str, tuple[tuple[int, int], float]] = {}
    done: set[tuple[str, tuple[int, int]]] = set()
    while True:
        now = time.monotonic()
        for path, state in _files(folder):
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
    from turnout.detection.detector.throw_verdict import ADVICE, CANNOT, Verdict
    from turnout.errors import TurnoutError

    try:
        verdicts = found.predict(_read([path], channels, found.quantity))
    except (TurnoutError, OSError) as error:
        verdicts = [
            Verdict(name=path.name, status=CANNOT, reason=str(error), advice=ADVICE[CANNOT])
        ]
    for item in verdicts:
        if as_json:
            text = json_text("detect watch", {"verdict": asdict(item)}, units=_units(found))
            typer.echo(" ".join(text.split()))
        else:
            typer.echo("\n".join(item.lines()))


@app.command("report", short_help="Write an HTML page about judged throws.")
def report_command(
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE.html", help="The page.")],
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
) -> None:
    """Judge throws and write one HTML file: findings, a row a throw, trend of friction."""
    check_outputs({"--out": out}, {"--out": (".html",)})
    from turnout.detection.detector.detector import Detector
    from turnout.report.detection import detection_page
    from turnout.report.page import page_html

    found = Detector.load(detector, false_alarm_rate=_rate(far))
    verdicts = found.predict(_read(recordings, channels, found.quantity))
    about = {
        "detector": str(detector),
        "panel": str(found.knowledge.about.get("panel", "")),
        "throws known": str(found.known.throws),
    }
    rows = [asdict(item) for item in verdicts]
    write_and_report(out, page_html(detection_page(rows, about=about, quantity=found.quantity)))
