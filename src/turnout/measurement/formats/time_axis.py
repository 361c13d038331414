"""Time columns as seconds: numbers with or without a unit, dates, time stamps of any layout.

A column of numbers may hold seconds, other units, Unix time, MATLAB's or Excel's days, or an index
that is no time. Stamps may lack their date, part the second by a point, a comma or a colon, pass
midnight, or come from the hour that summer time repeats. What could be read in two ways is refused.
"""

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from turnout.measurement.formats.clock import DAY, HOUR, seconds_of, unit_in_name

Floats = NDArray[np.float64]

# Unix time of 2000 to 2050 [s]; LabVIEW counts from 1904.
_UNIX = (946_684_800.0, 2_524_608_000.0)
_LABVIEW = 2_082_844_800.0
# Days of MATLAB, Julius Caesar and Excel from 2000 to 2100, and their number of 1970.
_DAYS = ((730_486.0, 767_011.0, 719_529.0), (2_451_544.0, 2_488_070.0, 2_440_587.5),
         (36_526.0, 73_051.0, 25_569.0))  # fmt: skip
# Steps that are days: as seconds they would be above 50 kHz.
_LARGEST_DAY_STEP = 2e-5
# Steps of a time of day in days: as seconds they would be above 500 kHz.
_LARGEST_SHARE_STEP = 2e-6
# A column without a unit that steps less or more, or has many times and is shorter, may not be in
# seconds [s].
_USUAL_STEP, _LEAST_LENGTH, _MANY = (1e-5, 0.2), 0.2, 30
_MONTHS = {
    name: number
    for number, names in enumerate(
        (
            *("jan januar januari january", "feb februar februari february"),
            *("mar mär märz mrz mars march", "apr april", "mai may maj", "jun juni june"),
            *("jul juli july", "aug august augusti", "sep sept september"),
            *("okt oct oktober october", "nov november", "dez dec dezember december"),
        ),
        1,
    )
    for name in names.split()
}
_DATE = re.compile(
    r"(?P<y1>\d{4})(?P<s1>[-/.])(?P<m1>\d{1,2})(?P=s1)(?P<d1>\d{1,2})(?!\d)|"
    r"(?P<a>\d{1,2})(?P<s2>[-/.])(?P<b>\d{1,2})(?P=s2)(?P<y2>\d{4}|\d\d)(?![\d.,]\d|\d)|"
    r"(?P<d3>\d{1,2})[-. ]{1,2}(?P<m3>(?!day)[A-Za-zäÄ]{3,9})[-., ]{1,2}(?P<y3>\d{4}|\d\d)(?!\d)|"
    r"(?P<m4>[A-Za-zäÄ]{3,9})[. ]{1,2}(?P<d4>\d{1,2}),? (?P<y4>\d{4})|"
    r"(?P<y5>(?:19|20)\d\d)(?P<m5>[01]\d)(?P<d5>[0-3]\d)(?=[T _]|\Z)"
)
# The first letter of a group says what it holds: year, month, day, a and b of which one is the day;
# whole days, hour, minute n, second c, fraction, half of the day p, zone.
_CLOCK = re.compile(
    r"(?:(?P<w>\d{1,5}) days?,?\s)?"
    r"(?:(?P<h1>\d{1,2}):(?P<n1>\d\d):(?P<c1>\d\d)(?:[.,:](?P<f1>\d{1,18}))?|"
    r"(?P<n2>\d{1,3}):(?P<c2>\d\d)[.,](?P<f2>\d{1,18})|(?P<h3>\d{1,2}):(?P<n3>\d\d)|"
    r"(?P<h4>\d{1,2})\.(?P<n4>\d\d)\.(?P<c4>\d\d)(?:[.,](?P<f4>\d{1,18}))?|"
    r"(?P<h5>\d\d)(?P<n5>\d\d)(?P<c5>\d\d)(?:[.,](?P<f5>\d{1,18}))?)"
    r"(?:\s*(?P<p>[AaPp])\.?[Mm]\.?)?"
    r"\s?(?P<z>Z|UTC|GMT|CET|CEST|MEZ|MESZ|[+-]\d\d:?(?:\d\d)?)?"
)
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d([.,]\d+)?(Z|[+-]\d\d(:?\d\d)?)?")
_PLAIN_CLOCK = re.compile(r"\d\d:\d\d:\d\d([.,]\d+)?")
_ZONES = {"CET": HOUR, "MEZ": HOUR, "CEST": 2 * HOUR, "MESZ": 2 * HOUR}
_LONGEST = 48
Parts = dict[str, str]
LARGEST_DEPARTURE = 0.01
"""By which a stated rate may differ from that of a column of times."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeAxis:
    """Times of the samples of a column.

    Attributes
    ----------
    seconds : ndarray, shape (n,)
        Time of each sample [s]; from the first one where `begin` is known.
    begin : float or None
        Moment of the first sample [s] since 1970, or since midnight without a date.
    remark : str
        What was made of the column; empty where nothing had to be.
    """

    seconds: Floats
    begin: float | None = None
    remark: str = ""

    @property
    def start_time(self) -> str | None:
        """Date and time of the first sample in ISO 8601; None without a date."""
        return iso_time(self.begin)


def iso_time(begin: float | None) -> str | None:
    """Return a moment [s] since 1970 in ISO 8601; None if it is none or has no date.

    Examples
    --------
    >>> iso_time(1764317640.25), iso_time(29640.0)
    ('2025-11-28T08:14:00.250000', None)
    """
    if begin is None or not _UNIX[0] <= begin <= _UNIX[1]:
        return None
    moment = datetime.datetime(1970, 1, 1) + datetime.timedelta(microseconds=round(begin * 1e6))
    return moment.isoformat()


def numeric_axis(values: Floats, *, name: str = "", unit: str = "") -> TimeAxis:
    """Return a column of numbers as times.

    Parameters
    ----------
    values : ndarray, shape (n,)
        As the file holds them.
    name, unit : str
        Of the column; the unit may also end its name ("time_ms").

    Raises
    ------
    ValueError
        When the unit is none of time, or without one the numbers count and may be an index.

    Examples
    --------
    >>> numeric_axis(np.array([0.0, 40.0, 80.0]), name="time_ms").seconds
    array([0.  , 0.04, 0.08])
    >>> numeric_axis(1.7e12 + np.array([0.0, 40.0])).start_time
    '2023-11-14T22:13:20'
    """
    values = np.asarray(values, dtype=np.float64)
    unit, _, origin = unit.partition(" since ")
    given = unit or unit_in_name(name)
    factor = seconds_of(given)
    if origin and values.size and np.isfinite(values[0]):
        zero = stamps_axis([origin]).begin or 0.0
        begin = zero + float(values[0]) * factor
        return replace(_from_first(values, factor, begin, ""), remark="")
    if values.size < 2 or not np.isfinite(values).all():
        return TimeAxis(values if factor == 1.0 else values * factor)
    values = gone_round(values, factor)
    first, step = float(values[0]), float(np.median(np.diff(values)))
    for scale in (factor,) if given else (1.0, 1e-3, 1e-6, 1e-9):
        if _UNIX[0] <= first * scale <= _UNIX[1]:
            return _from_first(values, scale, first * scale, "Unix time")
    days_from = day_zero(values)
    if days_from is not None and (factor == DAY or (not given and 0 < step < _LARGEST_DAY_STEP)):
        return _from_first(values, DAY, (first - days_from) * DAY, "days")
    if factor != DAY and _UNIX[0] <= first * factor - _LABVIEW <= _UNIX[1]:
        return _from_first(values, factor, first * factor - _LABVIEW, "seconds since 1904")
    if not given and 0.01 <= first < 1.0 and 0 < step < _LARGEST_SHARE_STEP:
        message = "may be seconds or parts of a day; write the unit behind its name, 'Time (d)'"
        raise ValueError(message)
    if not given and counts(values):
        message = (
            f"'{name or 'time'}' counts {first:.6g}, {values[1]:.6g}, ... without a unit and may "
            "be an index; write its unit behind the name, 'Time (ms)', or state the sample rate"
        )
        raise ValueError(message)
    return TimeAxis(values if factor == 1.0 else values * factor)


def gone_round(values: Floats, factor: float) -> Floats:
    """Return times that go on past midnight, the full hour, or the last number of a counter.

    Parameters
    ----------
    values : ndarray, shape (n,)
        As the file holds them.
    factor : float
        Seconds in their unit.

    Examples
    --------
    >>> gone_round(np.array([86_399_920.0, 86_399_960.0, 0.0, 40.0]), 1e-3)[2:]
    array([86400000., 86400040.])
    """
    steps = np.diff(values)
    falls = np.flatnonzero(steps < 0)
    if not falls.size or falls.size > 1 + values.size // 10:
        return values
    typical = float(np.median(steps))
    for turn in (DAY / factor, HOUR / factor, 2.0**32, 2.0**16):
        off = np.abs(steps[falls] + turn - typical)
        if values.min() >= 0 and values.max() < turn and np.all(off <= 0.5 * typical):
            return values + turn * np.concatenate(([0.0], np.cumsum(steps < 0)))
    return values


def day_zero(values: Floats) -> float | None:
    """Return the number of 1 January 1970 among days of Excel, MATLAB or Julius Caesar.

    None if the numbers are no such days of 2000 to 2100.

    Examples
    --------
    >>> day_zero(np.array([45363.3, 45363.4])), day_zero(np.array([45.0]))
    (25569.0, None)
    """
    for least, most, zero in _DAYS:
        if values.size and np.all((values >= least) & (values <= most)):
            return zero
    return None


def counts(values: Floats) -> bool:
    """Return True if whole numbers rise by the same whole step.

    Examples
    --------
    >>> counts(np.arange(5.0)), counts(np.arange(5) / 10)
    (True, False)
    """
    steps = np.diff(values)
    return bool(
        steps.size
        and np.all(np.isfinite(values))
        and steps[0] >= 1
        and np.all(steps == steps[0])
        and np.all(values == np.rint(values))
    )


def may_be_time(values: Floats, name: str, *, rate: float | None) -> bool:
    """Return True if a column called t, without a unit, holds the time.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of the column.
    name : str
        Its name; T alone is a temperature or a torque.
    rate : float or None
        Rate that is stated beside it [1/s].
    """
    if rate is None:
        return name.strip() != "T"
    steps = np.diff(values)
    typical = float(np.median(steps)) if steps.size else 0.0
    return abs(typical * rate - 1.0) < LARGEST_DEPARTURE


def rate_remark(time: Floats, rate: float) -> str:
    """Return a remark if times [s] are not those of a stated rate [1/s]; empty if they are.

    Examples
    --------
    >>> rate_remark(np.arange(5) * 0.04, 20.0), rate_remark(np.arange(5) * 0.05, 20.0)
    ('check the time: its times show 25 Hz, 20 Hz is stated', '')
    """
    shown = rate_of(time)
    if not shown or abs(rate / shown - 1.0) <= LARGEST_DEPARTURE:
        return ""
    return f"check the time: its times show {shown:.6g} Hz, {rate:.6g} Hz is stated"


def rate_of(time: Floats) -> float:
    """Return the rate [1/s] that the typical step of times [s] shows; 0 if they do not rise."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    return 1.0 / step if step > 0.0 else 0.0


def unit_remark(time: Floats, name: str) -> str:
    """Return a remark if times without a unit are those of no throw [s]; empty if they may be.

    Examples
    --------
    >>> unit_remark(np.arange(100) / 1500.0, "t"), unit_remark(np.arange(100) / 25.0, "t")
    ("check the time: 't' states no unit and is taken as seconds", '')
    """
    if time.size < 2:
        return ""
    step, (least, most) = float(np.median(np.diff(time))), _USUAL_STEP
    if least < step < most and (time.size < _MANY or time[-1] - time[0] >= _LEAST_LENGTH):
        return ""
    return f"check the time: '{name}' states no unit and is taken as seconds"


def rises_evenly(values: Floats) -> bool:
    """Return True if all steps are up and near their mean."""
    steps = np.diff(values)
    return bool(steps.size and np.all(steps > 0) and np.ptp(steps) <= 0.5 * float(np.mean(steps)))


def _from_first(values: Floats, scale: float, begin: float, kind: str) -> TimeAxis:
    """Return times from the first of large numbers, whose last digits are rounded."""
    seconds = (values - values[0]) * scale
    # Days are often written with nine digits behind the mark.
    quantum = max(2.0 * float(np.spacing(abs(values[-1]))), 1e-9 * (scale == DAY)) * scale
    length, number = float(seconds[-1]), np.arange(values.size)
    if length > 0:
        for digits in range(1, 7):
            rate = float(f"{number[-1] / length:.{digits - 1}e}")
            if np.all(np.abs(seconds - number / rate) <= quantum):
                seconds = number / rate
                break
    return TimeAxis(seconds, begin, f"its times are {kind}")


def moments_axis(values: NDArray[Any]) -> TimeAxis:
    """Return numpy's dates (datetime64) or durations (timedelta64) as times."""
    if np.any(np.isnat(values)):
        message = f"the time of sample {int(np.argmax(np.isnat(values))) + 1} is missing"
        raise ValueError(message)
    if np.datetime_data(values.dtype)[0] in ("Y", "M") and values.dtype.kind == "m":
        message = "months and years are of no fixed length"
        raise ValueError(message)
    if values.dtype.kind == "m":
        return TimeAxis(values / np.timedelta64(1, "s"))
    if not values.size:
        return TimeAxis(np.zeros(0))
    zero = np.datetime64(values[0], "ns") - np.datetime64(0, "ns")
    begin = float(zero / np.timedelta64(1, "s"))
    seconds = (values - values[0]) / np.timedelta64(1, "s")
    return TimeAxis(seconds.astype(np.float64), begin)


def is_date(text: str) -> bool:
    """Return True if a text is a date without a time of day."""
    text = text.strip()
    return len(text) <= _LONGEST and _DATE.fullmatch(text) is not None


def is_stamp(text: str) -> bool:
    """Return True if a text is a time of day, with or without a date.

    Examples
    --------
    >>> [is_stamp(text) for text in ("28.11.2026 08:14:00,5", "8.14.59,500", "14:59.5", "0.5")]
    [True, True, True, False]
    """
    text = text.strip()
    if len(text) > _LONGEST or not text[:1].strip("+-"):
        return False
    date, rest = _date_and_rest(text)
    match = _CLOCK.fullmatch(rest) if rest else None
    return match is not None and (bool(date) or match["h5"] is None)


def moment_of(text: str) -> float | None:
    """Return the moment [s] since 1970 of one time stamp; None if it is none."""
    return stamps_axis([text]).begin if is_stamp(text) else None


def _date_and_rest(text: str) -> tuple[Parts, str]:
    """Return the parts of the date that a text begins with, and what is behind it."""
    date = _DATE.match(text) if len(text) <= _LONGEST else None
    rest = text[date.end() :].strip(" T,;_").removeprefix("- ") if date else text
    return _named(date), rest


def _named(match: re.Match[str] | None) -> Parts:
    """Return the parts that a pattern found, by the first letter of their groups."""
    return {key[0]: text for key, text in match.groupdict().items() if text} if match else {}


def stamps_axis(texts: Sequence[str]) -> TimeAxis:
    """Return time stamps as times.

    Parameters
    ----------
    texts : sequence of str
        One a sample, all with a date or all without.

    Raises
    ------
    ValueError
        Naming the first that is no time, and what may be read in two ways.

    Examples
    --------
    >>> stamps_axis(["28.11.2026 08:14:00,000", "28.11.2026 08:14:00,040"]).seconds
    array([0.  , 0.04])
    >>> stamps_axis(["59:59.9", "00:00.0"]).seconds
    array([0. , 0.1])
    """
    texts = [text.strip() for text in texts]
    undated = _PLAIN_CLOCK.fullmatch(texts[0]) is not None
    first, last = (f"{'1970-01-01 ' * undated}{text}" for text in (texts[0], texts[-1]))
    if _ISO.fullmatch(first) and _ISO.fullmatch(last):
        try:
            column = pd.Series(texts).str.replace(",", ".")
            column = "1970-01-01 " + column if undated else column
            moments = pd.to_datetime(column, format="ISO8601", utc=True).dt.tz_localize(None)
        except ValueError:
            pass
        else:
            axis = moments_axis(moments.to_numpy())
            zoned = re.search(r"Z|[+-]", texts[0][10:]) is not None
            return _unwrapped(axis.seconds, axis.begin, zoned=zoned, wrap=DAY)
    rows = [_parts(text, number) for number, text in enumerate(texts, start=1)]
    days = _days([date for date, _ in rows], _month_first(rows), texts)
    clocks = [clock for _, clock in rows]
    if any("h" in clock and "c" not in clock and not date for date, clock in rows):
        message = f"'{texts[0]}' may be hours and minutes or minutes and seconds; write 08:14:00"
        raise ValueError(message)
    if all(re.search(r":\d\d:\d\d:[0-5]\d\Z", text) for text in texts):
        message = f"'{texts[0]}' may end in frames or hundredths of a second; write 08:14:00.01"
        raise ValueError(message)
    seconds = np.array([_second_of_day(clock) for clock in clocks])
    begin = days[0] * DAY + float(seconds[0])
    seconds = (seconds - seconds[0]) + DAY * (days - days[0])
    zoned = any("z" in clock for clock in clocks)
    return _unwrapped(seconds, begin, zoned=zoned, wrap=DAY if "h" in clocks[0] else HOUR)


def _parts(text: str, number: int) -> tuple[Parts, Parts]:
    """Return the parts of the date and of the time of day."""
    date, rest = _date_and_rest(text)
    clock = _named(_CLOCK.fullmatch(rest or "000000")) if len(rest) <= _LONGEST else {}
    if not clock:
        message = f"row {number} of the numbers: '{text[:40]}' is no time"
        raise ValueError(message)
    return date, clock


def _month_first(rows: Sequence[tuple[Parts, Parts]]) -> bool:
    """Return True if dates such as 11/28/2026 name the month first."""
    open_dates = {
        (int(date["a"]), int(date["b"]), date["y"])
        for date, _ in rows
        if "a" in date and date["s"] != "."
    }
    if not open_dates:
        return False
    if any(b > 12 for _, b, _ in open_dates):
        return True
    if any(a > 12 and len(year) == 4 for a, _, year in open_dates):
        return False
    if any("p" in clock for _, clock in rows):
        return True
    if all(a == b and len(year) == 4 for a, b, year in open_dates):
        return False
    shown = next(date for date, _ in rows if "a" in date and date["s"] != ".")
    first, second, year = shown["a"], shown["b"], shown["y"]
    order = "its day or its month" if len(year) == 4 else "its day, its month or its year"
    message = f"the date {first}/{second}/{year} may name {order} first; write dates as 2026-11-28"
    raise ValueError(message)


def _days(dates: Sequence[Parts], month_first: bool, texts: Sequence[str]) -> Floats:
    """Return the day of each row since 1970; 0 without a date."""
    known: dict[tuple[str, ...], int] = {(): 0}
    for number, date in enumerate(dates, start=1):
        if (key := tuple(date.values())) in known:
            continue
        year = int(date["y"])
        year += 2000 if year < 70 else 1900 if year < 100 else 0
        day, month = date.get("d", ""), date.get("m", "")
        if "a" in date:
            day, month = (date["b"], date["a"]) if month_first else (date["a"], date["b"])
        try:
            of_year = int(month) if month.isdigit() else _MONTHS[month.lower()]
            known[key] = datetime.date(year, of_year, int(day)).toordinal() - 719_163
        except (ValueError, KeyError):
            message = f"row {number} of the numbers: '{texts[number - 1]}' is no date"
            raise ValueError(message) from None
    return np.array([known[tuple(date.values())] for date in dates], dtype=np.float64)


def _second_of_day(clock: Parts) -> float:
    hour, fraction, zone = int(clock.get("h", 0)), clock.get("f", "0"), clock.get("z", "")
    if "p" in clock:
        hour = hour % 12 + 12 * (clock["p"] in "Pp")
    offset = _ZONES.get(zone, 0.0)
    if zone[:1] in ("+", "-"):
        digits = zone[1:].replace(":", "").ljust(4, "0")
        offset = float(f"{zone[0]}1") * (HOUR * int(digits[:2]) + 60.0 * int(digits[2:]))
    days, minutes, seconds = (int(clock.get(key, 0)) for key in "wnc")
    whole = DAY * days + HOUR * hour + 60.0 * minutes + seconds - offset
    return whole + int(fraction) / 10.0 ** len(fraction)


def _unwrapped(seconds: Floats, begin: float | None, *, zoned: bool, wrap: float) -> TimeAxis:
    """Go on past midnight (or the full hour), and through both ends of summer time."""
    steps = np.diff(seconds)
    if not steps.size or (steps.min() >= 0 and steps.max() < HOUR):
        return TimeAxis(seconds, begin)
    rising = steps[steps > 0]
    typical = float(np.median(rising)) if rising.size else 1.0
    again = np.zeros(steps.size)
    again[(steps < -wrap / 2) & (steps >= -wrap)] = wrap
    half = (steps >= -12 * HOUR - 1e-6) & (steps <= min(2 * typical - 12 * HOUR, -1.0))
    again[half] = 12 * HOUR  # 12:59 to 1:00
    twice = (steps >= -HOUR - 1e-6) & (steps <= 2 * typical - HOUR) & (again == 0)
    # Summer time begins at two in the morning.
    at_two = np.abs(((begin or 0.0) + seconds[:-1]) % DAY - 2 * HOUR) <= 2 * typical
    left_out = (steps >= HOUR) & (steps <= HOUR + 2 * typical) & at_two
    remark = ""
    if not zoned and typical < HOUR / 2 and (twice.any() or left_out.any()):
        again[twice] = HOUR
        again[left_out] = -HOUR
        remark = "its clock jumps by an hour, taken as the beginning or end of summer time"
    return TimeAxis(seconds + np.concatenate(([0.0], np.cumsum(again))), begin, remark)
