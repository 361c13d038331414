"""From the columns of a file to the channels of a recording: names, units, times, all problems."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.problems import choices, count_in_words
from turnout.measurement.formats.clock import DAY, StatedClock, is_time_name, is_time_unit
from turnout.measurement.formats.extent import MOST_CHANNELS
from turnout.measurement.formats.time_axis import TimeAxis, iso_time, rate_remark
from turnout.measurement.recording import RecordedChannel, Recording, TimeGrid, on_grid, time_grid

# Taken for a unit in round brackets, in a row of units, or behind a name; square brackets always
# hold one.
_UNITS = """
V mV kV µV uV V/V mV/V µV/V uV/V A mA kA Ohm Ω W kW MW mW VA kVA var F H Hz kHz MHz dB
N kN MN daN Nm kNm mNm Ncm N·m N*m kN·m mNm/A Nm/A gcm2 gcm²
bar mbar Pa hPa kPa MPa GPa J kJ Wh kWh g kg t
N/mm2 N/mm² N/m kN/m um/m µm/m μm/m ue µe με µε m/m mm/m µStrain uStrain m mm cm um µm km
m/s mm/s m/s2 m/s^2 m/s² km/h kph rpm 1/min U/min s ms us µs ns min h d °C degC °F K deg
° rad rad/s °/s mrad % ‰ - 1 l/min 1/s S/s kS/s MS/s Sa/s kSa/s
"""
UNIT_TEXTS = frozenset(_UNITS.split())
UNIT_WORDS = {
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("amp", "amps", "ampere", "amperes"), "A"),
    **dict.fromkeys(("watt", "watts"), "W"),
    **dict.fromkeys(("newton", "newtons"), "N"),
    "n m": "Nm",
    **dict.fromkeys(("second", "seconds", "sec", "sekunden"), "s"),
    **dict.fromkeys(("millisecond", "milliseconds", "millisekunden", "msec"), "ms"),
    **dict.fromkeys(("celsius", "deg c", "°c", "gradc"), "°C"),
    **dict.fromkeys(("none", "unknown", "n/a", "dimensionless"), ""),
}
# Instruments write 9.9E37 for an overload and 9.91E37 for a value that is none [SCPI], others the
# largest number there is: no quantity of a switch is so large.
_OVERLOAD = 9.89e37
_STAND_INS = (-9999.0, -99999.0, -999.25, -7999.0, 99999.0, -32768.0, 32767.0, 65535.0)
_LARGEST_RATE, _LEAST_RATE, _LATEST_START, _LARGEST_RATIO = 1e7, 0.1, 1e6, 1e4
_BEHIND = re.compile(r"(.*?\S)(\s/\s|\s+in\s+|,\s*|\s+)(\S+)")
# "Time in 1/10 ms", "Time (10 ms)"
_MULTIPLE = re.compile(r"(.*?\S)\s*(?:\((\d[^()]*)\)|(?:,|\s)\s*(?:in\s+)?(\d\S*\s?[^\W\d]+))")
# Name and unit without a blank: as a quotient, or as the end of a name in a program.
_QUOTIENT = re.compile(r"([^/]*[^\s/])/(\S+)")
_ENDING = re.compile(r".*[^\W_]_(?:([^\W_]{2,})|(N|A|V|W))")
# A single letter may be a phase (I_A) or the neutral (U_N) unless the name says the quantity.
_QUANTITY_OF = {
    "N": re.compile(r"f\d*_.*|.*(?:force|kraft|rod|stange).*", re.IGNORECASE),
    "A": re.compile(r".*(?:current|strom|ström).*", re.IGNORECASE),
    "V": re.compile(r".*(?:voltage|spannung|spänning).*", re.IGNORECASE),
    "W": re.compile(r".*(?:power|leistung|effekt).*", re.IGNORECASE),
}
_NO_UNIT_BEHIND = frozenset(("-", "1", "%", "min", "deg", "rad"))
_NAME_AND_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|[({<]([^(){}<>]*)[)}>])\s*\Z", re.DOTALL)


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
    begin : float or None
        Moment from which `time` or `start` count [s]; channels may have begun at different ones.
    remark : str
        What was made of its times.
    """

    name: str
    values: NDArray[np.float64]
    unit: str = ""
    description: str = ""
    time: NDArray[np.float64] | None = None
    rate: float | None = None
    start: float = 0.0
    begin: float | None = None
    remark: str = ""


def column_clock(axis: TimeAxis | None, stated: StatedClock, *, number: int = 0) -> dict[str, Any]:
    """Return the clock of a column, in the terms of `FileColumn`.

    Parameters
    ----------
    axis : TimeAxis or None
        Its times, where the file gives them; a stated rate is compared with them.
    stated : StatedClock
        Stated for it.
    number : int
        Number of the column, of which each may have its own rate.
    """
    if axis is not None:
        rates = stated.rate()
        remark = rate_remark(axis.seconds, rates[0]) if rates else ""
        return {"time": axis.seconds, "begin": axis.begin, "remark": remark or axis.remark}
    rates = stated.rate_of_rows()
    rate = None if rates is None else rates[number if len(rates) > 1 else 0]
    return {"rate": rate, "start": stated.start or 0.0}


def named_unit(heading: str, stated: str = "") -> tuple[str, str]:
    """Return name and unit of a column; a unit that is stated beside its heading goes first."""
    name, unit = split_unit(heading)
    return name, tidy_unit(stated) or unit


def split_unit(text: str) -> tuple[str, str]:
    """Split a heading such as "Rod 1 (mV/V)" into name and unit.

    Examples
    --------
    >>> split_unit("Rod 1 (mV/V)"), split_unit("force (left)"), split_unit("AI 3 [-]")
    (('Rod 1', 'mV/V'), ('force (left)', ''), ('AI 3', ''))
    >>> split_unit("t / ms"), split_unit("I in A"), split_unit("Rod 1")
    (('t', 'ms'), ('I', 'A'), ('Rod 1', ''))
    >>> split_unit("Kraft/N"), split_unit("F_N"), split_unit("I_A"), split_unit("mV/V")
    (('Kraft', 'N'), ('F_N', 'N'), ('I_A', ''), ('mV/V', ''))
    """
    text = text.strip()
    match = _MULTIPLE.fullmatch(text)
    if match and is_time_name(match[1]) and is_time_unit(match[2] or match[3]):
        return match[1], match[2] or match[3]
    match = _NAME_AND_UNIT.fullmatch(text)
    if match is not None and (match[1] or is_time_unit(tidy_unit(text))):
        name, square, unit = match[1], match[2], (match[2] or match[3] or "").strip()
        element = square and square.isdigit() and text.endswith(f"{name}[{square}]")  # "Y[0]"
        stated = square is not None or not unit or is_unit(unit)
        return (name, tidy_unit(unit)) if stated and not element else (text, "")
    match = _QUOTIENT.fullmatch(text)
    if match and not is_unit(text.split()[-1]) and _stands_behind(match[2], match[1]):
        return match[1], tidy_unit(match[2])
    if match := _ENDING.fullmatch(text):
        unit = match[1] or (match[2] if _QUANTITY_OF[match[2]].fullmatch(text) else "")
        if unit in UNIT_TEXTS and _stands_behind(unit):
            return text, tidy_unit(unit)
    if text.startswith("in ") and is_time_unit(text[3:]):
        return "", tidy_unit(text[3:])
    match = _BEHIND.fullmatch(text)
    # "Rod A" is a name, "I in A" and "Force kN" end in a unit.
    name = match[1] if match and match[2].strip() else ""  # "t min" may be a minimum
    if match and _stands_behind(match[3], name) and (match[2].strip() or len(match[3]) > 1):
        return match[1], tidy_unit(match[3])
    return text, ""


def _stands_behind(text: str, name: str = "") -> bool:
    """Return True for a unit that may stand behind a name without brackets."""
    timed = is_time_unit(text) and is_time_name(name)
    return is_unit(text) and (text not in _NO_UNIT_BEHIND or timed)


def is_unit(text: str) -> bool:
    """Return True if a text alone is taken for a unit.

    Examples
    --------
    >>> is_unit("mV/V"), is_unit("Volts"), is_unit("Rod")
    (True, True, False)
    """
    text = text.strip().strip("[]()").strip()
    return text in UNIT_TEXTS or text.lower() in UNIT_WORDS


def tidy_unit(unit: str) -> str:
    """Return a unit as `turnout` writes it; "-" is none.

    Examples
    --------
    >>> tidy_unit("µm/m"), tidy_unit(" [mV/V] "), tidy_unit("-"), tidy_unit("Volts")
    ('um/m', 'mV/V', '', 'V')
    """
    text = unit.strip().strip("[]()").strip().replace("µ", "u").replace("μ", "u")
    text = UNIT_WORDS.get(text.lower(), text)
    return {"-": "", "ue": "um/m", "uε": "um/m", "uStrain": "um/m", "U/min": "1/min"}.get(
        text, text
    )


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
    origin = min((c.begin for c in columns if c.begin is not None), default=0.0)
    for column in columns:
        name = _free(column.name.strip() or f"channel {len(channels) + 1}", channels, taken)
        try:
            channel, remarks = _evened(column, name, grids, remedy, origin)
        except ValueError as error:
            left_out.setdefault(str(error), []).append(name)
            continue
        channels[name] = channel
        for remark in filter(None, remarks):
            mended.setdefault(remark, []).append(name)
    found = [
        *problems,
        *(f"{_named(names)}: {problem}" for problem, names in mended.items()),
        *(
            f"{_named(names)} {'is' if len(names) == 1 else 'are'} left out: {reason}"
            for reason, names in left_out.items()
        ),
        *implausible_times(list(channels.values())),
    ]
    if not channels:
        reasons = "; ".join(found) or "there are no numbers in it"
        message = f"{source}: no channel can be read: {reasons}"
        raise FileError(message)
    return Recording(channels, source, start_time or iso_time(origin), tuple(found))


def implausible_times(channels: Sequence[RecordedChannel]) -> list[str]:
    """Return a note for each kind of time that a recording of a switch is unlikely to have.

    Examples
    --------
    >>> implausible_times([RecordedChannel("a", "V", np.zeros(3), rate=2e7)])
    ["check the time: the rate of channel 'a' is 2e+07 Hz"]
    """
    kinds: dict[str, tuple[str, list[str]]] = {}
    for item in channels:
        length = item.values.size / item.rate
        for kind, wrong, text in (
            ("rate", not _LEAST_RATE <= item.rate <= _LARGEST_RATE, f"{item.rate:.4g} Hz"),
            ("start", abs(item.start) > _LATEST_START, f"{item.start:.6g} s"),
            ("length", length > DAY, f"{length:.6g} s"),
        ):
            if wrong:
                kinds.setdefault(kind, (text, []))[1].append(item.name)
    notes = [
        f"check the time: the {kind} of {_named(names)} is {text}"
        for kind, (text, names) in kinds.items()
    ]
    rates = [item.rate for item in channels]
    if rates and max(rates) > _LARGEST_RATIO * min(rates):
        least, most = (pick(channels, key=attrgetter("rate")) for pick in (min, max))
        notes.append(
            f"check the time: '{most.name}' has {most.rate:.4g} samples per second, "
            f"'{least.name}' {least.rate:.4g}"
        )
    return notes


def _evened(
    column: FileColumn,
    name: str,
    grids: dict[int, TimeGrid | ValueError],
    remedy: str,
    origin: float,
) -> tuple[RecordedChannel, tuple[str, ...]]:
    values, remark = _without_overload(np.ascontiguousarray(column.values, dtype=np.float64))
    if not values.size:
        message = "no sample was recorded"
        raise ValueError(message)
    channel = RecordedChannel(name, column.unit, values, 0.0, column.start, column.description)
    mended = ""
    if column.time is None:
        if column.rate is None or not (np.isfinite(column.rate) and column.rate > 0):
            message = f"neither times nor a sample rate are known{remedy and '; ' + remedy}"
            raise ValueError(message)
        if not np.isfinite(column.start):
            message = "the time of its first sample is no number"
            raise ValueError(message)
        channel = replace(channel, rate=column.rate)
    elif column.time.size != values.size:
        message = f"has {values.size} samples and {column.time.size} times"
        raise ValueError(message)
    else:
        # Channels share a time column: its grid is found once.
        key = id(column.time)
        if key not in grids:
            try:
                grids[key] = time_grid(column.time)
            except ValueError as error:
                grids[key] = error
        if isinstance(grid := grids[key], ValueError):
            raise grid
        channel, mended = on_grid(grid, channel)
    if column.begin is not None:
        channel = replace(channel, start=float(channel.start + (column.begin - origin)))
    return channel, (mended, remark, column.remark)


def _without_overload(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], str]:
    """Return samples with NaN for infinite ones and those that instruments write for none."""
    with np.errstate(invalid="ignore"):
        wrong = np.abs(values) > _OVERLOAD
    count = int(np.count_nonzero(wrong))
    if not count:
        return values, _stand_in(values)
    return np.where(
        wrong, np.nan, values
    ), f"{count_in_words(count, 'sample')} overload, taken as missing"


def _stand_in(values: NDArray[np.float64]) -> str:
    """Return a remark on numbers that loggers write for none, far from all other samples."""
    for number in _STAND_INS:
        if count := int(np.count_nonzero(values == number)):
            others = values[(values != number) & np.isfinite(values)]
            if others.size and 10.0 * np.abs(others).max() < abs(number):
                what = f"{count_in_words(count, 'sample')} {number:g}"
                return f"check the values: {what}, as loggers write for none"
    return ""


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
