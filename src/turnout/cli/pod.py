"""The command `turnout pod`: probability of detection from the table of a test campaign."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turnout.cli.options import (
    FIGURE,
    FIGURES,
    File,
    argument,
    gives,
    option,
    read_texts,
)
from turnout.cli.output import Output, refuse

if TYPE_CHECKING:
    from turnout.detection.pod.pod_result import Pod
    from turnout.detection.pod.pod_table import TestThrows

TABLE = File("--out -o FILE", "Write the result (.nc), or the curve (.csv).", (".nc", ".csv"))
ROC = File(
    "--roc FILE",
    "Draw detections against false alarms, with the bound of --limit at --at.",
    FIGURES,
)
METRES = ("a50", "a90", "a90_95", "a90_95_profile", "required_size", "required_size_bound")


@gives("pod", quiet=True, out=TABLE, plot=FIGURE, roc=ROC)
def pod_command(
    output: Output,
    results: Path = argument("RESULTS", "Table of the campaign (.csv), a row a throw."),
    threshold: str | None = option(
        "--threshold VALUE",
        "Response from which an object is detected, as 250 or '250 N'; without it hits and "
        "misses are used.",
    ),
    floor: str | None = option(
        "--floor VALUE", "Responses at or below this are only known to be so."
    ),
    slip: str | None = option(
        "--slip VALUE", "Responses at or above this are only known to be so."
    ),
    size_scale: str = option("--size-scale NAME", "log or linear.", default="log"),
    response_scale: str = option("--response-scale NAME", "log or linear.", default="log"),
    link: str = option("--link NAME", "Of hits and misses: probit or logit.", default="probit"),
    pooled: bool = option("--pooled", "Ignore that switches differ; too optimistic."),
    campaigns: int = option(
        "--campaigns N",
        "Simulated campaigns that calibrate a90/95, 100 or more; 0 gives the plain profile "
        "likelihood.",
        default=400,
    ),
    limit: Path | None = option("--limit FILE.nc", "Map of `turnout limit -o`, for --roc."),
    at: str = option("--at PLACE", "Where the objects were, for --roc.", default="sleeper 6"),
) -> None:
    """Estimate the probability of detection over size, with a90 and a90/95."""
    from turnout.detection.pod.estimate import estimate_pod
    from turnout.detection.pod.pod_result import PodModel, pod_dataset
    from turnout.detection.pod.pod_table import read_test_throws, response_value
    from turnout.figures.pod import plot_pod

    throws = read_test_throws(results)
    curves = _roc_figure(throws, output["roc"], limit=limit, place=at)
    given = read_texts(
        {"--threshold": threshold, "--floor": floor, "--slip": slip},
        lambda _, text: response_value(text, throws=throws),
    )
    model = PodModel(
        threshold=given.get("--threshold"),
        least=given.get("--floor", float("-inf")),
        most=given.get("--slip", float("inf")),
        size_scale=size_scale,
        response_scale=response_scale,
        link=link,
        grouped=not pooled,
        drawn=campaigns,
    )
    found = estimate_pod(throws, model)
    out = output["out"]
    output.write(out, lambda: _content(found, out.suffix.lower() if out else ""))
    output.figure(output["plot"], lambda: plot_pod(pod_dataset(found)))
    output.figure(output["roc"], lambda: curves)
    output.json(pod_record, found, units=dict.fromkeys(METRES, "m"))
    output.lines(pod_lines(found))


def pod_record(found: "Pod") -> dict[str, Any]:
    """Return key figures, notes and the curve of a result."""
    from turnout.detection.pod.pod_result import key_figures

    return key_figures(found) | {
        "notes": found.notes,
        "curve": {
            "probability": found.probability,
            "required_size": found.size,
            "required_size_bound": found.size_bound,
        },
    }


def _roc_figure(throws: "TestThrows", path: Path | None, *, limit: Path | None, place: str) -> Any:
    """Return the figure of detections against false alarms, if it is wanted."""
    if path is None:
        return None
    from turnout.detection.pod.roc import campaign_roc
    from turnout.figures.roc import plot_roc
    from turnout.throw.store import open_response

    if limit is None:
        refuse("--roc: name the bound, a file of `turnout limit -o`, as --limit FILE.nc")
    found = campaign_roc(throws, open_response(limit), place=place)
    return plot_roc(
        false_alarms=found.false_alarms, detections=found.detections, intervals=found.intervals,
        sound=found.sound, rate=found.rate, bound=found.bound,
        title=f"{found.objects} objects at {place}, {found.sound} sound throws",
    )  # fmt: skip


def _content(found: "Pod", suffix: str) -> bytes | str:
    """Return the file of a result: all of it as netCDF, or its curve as a table."""
    from turnout.detection.pod.pod_result import pod_dataset

    dataset = pod_dataset(found)
    if suffix == ".nc":
        from turnout.throw.store import response_bytes

        return response_bytes(dataset)
    names = ("required_size", "required_size_bound")
    return str(dataset[list(names)].to_dataframe().to_csv(lineterminator="\n"))


def pod_lines(found: "Pod") -> Iterator[str]:
    """Yield counts, sizes and notes of a result."""
    from turnout.detection.conditions import CAMPAIGN

    what = "hits and misses" if found.model.threshold is None else "responses"
    effect = "differing" if found.model.grouped and found.switches > 1 else "pooled"
    yield (
        f"{found.throws} throws with objects ({what}) on {found.switches} "
        f"switch{'es' if found.switches != 1 else ''}, {effect}"
    )
    rows = (
        ("a50", found.a50, "half of the throws detect it"),
        ("a90", found.a90, "90 % of the throws detect it"),
        ("a90/95", found.a90_95, "upper 95 % confidence bound of a90"),
        ("", found.a90_95_profile, "the same by plain profile likelihood"),
    )
    for name, value, text in rows:
        yield f"{name:<8}{_millimetres(value):>10}   {text}"
    if found.sound_throws:
        rate = 100.0 * found.alarm_rate_high
        yield (
            f"false alarms: {found.alarms} of {found.sound_throws} sound throws, below "
            f"{rate:.2g} % with 95 % confidence"
        )
    for note in (*found.notes, CAMPAIGN):
        yield f"note: {note}"


def _millimetres(value: float) -> str:
    from math import isfinite

    return f"{1e3 * value:.2f} mm" if isfinite(value) else "none"
