"""Common parts of the commands of `turnout detect`: arguments, recordings, units of a verdict."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from turnout.cli.options import argument, option
from turnout.cli.output import note, refuse

if TYPE_CHECKING:
    from turnout.detection.detector.detector import Detector
    from turnout.detection.detector.recorded import Recorded

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
    Path | None, option("--channels MAP.toml", "Channel map of the recordings.")
]
RateOption = Annotated[float, option("--far RATE", "False alarms a sound throw: 1e-3 or 1e-4.")]


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
