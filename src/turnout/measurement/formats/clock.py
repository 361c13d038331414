"""Words of clocks: names of times, indices and throws; rates and intervals in words; their units.

Every format states its clock in one of four ways: a column of times, a column of time stamps, a
rate, or an interval. The words for them and their units are here, once for all formats.
"""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.measurement.formats.numbers import is_number, numbers
from turnout.measurement.recording import whole_rate

DAY, HOUR = 86_400.0, 3_600.0
_UNIT_WORDS = {
    1.0: ("", "s", "sec", "secs", "second", "seconds", "sekunde", "sekunden", "sek"),
    1e-3: ("ms", "msec", "millis", "millisecond", "milliseconds", "millisekunden"),
    1e-6: ("us", "µs", "μs", "usec", "microsecond", "microseconds"),
    1e-9: ("ns", "nsec", "nanosecond", "nanoseconds"),
    1e-12: ("ps",),
    60.0: ("min", "minute", "minutes", "minuten"),
    HOUR: ("h", "hr", "hrs", "hour", "hours", "std", "stunden"),
    DAY: ("d", "day", "days", "tage"),
}
SECONDS = {word: factor for factor, words in _UNIT_WORDS.items() for word in words}
_HERTZ_WORDS = {
    1.0: (
        *("hz", "hertz", "s/s", "sa/s", "sps", "1/s", "/s", "s-1", "s^-1", "samples/s", "sample/s"),
        *("samples/sec", "samples/second", "samples per second", "values/s", "werte/s"),
        *("messwerte/s", "points/s", "pts/s", "data/s", "per second"),
    ),
    1e3: ("khz", "ks/s", "ksa/s", "ksps"),
    1e6: ("mhz", "msa/s", "msps"),
}
HERTZ = {word: factor for factor, words in _HERTZ_WORDS.items() for word in words}
_SCALED = re.compile(r"(?:(?P<over>1/)?(?P<scale>[1-9]\d*|0[.,]\d*[1-9])\s?)?(?P<unit>[^\W\d]*)")
_UNCLEAR = {"Ms": "ms or 1e6 s", "mHz": "MHz or 1e-3 Hz", "mS/s": "MS/s or 1e-3 S/s"}
_SUFFIX = r"(?:_?(?P<unit>s|sec|ms|us|ns|min|hz|khz))?"
_SOURCES = (
    "sample|sampling|samp|scan|acquisition|acq|logging|log|logger|recording|record|recorded|"
    "storage|measuring|measurement|mess|abtast|data|daq|adc|digitizer|wf|wave|nominal|effective"
)
_RATE = re.compile(
    rf"(?:data\d+)?(?:(?:{_SOURCES})s?(?:rate|frequency|freq|frq|frequenz)|fs|sr|sps|srate|"
    r"(?:sample|sampling|scan|acquisition|acq)s?clock(?:rate|frequency|freq)?|"
    r"fsamp(?:le|ling)?|(?:samples|points|scans)(?:per|/)s(?:ec(?:ond)?)?|frequencyofsampling|"
    r"samplingsfrekvens|samplingshastighet|frequencedechantillonnage|frecuenciademuestreo|odr|"
    r"frequenzadicampionamento|(?:taxa|frequencia)deamostragem|czestotliwoscprobkowania|"
    r"vzorkovacifrekvence|bemonsteringsfrequentie|采样率|采样频率)"
    rf"{_SUFFIX}"
)
_STEP = re.compile(
    rf"(?:data\d+)?(?:(?:{_SOURCES}|time|horizontal|horz|x|h|t)"
    r"(?:interval|period|increment|incr|inc|step|resolution|spacing)|interval|increment|"
    r"intervall|dt|delta[tx]|δt|ts|tsamp(?:le)?|sample?time|samplingtime|timeper(?:sample|point)|"
    r"abtastintervall|abtastzeit|abtastperiode|messintervall|zeitschritt|zeitintervall|"
    r"zeitinkrement|samplingsintervall|intervalledechantillonnage|intervalodemuestreo|"
    rf"intervallodicampionamento|bemonsteringsinterval|okresprobkowania|采样间隔|采样周期){_SUFFIX}"
)
# Without a unit a data rate may be one of bits.
_EITHER = re.compile(
    rf"(?!samples\Z)(?:sampling|dat(?:a|en)rate|echantillonnage|abtastung|sample|messtakt|takt|"
    rf"(?:(?:re|down|sub)sampl|decimat)(?:ed|ing|ion)(?:to|at)?(?:rate|frequency)?){_SUFFIX}"
)
_WEAK_RATE = re.compile(rf"rate{_SUFFIX}")
_RATES = ((_EITHER, "either"), (_RATE, "rate"), (_STEP, "step"), (_WEAK_RATE, "weak"))
_NO_RATE = re.compile(r"(?:mains|line|net|supply|netz)?(?:frequency|freq|frequenz|frekvens)(?:hz)?")
# A clock of another part may be far faster than the samples.
_NO_CLOCK = re.compile(r"[^\W\d_]*clock(?:rate|frequency|freq|period)?")
_ROWS = (
    r"(?:samples?|values?|points?|rows?|readings?|scans?|measurements?|valeurs?|valor\w*|"
    r"(?:mess|abtast)?(?:werte?s?|punkte?s?|zeilen?)|v[aä]rde\w*|echantillons?|muestras?)"
)
_NTH = r"(?!1(?:st|\.)?\b)(?:\d+(?:st|nd|rd|th|\.|:?[ae]|te[rsn]?)?|n|n-?th|n-?te[rsn]?)"
_ORDINAL = (
    r"(?:other|second|third|(?:four|fif|six|seven|eigh|nin|ten|eleven|twelf|\w+teen|\w+tie|hundred|"
    r"thousand)th|(?:zwei|drit|vier|f[uü]nf|sechs|sieb(?:en)?|ach|neun|\w*zehn|elf|zw[oö]lf|"
    r"\w+(?:z|ß|ss)igs|\w*hunderts|\w*tausends)te[rnsm]?|andra|tredje|fj[aä]rde|femte|sj[aä]tte|"
    r"(?:sju|[aå]tto|nio|\w*tio|\w*tjugo)nde|hundrade|tusende)"
)
_STORED = r"(?:stored?|storage|saved?|kept|values|samples|points|gespeichert|werte)"
# Statements that samples were left out, without their marks.
_REDUCED = re.compile(
    rf"(?:.*\b)?(?:every|each|jede[rnms]?|alle|varje?|chaque|cada|ogni) (?:{_NTH}|{_ORDINAL}) "
    rf"(?:(?:stored|saved|recorded|raw) )?{_ROWS}\b.*|"
    r"(?!.*\b(?:not|nicht)\b).*\b(?:decimated|(?:down|sub) ?sampled|dezimiert)|"
    rf"(?:.*\b)?(?:every|jede[rns]?) {_NTH}(?: stored| saved| \d+)?|"
    r"(?:(?:data|samples?|sampling|storage|rate|clock|scan) )?(?:decimat(?:ion|ed|e)|dezim\w+|"
    r"(?:down|under|sub) ?sampl\w+|unterabtastung|reduction|reduced|divider|divisor|teiler|stride)"
    r"(?: (?:factor|ratio|rate|faktor|by))* (?:1 ?[:/] ?)?(?!1(?:\.0*)?\Z)[1-9]\d*(?:\.0*)? ?x?"
    rf"(?: {_ROWS})?|"
    rf"(?:(?:.*\b)?{_STORED} 1 ?(?:[:/]|(?:out )?(?:of|in|von|aus|av|sur))|"
    rf"1 (?:out )?(?:of|in|von)) ?(?!1\b)\d+(?: {_ROWS})?"
)
_TIME_UNIT = re.compile(r"(?:horizontal|horz|h|x|t|time|zeit)(?:units?|einheit)|wfxunitstring")
_MARKS = re.compile(r"(?:[\s_;=,\"'#()\[\]]|(?<!\d):|:(?!\d))+")
_TURNING = re.compile(
    r"rpm|drehzahl|varvtal|(?:rotation(?:al)?|shaft|rotor|motor)speed|(?:1|u|r|revs?)/min|min-1"
)
"""Names and units of a speed of rotation, beside which a "rate" may be that of a shaft."""
_START = re.compile(
    rf"(?:x0|t0|tstart|start|starts|xzero|xorg|xorigin|hoffset|wfstartoffset){_SUFFIX}"
)
_BEGIN = re.compile(
    r"(?:wf|recording|measurement|record|trigger)?(?:start|begin)?(?:store)?"
    r"(?:date(?:time)?|time|datum|zeit|timestamp)|start|startzeit|startdatum|beginn|"
    r"recordingstart|messbeginn|starttidpunkt|uhrzeit"
)
_BEGIN_WORD = re.compile(r"start|begin")
_SECONDS_TEXT = re.compile(r"[+\-]?[\d.,]+(?:[eE][+\-]?\d+)?\s*[^\W\d]{0,3}")
_OWNER = re.compile(r"\A[^\W\d]\w*:")
"""A channel before its own value: "CH1:0.04"."""
_TOGETHER = re.compile(r"\b(?:aggregat\w*|total|sum|combined|gesamt|together|insgesamt)\b")
_PER_SECOND = re.compile(r"(?:samples|points|scans)/")
_CLOCK_VALUE = re.compile(r"\d\s?(?:[kM]?Hz|k?S/s|[mµun]?s|m?sec)\b", re.IGNORECASE)
_MOMENT = re.compile(
    r"[\s\"']*(?:\d{1,4}[-/:]\d|\d{1,4}\.\d\d?\.|\d{1,2}[. ]{1,2}(?:\d{1,2}\.|[A-Za-zä]{3})|"
    r"[A-Za-zä]{3,9}\.? \d{1,2},|\d{8})"
)
_TIME = re.compile(
    r"(?:data\d+)?(?:relative|elapsed|rel|utc|local|unix|epoch|system|sample)?"
    r"(?:time|times|zeit|tid|temps|tiempo|tempo|ts|t|timestamp|timestamps|zeitstempel|tidsst[aä]mpel|"
    r"datetime|date&time|dateandtime|date/time|datumzeit|datumuhrzeit|datum/zeit|datum/uhrzeit|"
    r"uhrzeit|tidpunkt|xvalue|timeaxis|timevec(?:tor)?|zeitachse|zeitvektor|tout|epoch|posix|"
    r"posixtime|czas|tijd|aika|čas|idő|время|时间|時間|timeoffset|zeitversatz|datenum|serialdate|"
    r"abstime|reltime|elapsed|(?:m?s|(?:milli)?seconds?|(?:milli)?sekunden?)(?:of(?:the)?day|destages))"
    r"\d{0,2}"
    r"(?:-?\w*(?:default|standard|messrate|samplerate).*)?(?P<unit>m?sec|ms|us|usec|ns|s)?"
)
NameKind = Literal[
    "abscissa", "date", "direction", "id", "index", "signal", "throw", "unit of time"
]
_KINDS: dict[NameKind, re.Pattern[str]] = {
    "abscissa": re.compile(r"x|xaxis|xwerte?|abscissa|second|seconds|sekunden"),
    "date": re.compile(r"date|datum|day"),
    "direction": re.compile(r"direction|dir|richtung|riktning|sens"),
    "id": re.compile(r"id"),
    "index": re.compile(
        r"(?:sample|scan|point|record|row|data|mess)?(?:index|idx|no|nr|number|num|nummer|count|"
        r"punkt)|n|i|k|x|rn|sample|samples|scan|point|points|record|row|line|zeile|sequence|seq|"
        r"counter|t|time|indexlevel0|unnamed0"
    ),
    "signal": re.compile(
        r"signal|channel|variable|parameter|tag|sensor|kanal|quantity|name|key|series"
    ),
    "throw": re.compile(
        r"(?:throw|move|movement|run|umlauf|umstellung|stellvorgang|operation|event|cycle|curve|"
        r"shot|omläggning|switching|test|segment|record|trace)(?:no|nr|id|number|num|index|idx)?"
    ),
    # "min" may be a minimum, "s" a way.
    "unit of time": re.compile(
        r"sec|secs|seconds?|sek|sekunden?|msec|millis(?:econds?)?|ms|us|µs|usec"
    ),
}
_LEAST_RISING = 0.9
"""Share of the steps of a column of times that are up, with room for faults among them."""
_STATED = re.compile(
    r"\s*([+\-−–]?(?:\d{1,3}(?: \d{3})+(?!\d)(?:[.,]\d*)?|\d[\d.,'’\u00a0\u202f\u2009]*)"
    r"(?:[eEdD][+-]?\d+)?)\s*(.*?)\s*"
)


def squeezed(text: str) -> str:
    """Return a name without case, blanks, underscores and quotes: "Sample_Rate" -> "samplerate"."""
    return re.sub(r"[\s_.'\"()\[\]:]+", "", text.strip().lstrip("#%!/ ")).lower().strip("=")


def is_time_name(name: str) -> bool:
    """Return True if a column of this name, without its unit, holds the time.

    Examples
    --------
    >>> [is_time_name(name) for name in ("Time", "t", "time_ms", "Zeitstempel", "Throw time")]
    [True, True, True, True, False]
    """
    word = squeezed(name)
    # T1 and TS1 may be temperatures.
    return _TIME.fullmatch(word) is not None and re.fullmatch(r"ts?\d+", word) is None


def is_numbered_channel(
    name: str, values: NDArray[np.floating], *, unit: str = "", beside: bool = False
) -> bool:
    """Return True if a column called as a time with a number, without a unit, is a channel.

    That is one that falls, or stands behind another time.

    Examples
    --------
    >>> is_numbered_channel("Tempo 1", np.array([3.0, 1.0, 2.0, 0.5]))
    True
    """
    timed = is_time_unit(unit.partition(" since ")[0])
    if timed or re.fullmatch(r"\D+\d{1,2}", squeezed(name)) is None:
        return False
    steps = np.diff(values)
    return beside or int(np.count_nonzero(steps > 0)) < _LEAST_RISING * steps.size


def often_falls(values: NDArray[np.floating]) -> bool:
    """Return True if more steps are down than the faults and beginnings of throws among times.

    Times that are coarser than the samples repeat.

    Examples
    --------
    >>> often_falls(np.array([0.0, 0.0, 1.0, 1.0])), often_falls(np.array([3.0, 2.0, 1.0]))
    (False, True)
    """
    steps = np.diff(values)
    return int(np.count_nonzero(steps < 0)) > (1.0 - _LEAST_RISING) * steps.size


def unit_in_name(name: str) -> str:
    """Return the unit of time at the end of a name: "time_ms" -> "ms"; empty if there is none."""
    word = squeezed(name)
    if _KINDS["unit of time"].fullmatch(word):
        return word
    match = _TIME.fullmatch(word)
    plural = word.endswith("times") and not name.strip().endswith("_s")
    return _as_written(name, match["unit"]) if match and not plural else ""


def is_called(name: str, kind: NameKind) -> bool:
    """Return True if a column of this name, without its unit, may be of a kind.

    Parameters
    ----------
    name : str
        As the file writes it.
    kind : str
        "abscissa" is the time as soon as its unit is one of time, "date" holds days as soon as its
        numbers may be some, "index" counts samples (also without a name), "throw" numbers throws,
        "direction" tells that of a throw, "signal" which signal a row belongs to; "unit of time"
        stands in place of a name.

    Examples
    --------
    >>> is_called("Throw no.", "throw"), is_called("", "index"), is_called("Force", "index")
    (True, True, False)
    """
    word = squeezed(name).replace("-", "")
    if not word:  # other marks, such as %, may name a channel
        return kind == "index" and name.strip(" \"'") in ("", "#")
    return _KINDS[kind].fullmatch(word) is not None


def is_rate_name(name: str) -> bool:
    """Return True for a name of a rate or an interval of samples."""
    return any(pattern.fullmatch(squeezed(name).replace("-", "")) for pattern, _ in _RATES)


def is_speed(text: str) -> bool:
    """Return True for the name or unit of a speed of rotation; a "rate" beside may be its."""
    return _TURNING.search(squeezed(text)) is not None


def seconds_of(unit: str) -> float:
    """Return the seconds in a unit of time; ValueError when it is none.

    Examples
    --------
    >>> seconds_of("ms"), seconds_of(""), seconds_of("1/10 ms"), seconds_of("10 ms")
    (0.001, 1.0, 0.0001, 0.01)
    """
    _refuse_unclear(unit)
    scaled = _SCALED.fullmatch(unit.strip().strip("[]()").lower())
    factor = None if scaled is None else SECONDS.get(scaled["unit"])
    if factor is not None and scaled is not None and scaled["scale"]:
        scale = float(scaled["scale"].replace(",", "."))
        factor *= 1.0 / scale if scaled["over"] else scale
    if factor is None:
        message = f"'{unit}' is no unit of time; needs one of s, ms, us, ns, min, h, d"
        raise ValueError(message)
    return factor


def _refuse_unclear(unit: str, shown: str = "") -> None:
    """Refuse a unit whose small and capital letters belong to two units; ValueError names both."""
    if two := _UNCLEAR.get(unit.strip(" []()")):
        message = f"the unit of '{shown or unit}' may be {two}; write it out"
        raise ValueError(message)


def _as_written(name: str, ending: str | None) -> str:
    """Return the last letters of a name, of which the small ones are known."""
    return re.sub(r"[\W_]+\Z", "", name)[-len(ending) :] if ending else ""


def is_time_unit(unit: str) -> bool:
    """Return True for a unit of time or a multiple of one; none is not one."""
    scaled = _SCALED.fullmatch(unit.lower())
    return scaled is not None and scaled["unit"] != "" and scaled["unit"] in SECONDS


def stated_number(text: str, decimal: str | None = ".") -> tuple[float, str] | None:
    """Return the number and unit that a text begins with; None if it begins with none.

    Parameters
    ----------
    text : str
        Such as "1.000 Hz".
    decimal : str or None
        Decimal mark of the file; None if it has shown none.

    Raises
    ------
    ValueError
        When the mark may part thousands as well as decimals.

    Examples
    --------
    >>> stated_number("1.000 Hz", ","), stated_number("40 ms"), stated_number("2,5 kHz")
    ((1000.0, 'Hz'), (40.0, 'ms'), (2.5, 'kHz'))
    """
    match = _STATED.fullmatch(text)
    fits = [mark for mark in ".," if match and is_number(match[1], mark)]
    if match is None or not fits:
        return None
    values = [float(numbers([match[1]], mark)[0][0]) for mark in fits]
    if decimal is None and len(set(values)) > 1:
        message = f"'{text.strip()}' may be a thousand or a decimal; write it without its mark"
        raise ValueError(message)
    return values[fits.index(decimal) if decimal in fits else 0], match[2]


class StatedRates(NamedTuple):
    """Words that state rates, and these [1/s]: one, or one a column.

    Those of bare intervals are over the unit of times, which may be stated below them.
    """

    shown: str
    values: tuple[float, ...]
    bare: bool = False

    def in_seconds(self, unit: str) -> "StatedRates":
        """Return these rates, with times in a unit."""
        if not self.bare:
            return self
        factor = seconds_of(unit)
        return StatedRates(self.shown, tuple(whole_rate(rate / factor) for rate in self.values))


@dataclass(slots=True)
class StatedClock:
    """Rates, starts and dates that a file states in words.

    Attributes
    ----------
    rates : list of StatedRates
    weak : list of StatedRates
        Under a name that may mean something else ("rate").
    first : (float, bool) or None
        Time of the first sample [s], or True and that in the unit of times.
    moments : list of str
        Date and time of the start, in parts.
    doubtful : list of str
        Texts that look like a rate and are none, such as the frequency of the mains.
    reduced : list of str
        Texts that say that samples were left out, of the stated rate or before it.
    turning : bool
        Whether a "rate" may be that of a shaft.
    unit : str
        Of times, intervals and starts that state none; empty if it is not stated.
    """

    rates: list[StatedRates] = field(default_factory=list)
    weak: list[StatedRates] = field(default_factory=list)
    first: tuple[float, bool] | None = None
    moments: list[str] = field(default_factory=list)
    doubtful: list[str] = field(default_factory=list)
    reduced: list[str] = field(default_factory=list)
    turning: bool = False
    unit: str = ""

    @property
    def start(self) -> float | None:
        """Time of the first sample [s]; None if it is not stated."""
        if self.first is None:
            return None
        return self.first[0] * (seconds_of(self.unit) if self.first[1] else 1.0)

    def read(
        self, key: str, values: Sequence[object], *, unit: str = "", decimal: str | None = "."
    ) -> bool:
        """Take a rate, start or date from a key and its values; return False if there is none.

        Raises
        ------
        ValueError
            When they state a rate or an interval that is none.
        """
        name = squeezed(key if _PER_SECOND.search(key.lower()) else key.rsplit("/", 1)[-1])
        name = unicodedata.normalize("NFKD", name.replace("-", ""))
        name = "".join(character for character in name if not unicodedata.combining(character))
        texts = [str(value).strip() for value in values]
        self.turning |= is_speed(name)
        left_out = self.leaves_out(f"{key.strip()}: {', '.join(texts)}")
        if self.read_unit(key, texts):
            return True
        for pattern, kind in _RATES:
            if (match := pattern.fullmatch(name)) is None:
                continue
            shown = f"{key.strip()}: {', '.join(texts)}"[:60]
            suffix = _as_written(key, match["unit"])
            found = _rates(texts, unit or suffix, kind, decimal, shown)
            if found:
                (self.weak if kind == "weak" else self.rates).append(found)
            return found is not None or left_out
        kept = list(dict.fromkeys(texts))
        text, once = " ".join(texts).strip(), " ".join(kept)
        said = f"{key.strip()}: {text}"[:60]
        number = stated_number(text)
        unit_of = "" if number is None else _unit_of_clock(number[1] or unit)
        clock = _NO_CLOCK.fullmatch(name) and (unit_of in HERTZ or unit_of in SECONDS)
        if left_out:
            return True
        if clock or (_NO_RATE.fullmatch(name) and number is not None):
            self.doubtful.append(said)
            return True
        if match := _START.fullmatch(name):
            plain = all(_SECONDS_TEXT.fullmatch(v) and v.count(".") < 2 for v in kept)
            first = stated_number(kept[0], decimal) if plain else None
            own = (first and first[1]) or unit or match["unit"] or ""
            if first is not None and (not own or is_time_unit(own)):
                if len(kept) > 1:
                    message = f"'{key.strip()}: {text[:40]}': the columns start at different times"
                    raise ValueError(message + "; export a column of times for each")
                self.first = (first[0] * seconds_of(own), not own)
                return True
        begins = _BEGIN.fullmatch(name) is not None
        if begins and number and is_time_unit(seconds := number[1] or unit):
            if not _BEGIN_WORD.search(name):  # a duration
                self.doubtful.append(said)
            elif number := stated_number(text, decimal):
                self.first = (number[0] * seconds_of(seconds), False)
            return True
        if (begins or name == "t0") and _MOMENT.match(text):
            self.moments.append(once)
            return True
        return False

    def read_unit(self, key: str, values: Sequence[str]) -> bool:
        """Take the unit of times from a key and its values; return False if it is none.

        Raises
        ------
        ValueError
            When another one was stated.
        """
        name = squeezed(key.rsplit("/", 1)[-1])
        if not _TIME_UNIT.fullmatch(name):
            return False
        if len({*values}) == 1 and is_time_unit(values[0].strip()):
            before, self.unit = self.unit, values[0].strip()
            if before and seconds_of(before) != seconds_of(self.unit):
                message = f"two units of times are stated, '{before}' and '{self.unit}'; leave one"
                raise ValueError(message)
        return True

    def within(self, outer: "StatedClock") -> "StatedClock":
        """Return this clock, completed by that around it."""
        rated = bool(self.rates or (self.weak and not self.turning))
        weak = [] if rated or outer.turning else outer.weak
        return replace(
            self,
            rates=self.rates if rated else [item.in_seconds(outer.unit) for item in outer.rates],
            weak=self.weak or [item.in_seconds(outer.unit) for item in weak],
            reduced=self.reduced or ([] if rated else outer.reduced),
            first=self.first or (None if outer.start is None else (outer.start, False)),
            unit=self.unit or outer.unit,
        )

    def rate(self) -> tuple[float, ...] | None:
        """Return the rates [1/s], one or one a column; None if none is stated.

        Raises
        ------
        ValueError
            When two statements contradict each other.
        """
        for group in (self.rates, [] if self.turning else self.weak):
            if not group:
                continue
            taken = [item.in_seconds(self.unit) for item in group]
            shown, first, _ = max(taken, key=lambda item: len(item.values))
            for other, rates, _ in taken:
                same = rates[:1] * len(first) if len(rates) == 1 else rates
                if len(same) != len(first) or any(
                    abs(a - b) > 1e-3 * a for a, b in zip(first, same, strict=True)
                ):
                    message = f"two clocks are stated: '{shown}' and '{other}'; leave one"
                    raise ValueError(message)
            return first
        return None

    def rate_of_rows(self) -> tuple[float, ...] | None:
        """Return the rates [1/s] of samples without times; None if none is stated.

        Raises
        ------
        ValueError
            When two statements contradict each other, or samples were left out.
        """
        if (rate := self.rate()) and self.reduced:
            message = (
                f"'{self.reduced[0]}' is stated beside a sample rate of {rate[0]:.6g} Hz, which "
                "may be that before or that of the rows; state the rate of the rows alone, or "
                "give their times"
            )
            raise ValueError(message)
        return rate

    def leaves_out(self, text: str) -> bool:
        """Keep a statement that samples were left out; return False if it is none."""
        if len(text) < 80 and _REDUCED.fullmatch(_MARKS.sub(" ", text.lower()).strip()):
            self.reduced.append(text.strip())
            return True
        return False

    def other_rates(self, rate: float) -> list[str]:
        """Return texts that state another sample rate of something [1/s]: "Actual sample rate"."""
        found = []
        for shown in self.doubtful:
            key, _, text = shown.partition(":")
            words, number = key.split(), stated_number(text)
            parts = [" ".join(words[a:b]) for a in range(len(words)) for b in range(len(words) + 1)]
            factor = HERTZ.get(_unit_of_clock(number[1])) if number else None
            named = any(p.fullmatch(squeezed(w)) for w in parts for p in (_RATE, _EITHER))
            if number and factor and named:
                found += [shown] if abs(number[0] * factor / rate - 1.0) > 1e-3 else []
        return found

    def no_rates(self) -> list[str]:
        """Return texts that look like a sample rate and are none."""
        return [*self.doubtful, *(item.shown for item in self.weak if self.turning)]

    def doubt(self, key: str, text: str) -> bool:
        """Keep a statement of an unknown name with a frequency or a time; return False."""
        if _CLOCK_VALUE.search(text):
            self.doubtful.append(f"{key.strip()}: {text.strip()}"[:60])
        return False

    @property
    def start_time(self) -> str | None:
        """Date and time of the start as the file writes them; None if it does not."""
        return " ".join(dict.fromkeys(self.moments)) or None


def _rates(
    values: Sequence[str], unit: str, kind: str, decimal: str | None, shown: str
) -> StatedRates | None:
    """Return rates [1/s] from stated rates or intervals; None if there are no numbers."""
    texts = [_OWNER.sub("", value) for value in values if value]
    if len(texts) > 1 and not _STATED.fullmatch(texts[-1]):  # 2.5e-3, "s"
        unit = _unit_of_clock(texts[-1]) or unit
        texts = texts[:-1]
    found, own = [], unit
    for text in texts:
        number = stated_number(text, decimal)
        if number is None:
            return None
        if kind != "weak" and any(c.isdigit() for c in re.sub(r"\^?-?1", "", number[1])):
            message = f"'{shown}' is not one number with its unit; write '1000 Hz' or '1 ms'"
            raise ValueError(message)
        _refuse_unclear(number[1] or unit, shown)
        if _TOGETHER.search(number[1].lower()):
            message = f"'{shown}' is that of all channels together; state the rate of one"
            raise ValueError(message)
        own = _unit_of_clock(number[1] or unit)
        if own in HERTZ or (own == "" and kind in ("rate", "weak")):
            rate = number[0] * HERTZ.get(own, 1.0)
        elif is_time_unit(own) or (own == "" and kind != "either"):
            step = number[0] * seconds_of(own)
            rate = 1.0 / step if step else np.inf
        elif kind in ("weak", "either"):
            return None
        else:
            message = f"'{shown}' has no known unit of a rate or a time; write '1000 Hz' or '1 ms'"
            raise ValueError(message)
        if not (np.isfinite(rate) and rate > 0):
            message = f"'{shown}' is no rate; it must be more than 0 and finite"
            raise ValueError(message)
        found.append(whole_rate(rate))
    alike = tuple(found[:1] if len(set(found)) == 1 else found)
    return StatedRates(shown, alike, bare=kind == "step" and not own) if found else None


def _unit_of_clock(text: str) -> str:
    """Return a unit of a rate or a time without words behind it ("Hz (all channels)")."""
    text = text.strip("[]() ,;").lower()
    first, _, more = text.partition(" ")
    known = text in HERTZ or is_time_unit(text) or any(character.isdigit() for character in more)
    return text if known else first.strip("[]() ,;")
