"""Measured movements to lay over a throw: from a campaign, or from a recording just sent."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.core.toml import parse_toml
from turnout.errors import FileError
from turnout.measurement.campaign.build_campaign import CHANNEL_FILE, BuiltCampaign
from turnout.measurement.campaign.find_throws import find_throws
from turnout.measurement.chain.apply import (
    apply_chain,
    channel_rows,
    load_channel_map,
    parse_channel_map,
)
from turnout.measurement.chain.channel_map import ChannelMap
from turnout.measurement.chain.condition import condition
from turnout.measurement.chain.skeleton import skeleton
from turnout.measurement.formats.file_format import format_of, read_recording
from turnout.measurement.recording import Recording, overview
from turnout.metric.slip import movements

WINDOW = 0.1
DRAWN = ("drive_force", "object_force", "drive_displacement", "drive_gap")


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A measured movement.

    Attributes
    ----------
    title : str
        For lists and legends.
    direction : str
        "closing", "opening" or "unknown".
    size : float
        Of the trapped object [m]; NaN where that is not known, 0 without one.
    place : str
        Where it is; empty where that is not known.
    dataset : xarray.Dataset
        Filtered channels; time is zero at the onset.
    """

    title: str
    direction: str
    size: float
    place: str
    dataset: xr.Dataset


def campaign_movements(campaign: BuiltCampaign) -> Iterator[Measured]:
    """Yield the usable movements of a campaign."""
    dataset = campaign.dataset
    if dataset is None:
        return
    for number, name in enumerate(dataset["movement"].values):
        one = dataset.isel(movement=number)
        trapped = float(one["size"]) > 0
        what = f"{1e3 * float(one['size']):g} mm at {one['place'].values}"
        yield Measured(
            title=f"{name}: {one['direction'].values}, {what if trapped else 'no object'}",
            direction=str(one["direction"].values),
            size=float(one["size"]),
            place=str(one["place"].values) if trapped else "",
            dataset=_drawn(one),
        )


def campaign_file(folder: Path, name: str) -> Path:
    """Return a recording inside the folder of a campaign.

    Raises
    ------
    FileError
        When the name leads out of the folder, or there is no such file.

    Examples
    --------
    >>> campaign_file(Path("autumn"), "../secret.csv")
    Traceback (most recent call last):
    turnout.errors.FileError: ../secret.csv: lies outside the folder of the campaign; ...
    """
    root = folder.resolve()
    with suppress(OSError, ValueError):
        path = (root / name).resolve()
        if not path.is_relative_to(root):
            message = f"{name}: lies outside the folder of the campaign; name a file inside it"
            raise FileError(message)
        if path.is_file():
            return path
    message = f"{name}: there is no such file in the folder of the campaign"
    raise FileError(message)


def channel_map_of(text: str, folder: Path | None) -> ChannelMap:
    """Return the channel map that the page names: "campaign", one of the library, or its text.

    Raises
    ------
    FileError
        When it is none of these; the name of a file, too, as that would be one of this machine.
    """
    if text == "campaign" and folder is not None:
        return load_channel_map(folder / CHANNEL_FILE)
    if "\n" in text or "=" in text:
        return parse_channel_map(parse_toml(text, source="channel map"))
    if text.endswith(".toml") or "/" in text or "\\" in text:
        message = (
            f"channel map '{text[:80]}': the page takes no files of this machine; send the map's "
            "text, or name one of the library"
        )
        raise FileError(message)
    return load_channel_map(text)


def sent_recording(path: Path) -> tuple[Recording, str]:
    """Read a recording that the page sent; return it with the name of its format.

    Parameters
    ----------
    path : Path
        Where the server put it, under the plain name that the page gave it.

    Raises
    ------
    FileError
        With the message of `turnout import`, which names the file as the user does.
    """
    try:
        return read_recording(path), format_of(path).name
    except FileError as error:
        # The option that would permit other files is of the command line only.
        text = str(error).partition(", or permit it by ")[0]
        raise FileError(text.replace(str(path), path.name)) from None


def plain_name(name: str, otherwise: str) -> str:
    """Return a name without folders, short enough for a file and fit for the screen."""
    last = name.replace("\\", "/").rpartition("/")[2]
    kept = "".join(char for char in last if char.isprintable())
    return kept[-80:].strip(". ") or otherwise


def listing(recording: Recording, kind: str) -> list[str]:
    """Return what is in a recording, a line a channel, and a channel map to start from."""
    rows = [overview(channel) for channel in recording.channels.values()]
    lines = [f"{Path(recording.source).name}: {kind}, {len(rows)} channels"]
    lines += [
        f"{row.name} [{row.unit or '-'}]: {row.duration:.6g} s at {row.rate:.6g} 1/s, "
        f"{row.least:.4g} to {row.largest:.4g}, {row.missing} missing"
        for row in rows
    ]
    return [*lines, *recording.problems, "", *skeleton(recording).splitlines()]


def recorded_movements(
    recording: Recording, channel_map: ChannelMap
) -> tuple[list[Measured], list[str]]:
    """Return the movements of a recording, and lines about the conversion."""
    dataset = apply_chain(recording, channel_map)
    lines = [
        f"{row.key}: column {row.column}, {row.least:.4g} to {row.largest:.4g} {row.unit}, "
        f"{row.sensor}"
        for row in channel_rows(dataset, channel_map)
    ]
    lines += [line for line in str(dataset.attrs["problems"]).split("\n") if line]
    smooth = _drawn(condition(dataset, window=WINDOW))
    title = Path(recording.source).name
    found = []
    for throw in find_throws(dataset):
        part = smooth.isel(time=slice(throw.first, throw.stop))
        part = part.assign_coords(time=part["time"].values - throw.onset)
        name = f"{title}: {throw.direction} at {throw.onset:.2f} s"
        found.append(Measured(name, throw.direction, float("nan"), "", part))
    if not found:
        lines.append("no movement was found in it")
    return found, lines


def shifted(measured: Measured, run: xr.Dataset) -> xr.Dataset:
    """Return a measured movement on the time of a run: onsets of the same direction meet.

    Drives are those of the run; if the run has no such movement, its first one is used.
    """
    spans = movements(run)
    to = "open" if measured.direction == "opening" else "closed"
    going = [span.start for span in spans if span.to == to] or [span.start for span in spans[:1]]
    moved = measured.dataset.assign_coords(
        time=measured.dataset["time"].values + (going[-1] if going else 0.0)
    )
    if "drive" in moved.coords:
        known = run["drive"].values
        moved = moved.reindex(drive=known)
    return moved.assign_attrs(title=measured.title)


def _drawn(dataset: xr.Dataset) -> xr.Dataset:
    """Keep the channels that are drawn and hold a number, and the time in which any does."""
    names = [n for n in DRAWN if n in dataset and bool(np.isfinite(dataset[n].values).any())]
    kept = dataset[names].reset_coords(drop=True)
    there = np.zeros(kept.sizes["time"], dtype=bool)
    for name in names:
        values = np.isfinite(kept[name].values)
        there |= values.any(axis=0) if values.ndim > 1 else values
    kept = kept.isel(time=np.flatnonzero(there)).load()
    kept.attrs = {"kind": "measurement"}
    return kept
