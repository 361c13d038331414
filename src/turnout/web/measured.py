"""Measured movements to lay over a throw: from a campaign, or from a recording just sent."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.core.errors import FileError
from turnout.core.library import names_a_file
from turnout.core.moving_average import WINDOW
from turnout.core.toml import parse_toml
from turnout.figures.sheet import Line, Row
from turnout.measurement.campaign.build_campaign import CHANNEL_FILE, BuiltCampaign
from turnout.measurement.campaign.find_throws import find_throws
from turnout.measurement.chain.apply import (
    apply_chain,
    load_channel_map,
    mapped_channels,
    parse_channel_map,
)
from turnout.measurement.chain.channel_map import ChannelMap, drives_together
from turnout.measurement.chain.condition import condition
from turnout.measurement.formats.file_format import read_recording, recognise_format
from turnout.measurement.formats.history import READ, read_history
from turnout.measurement.recording import Recording, overview
from turnout.metric.channel_features import filtered
from turnout.throw.slip import movements

DRAWN = (
    *("drive_force", "object_force", "drive_displacement", "drive_gap"),
    *("drive_current", "drive_power"),
)
WHOLE = "whole"
# Differences between measurement and model: channel, its row, what its lines are called.
DIFFERENCES = {"drive_force": "Drive force", "object_force": "Object force"}
KILO = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A measured movement.

    Attributes
    ----------
    title : str
        For lists and legends.
    direction : str
        "closing", "opening" or "unknown"; "whole" for the history of a throw on its own time.
    size : float
        Of the trapped object [m]; NaN where that is not known, 0 without one.
    place : str
        Place of the object; empty if unknown.
    dataset : xarray.Dataset
        Filtered channels; time is zero at the onset. Those of a history as they are.
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
    turnout.core.errors.FileError: ../secret.csv: lies outside the folder of the campaign; ...
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
    if names_a_file(text):
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
        Path on the server, with the plain name that the page gave it.

    Raises
    ------
    FileError
        With the message of `turnout import`, which names the file as the user does.
    """
    try:
        return read_recording(path), recognise_format(path).name
    except FileError as error:
        # The option that would permit other files is of the command line only.
        text = str(error).partition(", or permit it by ")[0]
        raise FileError(text.replace(str(path), path.name)) from None


def plain_name(name: str, otherwise: str) -> str:
    """Return a name without folders, short enough for a file and fit for the screen."""
    last = name.replace("\\", "/").rpartition("/")[2]
    kept = "".join(char for char in last if char.isprintable())
    return kept[-80:].strip(". ") or otherwise


def recording_lines(recording: Recording, kind: str) -> list[str]:
    """Return the content of a recording: a line per channel, then what could not be read."""
    rows = [overview(channel) for channel in recording.channels.values()]
    lines = [f"{Path(recording.source).name}: {kind}, {len(rows)} channels"]
    lines += [
        f"{row.name} [{row.unit or '-'}]: {row.duration:.6g} s at {row.rate:.6g} 1/s, "
        f"{row.least:.4g} to {row.largest:.4g}, {row.missing} missing"
        for row in rows
    ]
    return [*lines, *recording.problems]


def recorded_movements(
    recording: Recording, channel_map: ChannelMap
) -> tuple[list[Measured], list[str]]:
    """Return the movements of a recording, and lines about the conversion."""
    dataset = apply_chain(recording, channel_map)
    lines = [
        f"{row.key}: column {row.column}, {row.least:.4g} to {row.largest:.4g} {row.unit}, "
        f"{row.sensor}"
        for row in mapped_channels(dataset, channel_map)
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

    Drives are those of the run and currents of several together; if the run has no such movement,
    its first one is used.
    """
    if measured.direction == WHOLE:
        return measured.dataset.assign_attrs(title=measured.title)
    spans = movements(run)
    to = "open" if measured.direction == "opening" else "closed"
    going = [span.start for span in spans if span.to == to] or [span.start for span in spans[:1]]
    moved = measured.dataset.assign_coords(
        time=measured.dataset["time"].values + (going[-1] if going else 0.0)
    )
    if "drive" in moved.coords:
        several = [str(name) for name in moved["drive"].values if drives_together(str(name))]
        moved = moved.reindex(drive=[*map(str, run["drive"].values), *several])
    return moved.assign_attrs(title=measured.title)


def history_movement(path: Path) -> Measured:
    """Return the history of a throw, as `history_text` writes it, on its own time."""
    try:
        dataset = read_history(path)
    except FileError as error:
        raise FileError(str(error).replace(str(path), path.name)) from None
    return Measured(path.name, WHOLE, float("nan"), "", _drawn(dataset, READ))


def differences(measured: Measured, run: xr.Dataset) -> list[Row]:
    """Return measurement less computation, at the instants of the measurement.

    Parameters
    ----------
    measured : Measured
        The movement.
    run : xarray.Dataset
        The throw; filtered as the measurement is, but not for a history.

    Returns
    -------
    list of Row
        A row for each force that both have, in kN, with the root mean square in the legend.
    """
    moved = shifted(measured, run)
    time = moved["time"].values
    rows = []
    for channel, title in DIFFERENCES.items():
        if channel not in moved or channel not in run:
            continue
        model = run[channel]
        if measured.direction != WHOLE:
            model = filtered(model, window=WINDOW)
        members = model["drive"].values if "drive" in model.dims else [None]
        lines = []
        for number, member in enumerate(members):
            one, other = (
                c if member is None else c.sel(drive=member) for c in (moved[channel], model)
            )
            computed = np.interp(time, run["time"].values, other.values, left=np.nan, right=np.nan)
            values = (one.values - computed) / KILO
            if not np.isfinite(values).any():
                continue
            name = "Object" if member is None else f"Drive {member}"
            rms = float(np.sqrt(np.nanmean(values**2)))
            lines.append(
                Line(
                    label=f"{name}, rms {rms:.2f} kN", x=time, y=values, colour=number, dash=number
                )
            )
        if lines:
            rows.append(Row(f"{title},\nmeasured − computed [kN]", tuple(lines)))
    return rows


def _drawn(dataset: xr.Dataset, wanted: Iterable[str] = DRAWN) -> xr.Dataset:
    """Keep the channels that are drawn and hold a number, and the time in which any does."""
    names = [n for n in wanted if n in dataset and bool(np.isfinite(dataset[n].values).any())]
    kept = dataset[names].reset_coords(drop=True)
    there = np.zeros(kept.sizes["time"], dtype=bool)
    for name in names:
        values = np.isfinite(kept[name].values)
        there |= values.any(axis=0) if values.ndim > 1 else values
    kept = kept.isel(time=np.flatnonzero(there)).load()
    kept.attrs = {"kind": "measurement"}
    return kept
