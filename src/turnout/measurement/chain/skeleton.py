"""A channel map to start from, guessed from the names and units of a recording's columns."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.measurement.chain.channel_map import raw_unit
from turnout.measurement.recording import RecordedChannel, Recording

_QUANTITY = {
    "drive_power": re.compile(r"power|leistung|watt|effekt|\bp ?\d*\b|\bp_", re.IGNORECASE),
    "drive_voltage": re.compile(r"voltage|spannung|volt|spänning|\bu ?\d*\b|\bu_", re.IGNORECASE),
    "drive_current": re.compile(
        r"clamp|current|strom|stromzange|ström|amp\b|\bi ?\d\b|\bi ?[a-cu-w]?\b|\bi_", re.IGNORECASE
    ),
    "object_force": re.compile(r"cell|object|dose|kraftaufnehmer", re.IGNORECASE),
    "drive_force": re.compile(
        r"rod|strain|bridge|force|kraft|stange|dms|stag|drive", re.IGNORECASE
    ),
}
_BY_DIMENSION = {"power": "drive_power", "current": "drive_current"}
# Above this a voltage is that of a supply, not of a bridge or a clamp [V].
_LEAST_SUPPLY = 40.0
# Units that a range suggests where a file states none: the first whose bound it exceeds.
_BY_RANGE = {
    "drive_force": ((200.0, "N"), (0.0, "kN")),
    "object_force": ((200.0, "N"), (0.0, "kN")),
    "drive_current": ((100.0, "mA"), (0.0, "A")),
    "drive_voltage": ((0.0, "V"),),
    "drive_power": ((20.0, "W"), (0.0, "kW")),
}
_PHASE = re.compile(r"(.*?[\s_]*)(L?[1-3]|[a-cA-C]|[u-wU-W]|[r-tR-T])")
_PHASES = ("123", "abc", "uvw", "rst")
# Three clamps are those of three drives.
_CLAMPS = re.compile(r"clamp|zange", re.IGNORECASE)
_NUMBER = re.compile(r"\d+")
_TOGETHER = re.compile(r"(\d+)\s*(?:\+|&|and|und|och)\s*(\d+)")

_ROD_KEYS = """\
kind = "strain bridge"
bridge = "full T"  # or "full bending", "half bending", "quarter"
gauge_factor = 2.1  # assumption: replace by that of your gauges
poisson_ratio = 0.3  # assumption: steel
youngs_modulus = "210 GPa"  # assumption: steel
diameter = "40 mm"  # assumption: replace, or give section_modulus
eccentricity = "60 mm"  # assumption: replace by the distance from the gauges to the force
"""
_CLAMP_KEYS = """\
kind = "clamp"
sensitivity = "100 mV/A"  # assumption: replace by that of your clamp
"""
_CELL_KEYS = """\
kind = "load cell"
sensitivity = "1 mV/V"  # assumption: replace by that of your load cell
capacity = "20 kN"  # assumption: replace by that of your load cell
optional = true  # recordings without the load cell are read as well
"""
_SCALED_KEYS = 'kind = "scaled"  # the column is in its physical unit already\n'
_AMPLIFIED_KEYS = """\
excitation = "10 V"  # assumption: replace; the column is a voltage
gain = 1000.0  # assumption: replace by that of the amplifier
"""
HEAD = """\
# A channel map to edit: which column is which quantity, through what sensor. Each number that is
# marked as an assumption is to be replaced. Other keys, for any sensor:
#   sign = -1                                  turns the direction round (closing is positive)
#   offset = "0.02 mV/V"                       reading at no load
#   tare = { start = "0 s", end = "0.5 s" }    rest whose mean is taken off
#   phases = ["I2", "I3"]                      columns of the other phases of the same drive
# One current or power for the machines of two drives: [drive_current."1+2"].
# A sensor calibrated by known loads: kind = "calibrated",
#   readings = { unit = "mV/V", values = [0.0, 0.25] }, loads = { unit = "kN", values = [0, 4] }
# What the recorder does to all forces, here above the first table:
#   recorded_filter = { kind = "butterworth", order = 2, corner = "6 Hz" }
#   recorded_average = "0.1 s"                 mean over the time before each sample
"""


@dataclass(frozen=True, slots=True)
class _Guess:
    """Quantity of a column, keys of its sensor, and the columns of its other phases."""

    quantity: str
    keys: str
    phases: tuple[str, ...] = ()


def skeleton(recording: Recording) -> str:
    """Return a channel map (TOML) for a recording, to be edited.

    Three currents or voltages whose names end in 1 to 3, a to c or u to w are the phases of one
    drive. A column without a unit is taken as scaled, in the unit that its range suggests. Columns
    that no rule recognises stand in the map as comments.

    Examples
    --------
    >>> import numpy as np
    >>> rod = RecordedChannel("Rod 2", "mV/V", np.zeros(3), rate=1000.0)
    >>> "[drive_force.2]" in skeleton(Recording({"Rod 2": rod}, "throw.csv")).splitlines()
    True
    """
    taken: set[str] = set()
    blocks = [HEAD, "\n".join(_blocks(recording, taken))]
    if not taken:
        blocks.append(
            "# No column looks like a drive rod, a clamp, a power or a load cell. Begin with:\n"
            '# [drive_force.1]\n# column = "..."\n'
            + "".join(f"# {line}\n" for line in _ROD_KEYS.splitlines())
        )
    return "\n".join(block for block in blocks if block)


def _blocks(recording: Recording, taken: set[str]) -> Iterator[str]:
    unused = []
    guesses = {name: _guess(channel) for name, channel in recording.channels.items()}
    guesses = _with_phases(guesses)
    for name, channel in recording.channels.items():
        guess = guesses.get(name)
        if guess is None:
            continue
        key = _key(guess, name, taken) if guess.quantity else None
        if key is None:
            unused.append(channel)
            continue
        taken.add(key)
        unit = f"unit = {json.dumps(channel.unit)}\n" if channel.unit else ""
        phases = f"phases = {json.dumps(guess.phases, ensure_ascii=False)}\n" * bool(guess.phases)
        column = json.dumps(name, ensure_ascii=False)
        yield f"[{key}]\ncolumn = {column}\n{phases}{unit}{guess.keys}"
    for channel in unused:
        unit = f" in {channel.unit}" if channel.unit else ", unit unknown"
        shown = json.dumps(channel.name, ensure_ascii=False)
        yield f"# not used: column {shown}{unit}"


def _with_phases(guesses: dict[str, _Guess]) -> dict[str, _Guess]:
    """Return the guesses with three phases of a drive as one."""
    found = dict(guesses)
    groups: dict[tuple[str, str, str], dict[str, str]] = {}
    for name, guess in guesses.items():
        match = _PHASE.fullmatch(name.strip())
        if match is None or guess.quantity not in ("drive_current", "drive_voltage"):
            continue
        letter = match[2].lower().removeprefix("l")
        series = next((item for item in _PHASES if letter in item), "")
        if _CLAMPS.search(match[1]) is None:
            groups.setdefault((guess.quantity, match[1], series), {})[letter] = name
    for (quantity, _, series), members in groups.items():
        if sorted(members) != sorted(series):
            continue
        first, *others = members.values()
        found[first] = _Guess(quantity, guesses[first].keys, tuple(others))
        for other in others:
            del found[other]
    return found


def _guess(channel: RecordedChannel) -> _Guess:
    """Return quantity and sensor keys of a column; empty if it is none of ours."""
    name = channel.name
    try:
        kind = raw_unit(channel.unit).dimension.name if channel.unit else ""
    except ValueError:
        return _Guess("", "")
    named = next((quantity for quantity, words in _QUANTITY.items() if words.search(name)), "")
    if kind in _BY_DIMENSION:
        return _Guess(_BY_DIMENSION[kind], _SCALED_KEYS)
    is_cell = named == "object_force"
    if kind == "force":
        return _Guess("object_force" if is_cell else "drive_force", _SCALED_KEYS)
    if not kind:
        return _Guess(named, _scaled_by_range(channel, named)) if named else _Guess("", "")
    if kind == "voltage" and _largest(channel.values) > _LEAST_SUPPLY:
        return _Guess("drive_voltage", _SCALED_KEYS)
    amplified = _AMPLIFIED_KEYS if kind == "voltage" else ""
    if is_cell and kind != "strain":
        return _Guess("object_force", _CELL_KEYS + amplified)
    if named == "drive_current" and kind == "voltage":
        return _Guess("drive_current", _CLAMP_KEYS)
    if kind in ("voltage ratio", "strain") or named == "drive_force":
        return _Guess("drive_force", _ROD_KEYS + amplified)
    return _Guess("", "")


def _largest(values: NDArray[np.float64]) -> float:
    there = np.abs(values)
    return float(np.max(there, where=np.isfinite(there), initial=0.0))


def _scaled_by_range(channel: RecordedChannel, quantity: str) -> str:
    """Return the keys of a column without a unit, in the unit that its range suggests."""
    largest = _largest(channel.values)
    bounds = _BY_RANGE[quantity]
    unit = next((unit for bound, unit in bounds if largest > bound), bounds[-1][1])
    return f'unit = "{unit}"  # assumption: the range, up to {largest:.4g}\n{_SCALED_KEYS}'


def _key(guess: _Guess, name: str, taken: set[str]) -> str | None:
    """Return a free key: the drive's number is the last in the name, else the next free one."""
    quantity = guess.quantity
    if quantity == "object_force":
        return quantity if quantity not in taken else None
    together = _TOGETHER.search(name)
    if together and quantity != "drive_force":
        key = f'{quantity}."{together[1]}+{together[2]}"'
        return key if key not in taken else None
    numbers = [] if guess.phases else _NUMBER.findall(name)
    wanted = f"{quantity}.{numbers[-1]}" if numbers else ""
    if wanted and wanted not in taken:
        return wanted
    number = 1
    while f"{quantity}.{number}" in taken:
        number += 1
    return f"{quantity}.{number}"
