"""Read recordings as other programs write them, for docs/evidence.

    python -m benchmarks.studies.recordings [FOLDER ...]

The recordings of `tests/unit/recording_kinds.py` and `tests/unit/recording_files.py` must come out
right or be refused with the true reason. Folders hold public test files, such as the unpacked
source packages of npTDMS, asammdf, mat-io and pymatreader; each channel that is read is compared
with the native library of its format, where that is installed.
"""

import argparse
import re
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tests.unit import recording_files, recording_kinds
from tests.unit.test_measurement_kinds import check

from benchmarks.page import write_section
from benchmarks.studies.quality_sweep import PAGE, RECORDINGS
from turnout.core.errors import FileError
from turnout.measurement.formats.file_format import read_recording, recognise_format
from turnout.measurement.recording import RecordedChannel

TEXTS = {
    "rate or interval stated in words": recording_kinds.RATES,
    "columns of times": recording_kinds.TIMES,
    "time stamps": recording_kinds.STAMPS,
    "numbers, units, headings": recording_kinds.NUMBERS,
    "loggers and oscilloscopes": recording_kinds.LOGGERS,
    "several throws in one table": recording_kinds.THROWS,
}
BY_SUFFIX = {
    ".json": "JSON",
    ".jsonl": "JSON",
    ".xls": "workbooks, HTML",
    ".xlsx": "workbooks, HTML",
    ".mat": "MATLAB, Simulink",
    ".h5": "HDF5, netCDF",
    ".nc": "HDF5, netCDF",
    **dict.fromkeys((".tdms", ".mf4", ".parquet"), "TDMS, MDF, Parquet"),
}
OTHERS = "COMTRADE, UFF, others"
FOREIGN = 100
"""Files that are none of the formats."""

Native = Iterator[tuple[str, np.ndarray, np.ndarray | None]]
"""Name, samples and times [s] of each channel, as a native library gives them."""


def outcomes(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the kind of each recording and what came of it: right, refused or wrong."""
    rows: list[tuple[str, str, Callable[[Path], object], Any]] = []
    for kind, texts in TEXTS.items():
        for _, text, expected in texts:
            suffix = ".lvm" if text.startswith("LabVIEW") else ".csv"
            rows.append((f"text: {kind}", suffix, partial(_write_text, text=text), expected))
    for _, suffix, write, expected in recording_files.FILES:
        rows.append((BY_SUFFIX.get(suffix, OTHERS), suffix, write, expected))
    for number, (kind, suffix, write, expected) in enumerate(rows):
        path = folder / f"{number}" / f"throw{suffix}"
        path.parent.mkdir()
        write(path)
        try:
            check(path, expected)
        except (AssertionError, FileError):
            yield kind, "wrong"
        else:
            yield kind, "refused" if isinstance(expected, tuple) else "right"


def _write_text(path: Path, *, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def tdms_channels(path: Path) -> Native:
    """Yield the channels of a TDMS file by npTDMS."""
    import nptdms

    for group in nptdms.TdmsFile.read(path).groups():
        for channel in group.channels():
            step, values = channel.properties.get("wf_increment"), channel[:]
            yield channel.name, values, step * np.arange(len(values)) if step else None


def mdf_channels(path: Path) -> Native:
    """Yield the channels of an MDF file by asammdf."""
    import asammdf

    with asammdf.MDF(path) as file:
        for signal in file.iter_channels(skip_master=True):
            yield signal.name, signal.samples, signal.timestamps


def comtrade_channels(path: Path) -> Native:
    """Yield the analog channels of a COMTRADE record by comtrade."""
    import comtrade

    record = comtrade.load(str(path))
    for name, values in zip(record.analog_channel_ids, record.analog, strict=True):
        yield name, np.asarray(values), np.asarray(record.time)


def hdf5_channels(path: Path) -> Native:
    """Yield the numeric datasets of an HDF5 file by h5py, a matrix by its columns or rows."""
    import h5py

    found: dict[str, np.ndarray] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf" and item.ndim:
            found[name.replace("/", ".") if path.suffix == ".mat" else name] = item[()]

    with h5py.File(path) as file:
        file.visititems(keep)
    for name, values in found.items():
        yield from by_columns(name, values)


def netcdf_channels(path: Path) -> Native:
    """Yield the variables of a netCDF 3 file by scipy."""
    from scipy.io import netcdf_file

    with netcdf_file(path, mmap=False) as file:
        yield from ((name, item[:].copy(), None) for name, item in file.variables.items())


def matlab_channels(path: Path) -> Native:
    """Yield the numbers in a MATLAB file by scipy or h5py, and in its tables by mat-io."""
    import matio
    import pandas as pd
    from scipy.io import loadmat

    if path.read_bytes()[:10] == b"MATLAB 7.3":
        yield from hdf5_channels(path)
    else:
        yield from structure("", loadmat(path, squeeze_me=True, struct_as_record=False))
    for table in matio.load_from_mat(str(path)).values():
        if isinstance(table, pd.DataFrame):
            seconds = (table.index - table.index[0]) if table.index.dtype.kind in "mM" else None
            times = None if seconds is None else seconds / pd.Timedelta(1, "s")
            for name in table.columns:
                yield str(name), table[name].to_numpy(), None if times is None else np.array(times)


def structure(name: str, held: Any) -> Native:
    """Yield the arrays of a structure by dotted names, those of a list by their numbers."""
    if hasattr(held, "_fieldnames"):
        held = {field: getattr(held, field) for field in held._fieldnames}
    if isinstance(held, dict):
        for key, item in held.items():
            yield from structure(f"{name}.{key}" if name else key, item)
    elif isinstance(held, np.ndarray) and held.dtype.kind == "O":
        for number, item in enumerate(held.ravel(), start=1):
            yield from structure(f"{name} {number}", item)
    elif isinstance(held, np.ndarray) and held.dtype.kind in "biuf":
        yield from by_columns(name, held)


def by_columns(name: str, values: np.ndarray) -> Native:
    """Yield a vector, or the columns of a matrix (the rows of one that is wider than long)."""
    if values.size == max((*values.shape, 1)):
        yield name, values.ravel(), None
    elif values.ndim == 2:
        table = values if values.shape[0] >= values.shape[1] else values.T
        yield from ((f"{name} {n}", column, None) for n, column in enumerate(table.T, start=1))


NATIVE: dict[str, Callable[[Path], Native]] = {
    ".tdms": tdms_channels,
    ".mf4": mdf_channels,
    ".mdf": mdf_channels,
    ".cfg": comtrade_channels,
    ".cff": comtrade_channels,
    ".mat": matlab_channels,
    ".h5": hdf5_channels,
    ".nc": netcdf_channels,
}


def is_same(own: RecordedChannel, values: np.ndarray, times: np.ndarray | None) -> bool:
    """Return True if a channel has the samples of a native library, at its times."""
    there = np.isfinite(own.values)
    if values.dtype.kind not in "biuf" or own.values.size != values.size:
        return False
    scale = float(np.max(np.abs(values), initial=1e-300))
    same = np.allclose(own.values[there], values[there], rtol=1e-9, atol=1e-6 * scale)
    if times is None or times.size < 2:
        return bool(same)
    away = np.abs((own.time - own.time[0]) - (times - times[0]))
    return bool(same and away.max() <= 0.5 / own.rate)


def compared(folder: Path) -> tuple[Counter[str], list[str]]:
    """Return counts of public files and channels, and the channels that differ."""
    found: Counter[str] = Counter()
    differ: list[str] = []
    for path in sorted(item for item in folder.rglob("*") if item.suffix.lower() in NATIVE):
        try:
            native = list(NATIVE[path.suffix.lower()](path))
        except Exception:  # not a recording, or its library is not installed
            continue
        found["files"] += 1
        try:
            recording = read_recording(path)
        except FileError:
            found["refused"] += 1
            continue
        for own in recording.channels.values():
            name = re.sub(r" \(\d+\)\Z", "", own.name.strip())
            named = [(re.sub(r"\s[\[(][^\])]*[\])]\Z", "", v[0].strip()), v) for v in native]
            alike = [v for bare, v in named if bare and name.endswith((bare, v[0].strip()))]
            # Cells of MATLAB 7.3 are named by the cell, their values by a number of the file.
            alike = alike or [v for v in native if v[0].startswith("#refs#")]
            if not any(is_same(own, np.asarray(v), t) for _, v, t in alike):
                differ.append(f"{path.name}: {own.name}")
            found["channels"] += 1
    return found, differ


def seconds_of_foreign(folder: Path) -> float:
    """Return the time in which files of no known format are refused [s]."""
    rng = np.random.default_rng(1)
    for number in range(FOREIGN):
        suffix = (".bin", ".h5", ".mat", ".tdms", ".txt")[number % 5]
        (folder / f"{number}{suffix}").write_bytes(rng.bytes(5000))
    begin = time.perf_counter()
    for path in folder.iterdir():
        try:
            recognise_format(path)
            read_recording(path)
        except FileError:
            continue
        message = f"{path} was read"
        raise AssertionError(message)
    return time.perf_counter() - begin


def main() -> None:
    """Read all and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="*", type=Path, help="public test files")
    folders = parser.parse_args().folder
    with tempfile.TemporaryDirectory() as place:
        found = Counter(outcomes(Path(place)))
    with tempfile.TemporaryDirectory() as place:
        seconds = seconds_of_foreign(Path(place))
    lines = [
        "Small recordings as loggers, oscilloscopes, data servers and other programs write them",
        "(`tests/unit/recording_kinds.py`, `tests/unit/recording_files.py`): each holds the same",
        '40 samples of a force and a current. "Right" is every value, unit, rate and start;',
        '"refused" is one message with the true reason, where the file cannot tell the time, holds',
        "several throws, or lacks a part.",
        "",
        "`python -m benchmarks.studies.recordings FOLDER ...` writes this section; folders are",
        "public test files, unpacked, whose channels are compared with the native library.",
        "",
        "| format | tried | right | refused | wrong |",
        "|---|---:|---:|---:|---:|",
    ]
    for kind in dict.fromkeys(kind for kind, _ in found):
        right, refused, wrong = (found[kind, what] for what in ("right", "refused", "wrong"))
        lines.append(f"| {kind} | {right + refused + wrong} | {right} | {refused} | {wrong} |")
    lines += ["", f"A folder of {FOREIGN} files of no known format is refused in {seconds:.1f} s."]
    if folders:
        lines += ["", "| public test files of | files | refused | channels | that differ |"]
        lines.append("|---|---:|---:|---:|---:|")
    for folder in folders:
        counts, differ = compared(folder)
        row = (counts["files"], counts["refused"], counts["channels"], len(differ))
        lines.append(f"| {folder.name} | {' | '.join(map(str, row))} |")
        print("\n".join(differ))
    write_section(RECORDINGS, "\n".join(lines), page=PAGE)


if __name__ == "__main__":
    main()
