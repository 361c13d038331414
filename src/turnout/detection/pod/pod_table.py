"""The table of a test campaign: a row a throw, with size, response or hit, and switch.

The format is described in docs/use/pod.md.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import StudyError
from turnout.core.problems import choices, nearest, show_value
from turnout.core.sheet_rows import sheet_rows
from turnout.core.toml import decode, read_bytes
from turnout.core.units import DIMENSIONS, Dimension, parse_quantity, unit_factor
from turnout.measurement.campaign.run_sheet import object_size, parse_yes_no

Floats = NDArray[np.float64]
T = TypeVar("T")
D = TypeVar("D")

COLUMNS = ("size", "response", "hit", "switch", "place", "simulated", "remark")
HITS = {"hit": "yes", "miss": "no"}
_HEADING = re.compile(r"\s*([^\[]*?)\s*(?:\[(.*)\])?\s*\Z")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TestThrows:
    """Throws of a test campaign.

    Attributes
    ----------
    size : ndarray, shape (n_throws,)
        Of the object, 0 for a sound throw [m].
    response : ndarray, shape (n_throws,), or None
        What the detector compares with its threshold; NaN where only hit or miss is known.
    hit : ndarray of bool, shape (n_throws,), or None
        Whether it gave an alarm.
    switch : tuple of str
        Name of the switch of each throw.
    simulated : ndarray of bool, shape (n_throws,)
        Throws of a model.
    unit : str
        Of the response; empty if it has none.
    source : str
        Where the table came from.
    """

    size: Floats
    response: Floats | None
    hit: NDArray[np.bool_] | None
    switch: tuple[str, ...]
    simulated: NDArray[np.bool_]
    unit: str = ""
    source: str = "table"

    __test__ = False


def read_test_throws(path: Path | str) -> TestThrows:
    r"""Read the table of a test campaign.

    Parameters
    ----------
    path : path-like
        CSV with a heading; separators are comma, semicolon or tab.

    Raises
    ------
    StudyError
        With everything that is wrong in it.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "results.csv"
    >>> _ = file.write_text("size [mm],hit,switch\n5,miss,12\n13,hit,12\n")
    >>> throws = read_test_throws(file)
    >>> throws.size.tolist(), throws.hit.tolist()
    ([0.005, 0.013], [False, True])
    """
    path = Path(path)
    text = decode(read_bytes(path), source=str(path))
    try:
        _, lines = sheet_rows(text)
    except ValueError as error:
        raise StudyError([str(error)], source=str(path)) from None
    if not lines:
        raise StudyError(["has no line with the names of the columns"], source=str(path))
    header = [_column(cell) for cell in lines[0][1]]
    problems = _heading_problems([name for name, _ in header])
    if problems:
        raise StudyError(problems, source=str(path))
    rows = []
    for number, cells in lines[1:]:
        if len(cells) > len(header):
            problems.append(f"line {number}: has {len(cells)} cells, the heading {len(header)}")
        rows.append((number, dict(zip((name for name, _ in header), cells, strict=False))))
    units = {name: unit or "" for name, unit in header}
    found = _throws(rows, units, problems, source=str(path))
    if problems or found is None:
        raise StudyError(problems or ["names no throw"], source=str(path))
    return found


def _column(cell: str) -> tuple[str, str | None]:
    match = _HEADING.match(cell)
    return (match[1].strip().lower(), match[2]) if match else (cell.strip().lower(), None)


def _heading_problems(names: Sequence[str]) -> list[str]:
    problems = [
        f"column {show_value(name)}: unknown{nearest(name, COLUMNS)}; allowed are "
        f"{choices(COLUMNS)}"
        for name in names
        if name not in COLUMNS
    ]
    problems += [f"column {name}: appears twice" for name in COLUMNS if names.count(name) > 1]
    if "size" not in names:
        problems.append("column size: missing; give the size of the object, 0 for a sound throw")
    if "response" not in names and "hit" not in names:
        problems.append("column response or hit: missing; give what the detector said")
    return problems


def _throws(
    rows: Sequence[tuple[int, Mapping[str, str]]],
    units: Mapping[str, str],
    problems: list[str],
    *,
    source: str,
) -> TestThrows | None:
    """Return the throws; what is wrong with a cell is added to the problems."""
    size: list[float | None] = []
    response: list[float] = []
    hit: list[bool | None] = []
    switch: list[str] = []
    simulated: list[bool] = []
    length = units.get("size", "")
    for number, row in rows:
        cells = _Cells(number=number, row=row, problems=problems)
        size.append(cells.read("size", partial(_size, unit=length), None))
        response.append(cells.read("response", _number, float("nan")))
        hit.append(cells.read("hit", _hit, None))
        switch.append(row.get("switch") or "1")
        simulated.append(cells.read("simulated", parse_yes_no, False))
        if not row.get("size"):
            problems.append(f"line {number}: has no size; 0 is a sound throw")
        if not row.get("response") and not row.get("hit"):
            problems.append(f"line {number}: has neither response nor hit")
    if problems or not rows:
        return None
    known_hits = "hit" in units and all(item is not None for item in hit)
    return TestThrows(
        size=np.array(size, dtype=np.float64),
        response=np.array(response, dtype=np.float64) if "response" in units else None,
        hit=np.array(hit, dtype=np.bool_) if known_hits else None,
        switch=tuple(switch),
        simulated=np.array(simulated, dtype=np.bool_),
        unit=units.get("response", ""),
        source=source,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cells:
    """A row whose cells are read; what is wrong with one is added to the problems."""

    number: int
    row: Mapping[str, str]
    problems: list[str]

    def read(self, name: str, how: Callable[[str], T], default: D) -> T | D:
        """Return a cell, or the default where it is empty or wrong."""
        cell = self.row.get(name, "")
        if not cell:
            return default
        try:
            return how(cell)
        except ValueError as error:
            self.problems.append(f"line {self.number}: {name} = {show_value(cell)}: {error}")
            return default


def _hit(cell: str) -> bool:
    return parse_yes_no(HITS.get(cell.lower(), cell))


def _size(cell: str, *, unit: str) -> float:
    bare = re.fullmatch(r"[-+]?[\d.,]+", cell)
    return object_size(f"{cell.replace(',', '.')} {unit}" if bare and unit else cell)


def response_value(text: str, *, throws: TestThrows) -> float:
    """Return a response given on its own, such as a threshold, in the unit of the table.

    Parameters
    ----------
    text : str
        A number, in the unit of the table, or with a unit of the same dimension.
    throws : TestThrows
        Whose responses it is compared with.

    Raises
    ------
    ValueError
        Saying what it must be.
    """
    bare = re.fullmatch(r"\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    if bare is None or not bare[2]:
        return _number(text.strip())
    known = next((item for item in DIMENSIONS if _is_of(throws.unit, item)), None)
    if known is None:
        message = (
            f"must be a number without a unit, since {throws.source} gives responses no known "
            'unit; name it in the heading, as in "response [N]"'
        )
        raise ValueError(message)
    value = parse_quantity(f"{bare[1].replace(',', '.')} {bare[2]}", known)
    return value / unit_factor(throws.unit, known)


def _is_of(unit: str, dimension: Dimension) -> bool:
    try:
        return bool(unit) and unit_factor(unit, dimension) > 0.0
    except ValueError:
        return False


def _number(cell: str) -> float:
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        message = "must be a number"
        raise ValueError(message) from None
    if not np.isfinite(value):
        message = "must be a finite number"
        raise ValueError(message)
    return value
