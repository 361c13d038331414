"""Histories as CSV text: `read_history` reads another program's, `history_text` writes ours.

There is a column for each channel. The first line names the columns, each with its unit:
``time [s]``, ``drive_force:1 [kN]``, ``sensor_gap:TKK1 [mm]``, ``object_force [N]``. Lines that
begin with # are comments. Times rise; they need not be even. Signs are those of a dataset.
"""

from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.channels import check_schema, label
from turnout.core.errors import FileError, refused_of
from turnout.core.problems import choices, nearest
from turnout.core.sheet_rows import sheet_rows
from turnout.core.toml import decode, read_bytes
from turnout.core.units import FORCE, LENGTH, TIME, Dimension, unit_factor
from turnout.core.value_text import shown_unit
from turnout.measurement.formats.assemble import split_unit

Floats = NDArray[np.float64]

# Channels that a figure of a throw shows: what they belong to, and their dimension.
READ: dict[str, tuple[str | None, Dimension]] = {
    "drive_force": ("drive", FORCE),
    "drive_displacement": ("drive", LENGTH),
    "drive_gap": ("drive", LENGTH),
    "sensor_gap": ("sensor", LENGTH),
    "object_force": (None, FORCE),
}
MOST_FILE_BYTES = 500_000_000
# Bytes in which the line of names must be.
MOST_HEADER_BYTES = 20_000
MOST_PROBLEMS = 12


def is_history(path: Path | str) -> bool:
    """Return True if a file begins like a history: a line of names, all of them known channels."""
    with Path(path).open("rb") as file:
        head = file.read(MOST_HEADER_BYTES).decode("utf-8-sig", errors="replace")
    lines = [line for line in head.splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        return False
    cells = [split_unit(cell)[0] for cell in lines[0].replace(";", ",").split(",")]
    names = [cell.partition(":")[0].strip().lower() for cell in cells]
    return names[0] == "time" and len(names) > 1 and set(names[1:]) <= set(READ)


def read_history(path: Path | str) -> xr.Dataset:
    """Read the history of another program as a dataset.

    Parameters
    ----------
    path : path-like
        A CSV file, columns parted by commas or semicolons.

    Returns
    -------
    xarray.Dataset
        In SI; ``attrs["title"]`` is the name of the file. NaN where a column says so.

    Raises
    ------
    FileError
        With everything that is wrong with the file.
    """
    file = Path(path)
    text = decode(read_bytes(file, largest=MOST_FILE_BYTES), source=str(file))
    with refused_of(file):
        _, lines = sheet_rows(text)
    if len(lines) < 3:
        message = f"{file}: needs a line of names and at least two lines of numbers"
        raise FileError(message)
    names, factors, problems = _columns(lines[0][1])
    values, found = _numbers(lines[1:], len(lines[0][1]))
    problems += found
    if not problems:
        time = values[:, names.index(("time", ""))]
        if not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0):
            at = int(np.argmin(np.diff(time) > 0)) + 1
            problems.append(f"line {lines[1 + at][0]}: time must rise from line to line")
    if problems:
        more = len(problems) - MOST_PROBLEMS
        shown = problems[:MOST_PROBLEMS] + ([f"and {more} more"] if more > 0 else [])
        raise FileError("\n  - ".join((f"{file}: cannot be read", *shown)))
    return _dataset(names, values * np.array(factors), title=file.name)


def _columns(heading: list[str]) -> tuple[list[tuple[str, str]], list[float], list[str]]:
    """Return channel and member of each column, its factor to SI, and the faults of columns."""
    names: list[tuple[str, str]] = []
    factors: list[float] = []
    problems: list[str] = []
    for cell in heading:
        name, unit = split_unit(cell)
        channel, _, member = (part.strip() for part in name.partition(":"))
        key = (channel.lower(), member)
        names.append(key)
        factors.append(1.0)
        problem = _problem_of(key)
        if problem is None and key in names[:-1]:
            problem = "stands twice"
        dimension = TIME if key[0] == "time" else READ.get(key[0], (None, TIME))[1]
        if problem is None and not unit:
            problem = f"has no unit; write it behind the name, such as '{name} [{dimension.unit}]'"
        if problem is None:
            try:
                factors[-1] = unit_factor(unit, dimension)
            except ValueError as error:
                problem = str(error)
        if problem is not None:
            problems.append(f"column '{cell.strip()}': {problem}")
    if ("time", "") not in names:
        problems.insert(0, "there is no column 'time [s]'")
    if len(names) - names.count(("time", "")) < 1:
        problems.append(f"there is no channel; allowed are {choices(READ)}")
    return names, factors, problems


def _problem_of(key: tuple[str, str]) -> str | None:
    channel, member = key
    if channel == "time":
        return f"time has no member '{member}'" if member else None
    if channel not in READ:
        return f"no such channel{nearest(channel, READ)}; allowed are time, {choices(READ)}"
    family = READ[channel][0]
    if family is not None and not member:
        return f"which {family}? write its name after a colon, such as '{channel}:1'"
    if family is None and member:
        return f"{channel} has no member; leave ':{member}' out"
    return None


def _numbers(lines: list[tuple[int, list[str]]], width: int) -> tuple[Floats, list[str]]:
    """Return the numbers and the faults of their lines."""
    values = np.full((len(lines), width), np.nan)
    problems: list[str] = []
    for at, (number, row) in enumerate(lines):
        if len(row) != width:
            problems.append(f"line {number}: {len(row)} cells, must be {width}")
            continue
        for column, cell in enumerate(row):
            try:
                values[at, column] = float(cell) if cell else np.nan
            except ValueError:
                problems.append(f"line {number}: '{cell}' is not a number")
    return values, problems


def _dataset(names: list[tuple[str, str]], values: Floats, *, title: str) -> xr.Dataset:
    time = values[:, names.index(("time", ""))]
    members: dict[str, list[str]] = {}
    for channel, member in names:
        family = READ[channel][0] if channel in READ else None
        if family is not None and member not in members.setdefault(family, []):
            members[family].append(member)
    variables: dict[str, tuple[tuple[str, ...], Floats]] = {}
    for column, (channel, member) in enumerate(names):
        if channel == "time":
            continue
        family = READ[channel][0]
        if family is None:
            variables[channel] = (("time",), values[:, column].copy())
            continue
        blank = np.full((len(members[family]), time.size), np.nan)
        _, table = variables.setdefault(channel, ((family, "time"), blank))
        table[members[family].index(member)] = values[:, column]
    coordinates = {
        "time": ("time", time),
        **{family: (family, np.array(found, dtype=np.str_)) for family, found in members.items()},
    }
    dataset = check_schema(label(xr.Dataset(variables, coordinates)))
    return dataset.assign_attrs(title=title, kind="computed elsewhere")


DIGITS = 10


def history_text(dataset: xr.Dataset) -> str:
    """Return the channels of a run that figures show, a column each.

    Parameters
    ----------
    dataset : xarray.Dataset
        Simulated or measured; columns without a number are left out.

    Returns
    -------
    str
        Comma-separated, the first line names columns with units: ``time [s]``,
        ``drive_force:1 [kN]``. Empty cells stand for NaN.

    Examples
    --------
    >>> run = xr.Dataset({"object_force": ("time", [0.0, 1500.0])}, {"time": [0.0, 0.5]})
    >>> history_text(run).splitlines()
    ['time [s],object_force [kN]', '0,0', '0.5,1.5']
    """
    names, columns = ["time [s]"], [dataset["time"].values]
    for channel, (family, dimension) in READ.items():
        if channel not in dataset:
            continue
        unit, factor = shown_unit(dimension.unit)
        members = [None] if family is None else dataset[family].values.tolist()
        for member in members:
            values = dataset[channel] if member is None else dataset[channel].sel({family: member})
            if np.isnan(values.values).all():
                continue
            own = "" if member is None else f":{member}"
            names.append(f"{channel}{own} [{unit}]")
            columns.append(values.values / factor)
    table: Floats = np.stack(columns, axis=1)
    lines = [",".join(names)]
    lines += [",".join(_number(value) for value in row) for row in table.tolist()]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    # Adding zero turns a negative zero into a plain one.
    return "" if value != value else f"{value + 0.0:.{DIGITS}g}"
