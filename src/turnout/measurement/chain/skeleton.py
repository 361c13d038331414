"""A channel map to start from, guessed from the names and units of a recording's columns."""

import json
import re
from collections.abc import Iterator

from turnout.measurement.chain.channel_map import raw_unit
from turnout.measurement.recording import RecordedChannel, Recording

_CLAMP = re.compile(r"clamp|current|strom|stromzange|amp\b|\bi ?\d\b", re.IGNORECASE)
_CELL = re.compile(r"cell|object|dose|kraftaufnehmer", re.IGNORECASE)
_ROD = re.compile(r"rod|strain|bridge|force|stange|dms|stag|drive", re.IGNORECASE)
_NUMBER = re.compile(r"\d+")

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
# A sensor calibrated by known loads: kind = "calibrated",
#   readings = { unit = "mV/V", values = [0.0, 0.25] }, loads = { unit = "kN", values = [0, 4] }
# What the recorder does to all forces, here above the first table:
#   recorded_filter = { kind = "butterworth", order = 2, corner = "6 Hz" }
#   recorded_average = "0.1 s"                 mean over the time before each sample
"""


def skeleton(recording: Recording) -> str:
    """Return a channel map (TOML) for a recording, to be edited.

    Columns that no rule recognises stand in it as comments.

    Examples
    --------
    >>> import numpy as np
    >>> rod = RecordedChannel("Rod 2", "mV/V", np.zeros(3), rate=1000.0)
    >>> print(skeleton(Recording({"Rod 2": rod}, "throw.csv")).splitlines()[11])
    [drive_force.2]
    """
    taken: set[str] = set()
    blocks = [HEAD, "\n".join(_blocks(recording, taken))]
    if not taken:
        blocks.append(
            "# No column looks like a drive rod, a clamp or a load cell. Begin with:\n"
            '# [drive_force.1]\n# column = "..."\n'
            + "".join(f"# {line}\n" for line in _ROD_KEYS.splitlines())
        )
    return "\n".join(block for block in blocks if block)


def _blocks(recording: Recording, taken: set[str]) -> Iterator[str]:
    unused = []
    for channel in recording.channels.values():
        quantity, keys = _guess(channel)
        if not quantity:
            unused.append(channel)
            continue
        key = _key(quantity, channel.name, taken)
        if key is None:
            unused.append(channel)
            continue
        taken.add(key)
        unit = f"unit = {json.dumps(channel.unit)}\n" if channel.unit else ""
        column = json.dumps(channel.name, ensure_ascii=False)
        yield f"[{key}]\ncolumn = {column}\n{unit}{keys}"
    for channel in unused:
        unit = f" in {channel.unit}" if channel.unit else ", unit unknown"
        shown = json.dumps(channel.name, ensure_ascii=False)
        yield f"# not used: column {shown}{unit}"


def _guess(channel: RecordedChannel) -> tuple[str, str]:
    """Return quantity and sensor keys of a column; empty if it is none of ours."""
    try:
        kind = raw_unit(channel.unit).dimension.name if channel.unit else ""
    except ValueError:
        return "", ""
    if kind == "current":
        return "drive_current", _SCALED_KEYS
    if kind == "force":
        return ("object_force" if _CELL.search(channel.name) else "drive_force"), _SCALED_KEYS
    amplified = _AMPLIFIED_KEYS if kind == "voltage" else ""
    missing = "" if kind else 'unit = "mV/V"  # assumption: the file does not state it\n'
    if _CELL.search(channel.name) and kind != "strain":
        return "object_force", missing + _CELL_KEYS + amplified
    if _CLAMP.search(channel.name) and kind in ("voltage", ""):
        return "drive_current", missing.replace("mV/V", "V") + _CLAMP_KEYS
    if kind in ("voltage ratio", "strain") or _ROD.search(channel.name):
        return "drive_force", missing + _ROD_KEYS + amplified
    return "", ""


def _key(quantity: str, name: str, taken: set[str]) -> str | None:
    """Return a free key: the drive's number is the last in the name, else the next free one."""
    if quantity == "object_force":
        return quantity if quantity not in taken else None
    numbers = _NUMBER.findall(name)
    wanted = f"{quantity}.{numbers[-1]}" if numbers else ""
    if wanted and wanted not in taken:
        return wanted
    number = 1
    while f"{quantity}.{number}" in taken:
        number += 1
    return f"{quantity}.{number}"
