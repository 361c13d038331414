"""From the columns of a file to the channels of a recording: names, units, times, all problems."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.problems import choices
from turnout.measurement.formats.extent import MOST_CHANNELS
from turnout.measurement.recording import RecordedChannel, Recording, TimeGrid, on_grid, time_grid

# Taken for a unit in round brackets; square brackets always hold one.
_ELECTRIC = ("V", "mV", "µV", "uV", "V/V", "mV/V", "µV/V", "uV/V", "A", "mA", "Ohm", "Ω", "W", "kW")
_MECHANIC = (
    "N",
    "kN",
    "MN",
    "Nm",
    "kNm",
    "bar",
    "Pa",
    "kPa",
    "MPa",
    "GPa",
    "J",
    "g",
    "kg",
    "N/mm2",
)
_STRAIN = ("um/m", "µm/m", "μm/m", "ue", "µe", "με", "µε", "m/m", "mm/m")
_MOTION = (
    "m",
    "mm",
    "cm",
    "um",
    "µm",
    "m/s",
    "m/s2",
    "m/s^2",
    "m/s²",
    "km/h",
    "kph",
    "rpm",
    "1/min",
)
_OTHER = ("s", "ms", "us", "µs", "min", "h", "Hz", "kHz", "°C", "degC", "K", "deg", "°", "rad", "%")
UNIT_TEXTS = frozenset((*_ELECTRIC, *_MECHANIC, *_STRAIN, *_MOTION, *_OTHER, "-", "1"))
SECONDS = {
    "": 1.0,
    "s": 1.0,
    "sec": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "min": 60.0,
    "h": 3600.0,
}
_NAME_AND_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*\Z", re.DOTALL)
_TIME_NAME = re.compile(
    r"(data\d+_)?(relative |elapsed )?(time|zeit|tid|temps|tiempo|t)(_s)?", re.I
)
RATE_NAME = re.compile(
    r"(data\d+_)?(sample|sampling|scan)?[ _]?(rate|frequency|freq)|(data\d+_)?fs|abtastrate", re.I
)


@dataclass(frozen=True, slots=True, eq=False)
class FileColumn:
    """Samples as a file holds them, before their times are understood.

    Attributes
    ----------
    name, unit, description : str
        What the file says.
    values : ndarray, shape (n,)
        Samples in `unit`; NaN where one is missing.
    time : ndarray or None, shape (n,)
        Time of each sample [s], where the file gives it.
    rate : float or None
        Samples a second [1/s], where it gives that instead.
    start : float
        Time of the first sample where it gives the rate [s].
    """

    name: str
    values: NDArray[np.float64]
    unit: str = ""
    description: str = ""
    time: NDArray[np.float64] | None = None
    rate: float | None = None
    start: float = 0.0


def split_unit(text: str) -> tuple[str, str]:
    """Split a heading such as "Rod 1 (mV/V)" into name and unit.

    Examples
    --------
    >>> split_unit("Rod 1 (mV/V)"), split_unit("force (left)"), split_unit("AI 3 [-]")
    (('Rod 1', 'mV/V'), ('force (left)', ''), ('AI 3', ''))
    """
    text = text.strip()
    match = _NAME_AND_UNIT.fullmatch(text)
    if match is None or not match[1]:
        return text, ""
    unit = (match[2] if match[2] is not None else match[3]).strip()
    if match[2] is None and unit and unit not in UNIT_TEXTS:
        return text, ""
    return match[1], tidy_unit(unit)


def tidy_unit(unit: str) -> str:
    """Return a unit as `turnout` writes it; "-" is none.

    Examples
    --------
    >>> tidy_unit("µm/m"), tidy_unit(" [mV/V] "), tidy_unit("-")
    ('um/m', 'mV/V', '')
    """
    text = unit.strip().strip("[]()").strip().replace("µ", "u").replace("μ", "u")
    return {"-": "", "ue": "um/m", "uε": "um/m", "uStrain": "um/m"}.get(text, text)


def is_time_name(name: str) -> bool:
    """Return True if a column of this name holds the time.

    Examples
    --------
    >>> is_time_name("Time (s)"), is_time_name("t"), is_time_name("Throw time")
    (True, True, False)
    """
    return _TIME_NAME.fullmatch(split_unit(name)[0].strip()) is not None


def seconds_of(unit: str) -> float:
    """Return the seconds in the unit of a time column; ValueError when it is none."""
    factor = SECONDS.get(tidy_unit(unit))
    if factor is None:
        message = f"'{unit}' is no unit of time; needs one of {', '.join(filter(None, SECONDS))}"
        raise ValueError(message)
    return factor


def assemble_recording(
    columns: Sequence[FileColumn],
    *,
    source: str,
    start_time: str | None = None,
    problems: Sequence[str] = (),
    remedy: str = "",
) -> Recording:
    """Make a recording of columns; those without a usable time become problems.

    Parameters
    ----------
    columns : sequence of FileColumn
        In the order of the file.
    source : str
        The file, for messages.
    start_time : str, optional
        Date and time of the start.
    problems : sequence of str
        What was found before.
    remedy : str
        What to do where the time is unknown.

    Raises
    ------
    FileError
        When not one channel is left; the text says why for each.
    """
    channels: dict[str, RecordedChannel] = {}
    mended, left_out = dict[str, list[str]](), dict[str, list[str]]()
    grids: dict[int, TimeGrid | ValueError] = {}
    if len(columns) > MOST_CHANNELS:
        message = f"{source}: holds {len(columns)} channels, at most {MOST_CHANNELS} are read"
        raise FileError(message + "; export fewer")
    taken: dict[str, int] = {}
    for column in columns:
        name = _free(column.name.strip() or f"channel {len(channels) + 1}", channels, taken)
        try:
            channel, problem = _evened(column, name, grids, remedy)
        except ValueError as error:
            left_out.setdefault(str(error), []).append(name)
            continue
        channels[name] = channel
        if problem:
            mended.setdefault(problem, []).append(name)
    found = [
        *problems,
        *(f"{_named(names)}: {problem}" for problem, names in mended.items()),
        *(_left_out(reason, names) for reason, names in left_out.items()),
    ]
    if not channels:
        reasons = "; ".join(found) or "there are no numbers in it"
        message = f"{source}: no channel can be read: {reasons}"
        raise FileError(message)
    return Recording(channels, source, start_time, tuple(found))


def _evened(
    column: FileColumn, name: str, grids: dict[int, TimeGrid | ValueError], remedy: str
) -> tuple[RecordedChannel, str]:
    values = np.ascontiguousarray(column.values, dtype=np.float64)
    if not values.size:
        message = "it is empty: no sample was recorded"
        raise ValueError(message)
    if column.time is None:
        if column.rate is None or not (np.isfinite(column.rate) and column.rate > 0):
            message = f"neither times nor a sample rate are known{remedy and '; ' + remedy}"
            raise ValueError(message)
        if not np.isfinite(column.start):
            message = "the time of its first sample is no number"
            raise ValueError(message)
        channel = RecordedChannel(
            name, column.unit, values, column.rate, column.start, column.description
        )
        return channel, ""
    if column.time.size != values.size:
        message = f"has {values.size} samples and {column.time.size} times"
        raise ValueError(message)
    # Channels share a time column: its grid is found once.
    key = id(column.time)
    if key not in grids:
        try:
            grids[key] = time_grid(column.time)
        except ValueError as error:
            grids[key] = error
    grid = grids[key]
    if isinstance(grid, ValueError):
        raise grid
    return on_grid(grid, name, values, unit=column.unit, description=column.description)


def _left_out(reason: str, names: Sequence[str]) -> str:
    return f"{_named(names)} {'is' if len(names) == 1 else 'are'} left out: {reason}"


def _named(names: Sequence[str]) -> str:
    return f"channel{'s' if len(names) > 1 else ''} {choices(names)}"


def _free(name: str, channels: dict[str, RecordedChannel], taken: dict[str, int]) -> str:
    """Return a name that no channel has yet; `taken` is the last number of each name."""
    free, number = name, taken.get(name, 1)
    while free in channels:
        number += 1
        free = f"{name} ({number})"
    taken[name] = number
    return free
