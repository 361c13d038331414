"""Read recordings of any known format, and write them in formats that other programs read."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from turnout.core.errors import FileError
from turnout.core.files import read_fault, require_regular_file, write_atomic
from turnout.measurement.formats.channel_table import ALL, recordings_of
from turnout.measurement.formats.comtrade import is_comtrade
from turnout.measurement.formats.hdf5 import hdf5_bytes
from turnout.measurement.formats.isolated import read_isolated
from turnout.measurement.formats.mat import mat_bytes
from turnout.measurement.formats.text_table import csv_bytes, text_table
from turnout.measurement.recording import Recording

SNIFFED_BYTES = 600
_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_ARCHIVE, _OLD_OFFICE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
ARCHIVED_NAME = 30
"""Place of the name of the first file of an archive [byte]."""
WORKBOOKS = ".xlsx .xlsm .xls .ods"
# Formats that are not read, by their first bytes, and the way out.
FOREIGN = (
    (b"|CF,", "an imc FAMOS file; export it as ASCII or MDF"),
    (b"|CG,", "an imc FAMOS file; export it as ASCII or MDF"),
    (b"\x94\x13", "a file of catman; export it as ASCII or MDF"),
    (b"DIAEXTENDED", "a DIAdem file; export it as TDMS or CSV"),
    (b"DIADEM", "a DIAdem file; export it as TDMS or CSV"),
    (b"<?xml", "an XML file; export it as CSV, TDMS or MDF"),
    (b"RIFF", "a sound or video file; export it as CSV with its sample rate"),
    (b"\x1f\x8b", "compressed (gzip); unpack it"),
    (b"BZh", "compressed (bzip2); unpack it"),
    (b"7z\xbc\xaf", "a 7-Zip archive; unpack it"),
    (b"Rar!", "a RAR archive; unpack it"),
    (b"%PDF", "a PDF; export the table as CSV"),
    (b"CDF\x05", "a netCDF file with 64-bit data (CDF-5); save it as netCDF 4"),
    (b"\x93NUMPY", "a NumPy array; save it as CSV or HDF5 with its sample rate"),
    (b"SQLite format 3", "a database; export its table as CSV"),
    (b"{\\rtf", "a formatted text (RTF); save it as plain text"),
    (_ARCHIVE, "an archive; unpack it"),
)


@dataclass(frozen=True, slots=True)
class FileFormat:
    """One kind of file: how it is recognised, and the function that reads it.

    Attributes
    ----------
    name : str
        What it is called.
    endings : str
        What its files end in, with blanks between; used only where the content is ambiguous.
    mark : bytes or callable
        Pattern of its first bytes; or whether a file, given these and its path, is of this format.
    reader : str
        Module of `turnout.measurement.formats` and function that read it in a process of its own;
        empty for text, whose memory grows with the file only.
    package : str
        What the reader loads.
    refers : bool
        Whether such a file can take samples from others.
    tables : bool
        Whether it holds tables, in which there may be several throws.
    """

    name: str
    endings: str
    mark: bytes | Callable[[bytes, Path], bool]
    reader: str = ""
    package: str = ""
    refers: bool = False
    tables: bool = False

    def recognises(self, head: bytes, path: Path) -> bool:
        """Return True if a file, given its first bytes, is of this format."""
        if isinstance(self.mark, bytes):
            return re.match(self.mark, head) is not None
        return self.mark(head, path)


def _is_workbook(head: bytes, path: Path) -> bool:
    """Return True for a workbook of Excel before 2007, or an archive that begins as one."""
    first = head[ARCHIVED_NAME:]
    is_sheet = first.startswith((b"[Content_Types].xml", b"_rels/", b"xl/", b"docProps/"))
    is_sheet |= first.startswith(b"mimetype") and b"opendocument.spreadsheet" in head
    is_sheet |= path.suffix.lower() in WORKBOOKS.split()
    return head.startswith(_OLD_OFFICE) or (head.startswith(_ARCHIVE) and is_sheet)


def _is_mat5(head: bytes, path: Path) -> bool:
    return head.startswith(b"MATLAB 5.0 MAT-file") and _HDF5_MARK not in head


def _is_hdf5(head: bytes, path: Path) -> bool:
    return _HDF5_MARK in head


_HTML = rb"(?i)\s*(\xef\xbb\xbf)?\s*<(!doctype html|html|table|meta|head|body)\b"
_JSON = rb'(\xef\xbb\xbf)?\s*(\{\s*"|\[\s*([\[{]|-?\d[\d.eE+-]*\s*,))'
_OTHER = "optional_formats:read_"
EXTRAS = {
    **dict.fromkeys(("dwdatareader", "asammdf", "nptdms", "pyuff"), "daq"),
    "pyarrow": "parquet",
    "python_calamine": "sheets",
}
"""Extra of turnout that brings a package."""
FORMATS = (
    FileFormat(
        "Dewesoft", ".d7d .dxd .d7z", b"MULTI_STREAM_FILE", f"{_OTHER}dewesoft", "dwdatareader"
    ),
    FileFormat("MDF", ".mf4 .mdf", b"MDF     |UnFinMF ", f"{_OTHER}mdf", "asammdf"),
    FileFormat("TDMS", ".tdms", b"TDSm", f"{_OTHER}tdms", "nptdms"),
    FileFormat("Parquet", ".parquet .pq", b"PAR1", f"{_OTHER}parquet", "pyarrow", tables=True),
    FileFormat("MATLAB 7.3", "", b"MATLAB 7.3 MAT-file", "mat:read_mat73", refers=True),
    FileFormat("MATLAB", ".mat", _is_mat5, "mat:read_mat"),
    FileFormat("HDF5", ".h5 .hdf5 .hdf .nc", _is_hdf5, "mat:read_hdf5_or_mat73", refers=True),
    FileFormat("netCDF", "", b"CDF[\x01\x02]", "hdf5:read_netcdf3"),
    FileFormat(
        "workbook", WORKBOOKS, _is_workbook, "sheets:read_workbook", "python_calamine", tables=True
    ),
    FileFormat("HTML", ".html .htm", _HTML, "sheets:read_html", tables=True),
    FileFormat("JSON", ".json .jsonl .ndjson", _JSON, "json_table:read_json", tables=True),
    FileFormat("UFF", ".uff .unv", rb" *-1 *\r?\n *\d+", f"{_OTHER}uff", "pyuff"),
    FileFormat("COMTRADE", "", is_comtrade, "comtrade:read_comtrade"),
    FileFormat("LabVIEW", ".lvm", b"LabVIEW Measurement", "lvm:read_lvm"),
    FileFormat("text", ".csv .txt .tsv .asc .dat", lambda head, path: False, tables=True),
)


def read_recording(
    path: Path | str, *, allow_outside: bool = False, throw: str | None = None
) -> Recording:
    r"""Read the channels of a file; the format follows from its content, then its name.

    Parameters
    ----------
    path : path-like
        Text (CSV, TXT), JSON, HTML, LabVIEW (.lvm), COMTRADE, MATLAB, HDF5; Dewesoft, MDF, TDMS and
        UFF with the extra ``daq``; workbooks with ``sheets``; Parquet with ``parquet``.
    allow_outside : bool
        Whether a file may take samples from other files, as HDF5 can.
    throw : str, optional
        Which throw of several in one table.

    Returns
    -------
    Recording
        Every channel that can be read; `problems` names the others and why.

    Raises
    ------
    FileError
        When nothing can be read; the text names the file, what is wrong and the remedy.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "throw.csv"
    >>> _ = file.write_text("Time (s),Rod 1 (mV/V)\n0,0.1\n0.001,0.2\n0.002,0.3\n")
    >>> rod = read_recording(file).channel("Rod 1")
    >>> rod.rate, rod.unit, rod.values
    (1000.0, 'mV/V', array([0.1, 0.2, 0.3]))
    """
    path = Path(path)
    try:
        throws = () if throw is None else (throw,)
        (found,) = _read(path, allow_outside=allow_outside, throws=throws)
        if isinstance(found, FileError):
            raise found
        return found
    except FileError as error:
        # What a message quotes from a damaged file may hold anything.
        text = "".join(char if char.isprintable() else " " for char in str(error))
        raise FileError(text) from None


def read_throws(
    path: Path, throws: Sequence[str] = ALL, *, allow_outside: bool = False
) -> list[Recording | FileError]:
    """Read several throws of one table, or the error of each that cannot be read.

    Parameters
    ----------
    path : Path
        File that holds a table.
    throws : sequence of str
        Labels of the throws, as its column or the order of the table has them; all by default, each
        with its own among its labels.
    allow_outside : bool
        Whether a file may take samples from other files.
    """
    try:
        return _read(path, allow_outside=allow_outside, throws=throws)
    except FileError as error:
        return [error] * len(throws)


def _read(path: Path, *, allow_outside: bool, throws: Sequence[str]) -> list[Recording | FileError]:
    """Return the recording of a file, or one a throw; FileError when none can be read."""
    kind = recognise_format(path)
    if throws and not kind.tables and tuple(throws) != ALL:
        message = f"{path}: a {kind.name} file holds one throw; leave out the choice '{throws[0]}'"
        raise FileError(message)
    throws = throws if kind.tables else ()
    if not kind.reader:
        return recordings_of(text_table(path.read_bytes(), source=str(path)), throws)
    packages = [kind.package] if kind.package else []
    for package in packages:
        require(package, purpose=f"{path}: {kind.name} files")
    return read_isolated(
        path,
        reader=f"turnout.measurement.formats.{kind.reader}",
        kind=kind.name.removesuffix(" 7.3"),
        packages=packages,
        throws=throws,
        **({"allow_outside": allow_outside} if kind.refers else {}),
    )


def recognise_format(path: Path) -> FileFormat:
    """Return the format of a file; FileError when it cannot be read at all."""
    head = _head(path)
    for item in FORMATS:
        if item.recognises(head, path):
            return item
    for mark, way_out in FOREIGN:
        if head.startswith(mark):
            message = f"{path}: is {way_out}"
            raise FileError(message)
    suffix = path.suffix.lower()
    by_name = next((item for item in FORMATS if suffix in item.endings.split()), FORMATS[-1])
    return FORMATS[-1] if all(byte > 8 for byte in head) else by_name


def _head(path: Path) -> bytes:
    """Return the first bytes of a file that is there, is readable and is not empty."""
    require_regular_file(path)
    try:
        with path.open("rb") as file:
            head = file.read(SNIFFED_BYTES)
    except (OSError, ValueError) as error:
        raise FileError(read_fault(path, error)) from None
    if not head.strip():
        message = f"{path}: the file is empty"
        raise FileError(message)
    return head


WRITERS: dict[str, Callable[[Recording], bytes]] = {
    ".csv": csv_bytes,
    ".mat": mat_bytes,
    ".h5": hdf5_bytes,
}


def write_recording(recording: Recording, path: Path | str) -> None:
    """Write a recording; the suffix selects the format.

    Parameters
    ----------
    recording : Recording
        At least one channel.
    path : path-like
        Ends in .csv (as DewesoftX exports it), .mat (version 5) or .h5; a file there is replaced.

    Raises
    ------
    FileError
        When it cannot be written; nothing half-written stays behind.
    MeasurementError
        When the format cannot hold the recording.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from turnout.measurement.formats.file_format import read_recording
    >>> from turnout.measurement.recording import RecordedChannel
    >>> file = Path(tempfile.mkdtemp()) / "throw.mat"
    >>> rod = RecordedChannel("Rod 1", "mV/V", np.array([0.1, 0.2]), rate=1000.0)
    >>> write_recording(Recording({"Rod 1": rod}, "a test"), file)
    >>> read_recording(file).channel("Rod 1").unit
    'mV/V'
    """
    path = Path(path)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        message = f"{path}: the name must end in {' or '.join(WRITERS)}"
        raise FileError(message)
    write_atomic(path, writer(recording))


def require(package: str, *, purpose: str) -> None:
    """Refuse to read without an optional package; the text names the install command.

    Parameters
    ----------
    package : str
        Of `EXTRAS`.
    purpose : str
        What cannot be read without it.

    Raises
    ------
    FileError
        When it is missing.
    """
    if find_spec(package) is None:
        extra = EXTRAS[package]
        message = (
            f"{purpose} need {package}; pip install 'turnout[{extra}]', or in a checkout "
            f"sh bin/setup {extra}"
        )
        raise FileError(message)
