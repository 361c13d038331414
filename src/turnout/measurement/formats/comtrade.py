"""COMTRADE records (IEEE C37.111): a configuration (.cfg) and its data (.dat), or both (.cff)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.measurement.formats.assemble import FileColumn, assemble_recording, tidy_unit
from turnout.measurement.formats.extent import Declared
from turnout.measurement.formats.text_dialect import encoding_of
from turnout.measurement.formats.time_axis import rate_remark, stamps_axis
from turnout.measurement.recording import Recording

_WIDTHS = {"BINARY": "<i2", "BINARY32": "<i4", "FLOAT32": "<f4"}
_MISSING = {"ASCII": 99_999, "BINARY": -32_768, "BINARY32": -(2**31)}


@dataclass(frozen=True, slots=True)
class _Configuration:
    """Channels (name, unit, factor, offset), rate, start and kind of the data."""

    analog: list[tuple[str, str, float, float]]
    digital: int
    rates: list[tuple[float, int]]
    start: str | None
    kind: str
    factor: float


def is_comtrade(head: bytes, path: Path) -> bool:
    """Return True for a configuration, or data with a configuration beside them."""
    if path.suffix.lower() == ".dat":
        beside = _beside(path, ".cfg")
        if beside is None:
            return False
        with beside.open("rb") as file:
            head = file.read(600)
    elif path.suffix.lower() not in (".cfg", ".cff"):
        return False
    lines = [line for line in head.decode("latin-1").splitlines() if not line.startswith("---")]
    counts = [cell.strip().upper() for cell in lines[1].split(",")] if len(lines) > 1 else []
    return len(counts) == 3 and counts[1].endswith("A") and counts[2].endswith("D")


def read_comtrade(path: Path) -> Recording:
    """Read the analog channels of a COMTRADE record, in primary or secondary units as stated.

    Raises
    ------
    FileError
        When a part is missing.
    ValueError, IndexError
        When a part does not hold what the configuration says.
    """
    suffix = path.suffix.lower()
    if suffix == ".cff":
        lines, data = _combined(path)
    else:
        files = {part: path if suffix == part else _beside(path, part) for part in (".cfg", ".dat")}
        for part, file in files.items():
            if file is None:
                message = f"{path}: its {part} file is not beside it; put both into one folder"
                raise FileError(message)
        configuration, samples = (file for file in files.values() if file is not None)
        lines, data = _text(configuration.read_bytes()).splitlines(), samples.read_bytes()
    found = _configured(lines)
    Declared(path).add(len(data) // 2)
    times, values = _samples(found, data)
    rate = found.rates[0][0] if found.rates else 0.0
    if len(found.rates) > 1:
        rate = 0.0  # the rate changes within the record; its time stamps hold all
    seconds = times * 1e-6 * found.factor
    columns = [
        FileColumn(
            name,
            np.where(values[:, n] == _MISSING.get(found.kind), np.nan, values[:, n] * a + b),
            tidy_unit(unit),
            rate=rate or None,
            time=None if rate else seconds,
            remark=rate_remark(seconds, rate) if rate else "",
        )
        for n, (name, unit, a, b) in enumerate(found.analog)
    ]
    return assemble_recording(columns, source=str(path), start_time=found.start)


def _beside(path: Path, suffix: str) -> Path | None:
    for item in (path.with_suffix(suffix), path.with_suffix(suffix.upper())):
        # A link may lead to any file of the machine.
        if item.is_file() and item.resolve().parent == path.resolve().parent:
            return item
    return None


def _text(content: bytes) -> str:
    return content.decode(encoding_of(content), errors="replace")


def _combined(path: Path) -> tuple[list[str], bytes]:
    """Return the configuration and the data of a combined file."""
    content = path.read_bytes()
    parts: dict[str, bytes] = {}
    for part in content.split(b"--- file type:")[1:]:
        title, _, rest = part.partition(b"\n")
        parts[title.strip(b" -\r").split()[0].decode("latin-1").upper()] = rest
    if "CFG" not in parts or "DAT" not in parts:
        message = f"{path}: lacks its configuration or its data; export it again"
        raise FileError(message)
    return _text(parts["CFG"]).splitlines(), parts["DAT"]


def _configured(lines: list[str]) -> _Configuration:
    rows = [[cell.strip() for cell in line.split(",")] for line in lines if line.strip()]
    analog, digital = int(rows[1][1][:-1]), int(rows[1][2][:-1])
    channels = [(row[1], row[4], float(row[5]), float(row[6])) for row in rows[2 : 2 + analog]]
    at = 2 + analog + digital + 1
    count = int(rows[at][0])
    rates = [(float(row[0]), int(row[1])) for row in rows[at + 1 : at + 1 + max(count, 1)]]
    at += 1 + max(count, 1)
    kind = rows[at + 2][0].upper()
    factor = float(rows[at + 3][0]) if len(rows) > at + 3 and rows[at + 3][0] else 1.0
    rates = [] if count == 0 else [item for item in rates if item[0] > 0]
    return _Configuration(channels, digital, rates, _start(rows[0], rows[at]), kind, factor)


def _start(head: list[str], cells: list[str]) -> str | None:
    """Return the start in ISO 8601; the day comes first from the edition of 1999 on."""
    if not (head[-1].isdigit() and int(head[-1]) >= 1999):
        return None
    try:
        return stamps_axis([" ".join(cells[:2]).replace("/", ".")]).start_time
    except ValueError:
        return None


def _samples(found: _Configuration, data: bytes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the time stamps in steps of the record, and the samples before they are scaled."""
    count = len(found.analog)
    if found.kind == "ASCII":
        rows = [line.split(",") for line in _text(data).split("\n") if line.strip(" \r\x1a")]
        numbers = np.array(
            [[float(cell.strip() or "nan") for cell in row[1 : count + 2]] for row in rows]
        )
        return numbers[:, 0], numbers[:, 1:]
    width = _WIDTHS.get(found.kind, "")
    if not width:
        message = f"its data are of the unknown kind '{found.kind}'"
        raise ValueError(message)
    states = ("d", "<u2", (-(-found.digital // 16),))
    row = np.dtype([("n", "<u4"), ("t", "<u4"), ("v", width, (count,)), states])
    held = np.frombuffer(data[: len(data) // row.itemsize * row.itemsize], row)
    return held["t"].astype(np.float64), held["v"].astype(np.float64)
