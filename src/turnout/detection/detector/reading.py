"""Throws from whatever holds them: campaign folders, recordings with a map, datasets, tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.detection.conditions import FORCE
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_layout import CLOSING
from turnout.detection.detector.throw_rows import read_table
from turnout.detection.detector.throws_of_dataset import faulty, throws_of_dataset, unmarked
from turnout.measurement.campaign.build_campaign import (
    CHANNEL_FILE,
    BuiltCampaign,
    build_campaign_dataset,
)
from turnout.measurement.chain.apply import apply_chain, load_channel_map
from turnout.measurement.formats.file_format import read_recording

Floats = NDArray[np.float64]


def read_throws(
    path: Path | str, *, channels: Path | str | None = None, quantity: str = FORCE
) -> list[Recorded]:
    """Return the throws of a campaign folder, a dataset (.nc), a table (.csv), or a recording.

    Parameters
    ----------
    path : path-like
        What was recorded.
    channels : path-like, optional
        Channel map of a recording; without one, a .csv is a table with a row a throw.
    quantity : str
        What of the drives is judged: "force", "current" or "power" (`Detector.quantity`).

    Raises
    ------
    FileError, MeasurementError
        When it cannot be read.
    """
    place = Path(path)
    if not place.exists():
        message = f"{place}: there is no such file or folder"
        raise FileError(message)
    if place.is_dir():
        return _of_folder(place, channels, quantity)
    if channels is not None:
        dataset = apply_chain(read_recording(place), load_channel_map(channels))
        return throws_of_dataset(dataset, name=place.name, quantity=quantity)
    if place.suffix == ".nc":
        from turnout.throw.store import open_response

        return throws_of_dataset(open_response(place), name=place.name, quantity=quantity)
    if place.suffix == ".csv":
        return read_table(place, quantity=quantity)
    message = f"{place}: needs a channel map: --channels MAP.toml"
    raise FileError(message)


def _of_folder(folder: Path, channels: Path | str | None, quantity: str) -> list[Recorded]:
    """Return the closings of a campaign; of forces alone, each recording as a whole."""
    campaign = build_campaign_dataset(folder, channels=channels)
    found = {item.name: item for item in throws_of_campaign(campaign, quantity)}
    chain = load_channel_map(channels if channels is not None else folder / CHANNEL_FILE)
    if chain.drive_current or quantity != FORCE:
        return list(found.values())
    reasons = {item.run.name: item.reasons for item in campaign.excluded}
    throws: list[Recorded] = []
    for file in dict.fromkeys(run.file for run in campaign.sheet.runs):
        runs = [run for run in campaign.sheet.runs if run.file == file and run.direction == CLOSING]
        if not runs:
            continue
        said = [reason for run in runs for reason in reasons.get(run.name, ())]
        if not all(reason.startswith(OF_FINDING) for reason in said):
            throws += [found[run.name] for run in runs]
            continue
        dataset = apply_chain(read_recording(folder / file), chain)
        if any(reason.startswith(DEAD) for reason in said) and _rests(dataset):
            throws += [found[run.name] for run in runs]
            continue
        whole = unmarked(
            dataset,
            name=str(Path(file).with_suffix("")),
            shown=[found[run.name].onsets for run in runs if not found[run.name].fault],
        )
        listed = {run.name: {"size": run.size, "place": run.place} for run in runs}
        throws.append(replace(whole, listed=listed, panel=(campaign.sheet.panel, "")))
    return throws


DEAD = "dead channel"
OF_FINDING = (
    *("movement ", "truncated", "drift", "direction", "reversed polarity", "swapped channels"),
    *("sampling rate: the throw begins", DEAD),
)
"""Reasons to leave a movement out that a wrong cut can make; the match checks these again."""
LEAST_RANGE = 200.0
"""Range of a drive force over a recording below which its channel is dead [N]."""


def _rests(dataset: xr.Dataset) -> bool:
    """Return True if some drive force hardly changes over a whole recording."""
    low, high = np.nanquantile(dataset["drive_force"].transpose("drive", "time"), [0.01, 0.99], 1)
    return bool(np.any(high - low < LEAST_RANGE))


def throws_of_campaign(campaign: BuiltCampaign, quantity: str = FORCE) -> list[Recorded]:
    """Return the closing movements of a campaign, and what is not usable with its reasons."""
    found = []
    if campaign.dataset is not None:
        found = throws_of_dataset(campaign.dataset, quantity=quantity)
    for item in campaign.excluded:
        if item.run.direction == CLOSING:
            found.append(faulty(item.run.name, "; ".join(item.reasons)))
    return found
