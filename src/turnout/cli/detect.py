"""The commands `turnout detect ...`: train a detector, teach it a switch, judge throws."""

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
from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import (
    INTERRUPTED,
    CalibrationOption,
    PanelArgument,
    QuietOption,
    SetOption,
    check_outputs,
    write_and_report,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from turnout.detection.detector.knowledge import Knowledge
    from turnout.detection.detector.throw_verdict import Verdict
    from turnout.study.sweep.run import SweepProgress

EXIT_NOT_SOUND = 1
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
            help="Throws with objects, the first 800 also as objects that yield, such as ice; "
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
    from turnout.calibration.load_study import load_study
    from turnout.cli.options import opened_panel
    from turnout.cli.sweep import cores
    from turnout.detection.detector.allowances import Allowances
    from turnout.detection.detector.detector import Detector
    from turnout.detection.detector.train_detector import train_detector
    from turnout.detection.detector.training_sets import Counts

    allowances = Allowances(discrepancy=discrepancy)
    counts = {"sound": sound, "objects": objects, "defects": defects, "switches": switches}
    given = None
    if panel is not None or calibration is not None or settings:
        given = opened_panel(panel, settings, calibration)
    try:
        knowledge = train_detector(
            folder,
            panel=given,
            study=None if study is None else load_study(study),
            counts=replace(Counts(), **{name: item for name, item in counts.items() if item}),
            allowances=allowances,
            quantity=_quantity(channels),
            workers=workers or cores(),
            watch=_watching(quiet=quiet),
            report=None if quiet else _calibrating,
        )
    except KeyboardInterrupt:
        text = f"interrupted; throws so far are in {folder}, run the same command to continue"
        typer.echo(f"turnout: {text}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    Detector(knowledge).save(out)
    if as_json:
        print_json("detect train", _described(knowledge), written=[out])
        return
    for line in _training_lines(knowledge):
        typer.echo(line)
    typer.echo(f"wrote           {out}")


def _quantity(channels: str) -> str:
    from turnout.core.errors import FileError
    from turnout.detection.conditions import UNITS

    if channels not in UNITS:
        message = f"--channels {channels}: allowed are {', '.join(UNITS)}"
        raise FileError(message)
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
    """Add sound throws of one switch to its detector; throws not called sound are left out."""
    check_outputs({"--out": out}, {"--out": (".detector",)})
    from turnout.core.errors import FileError
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
        raise FileError(_nothing_learned(verdicts, out) + (f"; {remark}" if remark else ""))
    found.save(out)
    if as_json:
        known = found.known
        record = {"verdicts": [asdict(item) for item in verdicts], "throws": known.throws}
        record["scatter"] = known.scatter
        print_json("detect learn", record, units=verdict_units(found), written=[out])
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
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 where a throw is not called sound.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Judge throws: object or none, its place and size, gaps without sensors, other causes."""
    from turnout.detection.conditions import TRAINED
    from turnout.detection.detector.another_switch import misfit_remark
    from turnout.detection.detector.detector import Detector

    found = Detector.load(detector, false_alarm_rate=known_rate(far))
    verdicts = found.predict(read_recordings(recordings, channels, found))
    remark = misfit_remark([item.status for item in verdicts], found.knowledge.about)
    if as_json:
        record = {"verdicts": [asdict(item) for item in verdicts], "remark": remark}
        print_json("detect run", record, units=verdict_units(found))
    else:
        for item in verdicts:
            typer.echo("\n".join(item.lines()))
        typer.echo(f"{_summary(verdicts)}\n{TRAINED}")
        if remark:
            typer.echo(remark)
    if strict and any(item.status != "sound" for item in verdicts):
        raise typer.Exit(EXIT_NOT_SOUND)


def _summary(verdicts: "Sequence[Verdict]") -> str:
    counts: dict[str, int] = {}
    for item in verdicts:
        counts[item.status] = counts.get(item.status, 0) + 1
    throws = "1 throw" if len(verdicts) == 1 else f"{len(verdicts)} throws"
    return f"{throws}: " + ", ".join(f"{n} {name}" for name, n in counts.items())


@app.command("report", short_help="Write an HTML page about judged throws.")
def detect_report_command(
    detector: DetectorArgument,
    recordings: RecordingsArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE.html", help="The page.")],
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
    write_and_report(out, page_html(detection_page(rows, about=about, quantity=found.quantity)))


app.command("watch", short_help="Judge recordings as they come into a folder.")(watch_command)
