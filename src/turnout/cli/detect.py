"""The commands `turnout detect ...`: train a detector, teach it a switch, judge throws."""

from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.detect_options import (
    ChannelsOption,
    DetectorArgument,
    RateOption,
    RecordingsArgument,
    known_rate,
    read_recordings,
    verdict_units,
)
from turnout.cli.detect_watch import watch_command
from turnout.cli.options import (
    CalibrationOption,
    PanelArgument,
    QuietOption,
    SetOption,
    StrictOption,
    WorkersOption,
    check_outputs,
    given_panel,
    option,
)
from turnout.cli.output import FINDINGS, JsonOption, Output, refuse, resumable
from turnout.core.value_text import count_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from turnout.detection.detector.knowledge import Knowledge
    from turnout.detection.detector.throw_verdict import Verdict

WORTH_SAYING = 1.2
"""Scatter of the throws of a switch from which on it is mentioned [-]."""
app = typer.Typer(
    help="Detect trapped objects from drive forces: train, learn a switch, judge throws.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("train", short_help="Train a detector for a panel on simulated throws.")
def train_command(
    panel: PanelArgument = None,
    calibration: CalibrationOption = None,
    settings: SetOption = [],  # noqa: B006 - typer copies it
    study: Annotated[
        Path | None, option("--study FILE.toml", "Population in place of the reference case.")
    ] = None,
    sound: Annotated[
        int | None, option("--sound N", "Sound throws; default 4000.", min=420)
    ] = None,
    objects: Annotated[
        int | None,
        option(
            "--objects N",
            "Throws with objects, the first 800 also as objects that yield, such as ice; default "
            "3000.",
            min=200,
        ),
    ] = None,
    defects: Annotated[
        int | None, option("--defects N", "Throws of each other cause; default 400.", min=40)
    ] = None,
    switches: Annotated[
        int | None, option("--switches N", "Switches thrown 26 times; default 80.", min=10)
    ] = None,
    channels: Annotated[
        str, option("--channels KIND", "What is judged: force, or current or power.")
    ] = "force",
    discrepancy: Annotated[
        float,
        option(
            "--discrepancy SHARE",
            "Assumed difference of model and switch, share of the peak force [-].",
        ),
    ] = 0.05,
    folder: Annotated[
        Path, option("--folder DIR", "Keeps the throws; run the same command to continue.")
    ] = Path("detector-throws"),
    out: Annotated[Path, option("--out -o FILE.detector", "The detector.")] = Path(
        "switch.detector"
    ),
    workers: WorkersOption = 0,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Throw a population of switches with and without objects, and learn to distinguish them."""
    check_outputs({"--out": out}, {"--out": (".detector",)})
    from turnout.calibration.load_study import load_study
    from turnout.cli.watch import cores, watched_sweeps
    from turnout.detection.detector.allowances import Allowances
    from turnout.detection.detector.detector import Detector
    from turnout.detection.detector.train_detector import train_detector
    from turnout.detection.detector.training_sets import Counts

    allowances = Allowances(discrepancy=discrepancy)
    counts = {"sound": sound, "objects": objects, "defects": defects, "switches": switches}
    given, shown = given_panel(panel, settings, calibration), watched_sweeps(quiet=quiet)
    with resumable(f"throws so far are in {folder}, run the same command to continue"):
        knowledge = train_detector(
            folder,
            panel=given,
            study=None if study is None else load_study(study),
            counts=replace(Counts(), **{name: item for name, item in counts.items() if item}),
            allowances=allowances,
            quantity=_quantity(channels),
            workers=workers or cores(),
            watch=lambda name: shown(name, "throws: "),
            report=None if quiet else _calibrating,
        )
    Detector(knowledge).save(out)
    output = Output("detect train", as_json=as_json, width=16)
    output.show(*_training_lines(knowledge))
    output.wrote(out)
    if as_json:
        output.json(_described(knowledge))


def _quantity(channels: str) -> str:
    from turnout.detection.conditions import UNITS

    if channels not in UNITS:
        refuse(f"--channels {channels}: allowed are {', '.join(UNITS)}")
    return channels


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


def _calibrating(what: str, done: int, total: int) -> None:
    if done == total or done % 20 == 0:
        typer.echo(f"{what}: {done} of {total} histories", err=True)


@app.command("learn", short_help="Learn a switch from its own throws without an object.")
def learn_command(
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    out: Annotated[Path, option("--out -o FILE.detector", "The detector of the switch.")],
    channels: ChannelsOption = None,
    reset: Annotated[
        bool, option("--reset", "Forget what was learned, as after an adjustment.")
    ] = False,
    unchecked: Annotated[
        bool, option("--unchecked", "Learn throws that are not called sound, too.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Add sound throws of one switch to its detector; throws not called sound are left out."""
    check_outputs({"--out": out}, {"--out": (".detector",)})
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
        refuse(_nothing_learned(verdicts, out) + (f"; {remark}" if remark else ""))
    found.save(out)
    output, known = Output("detect learn", as_json=as_json), found.known
    output.show(*(item.lines()[0] for item in verdicts if item.status != "sound"))
    output.show(f"{known.throws} sound throws known")
    if known.scatter > WORTH_SAYING:
        output.show(
            f"they scatter more than is assumed (variance x {known.scatter:.1f}), which "
            "limits allow for: small objects are harder to detect"
        )
    output.wrote(out)
    if as_json:
        record = {"verdicts": [asdict(item) for item in verdicts], "throws": known.throws}
        output.json({**record, "scatter": known.scatter}, units=verdict_units(found))


def _nothing_learned(verdicts: "Sequence[Verdict]", out: Path) -> str:
    first = verdicts[0].lines()[0] if verdicts else "none was found"
    return (
        f"none of {len(verdicts)} throws is called sound, so nothing was learned and {out} is not "
        f"written; {first}"
    )


@app.command("run", short_help="Judge recorded throws.")
def detect_run_command(
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
    strict: StrictOption = False,
    as_json: JsonOption = False,
) -> None:
    """Judge throws: object or none, its place and size, gaps without sensors, other causes."""
    from turnout.detection.conditions import TRAINED
    from turnout.detection.detector.another_switch import misfit_remark
    from turnout.detection.detector.detector import Detector

    found = Detector.load(detector, false_alarm_rate=known_rate(far))
    verdicts = found.predict(read_recordings(recordings, channels, found))
    remark = misfit_remark([item.status for item in verdicts], found.knowledge.about)
    output = Output("detect run", as_json=as_json)
    output.show(*(line for item in verdicts for line in item.lines()))
    output.show(_summary(verdicts), TRAINED, *([remark] if remark else []))
    if as_json:
        record = {"verdicts": [asdict(item) for item in verdicts], "remark": remark}
        output.json(record, units=verdict_units(found))
    if strict and any(item.status != "sound" for item in verdicts):
        raise typer.Exit(FINDINGS)


def _summary(verdicts: "Sequence[Verdict]") -> str:
    counts = Counter(item.status for item in verdicts)
    return f"{count_text(len(verdicts), 'throw')}: " + ", ".join(
        f"{n} {name}" for name, n in counts.items()
    )


@app.command("report", short_help="Write an HTML page about judged throws.")
def detect_report_command(
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    out: Annotated[Path, option("--out -o FILE.html", "The page.")],
    channels: ChannelsOption = None,
    far: RateOption = 1e-3,
) -> None:
    """Judge throws and write one HTML file: findings, a row a throw, trend of friction."""
    check_outputs({"--out": out}, {"--out": (".html",)})
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
    Output("detect report").write(out, page_html(page))


app.command("watch", short_help="Judge recordings as they come into a folder.")(watch_command)
