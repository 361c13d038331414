"""Recordings of many loggers, oscilloscopes, programs and languages, as small texts.

Each holds the same 40 samples, or refuses for the reason given. A row says what must come out: the
rate and start of each channel, or words of the message.
"""

from collections.abc import Callable
from datetime import datetime, timedelta

import numpy as np

COUNT = 40
FORCE = np.round(np.sin(np.arange(COUNT) / 3.0) * 2.0 - 0.613, 3)
CURRENT = np.round(2.4 + 4.0 * np.exp(-np.arange(COUNT) / 4.0), 3)
BEGIN = datetime(2026, 11, 28, 8, 14, 0)

Read = dict[str, tuple[float, float]]
"""Rate [1/s] and start [s] by channel; "Force" and "Current" hold the samples above."""
Kind = tuple[str, str, Read | tuple[str, ...]]
BOTH: Read = {"Force": (25.0, 0.0), "Current": (25.0, 0.0)}
STEP = 0.04


def rows(
    separator: str = ",",
    *,
    time: Callable[[int], str] | None = None,
    number: Callable[[float], str] = lambda value: f"{value:.3f}",
    end: str = "",
    count: int = COUNT,
) -> str:
    """Return the samples as lines, behind a time or an index if one is given."""
    lines = []
    for place in range(count):
        cells = [] if time is None else [time(place)]
        cells += [number(FORCE[place]), number(CURRENT[place])]
        lines.append(separator.join(cells) + end + "\n")
    return "".join(lines)


def german(value: float) -> str:
    return f"{value:.3f}".replace(".", ",")


def moment(pattern: str, *, digits: int = 3, step: float = STEP, begin: datetime = BEGIN):
    """Return a function that writes time stamps; %f stands for the digits of the second."""

    def written(place: int) -> str:
        at = begin + timedelta(seconds=place * step)
        text = at.strftime(pattern.replace("%f", "\x01"))
        return text.replace("\x01", f"{at.microsecond:06d}"[:digits])

    return written


def seconds(place: int) -> str:
    return f"{place * STEP:.2f}"


def milliseconds(place: int) -> str:
    return f"{place * 40}"


HEAD = "Time (s),Force [kN],Current [A]\n"
VALUES = "Force [kN],Current [A]\n"


def stated(line: str, **options: object) -> str:
    return f"{line}\n{VALUES}{rows(**options)}"


def stamped(pattern: str, name: str = "Time", **options: object) -> str:
    return f"{name},Force [kN],Current [A]\n{rows(time=moment(pattern, **options))}"


RATES: list[Kind] = [
    (f"rate: {line}", stated(line), BOTH)
    for line in (
        "Sample rate: 25 Hz",
        "Sampling frequency = 25.0 Hz",
        "SampleRate,25",
        "sr: 25",
        "Fs=25",
        "Sampling rate [Hz]: 25",
        "Sample rate (kHz): 0.025",
        "Scan rate;25 S/s",
        "Samples per second: 25",
        "Acquisition rate\t25 Hz",
        "Abtastfrequenz: 25 Hz",
        "Samplingsfrekvens: 25 Hz",
        "Sample interval: 40 ms",
        "Sampling Interval,40ms",
        "Abtastintervall;40 ms",
        "interval_ms: 40",
        '"INTERVAL", 4.000E-02',
        "HResolution: 4.0E-02 s",
        "dt = 0.04",
        "Sampling period: 40000 us",
        "Time step [ms]: 40",
        "# sample_rate: 25 Hz",
        "Logging interval: 0.04 s",
        "Sample time: 0.04 s",
        '"Sample Interval",4.000000e-02,s',
        "SamplingRate 25 Hz",
        "Sampling rate: 25Hz; Channels: 2",
        "Messfrequenz: 25 Hz",
        "Intervall;40;ms",
        "Fréquence d'échantillonnage : 25 Hz",
        "Points per second: 25",
        "Sample Interval,0.04,CH1:0.04",
        "Storage interval: 40 ms",
        "Datenrate: 25 Hz",
        "ODR: 25 Hz",
        "Échantillonnage : 25 Hz",
        "Częstotliwość próbkowania: 25 Hz",
        "Taxa de amostragem: 25 Hz",
        "Vzorkovací frekvence: 25 Hz",
        "Bemonsteringsfrequentie: 25 Hz",
        "采样率: 25Hz",
        "采样间隔: 40ms",
    )
] + [
    ("rate: thousands", stated("Sample rate: 1,000 Hz"), dict.fromkeys(BOTH, (1000.0, 0.0))),
    (
        "rate: German thousands",
        f"Abtastrate: 2.500 Hz\nForce [kN];Current [A]\n{rows(';', number=german)}",
        dict.fromkeys(BOTH, (2500.0, 0.0)),
    ),
    (
        "rate: Swiss thousands",
        stated("Sample rate: 10'000 Hz"),
        dict.fromkeys(BOTH, (10_000.0, 0.0)),
    ),
    (
        "rate: one per column",
        "Sample rate,25,5\nForce [kN],Current [A]\n"
        + "".join(f"{f},{CURRENT[n] if n < 8 else ''}\n" for n, f in enumerate(FORCE)),
        {"Force": (25.0, 0.0), "Current": (5.0, 0.0)},
    ),
    (
        "rate: blank between thousands",
        stated("Sample rate: 1 000 Hz"),
        dict.fromkeys(BOTH, (1000.0, 0.0)),
    ),
    ("rate: below a number alone", f"1\nSample rate: 25 Hz\n{VALUES}{rows()}", BOTH),
    ("rate: words behind", stated("Sample rate: 25 Hz (all channels)"), BOTH),
    ("rate: in words", stated("Sample rate: 25 samples per second"), BOTH),
    ("rate: two numbers", stated("Sample rate: 25 of 50 Hz"), ("is not one number with its unit",)),
    ("rate: label with its unit", stated("Abtastrate [Hz];25"), BOTH),
    ("rate: sampling, a time", stated("Sampling: 40 ms"), BOTH),
    ("rate: sampling, a frequency", stated("Sampling,25Hz"), BOTH),
    ("rate: of bits", stated("Data rate: 9600"), ("neither times nor",)),
    ("rate: sampling without a unit", stated("Sampling: 25"), ("neither times nor",)),
    ("rate: mains", stated("Frequency: 50 Hz"), ("not taken for the sample rate", "neither")),
    ("rate: twice", stated("Sample rate: 25 Hz\nSample interval: 4 ms"), ("two clocks",)),
    *(
        (f"rate: {line}", stated(line), (f"'{line}' is not taken for the sample rate",))
        for line in ("Time base: 40 ms", "Clock: 25 Hz", "Sampling: every 40 ms")
    ),
    ("rate: duration", stated("Sample interval: 0:00:00.040"), ("is not one number",)),
    (
        "rate: start in seconds",
        stated("Start time: 12.5 s\nSample rate: 25 Hz"),
        dict.fromkeys(BOTH, (25.0, 12.5)),
    ),
    *(
        (f"rate: {line}, a duration", stated(f"{line}\nSample rate: 25 Hz"), BOTH)
        for line in (
            *("Recording time: 10 s", "Record time: 10 sec", "Measurement time: 5 seconds"),
            *("Time: 10 s", "Date: 5 d", "Trigger time: 5 min"),
        )
    ),
    (
        "rate: a duration alone",
        stated("Recording time: 10 s"),
        ("'Recording time: 10 s' is not taken for the sample rate",),
    ),
    (
        "rate: start in words",
        stated("Recording start time: 12.5 seconds\nSample rate: 25 Hz"),
        dict.fromkeys(BOTH, (25.0, 12.5)),
    ),
    *(
        (f"rate: {name} of another part", stated(f"{name}: 1 MHz\nSample rate: 25 Hz"), BOTH)
        for name in ("Clock rate", "ADC clock", "Clock frequency", "Data clock")
    ),
    *(
        (f"rate: {name} alone", stated(f"{name}: 1 MHz"), (f"'{name}: 1 MHz' is not taken",))
        for name in ("Clock rate", "ADC clock", "Data clock")
    ),
    ("rate: Sampling clock", stated("Sampling clock: 25 Hz"), BOTH),
    ("rate: zero", stated("Sample rate: 0 Hz"), ("is no rate",)),
    ("rate: ambiguous", "Sample rate: 1.000 Hz\nA (V),B (V)\n1,2\n3,4\n5,6\n", ("a thousand",)),
    ("rate: none", VALUES + rows(), ("neither times nor a sample rate",)),
    ("rate: in kilograms", stated("Sample interval: 4 kg"), ("no known unit of a rate or a time",)),
]

TIMES: list[Kind] = [
    *(
        (f"time: {name}", f"{name},Force [kN],Current [A]\n{rows(time=time)}", BOTH)
        for name, time in (
            ("Time (s)", seconds),
            ("time_ms", milliseconds),
            ("t [ms]", milliseconds),
            ("t / s", seconds),
            ("Time (sec)", seconds),
            ("Time in ms", milliseconds),
            ("timestamp", seconds),
            ("Zeit", seconds),
            ("tid_s", seconds),
            ("Elapsed Time (s)", seconds),
            ("x [s]", seconds),
            ("X_Value", seconds),
            ("Time 1 - default sample rate", seconds),
            ("t (us)", lambda n: f"{n * 40000}"),
            ("Unix time", lambda n: f"{1_795_853_640 + n * STEP:.3f}"),
            ("epoch_ms", lambda n: f"{1_795_853_640_000 + n * 40}"),
            ("timestamp (us)", lambda n: f"{1_795_853_640_000_000 + n * 40_000}"),
            ("timestamp", lambda n: f"{1_795_853_640_000_000_000 + n * 40_000_000}"),
            ("time", lambda n: f"{739_949.343 + n * STEP / 86_400:.9f}"),
            ("Time", lambda n: f"{46_354.343 + n * STEP / 86_400:.12f}"),
            ("Time (d)", lambda n: f"{46_354.343 + n * STEP / 86_400:.12f}"),
            ("Date", lambda n: f"{46_354.343 + n * STEP / 86_400:.12f}"),
            ("Datum", lambda n: f"{739_949.343 + n * STEP / 86_400:.9f}"),
            ("elapsed_s", seconds),
            ("seconds", seconds),
            ("millis", milliseconds),
            ("in s", seconds),
            ("Time offset [ms]", milliseconds),
            ("Time", lambda n: f"{n * 40} ms"),
            ("Time", lambda n: f"0 days 00:00:{n * STEP:09.6f}"),
            ("Time{ms}", milliseconds),
            ("Time <ms>", milliseconds),
            ("TIME_MSEC", milliseconds),
            ("Zeit in Millisekunden", milliseconds),
            ("[s]", seconds),
            ("Zeit in min", lambda n: f"{n * STEP / 60:.10f}"),
            ("Time / min", lambda n: f"{n * STEP / 60:.10f}"),
            ("Time [hh:mm:ss.ms]", lambda n: f"08:14:{n * STEP:06.3f}"),
        )
    ),
    ("time: days beside parts of a day",
     "Date,Time,Force [kN],Current [A]\n" + rows(
         time=lambda n: f"46354,{0.343 + n * STEP / 86_400:.12f}"), BOTH),
    ("time: days with one digit",
     "Date,Force,Current\n" + rows(time=lambda n: f"{46_354.343 + n * STEP / 86_400:.1f}"),
     ("column 'Date': 39 of its 40 times repeat", "state the sample rate")),
    ("time: days alone",
     "Date,Force,Current\n" + rows(time=lambda n: "2026-11-28"),
     ("'Date' is left out: it holds dates without a time of day",)),
    ("time: index", "Time,Force,Current\n" + rows(time=str), ("counts 0, 1", "index")),
    ("time: index headless", rows(time=str), ("counts samples and is no time",)),
    ("time: tens headless", rows(time=milliseconds), ("counts samples and is no time",)),
    ("time: index and rate", "Rate: 25 Hz\nindex,Force [kN],Current [A]\n" + rows(time=str), BOTH),
    ("time: index in steps of four",
     "Rate: 100 Hz\nindex,Force,Current\n" + rows(time=lambda n: f"{4 * n}"),
     ("counts in steps of 4 beside a stated rate of 100 Hz",)),
    ("time: index leaves numbers out",
     "Rate: 25 Hz\nindex,Force [kN],Current [A]\n" + "".join(
         f"{n},{FORCE[n]},{CURRENT[n]}\n" for n in range(COUNT) if n != 5), BOTH),
    *((f"time: {name} leaves numbers out",
       f"Rate: 25 Hz\n{name},Force [kN],Current [A]\n" + "".join(
         f"{n},{FORCE[n]},{CURRENT[n]}\n" for n in range(COUNT) if n != 5), BOTH)
      for name in ("Time", "t", "sample_index")),
    ("time: t counts beside a rate",
     "Rate: 25 Hz\nt,Force [kN],Current [A]\n" + rows(time=str), BOTH),
    ("time: parts of a day",
     "Time,Force,Current\n" + rows(time=lambda n: f"{0.343 + n * STEP / 86400:.12f}"),
     ("seconds or parts of a day",)),
    ("time: headless", rows(time=seconds), {"column 2": (25.0, 0.0), "column 3": (25.0, 0.0)}),
    ("time: no time unit", "Time (kg),Force\n0,1\n1,2\n", ("no unit of time",)),
    ("time: repeats", HEAD + rows(time=lambda n: f"{n // 5 * 0.2:.1f}"), ("times repeat",)),
    ("time: only the first unit in a row of its own",
     "Time;Force;Current\nms;;\n" + rows(";", time=milliseconds), BOTH),
    ("time: in a column without a name",
     ",Force [kN],Current [A]\n" + rows(time=moment("%Y-%m-%d %H:%M:%S.%f")), BOTH),
    ("time: behind an empty column", ";;;\n;Time (s);Force [kN];Current [A]\n" + "".join(
        f";{line}\n" for line in rows(";", time=seconds).splitlines()), BOTH),
    ("time: whole seconds beside it", "Date;t (s);Force [kN];Current [A]\n" + rows(
        ";", time=lambda n: f"{moment('%d.%m.%Y %H:%M:%S')(n)};{seconds(n)}"), BOTH),
    ("time: a column repeats the rate", "throw_id,sample_rate_hz,sample_index,Force,Current\n"
     + rows(time=lambda n: f"418,25,{n}"), BOTH),
    *((f"time: a constant column called {name}, {head!r}", f"{head}\nForce,Current,{name}\n"
       + rows(end=",5"), {**BOTH, channel: (25.0, 0.0)})
      for head in ("Sample rate: 25 Hz", "Rate: 25 Hz")
      for name, channel in (("START", "START"), ("Start [V]", "Start"))),
    ("time: beside a least temperature", "t min,Time (s),Force,Current\n" + rows(
        time=lambda n: f"{20 + n / 100:.2f},{seconds(n)}"), {"t min": (25.0, 0.0), **BOTH}),
    ("time: newest first", HEAD + "".join(reversed(rows(time=seconds).splitlines(True))),
     ("time must rise",)),
    ("time: a row twice", HEAD + rows(time=seconds) + rows(time=seconds).splitlines()[-1] + "\n",
     ("1 of its 41 times repeat", "rows may stand twice")),
    ("time: rounded from a whole rate", HEAD + rows(time=lambda n: f"{int(n / 0.029) / 1e3:.3f}"),
     dict.fromkeys(BOTH, (29.0, 0.0))),
    ("time: falls", HEAD + rows(time=lambda n: f"{5 + (n if n != 9 else 7) * STEP:.2f}"),
     ("time must rise",)),
    ("time: tiny", HEAD + rows(time=lambda n: f"{n}e-320"), ("no sample rate",)),
    ("time: 5000 digits", HEAD + rows(time=lambda n: "1" * 5000 if n == 3 else seconds(n)),
     ("the time of sample 4 is no number",)),
    ("time: two columns",
     "Time (s),Force [kN],Time (s),Current [A]\n" + "".join(
         f"{n * STEP:.2f},{FORCE[n]},{f'{n * 0.2:.1f},{CURRENT[n]}' if n < 8 else ','}\n"
         for n in range(COUNT)),
     {"Force": (25.0, 0.0), "Current": (5.0, 0.0)}),
    ("time: rate changes",
     HEAD + rows(time=lambda n: f"{n * STEP if n < 20 else 0.8 + (n - 20) * 0.02:.2f}"),
     ("its step is 0.04 s up to 0.8 s and 0.02 s behind it",)),
    *(
        (f"time: {name} is a channel", f"Time (s),{name},Force [kN]\n" + "".join(
            f"{n * STEP:.2f},{CURRENT[n]},{FORCE[n]}\n" for n in range(COUNT)),
         {name: (25.0, 0.0), "Force": (25.0, 0.0)})
        for name in ("Tid 1", "Tempo 1")
    ),
    ("time: a numbered channel that rises", "Time (s),Tempo 1,Force [kN]\n" + "".join(
        f"{n * STEP:.2f},{20 + n / 2},{FORCE[n]}\n" for n in range(COUNT)),
     {"Tempo 1": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("time: numbered columns of times without a unit",
     "Time 1,Force [kN],Time 2,Current [A]\n" + "".join(
         f"{n * STEP:.2f},{FORCE[n]},{n * STEP + 1.5:.2f},{CURRENT[n]}\n" for n in range(COUNT)),
     {"Force": (25.0, 0.0), "Current": (25.0, 1.5)}),
    ("time: numbered columns of times",
     "Time 1 (s),Force [kN],Time 2 (s),Current [A]\n" + "".join(
         f"{n * STEP:.2f},{FORCE[n]},{n * STEP + 1.5:.2f},{CURRENT[n]}\n" for n in range(COUNT)),
     {"Force": (25.0, 0.0), "Current": (25.0, 1.5)}),
    *((f"time: {one} and {two}, which leaves a row out", f"{one},Force,{two},Current\n" + "".join(
        f"{n * STEP:.2f},{f},"
        + (f"{(n + (n > 3)) * STEP + 1.5:.2f},{CURRENT[n + (n > 3)]}\n" if n < 7 else ",\n")
        for n, f in enumerate(FORCE)), {"Force": (25.0, 0.0), "Current": (25.0, 1.5)})
      for one, two in (("t1 (s)", "t2 (s)"), ("t", "t2"), ("Time F [s]", "Time I [s]"))),
    ("time: two starts",
     "Time (s),Force [kN],Time (s),Current [A]\n" + "".join(
         f"{n * STEP:.2f},{FORCE[n]},{n * STEP + 1.5:.2f},{CURRENT[n]}\n" for n in range(COUNT)),
     {"Force": (25.0, 0.0), "Current": (25.0, 1.5)}),
]  # fmt: skip

STAMPS: list[Kind] = [
    *(
        (f"stamps: {pattern}", stamped(pattern), BOTH)
        for pattern in (
            "%Y-%m-%d %H:%M:%S.%f",
            "%Y-%m-%dT%H:%M:%S.%fZ",
            "%Y-%m-%dT%H:%M:%S.%f+01:00",
            "%Y/%m/%d %H:%M:%S.%f",
            "%d.%m.%Y %H:%M:%S.%f",
            "%d/%m/%Y %H:%M:%S.%f",
            "%m/%d/%Y %I:%M:%S.%f %p",
            "%m-%d-%Y %H:%M:%S.%f",
            "%d-%b-%Y %H:%M:%S.%f",
            "%Y%m%d %H%M%S.%f",
            "%H:%M:%S.%f",
            "%H:%M:%S:%f",
            "%M:%S.%f",
            "%d.%m.%Y - %H:%M:%S.%f",
            "%I:%M:%S.%f %p",
        )
    ),
    ("stamps: microseconds", stamped("%H:%M:%S.%f", digits=6), BOTH),
    ("stamps: dots",
     f"Zeit;Force [kN];Current [A]\n{rows(';', time=moment('%H.%M.%S,%f'), number=german)}", BOTH),
    ("stamps: German",
     "Zeitstempel;Force [kN];Current [A]\n"
     + rows(";", time=moment("%d.%m.%Y %H:%M:%S,%f"), number=german), BOTH),
    ("stamps: midnight", stamped("%H:%M:%S.%f", begin=datetime(2026, 11, 28, 23, 59, 59)), BOTH),
    ("stamps: full hour", stamped("%M:%S.%f", begin=datetime(2026, 11, 28, 8, 59, 59)), BOTH),
    ("stamps: hour twice",
     "Time,Force [kN],Current [A]\n" + rows(time=lambda n: moment(
         "%Y-%m-%d %H:%M:%S.%f", begin=datetime(2026, 10, 25, 1 + (n < 25), 59, 59))(n)), BOTH),
    ("stamps: hour left out",
     "Time,Force [kN],Current [A]\n" + rows(time=lambda n: moment(
         "%Y-%m-%d %H:%M:%S.%f", begin=datetime(2026, 3, 29, 1 + (n >= 25), 59, 59))(n)), BOTH),
    ("stamps: date beside",
     "Date,Time,Force [kN],Current [A]\n" + rows(time=moment("%d.%m.%Y,%H:%M:%S.%f")), BOTH),
    ("stamps: date behind",
     "Time,Date,Force [kN],Current [A]\n" + rows(time=moment("%H:%M:%S.%f,%Y-%m-%d")), BOTH),
    ("stamps: milliseconds beside",
     "Date&Time,ms,Force [kN],Current [A]\n" + rows(time=moment("%Y/%m/%d %H:%M:%S,%f")), BOTH),
    ("stamps: whole seconds", stamped("%Y-%m-%d %H:%M:%S"), ("tell no rate",)),
    ("stamps: whole seconds and a rate",
     "Sample rate: 25 Hz\n" + stamped("%Y-%m-%d %H:%M:%S"), BOTH),
    ("stamps: ambiguous", stamped("%m/%d/%Y %H:%M:%S.%f", begin=datetime(2026, 3, 4, 8)),
     ("its day or its month first",)),
    ("stamps: year in two digits", stamped("%d/%m/%y %H:%M:%S.%f"),
     ("its day, its month or its year first",)),
    ("stamps: unknown layout", stamped("%Y-%m-%d-%H-%M-%S.%f"), ("times of no known layout",)),
    ("stamps: hours or minutes", stamped("%H:%M", step=60.0), ("hours and minutes or",)),
    ("stamps: not all", stamped("%H:%M:%S.%f").replace("08:14:00.400", "soon"), ("'soon' is no",)),
]  # fmt: skip

NUMBERS: list[Kind] = [
    ("numbers: minus sign",
     "Tid (s);Force (kN);Current (A)\n"
     + rows(";", time=lambda n: german(n * STEP), number=lambda v: german(v).replace("-", "−")),
     BOTH),
    ("numbers: dash",
     HEAD + rows(time=seconds, number=lambda v: f"{v:.3f}".replace("-", "–")), BOTH),
    ("numbers: quoted",
     '"Zeit (s)","Force (kN)","Current (A)"\n' + rows(
         time=lambda n: f'"{german(n * STEP)}"', number=lambda v: f'"{german(v)}"'), BOTH),
    ("numbers: Fortran", HEAD + rows(time=seconds, number=lambda v: f"{v:.6E}".replace("E", "D")),
     BOTH),
    ("numbers: trailing separator",
     "Time (s);Force (kN);Current (A)\n" + rows(";", time=seconds, end=";"), BOTH),
    ("numbers: bars", "Time (s)|Force (kN)|Current (A)\n" + rows("|", time=seconds), BOTH),
    ("numbers: blanks", "t Force Current\n" + rows("   ", time=seconds), BOTH),
    ("numbers: unknown unit row",
     "Time;Force;Current\ns;kN;furlong\n" + rows(";", time=seconds), BOTH),
    ("numbers: units in words", "Time,Force,Current\nsecond,Newtons,Amps\n" + rows(time=seconds),
     BOTH),
    ("numbers: headings over two lines",
     '"Time\n(s)","Force\n[kN]","Current\n[A]"\n' + rows(time=seconds), BOTH),
    ("numbers: first column without a name",
     "Force Current\n" + "".join(f'"{n}" {FORCE[n]} {CURRENT[n]}\n' for n in range(COUNT)),
     ("neither times nor a sample rate",)),
    ("numbers: date and time under one name",
     "Timestamp Force Current\n" + rows(" ", time=moment("%Y-%m-%d %H:%M:%S.%f")), BOTH),
    ("numbers: a name too few", "Time (s),Force\n" + rows(time=seconds),
     ("2 names for 3 columns",)),
    ("numbers: a name too many", "Time rod Force Current\n" + rows(" ", time=seconds),
     ("4 names for 3 columns",)),
    ("numbers: mark of a comment", "% t Force Current\n" + rows(" ", time=seconds), BOTH),
    ("numbers: names of several words",
     "Time of run [s] Force [kN] Current [A]\n" + rows(" ", time=seconds), BOTH),
    ("numbers: last unit empty", "Time,Force,Current\ns,kN,\n" + rows(time=seconds), BOTH),
    ("numbers: columns numbered above", "1,2,3\nTime [s],Force,Current\n" + rows(time=seconds),
     BOTH),
    ("numbers: unit in each cell", "Time;Force;Current\n" + "".join(
        f"{n * STEP:.2f} s;{f} kN;{CURRENT[n]} A\n" for n, f in enumerate(FORCE)), BOTH),
    ("numbers: units change", "Time (s);Force\n" + "".join(
        f"{n * STEP:.2f};{f} {'k' * (n % 2)}N\n" for n, f in enumerate(FORCE)),
     ("its cells are in 'N', 'kN'",)),
    ("numbers: unit in each cell, another in the heading", "Time (s);Force [kN]\n" + "".join(
        f"{n * STEP:.2f};{f} N\n" for n, f in enumerate(FORCE)),
     ("column 'Force'", "its heading states 'kN', its cells 'N'")),
    *((f"numbers: unit in each cell and {unit} in the heading", f"Time (s);Force [{unit}]\n"
       + "".join(f"{n * STEP:.2f};{f} {cell}\n" for n, f in enumerate(FORCE)),
       {"Force": (25.0, 0.0)}) for unit, cell in (("kn", "kN"), ("C", "°C"), ("µm/m", "um/m"))),
    ("numbers: unit in each cell and in the heading",
     "Time [sec];Force [kN];Current (A)\n" + "".join(
        f"{n * STEP:.2f} s;{f} kN;{CURRENT[n]} A\n" for n, f in enumerate(FORCE)), BOTH),
    *((f"numbers: {name} in milliseconds", f"{name},Force [kN]\n" + "".join(
        f"{n * 40} ms,{f}\n" for n, f in enumerate(FORCE)),
       ("its heading states 's', its cells 'ms'",)) for name in ("Time [s]", "time_s")),
    ("numbers: formulas", HEAD + rows(time=seconds, number=lambda v: f'="{v:.3f}"'), BOTH),
    ("numbers: comma twice", "Zeit (s),Force (kN)\n" + "".join(
        f"{german(n * STEP)},{german(f)}\n" for n, f in enumerate(FORCE)),
     ("the comma may part its columns and its decimals",)),
    ("numbers: comma twice, whole numbers", "Zeit (s),Force (N)\n" + "".join(
        f"{german(n * STEP / 2)},{round(1e3 * f)}\n" for n, f in enumerate(FORCE)),
     ("the comma may part its columns and its decimals",)),
    ("numbers: a name too few, a constant in front", "Sample rate: 25 Hz\nForce,Current\n"
     + "".join(f"1,{n * n % 7},{n * n % 5}\n" for n in range(COUNT)),
     ("line 2 has 2 names for 3 columns",)),
    ("numbers: comma twice, stamps", "Zeit,Force (kN),Current (A)\n"
     + rows(time=moment("%d.%m.%Y %H:%M:%S.%f"), number=german),
     ("the comma may part its columns and its decimals",)),
    ("numbers: comma twice, no names", f"Sample rate: 25 Hz\n{rows(number=german)}",
     ("the comma may part its columns and its decimals",)),
    *((f"numbers: whole ones without names, a state {states[-1]}", "".join(
        f"{n * n % 7},{states[n // 20 % len(states)]},{n * n % 11}\n" for n in range(COUNT)),
       ("neither times nor a sample rate are known",))
      for states in (("00", "01"), ("0815",))),
    ("numbers: rows are channels", "".join(
        ",".join([name, *(f"{v}" for v in values)]) + "\n" for name, values in (
            ("Time (s)", np.round(np.arange(COUNT) * STEP, 2)), ("Force [kN]", FORCE),
            ("Current [A]", CURRENT))), BOTH),
    ("numbers: rows are curves", "".join(
        ";".join(["1", *(f"{v}" for v in CURRENT)]) + "\n" for _ in range(5)),
     ("curves may lie in its rows",)),
    ("numbers: overloads", HEAD + rows(time=seconds).replace("6.400", "OVL").replace("5.515", "***")
     .replace("4.826", "+++++").replace("4.289", "Infinity").replace("3.872", "9.91E+37")
     .replace("3.546", "\u221e"), BOTH),
    *((f"numbers: {text} is no number", HEAD + rows(time=seconds).replace("6.400", text), BOTH)
      for text in ("1.#IND", "-1.#IND00", "1.#QNAN", "1.#INF")),
    ("numbers: overloads in the first rows",
     "Sample rate: 25 Hz\nForce,Current\nOVL,OVL\n***,***\n" + rows(count=38),
     {"Force": (25.0, 0.0), "Current": (25.0, 0.0)}),
    ("numbers: an overload in the first cell",
     f"Sample rate: 25 Hz\nCurrent,Force\n***,{FORCE[0]}\n" + "".join(
         f"{c},{f}\n" for c, f in zip(CURRENT[1:], FORCE[1:], strict=True)),
     {"Current": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("numbers: factors above them, without a first",
     f"Sample rate: 25 Hz\nForce;Current\n;0,5\n{rows(';', number=german)}",
     ("line 3", "'0,5'", "with an empty cell")),
    ("numbers: factors above them, of which one is empty",
     "Sample rate: 25 Hz\nForce;Position;Current\n10;;5000\n"
     + "".join(f"{f};{n};{c}\n" for n, (f, c) in enumerate(zip(FORCE, CURRENT, strict=True))),
     ("line 3", "'10'", "with an empty cell")),
    ("numbers: numbers of columns above them", "Sample rate: 25 Hz\n1;2\n" + rows(";"),
     {"1": (25.0, 0.0), "2": (25.0, 0.0)}),
    ("numbers: two whole ones or one decimal", "Sample rate: 25 Hz\n" + "".join(
        f"{round(1e3 * f)},{640 + n}\n" for n, f in enumerate(FORCE)),
     ("the comma may part its columns or its decimals",)),
    ("numbers: decimals of one column", "Sample rate: 25 Hz\n" + "".join(
        f"{german(f)}\n" for f in FORCE), {"column 1": (25.0, 0.0)}),
    ("numbers: a column without a name that alternates", "Sample rate: 25 Hz\n" + rows(
        ";", time=lambda n: f"0{n % 2}"),
     {"column 1": (25.0, 0.0), "column 2": (25.0, 0.0), "column 3": (25.0, 0.0)}),
    ("numbers: an empty cell between tabs, one behind each row",
     "Time (s)\tCurrent\tForce\n" + "".join(
         f"{n * STEP:.2f}\t{'' if n == 7 else CURRENT[n]}\t{f}\t\n" for n, f in enumerate(FORCE)),
     {"Current": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("numbers: an empty first cell between tabs, one behind each row",
     "Sample rate: 25 Hz\nCurrent\tForce\n" + "".join(
         f"{'' if n == 7 else CURRENT[n]}\t{f}\t\n" for n, f in enumerate(FORCE)),
     {"Current": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("numbers: notes in some rows, the first among them",
     "Sample rate: 25 Hz\nNote\tValid\tSide\tForce\tCurrent\n" + "".join(
         f"{'' if n % 3 else 'ok'}\tTRUE\tN\t{german(f)}\t{german(CURRENT[n])}\n"
         for n, f in enumerate(FORCE)), BOTH),
    *((f"numbers: more texts than numbers, parted by {mark}",
       mark.join(("Sample rate: 25 Hz\nForce", "Side", "Valid", "Switch", "Current\n")) + "".join(
         mark.join((german(f), "N", "TRUE", "W12", german(CURRENT[n]))) + "\n"
         for n, f in enumerate(FORCE)), BOTH) for mark in ";|\t"),
    ("numbers: a named column in front that is empty", "Empty;Time (s);Force;Current\n" + "".join(
        f";{line}\n" for line in rows(";", time=seconds).splitlines()),
     dict.fromkeys(("Empty", *BOTH), (25.0, 0.0))),
    ("numbers: an empty cell between blanks", "Time Current Force\n" + "".join(
        f"{n * STEP:6.2f}{'' if n == 7 else CURRENT[n]:8}{f:8}\n" for n, f in enumerate(FORCE)),
     ("line 9 has 2 of 3 cells", "write NaN")),
    ("numbers: an empty first cell in the middle", "Sample rate: 25 Hz\nCurrent|Force\n" + "".join(
        f"{'' if n == COUNT // 2 else CURRENT[n]}|{f}|\n" for n, f in enumerate(FORCE)),
     {"Current": (25.0, 0.0), "Force": (25.0, 0.0)}),
    *((f"numbers: {text or 'no text'} in the first cell of the last row",
       "Sample rate: 25 Hz\nCurrent;Force\n" + "".join(
         f"{text if n == COUNT - 1 else CURRENT[n]};{f}\n" for n, f in enumerate(FORCE)),
       {"Current": (25.0, 0.0), "Force": (25.0, 0.0)}) for text in ("NaN", "")),
    ("numbers: marks of gaps", HEAD + rows(time=seconds).replace("3.872", "////")
     .replace("3.546", "k.A."), BOTH),
    ("numbers: kiloamperes in the row of units", "Sample rate: 25 Hz\nForce;Current\nkA;kA\n"
     + rows(";"), BOTH),
    ("numbers: other marks of gaps", HEAD + rows(time=seconds).replace("3.872", "I/O Timeout")
     .replace("3.546", "±∞"), BOTH),
    ("numbers: a rate above them behind an empty cell",
     f";Sample rate;25 Hz\nIndex;Force;Current\n{rows(';', time=str)}", BOTH),
    ("numbers: a heading of pandas", ",0,1\n" + "".join(
        f"{n},{f},{c}\n" for n, (f, c) in enumerate(zip(FORCE, CURRENT, strict=True))),
     ("'0', '1' are left out",)),
    ("numbers: numbers of channels below their names", "Time;Force;Current\n;1;2\n"
     + rows(";", time=lambda n: german(n * STEP), number=german),
     ("line 2", "'1'", "with an empty cell")),
    ("numbers: a current called I falls in whole numbers", "Sample rate: 25 Hz\nForce,I in mA\n"
     + "".join(f"{f},{4000 - n * n}\n" for n, f in enumerate(FORCE)),
     {"Force": (25.0, 0.0), "I": (25.0, 0.0)}),
    ("time: Tempo beside a time falls and is a channel", "Time (s),Force,Tempo\n" + "".join(
        f"{n * STEP:.2f},{f},{CURRENT[n]}\n" for n, f in enumerate(FORCE)),
     {"Force": (25.0, 0.0), "Tempo": (25.0, 0.0)}),
    ("time: three throws in whole seconds beside a rate", "Sample rate: 25 Hz\nTime;I\n" + "".join(
        f"{n // 25};{c}\n" for _ in range(3) for n, c in enumerate(CURRENT)),
     ("there are 3 throws in one table",)),
    ("time: a second one too coarse for its samples", "Time;Force;Time;Current\n" + "".join(
        f"{n * STEP:.2f};{f};{n // 25};{CURRENT[n]}\n" for n, f in enumerate(FORCE)),
     ("column 'Time'", "coarser than the samples")),
    *((f"time: {one} and {two}, which is shorter", f"{one};Force;{two};Current\n" + "".join(
        f"{n * STEP:.2f};{f};" + (f"{n / 10};{CURRENT[n]}\n" if n < COUNT // 5 else ";\n")
        for n, f in enumerate(FORCE)), {"Force": (25.0, 0.0), "Current": (10.0, 0.0)})
      for one, two in (("Time I [s]", "Time F [s]"), ("t", "t2"), ("Time", "Time F"))),
    ("time: seconds right behind stamps", "Stamp;Relative [s];Force\n" + "".join(
        f"{moment('%Y-%m-%d %H:%M:%S.%f')(n)};{n * STEP:.2f};{f}\n" for n, f in enumerate(FORCE)),
     {"Relative": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("numbers: decimal commas without names", f"Sample rate: 25 Hz\n{rows(';', number=german)}",
     dict.fromkeys(("column 1", "column 2"), (25.0, 0.0))),
    ("numbers: a title of as many words as columns and one more", "Measurement of switch 12\n"
     + rows("\t", time=seconds), {"column 2": (25.0, 0.0), "column 3": (25.0, 0.0)}),
    ("numbers: a first row without its last cell", "Time (s);Force;Current;Power\n0.00;1.5;2.5\n"
     + "".join(f"{n * STEP:.2f};{f};{f};{f}\n" for n, f in enumerate(FORCE)),
     ("line 2 has fewer or more cells than the table",)),
    ("numbers: blanks between, quoted names and numbers of rows", '"Time (s)" "Force" "Current"\n'
     + "".join(f'"{n + 1}" {n * STEP:.2f} {f} {CURRENT[n]}\n' for n, f in enumerate(FORCE)), BOTH),
    ("numbers: blanks between, all quoted", '"Time (s)" "Force" "Current"\n'
     + "".join(f'"{n * STEP:.2f}" "{f}" "{CURRENT[n]}"\n' for n, f in enumerate(FORCE)), BOTH),
    ("numbers: first row unreadable, whole numbers",
     "Time (s),Force\nx7,3\n0.00,1\n0.04,2\n0.08,4\n", ("line 2", "'x7'")),
    ("numbers: a column with an empty line",
     "Sample rate: 25 Hz\nForce [kN]\n" + "".join(
         f"{'' if n == 5 else value}\n" for n, value in enumerate(FORCE)) + "\n",
     {"Force": (25.0, 0.0)}),
    ("numbers: first row unreadable",
     HEAD + "zero,0.5,0.7\n" + rows(time=seconds), ("line 2", "'zero'")),
    ("numbers: text among them",
     HEAD + rows(time=seconds).replace("2.400\n", "2.4x0\n", 1).replace("6.400", "6..4"),
     ("line 2", "column 'Current'", "'6..4'")),
    ("numbers: text column",
     "Time (s),Force (kN),State,Current (A)\n" + "".join(
         f"{n * STEP:.2f},{FORCE[n]},{'MOVING' if n > 3 else 'IDLE'},{CURRENT[n]}\n"
         for n in range(COUNT)), BOTH),
    ("numbers: T is a torque", "Rate: 25 Hz\nForce,T\n" + "".join(
        f"{FORCE[n]},{1 + n / 10:.1f}\n" for n in range(COUNT)),
     {"Force": (25.0, 0.0), "T": (25.0, 0.0)}),
    *((f"numbers: {name} is a temperature", f"Time (s),Force,{name}\n" + "".join(
        f"{n * STEP:.2f},{FORCE[n]},{20 + n / 10:.1f}\n" for n in range(COUNT)),
       {"Force": (25.0, 0.0), name: (25.0, 0.0)}) for name in ("T1", "t1")),
    ("numbers: more channels than rows",
     "Time (s),Force," + ",".join(f"AI {k}" for k in range(100)) + "\n" + "".join(
         f"{n * STEP:.2f},{FORCE[n]}{',1.5' * 100}\n" for n in range(COUNT)),
     dict.fromkeys(("Force", *(f"AI {k}" for k in range(100))), (25.0, 0.0))),
    ("numbers: states with a letter", "Time (s),Force,State,Note\n" + "".join(
        f"{n * STEP:.2f},{FORCE[n]},{1 + n // 20}a,{'5 %' if n == 3 else ''}\n"
        for n in range(COUNT)), {"Force": (25.0, 0.0)}),
    ("numbers: 5000 digits", f"{'1' * 5000},{'2' * 5000}\n" * 40, ("it holds no numbers",)),
    ("numbers: T is a temperature", "Time (s),Force,T [°C]\n" + "".join(
        f"{n * STEP:.2f},{FORCE[n]},{1 + n / 10:.1f}\n" for n in range(COUNT)),
     {"Force": (25.0, 0.0), "T": (25.0, 0.0)}),
]  # fmt: skip

LOGGERS: list[Kind] = [
    ("PicoScope", "Time,Force,Current\n(ms),(kN),(A)\n\n" + rows(time=milliseconds), BOTH),
    ("Rigol",
     f"X,Force,Current,Start,Increment,\nSequence,Volt,Volt,0.0,{STEP},\n"
     + rows(time=str, end=",,,"), BOTH),
    ("Rigol, two columns empty",
     f"X,Force,D7-D0,D15-D8,Current,Start,Increment,\nSequence,Volt,,,Volt,-0.1,{STEP}\n"
     + "".join(f"{n},{FORCE[n]},0x00,0x00,{CURRENT[n]},\n" for n in range(COUNT)),
     dict.fromkeys(BOTH, (25.0, -0.1))),
    ("Rigol, times in the row of names",
     f"Force,Current,t0 =-1.000000e-01, tInc = {STEP:.6e},\n" + rows(end=",,"),
     dict.fromkeys(BOTH, (25.0, -0.1))),
    ("Infiniium", f"Revision:,0\nPoints:,40\nXInc:,{STEP}\nXOrg:,-0.1\nY Units:,Volt\nData:,\n"
     + "".join(f"{value:.5e}\n" for value in FORCE), {"column 1": (25.0, -0.1)}),
    ("Infiniium, with times",
     f"Revision:,0\nXInc:,{STEP}\nXOrg:,-0.1\nY Units:,Volt\nData:,\n" + "".join(
         f"{n * STEP - 0.1:.5e}, {value:.5e}\n" for n, value in enumerate(FORCE)),
     {"column 2": (25.0, -0.1)}),
    ("Tektronix, units as names", "s,Volts1,Volts2\n" + rows(time=lambda n: f"{n * STEP:.3e}"),
     {"Volts1": (25.0, 0.0), "Volts2": (25.0, 0.0)}),
    ("TwinCAT", "Name\tForce\tName\tCurrent\nData-Type\tREAL64\tData-Type\tREAL64\n"
     "SampleTime[ms]\t40\tSampleTime[ms]\t40\nVariableSize\t8\tVariableSize\t8\n\n" + "".join(
         f"{n * 40}\t{FORCE[n]}\t{n * 40}\t{CURRENT[n]}\n" for n in range(COUNT)), BOTH),
    ("Siglent, two channels",
     "Record Length,Analog:40\nSample Rate,25.0\nVertical Scale,CH1: 0.05 CH2: 1.0\n"
     "Horizontal Scale, 0.2000000\nSecond,Volt,Volt\n" + rows(time=seconds),
     {"Volt": (25.0, 0.0), "Volt (2)": (25.0, 0.0)}),
    ("Keysight", "x-axis,1,2\nsecond,Volt,Volt\n" + rows(time=lambda n: f"{n * STEP:+.5E}"),
     {"1": (25.0, 0.0), "2": (25.0, 0.0)}),
    ("Tektronix",
     "Model,MSO54\nLabel,,\nHorizontal Units,s\nSample Interval,4e-2\nRecord Length,40\n"
     "Vertical Units,kN,A\n,,\nTIME,Force,Current\n" + rows(time=seconds), BOTH),
    ("Tektronix, older", "".join(
        f"{head},{n * STEP:.5f},{FORCE[n]}\n" for n, head in enumerate(
            ["Record Length,40,Points", "Sample Interval,4.0e-02,s", "Trigger Point,0,Samples",
             *[",,"] * (COUNT - 3)])), {"column 2": (25.0, 0.0)}),
    ("Tektronix, older, with a blank column", "".join(
        f"{head},{n * STEP:.5f},{FORCE[n]},\n" for n, head in enumerate(
            ["Record Length,40,", "Sample Interval,4.0e-02,", "Trigger Point,0,",
             *[",,"] * (COUNT - 3)])), {"column 2": (25.0, 0.0)}),
    ("directions that are numbers",
     "Sample rate: 25 Hz\nDirection,Force\n" + "".join(
         f"{5 + n * 1e-7:.9f},{FORCE[n]}\n" for n in range(COUNT)),
     {"Direction": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("Campbell",
     '"TOA5","SITE","CR6"\n"TIMESTAMP","RECORD","Force","Current"\n"TS","RN","kN","A"\n'
     '"","","Smp","Smp"\n' + rows(time=lambda n: f'"{moment("%Y-%m-%d %H:%M:%S.%f")(n)}",{n}'),
     BOTH),
    ("catman", "Time  1 - default sample rate\tForce\tCurrent\ns\tkN\tA\nSG bridge\tMX840\tMX411\n"
     + rows("\t", time=seconds), BOTH),
    ("Siglent",
     "Record Length,Analog:40\nVertical Scale,CH1:0.50\nSource,Force,Current\n"
     "Second,Volt,Volt\n" + rows(time=lambda n: f"{n * STEP:.7e}"), BOTH),
    ("LeCroy",
     "LECROYWS,1,Waveform\nSegments,1,SegmentSize,40\nSegment,TrigTime,TimeSinceSegment1\n"
     "#1,28-Nov-2026 08:14:00,0\nTime,Force,Current\n" + rows(time=seconds), BOTH),
    ("HIOKI",
     '"COMMENT",""\n"NUM_SIGS", 3\n"INTERVAL", 4.0E-02\n"VERT_UNITS", "S", "kN", "A"\n'
     '"SIGNAL", "TIME", "Force", "Current"\n"DATA"\n' + rows(", ", time=seconds), BOTH),
    ("Yokogawa",
     '"Model Name","DL850"\n"TraceName","Force","Current"\n"BlockSize",40,40\n"VUnit","kN","A"\n'
     '"HResolution",4.0e-02,4.0e-02\n"HOffset",0.0,0.0\n"HUnit","s","s"\n'
     + "".join(f",{FORCE[n]},{CURRENT[n]}\n" for n in range(COUNT)), BOTH),
    ("Graphtec",
     "Vendor,Graphtec Corporation\nSampling interval,40ms\nNumber,Date&Time,ms,Force,Current\n"
     "NO.,Time,ms,kN,A\n" + rows(time=lambda n: f"{n + 1},{moment('%Y/%m/%d %H:%M:%S,%f')(n)}"),
     BOTH),
    ("catman, two rates",
     "Time  1 - default sample rate\tForce\tTime  2 - slow sample rate\tCurrent\ns\tkN\ts\tA\n"
     + "".join(f"{n * STEP:.2f}\t{FORCE[n]}\t"
               + (f"{n * 0.2:.1f}\t{CURRENT[n]}\n" if n < 8 else "\t\n") for n in range(COUNT)),
     {"Force": (25.0, 0.0), "Current": (5.0, 0.0)}),
    ("catman with its start",
     "T0\t28.11.2026 08:14:00\nZeit  1 - Standardmessrate\tForce\tCurrent\ns\tkN\tA\n"
     "S1\tS2\tS3\n" + rows("\t", time=seconds), BOTH),
    ("Beckhoff",
     "Name\tTrace\nName\tForce\tName\tCurrent\nSampleTime[ms]\t40\tSampleTime[ms]\t40\n"
     "Unit\tkN\tUnit\tA\n\n" + "".join(
         f"{n * 40}\t{FORCE[n]}\t{n * 40}\t{CURRENT[n]}\n" for n in range(COUNT)), BOTH),
    ("Instek, a trailing comma", "Source,CH1\nSampling Period,4.000E-02\nMode,Detail\nForce,\n"
     + "".join(f"{value},\n" for value in FORCE), {"Force": (25.0, 0.0)}),
    ("Yokogawa, two blocks",
     ('"TraceName","Force","Current"\n"HResolution",4.0e-02,4.0e-02\n' + "".join(
         f",{FORCE[n]},{CURRENT[n]}\n" for n in range(COUNT))) * 2,
     ("a second table begins at line 43",)),
    ("facts in rows above a wider table", "1,2\n3,4\n5,6\n" + HEAD + rows(time=seconds), BOTH),
    ("second table, wider", "Time (s),Force\n" + "".join(
        f"{n * STEP:.2f},{f}\n" for n, f in enumerate(FORCE[:30])) + "\n" + HEAD
     + rows(time=seconds), ("holds tables of different widths",)),
    ("footer", HEAD + rows(time=seconds) + "Mean,0.1,2.5\nMax,1.4,6.4\n", BOTH),
    ("second table", HEAD + rows(time=seconds) + "\n" + HEAD + rows(time=seconds),
     ("a second table begins at line",)),
    ("LabVIEW, no times",
     "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tNo\n"
     "***End_of_Header***\t\n\t\nChannels\t2\t\nY_Unit_Label\tkN\tA\nX0\t0.0\t0.0\n"
     "Delta_X\t0.04\t0.04\n***End_of_Header***\t\t\nForce\tCurrent\tComment\n" + rows("\t"), BOTH),
    ("LabVIEW, starts",
     "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tNo\n"
     "***End_of_Header***\t\n\t\nChannels\t2\t\nDate\t2026/11/28\t2026/11/28\n"
     "Time\t08:14:00\t08:14:01.5\nX0\t0.0\t0.0\nDelta_X\t0.04\t0.04\n"
     "***End_of_Header***\t\t\nForce\tCurrent\tComment\n" + rows("\t"),
     {"Force": (25.0, 0.0), "Current": (25.0, 1.5)}),
    ("LabVIEW over a frequency",
     "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\n"
     "Channels\t2\t\nX_Dimension\tFrequency\tFrequency\nX0\t0.0\t0.0\nDelta_X\t0.04\t0.04\n"
     "***End_of_Header***\t\t\nForce\tCurrent\tComment\n" + rows("\t"),
     ("recorded over frequency, not over time",)),
]  # fmt: skip

stamp = moment("%Y-%m-%d %H:%M:%S", step=0.25)

THROWS: list[Kind] = [
    ("throws: number",
     "throw,Time (s),Force,Current\n" + "".join(
         rows(time=lambda n, k=k: f"{k},{seconds(n)}", count=20) for k in (1, 2)),
     ("2 throws in one table (column 'throw')",)),
    *((f"throws: curves with {mark!r} behind texts", "Sample rate: 25 Hz\nthrow\tdirection\tpower\n"
       + "".join(f"T{k}\tN\t{mark.join(f'{v:.1f}' for v in CURRENT)}\n" for k in (1, 2, 3)),
       ("3 throws in one table (column 'throw'): 'T1', 'T2', 'T3'",)) for mark in ",;|"),
    ("throws: long numbers",
     "throw,Time (s),Force,Current\n" + "".join(
         rows(time=lambda n, k=k: f"{10_000_001 + k},{(n + 20 * k) * STEP:.2f}", count=20)
         for k in (0, 1)),
     ("2 throws in one table (column 'throw'): '10000001', '10000002'",)),
    ("throws: time starts again", HEAD + rows(time=seconds, count=20) * 2,
     ("2 throws in one table ('Time' starts again)",)),
    ("throws: index starts again",
     "Rate: 25 Hz\nindex,Force,Current\n" + rows(time=str, count=20) * 2,
     ("2 throws in one table ('index' starts again)",)),
    ("throws: curve in a cell",
     "id;direction;power\n" + "".join(
         f"{k};N;{','.join(f'{v:.1f}' for v in CURRENT)}\n" for k in (1, 2, 3)),
     ("3 throws in one table",)),
    ("throws: curves in rows",
     f"id,direction,{','.join(f'p{n}' for n in range(COUNT))}\n" + "".join(
         f"{k},N,{','.join(map(str, CURRENT))}\n" for k in (1, 2, 3)), ("3 throws in one",)),
    ("throws: direction changes", "Rate: 25 Hz\ndirection,Force,Current\n" + rows(
        time=lambda n: "N" if n < 20 else "R"), ("2 throws in one table (column 'direction'",)),
    ("throws: curve between bars", "id,power\n" + "".join(
        f"{k},{'|'.join(f'{v:.1f}' for v in CURRENT)}\n" for k in (1, 2, 3)), ("3 throws in one",)),
    ("throws: long table of numbers", "time,channel,value\n" + "".join(
        f"{n * STEP:.2f},{k},{values[n]}\n" for n in range(COUNT)
        for k, values in ((1, FORCE), (2, CURRENT))),
     {"channel 1": (25.0, 0.0), "channel 2": (25.0, 0.0)}),
    ("throws: a state beside times that repeat", "Time (s),Position,State\n" + "".join(
        f"{n // 2 * STEP:.2f},{FORCE[n]},{n % 2}\n" for n in range(COUNT)),
     ("column 'Time': 20 of its 40 times repeat",)),
    ("throws: a state next to times that repeat", "Time (s),State,Position\n" + "".join(
        f"{n // 2 * STEP:.2f},{n % 2},{FORCE[n]}\n" for n in range(COUNT)),
     ("column 'Time': 20 of its 40 times repeat",)),
    ("throws: numbers beside a rate", "Sample rate: 4 Hz\nTime,Drive,Force,Current\n" + "".join(
        f"{stamp(n)},{n % 2},{FORCE[n]},{CURRENT[n]}\n" for n in range(COUNT)),
     dict.fromkeys(("Drive", "Force", "Current"), (4.0, 0.0))),
    ("throws: long table of numbered machines", "time,machine,value\n" + "".join(
        f"{n * STEP:.2f},{k},{values[n]}\n" for n in range(COUNT)
        for k, values in ((1, FORCE), (2, CURRENT))),
     {"machine 1": (25.0, 0.0), "machine 2": (25.0, 0.0)}),
    ("throws: long table of two quantities", "time,machine,I (A),P (W)\n" + "".join(
        f"{n * STEP:.2f},{k},{CURRENT[n]},{FORCE[n]}\n" for n in range(COUNT) for k in ("A", "B")),
     {f"{k} {q}": (25.0, 0.0) for k in "AB" for q in "IP"}),
    ("throws: long table",
     "time,signal,value\n" + "".join(
         f"{n * STEP:.2f},{name},{values[n]}\n" for n in range(COUNT)
         for name, values in (("Force", FORCE), ("Current", CURRENT))), BOTH),
]  # fmt: skip

TEXTS: list[Kind] = [*RATES, *TIMES, *STAMPS, *NUMBERS, *LOGGERS, *THROWS]

REMARKS: list[tuple[str, str, tuple[str, ...]]] = [
    ("whole numbers below a statement", "Sample rate,25\n" + "".join(
        f"{n * n % 7},{n * n % 5},{n * n % 13},{n * n % 11}\n" for n in range(COUNT)), ()),
    *((f"{line}, beside times", f"{line}\n{HEAD}{rows(time=seconds)}", ())
      for line in ("Duration: 10 s", "Frequency: 50 Hz", "Clock rate: 1 MHz", "Record time: 10 s")),
    ("rows above the table", "1,2\n3,4\n5,6\n" + HEAD + rows(time=seconds),
     ("3 rows of numbers above the table are left out",)),
    ("numbers for channels", "time,machine,value\n" + "".join(
        f"{n * STEP:.2f},{k},{FORCE[n]}\n" for n in range(COUNT) for k in (1, 2)),
     ("column 'machine' is taken for the number of the channel",)),
    ("times in whole seconds beside a rate", "Sample rate: 25 Hz\nTime;Force\n" + "".join(
        f"{n // 25};{f}\n" for n, f in enumerate(FORCE)),
     ("column 'Time' is not used, the stated rate is: 38 of its 40 times repeat, the first is 0 s: "
      "coarser than the samples, they tell no rate; state the sample rate, or export times with "
      "more digits", "channel 'Force': its times only tell its start")),
    *((f"{text} in a cell", "Time (s),Force\n" + "".join(
        f"{n * STEP:.2f},{text if n == 3 else FORCE[n]}\n" for n in range(COUNT)), (remark,))
      for text, remark in (
          ("1.#IND00", "channel 'Force': 1 cell is empty, taken as missing"),
          ("-1.#QNAN", "channel 'Force': 1 cell is empty, taken as missing"),
          ("1.#INF", "channel 'Force': 1 cell is overload ('1.#INF'), taken as missing"))),
]  # fmt: skip
"""Texts that are read, and all that is said about them."""
