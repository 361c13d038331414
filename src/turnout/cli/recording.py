"""The command `turnout import`: list the channels of a recording, or convert them."""

import math
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turnout.cli.options import (
    DATASET,
    FIGURE,
    File,
    argument,
    gives,
    option,
)
from turnout.cli.output import Output, refuse

if TYPE_CHECKING:
    import xarray as xr

    from turnout.measurement.chain.apply import MappedChannel
    from turnout.measurement.chain.channel_map import ChannelMap
    from turnout.measurement.recording import Recording

SPARK_WIDTH = 32
# From low to high; the second where the screen cannot show the first.
LEVELS, PLAIN_LEVELS = "▁▂▃▄▅▆▇█", "_.-:=+*#"
COLUMN = 24


@gives(
    "import",
    out=DATASET,
    plot=FIGURE,
    map=File("--map FILE.toml", "Write the suggested map to a file."),
)
def import_command(
    output: Output,
    file: Path = argument(
        "FILE",
        "Recording: text, workbook, JSON, Dewesoft, MATLAB, HDF5, MDF, TDMS, Parquet, LabVIEW, "
        "COMTRADE or UFF.",
    ),
    channels: str | None = option(
        "--channels MAP",
        "Channel map (.toml), or one of the library: two-rods. Without it the file is listed "
        "and a map to edit is suggested.",
    ),
    smooth: str | None = option(
        "--smooth TIME",
        "Centred moving average, such as 0.1s; unfiltered channels are kept as well.",
    ),
    throw: str | None = option("--throw NUMBER", "Which throw of several in one table."),
    allow_outside: bool = option("--allow-outside", "Also read other files that FILE refers to."),
) -> None:
    """Read a measurement: list and preview it, or turn it into forces and currents."""
    window = _checked(channels, output, smooth=smooth)
    from turnout.measurement.campaign.campaign_folder import refuse_to_write_outside
    from turnout.measurement.chain.apply import load_channel_map
    from turnout.measurement.formats.file_format import read_recording, recognise_format

    for target in filter(None, map(output.__getitem__, ("out", "plot", "map"))):
        refuse_to_write_outside(target, file.parent)
    channel_map = load_channel_map(channels) if channels is not None else None
    kind = recognise_format(file).name
    recording = read_recording(file, allow_outside=allow_outside, throw=throw)
    if channel_map is None:
        _list(recording, kind, output)
    else:
        _convert(recording, channel_map, window, output)


def _checked(channels: str | None, output: Output, *, smooth: str | None) -> float | None:
    """Refuse conflicting options, all at once; return the filter window [s]."""
    from turnout.core.units import TIME, parse_quantity

    problems = []
    if channels is None:
        given = {"--out": output["out"], "--smooth": smooth}
        problems += [
            f"{option}: needs --channels MAP, which assigns the columns"
            for option, value in given.items()
            if value is not None
        ]
    elif output["map"] is not None:
        problems.append("--map: there is a channel map already; leave out --channels")
    window = None
    if smooth is not None:
        try:
            window = parse_quantity(smooth, TIME)
            if window <= 0:
                problems.append(f"--smooth {smooth}: must be more than 0")
        except ValueError as error:
            problems.append(f"--smooth {smooth}: {error}")
    if problems:
        refuse("\n".join(problems))
    return window


def _list(recording: "Recording", kind: str, output: Output) -> None:
    from turnout.figures.recording import Trace, plot_columns
    from turnout.measurement.chain.skeleton import skeleton

    output.lines(channel_lines(recording, kind))
    traces = [Trace(c.name, c.unit, c.time, c.values) for c in recording.channels.values()]
    output.figure(output["plot"], plot_columns, traces, title=Path(recording.source).name)
    output.write(output["map"], lambda: skeleton(recording))
    output.json(recording_record, recording, kind, units=CHANNEL_UNITS)
    if made := output["map"]:
        output.show(f"next: edit it, then: turnout import FILE --channels {made} --out FILE.nc")
    else:
        output.show("\nA channel map to start from (--map FILE.toml writes it):\n")
        output.show(_plain(skeleton(recording)))


def channel_lines(recording: "Recording", kind: str) -> Iterator[str]:
    """Yield a row for each channel with its course, then the parts that could not be read."""
    from turnout.measurement.recording import overview

    started = f", started {recording.start_time}" if recording.start_time else ""
    yield _plain(f"{recording.source}: {kind}{started}")
    levels = LEVELS if _can_show(LEVELS) else PLAIN_LEVELS
    yield (
        f"{'channel':<{COLUMN}} {'unit':<6} {'rate 1/s':>9} {'start s':>8} {'length s':>9} "
        f"{'missing':>8} {'least':>10} {'mean':>10} {'largest':>10}  course"
    )
    for channel in recording.channels.values():
        row = overview(channel, steps=SPARK_WIDTH)
        course = "".join(
            " " if math.isnan(part) else levels[round(part * (len(levels) - 1))]
            for part in row.course
        )
        yield _plain(
            f"{row.name:<{COLUMN}} {row.unit or '-':<6} {row.rate:>9.6g} {row.start:>8.4g} "
            f"{row.duration:>9.6g} {row.missing:>8} {row.least:>10.4g} {row.mean:>10.4g} "
            f"{row.largest:>10.4g}  {course}"
        )
    yield from _problems(recording.problems)


def _convert(
    recording: "Recording", channel_map: "ChannelMap", window: float | None, output: Output
) -> None:
    from turnout.figures.recording import plot_measured
    from turnout.measurement.chain.apply import apply_chain, mapped_channels
    from turnout.measurement.chain.condition import condition

    dataset = apply_chain(recording, channel_map)
    if window is not None:
        dataset = condition(dataset, window=window)
    output.lines(mapped_summary(dataset, channel_map))
    output.dataset(output["out"], dataset)
    output.figure(output["plot"], plot_measured, dataset, title=Path(recording.source).name)
    rows = mapped_channels(dataset, channel_map)
    output.json(quantity_record, dataset, rows, units={**CHANNEL_UNITS, "end": "s"})


def mapped_summary(dataset: "xr.Dataset", channel_map: "ChannelMap") -> Iterator[str]:
    """Yield a row for each quantity with its sensor, then the repairs made."""
    from turnout.measurement.chain.apply import mapped_channels

    rate = 1.0 / float(dataset["time"][1] - dataset["time"][0])
    first, last = float(dataset["time"][0]), float(dataset["time"][-1])
    yield _plain(f"{dataset.attrs['source']}: {first:g} to {last:g} s at {rate:.6g} Hz")
    yield f"{'quantity':<18} {'column':<{COLUMN}} {'least':>10} {'largest':>10}      sensor"
    for row in mapped_channels(dataset, channel_map):
        yield _plain(
            f"{row.key:<18} {row.column:<{COLUMN}} {row.least:>10.4g} {row.largest:>10.4g} "
            f"{row.unit:<4} {row.sensor}"
        )
    if "filter" in dataset.attrs:
        yield f"filter: {dataset.attrs['filter']}; unfiltered channels are kept"
    yield from _problems(tuple(filter(None, str(dataset.attrs["problems"]).split("\n"))))


def _problems(problems: tuple[str, ...]) -> Iterator[str]:
    if problems:
        yield "notes:"
        for problem in problems:
            yield _plain(f"  - {problem}")


def _can_show(text: str) -> bool:
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def _plain(text: str) -> str:
    """Return text that the screen can show: names in files may hold anything."""
    encoding = sys.stdout.encoding or "ascii"
    shown = "".join(char if char.isprintable() or char == "\n" else "?" for char in text)
    return shown.encode(encoding, "replace").decode(encoding)


CHANNEL_UNITS = {"rate": "1/s", "start": "s", "duration": "s"}

SI_UNIT, SI_SIZE = {"kN": "N", "A": "A"}, {"kN": 1e3, "A": 1.0}


def recording_record(recording: "Recording", kind: str) -> dict[str, Any]:
    """Return the channels of a recording."""
    from turnout.measurement.recording import overview

    return {
        "source": recording.source,
        "format": kind,
        "start_time": recording.start_time,
        "channels": [overview(item, steps=SPARK_WIDTH) for item in recording.channels.values()],
        "problems": recording.problems,
    }


def quantity_record(dataset: "xr.Dataset", rows: "Iterable[MappedChannel]") -> dict[str, Any]:
    """Return the quantities of a recording, each with its unit."""
    return {
        "source": dataset.attrs["source"],
        "start": float(dataset["time"][0]),
        "end": float(dataset["time"][-1]),
        "rate": 1.0 / float(dataset["time"][1] - dataset["time"][0]),
        "quantities": [
            {
                **asdict(row),
                "least": SI_SIZE[row.unit] * row.least,
                "largest": SI_SIZE[row.unit] * row.largest,
                "unit": SI_UNIT[row.unit],
            }
            for row in rows
        ],
        "problems": [text for text in str(dataset.attrs["problems"]).split("\n") if text],
    }
