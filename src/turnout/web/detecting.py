"""Judge throws with a detector that the page has sent: verdicts, expected bands, places, trends."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from turnout.core.errors import FileError
from turnout.detection.conditions import FORCE, TRAINED
from turnout.detection.detector.another_switch import misfit_remark, panel_remark
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.switch_history import predict
from turnout.detection.detector.throw_rows import read_table
from turnout.detection.detector.throw_verdict import CANNOT, OBJECTS, Verdict
from turnout.detection.detector.throws_of_dataset import throws_of_dataset
from turnout.detection.detector.trends import staying_causes
from turnout.figures.detection import trend_sheet
from turnout.figures.sheet import Line, Row, Sheet, sheet_record
from turnout.measurement.chain.apply import apply_chain
from turnout.measurement.formats.history import is_history, read_history
from turnout.web.measured import KILO, channel_map_of, sent_recording
from turnout.web.netcdf import sent_dataset

MOST_THROWS = 200
DEVIATIONS = 1.96
"""Of a normal distribution, half of the interval that holds 95 %."""
SAFETY = f"Advisory: replaces neither lock nor end-position sensors. {TRAINED.capitalize()}."


def read_detector(path: Path) -> Detector:
    """Read a detector file; messages name it as the user does."""
    try:
        return Detector.load(path)
    except FileError as error:
        raise FileError(str(error).replace(str(path), path.name)) from None


def described_detector(detector: Detector, mark: str) -> dict[str, Any]:
    """Return the data by which the page shows a detector."""
    known = detector.knowledge
    return {
        "mark": mark,
        "panel": str(known.about.get("panel", "")),
        "throws": detector.known.throws,
        "drives": list(known.layout.drives),
        "places": list(known.places),
        "safety": SAFETY,
    }


def sent_throws(
    path: Path, chosen: str, folder: Path | None, *, quantity: str = FORCE
) -> list[Recorded]:
    """Return the throws of a file that the page sent.

    Parameters
    ----------
    path : Path
        A table with a row a throw, a CSV file of this page, a dataset (.nc), or a recording.
    chosen : str
        Channel map of a recording: its text, the name of a library map, or "campaign".
    folder : Path, optional
        Of the studio's campaign.
    quantity : str
        Judged quantity of the drives.
    """
    try:
        if path.suffix == ".nc":
            return throws_of_dataset(sent_dataset(path), name=path.name, quantity=quantity)
        if is_history(path):
            return throws_of_dataset(read_history(path), name=path.name, quantity=quantity)
        if not chosen and path.suffix == ".csv":
            return read_table(path, quantity=quantity)
    except FileError as error:
        raise FileError(str(error).replace(str(path), path.name)) from None
    if not chosen:
        message = f"{path.name}: choose its channel map under 'Measured throw', then send it again"
        raise FileError(message)
    recording, _ = sent_recording(path)
    dataset = apply_chain(recording, channel_map_of(chosen, folder))
    return throws_of_dataset(dataset, name=path.name, quantity=quantity)


def run_throws(dataset: xr.Dataset, *, quantity: str = FORCE) -> list[Recorded]:
    """Return the throw that the page shows."""
    return throws_of_dataset(dataset, name="the throw shown", quantity=quantity)


def judged_record(detector: Detector, throws: Sequence[Recorded]) -> dict[str, Any]:
    """Return verdicts, each with the throw in its expected band, remarks, trends, as plain data."""
    throws = [throw for item in throws for throw in detector.located(item)]
    if not throws:
        message = "it holds no closing movement; only these are judged"
        raise FileError(message)
    if len(throws) > MOST_THROWS:
        message = f"{len(throws)} throws: at most {MOST_THROWS}; use `turnout detect run` for more"
        raise FileError(message)
    verdicts = detector.predict(throws)
    rows = [asdict(item) for item in verdicts]
    about = detector.knowledge.about
    remarks = panel_remark(throws, about), misfit_remark([item.status for item in verdicts], about)
    trends = trend_sheet(rows) if len(verdicts) > 1 else None
    staying = [
        f"{name} stays since {rows[since]['name']} (cumulated log odds {total:.1f})"
        for name, (since, total) in staying_causes(rows).items()
    ]
    return {
        "verdicts": [
            _verdict_record(detector, verdict)
            | {"band": sheet_record(band) if (band := _band(detector, throw, verdict)) else None}
            for throw, verdict in zip(throws, verdicts, strict=True)
        ],
        "trends": sheet_record(trends) if trends else None,
        "staying": staying,
        "remark": "; ".join(text for text in remarks if text),
        "history": detector.known.throws,
        "safety": SAFETY,
    }


def _verdict_record(detector: Detector, verdict: Verdict) -> dict[str, Any]:
    x_of = detector.knowledge.setting.places
    record: dict[str, Any] = _plain(asdict(verdict))
    shares = verdict.places
    record["lines"] = verdict.lines()
    record["blade"] = [
        {"name": name, "x": float(x_of[name]), "value": float(shares.get(name, 0.0))}
        for name in detector.knowledge.places
    ]
    return record


def _band(detector: Detector, throw: Recorded, verdict: Verdict) -> Sheet | None:
    """Return a throw in the band of 95 % of sound throws of this switch at its friction level."""
    if verdict.status in (CANNOT, OBJECTS):
        return None
    _, features = detector.features(throw)
    known = detector.knowledge
    model, layout = known.model, known.layout
    number = int(np.argmin(np.abs(model.level - verdict.friction)))
    mean, covariance = predict(model, known.errors(), detector.known, number)
    mean = mean + model.slope[number] * (verdict.friction - model.level[number])
    mean, half = mean[: layout.size], DEVIATIONS * np.sqrt(np.diag(covariance)[: layout.size])
    seen = np.isfinite(features) & np.isin(
        np.arange(layout.size), detector.view(verdict.part).features
    )
    factor, unit = (KILO, "kN") if detector.quantity == FORCE else (1.0, known.setting.unit)
    rows = []
    for row, drive in enumerate(layout.drives):
        own = np.flatnonzero((layout.drive == row) & seen)
        time = layout.time[own]
        curves = (
            ("low", mean[own] - half[own]),
            ("high", mean[own] + half[own]),
            ("expected", mean[own]),
            ("this throw", features[own]),
        )
        lines = tuple(Line(label=text, x=time, y=values / factor) for text, values in curves)
        rows.append(Row(f"Drive {drive}\n{detector.quantity} [{unit}]", lines))
    return Sheet(
        name="band",
        title="",
        caption="",
        x_label="Time on the schedule of the panel [s]",
        rows=tuple(rows),
    )


def _plain(value: Any) -> Any:
    """Return plain data fit for JSON: None for numbers that are not finite."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
