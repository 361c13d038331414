"""The run sheet of a campaign: file and movement of each run, and parsers of its cells.

The format is described in docs/use/campaign-format.md.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from turnout.core.errors import FileError, MeasurementError
from turnout.core.problems import choices, nearest, show_value
from turnout.core.sheet_rows import sheet_rows
from turnout.core.toml import decode, parse_toml, read_bytes
from turnout.core.units import LENGTH, parse_quantity
from turnout.measurement.campaign.campaign_folder import is_outside
from turnout.measurement.campaign.motion_signals import CLOSING, OPENING
from turnout.measurement.formats.file_format import read_throws
from turnout.measurement.recording import Recording

# A larger object does not fit into any flangeway: its unit is wrong [m].
LARGEST_SIZE = 0.2
FAMILIES = ("sleeper", "drive", "sensor", "chair", "stud", "stop", "link", "fastening")
_NAMED = re.compile(rf"({'|'.join(FAMILIES)})\s*[-_ ]?\s*(\S.*)\Z", re.IGNORECASE)
_YES_NO = {"yes": True, "no": False, "true": True, "false": False, "1": True, "0": False}
_DIRECTIONS = {CLOSING: CLOSING, OPENING: OPENING, "close": CLOSING, "open": OPENING}


def normal_place(text: str) -> str:
    """Return a place as all datasets write it.

    One word alone is taken as it is, since objects may lie at something that has a name on site.

    Raises
    ------
    ValueError
        When it is of no family of places, or a position has no unit.

    Examples
    --------
    >>> normal_place("Sleeper6"), normal_place("x=3600 mm"), normal_place("-")
    ('sleeper 6', 'x = 3.6 m', 'none')
    """
    words = " ".join(text.split())
    if words.lower() in ("", "-", "none", "no object"):
        return "none"
    if re.match(r"x\s*=", words, re.IGNORECASE):
        return f"x = {parse_quantity(words.split('=', 1)[1], LENGTH):.9g} m"
    named = _NAMED.match(words)
    if named is None and " " in words:
        hint = nearest(words.split()[0], FAMILIES)
        message = f"must be {choices(FAMILIES)} and a name, or such as 'x = 3.6 m'{hint}"
        raise ValueError(message)
    return f"{named[1].lower()} {named[2]}" if named else words


def object_size(value: Any) -> float:
    """Return the size of an object in a unit [m]; ValueError when it is none, or too large.

    Examples
    --------
    >>> object_size("1.3 cm")
    0.013
    """
    size = parse_quantity(value, LENGTH)
    if size < 0:
        message = "must be at least 0"
        raise ValueError(message)
    if size > LARGEST_SIZE:
        limit = f"at most {LARGEST_SIZE:g} m; check the unit"
        message = f"{size:g} m is too large for an object in a switch, {limit}"
        raise ValueError(message)
    return size


def whole_number(value: Any) -> int:
    """Return a number of a movement or a repeat; ValueError when it is no whole number from 1.

    Examples
    --------
    >>> whole_number("2")
    2
    """
    if isinstance(value, bool) or not re.fullmatch(r"[1-9]\d{0,5}", str(value)):
        message = "must be a whole number from 1"
        raise ValueError(message)
    return int(value)


def direction_name(value: Any) -> str:
    """Return "closing" or "opening", also for "close" and "open"; ValueError for anything else.

    Examples
    --------
    >>> direction_name("Open")
    'opening'
    """
    known = _DIRECTIONS.get(str(value).strip().lower())
    if known is None:
        message = f'must be "{CLOSING}" or "{OPENING}"'
        raise ValueError(message)
    return known


def parse_yes_no(value: Any) -> bool:
    """Return True for yes and False for no; ValueError for anything else.

    Examples
    --------
    >>> parse_yes_no("Yes")
    True
    """
    known = _YES_NO.get(str(value).strip().lower())
    if known is None:
        message = "must be yes or no"
        raise ValueError(message)
    return known


SHEETS = ("runs.csv", "runs.toml")
NOT_RECORDINGS = {*SHEETS, "channels.toml", "truth.nc", "campaign.nc"}
LOAD_CELL_FROM = 0.013
NEEDED = ("file", "direction", "size", "place")
OPTIONAL = ("throw", "movement", "repeat", "slip", "load_cell", "remark")
HEADINGS = (
    *("title", "panel", "synthetic", "load_cell_from"),
    *("files", "direction_column", CLOSING, OPENING),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetRow:
    """One movement as the sheet has it.

    Attributes
    ----------
    where : str
        Line or number in the sheet, for messages.
    file : str
        Name of the recording, relative to the folder of the campaign.
    throw : str
        Which throw of a file that holds a table of several; empty for a file of one recording.
    movement : int
        Which movement of that recording, from 1.
    direction : str
        "closing" or "opening".
    size : float
        Of the foreign object, 0 for none [m].
    place : str
        "sleeper 6", "drive 1", "x = 3.6 m"; "none" without an object.
    repeat : int
        Number among equal movements, from 1.
    slip : bool or None
        Whether a drive slipped; None where the sheet does not say.
    load_cell : bool
        Whether a load cell was mounted.
    remark : str
        Free text.
    """

    where: str
    file: str
    throw: str = ""
    movement: int
    direction: str
    size: float
    place: str
    repeat: int
    slip: bool | None
    load_cell: bool
    remark: str

    @property
    def what(self) -> tuple[str, float, str]:
        """Direction, size and place, the same for repeats."""
        return self.direction, self.size, self.place

    @property
    def name(self) -> str:
        """Name of the movement: its file, and its number unless that is the first."""
        stem = str(Path(self.file).with_suffix("")) + (f"@{self.throw}" if self.throw else "")
        return stem if self.movement == 1 else f"{stem}#{self.movement}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSheet:
    """A run sheet as a whole.

    Attributes
    ----------
    runs : tuple of SheetRow
        In the order of the sheet.
    title : str
        Of the campaign.
    panel : str
        That describes the switch; empty where the sheet names none.
    synthetic : str
        How the recordings were made where they were not measured; empty where they were.
    source : str
        Path of the sheet.
    """

    runs: tuple[SheetRow, ...]
    title: str
    panel: str
    synthetic: str
    source: str


def find_sheet(folder: Path | str) -> Path:
    """Return the run sheet of a campaign's folder.

    Raises
    ------
    FileError
        When there is no such folder, no sheet in it, or two.
    """
    folder = Path(folder)
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "no such folder"
        message = f"{folder}: {what}; name the folder of a campaign"
        raise FileError(message)
    found = [folder / name for name in SHEETS if (folder / name).is_file()]
    if not found:
        state = "is empty" if not any(folder.iterdir()) else "has no run sheet"
        message = (
            f"{folder}: {state}; put {' or '.join(SHEETS)} there, "
            "as docs/use/campaign-format.md describes"
        )
        raise FileError(message)
    if len(found) > 1:
        message = f"{folder}: has two run sheets, {' and '.join(SHEETS)}; keep one"
        raise FileError(message)
    return found[0]


def read_sheet(path: Path | str, *, allow_outside: bool = False) -> RunSheet:
    r"""Read a run sheet.

    Parameters
    ----------
    path : path-like
        CSV or TOML file with a row for each movement, or a heading that finds the recordings.
    allow_outside : bool
        Whether directions may be looked up in recordings outside the folder of the sheet.

    Returns
    -------
    RunSheet

    Raises
    ------
    FileError
        When it cannot be read.
    MeasurementError
        With everything that is wrong in it.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "runs.csv"
    >>> _ = file.write_text("file,direction,size [mm],place\na.csv,closing,13,Sleeper6\n")
    >>> run = read_sheet(file).runs[0]
    >>> run.size, run.place, run.load_cell
    (0.013, 'sleeper 6', True)
    """
    path = Path(path)
    content = read_bytes(path)
    if path.suffix.lower() == ".toml":
        headings, rows = _toml_rows(decode(content, source=str(path)), path)
    else:
        headings, rows = _csv_rows(_decoded(content, path), path)
    problems: list[str] = []
    mounted_from = LOAD_CELL_FROM
    if "load_cell_from" in headings:
        try:
            mounted_from = parse_quantity(headings["load_cell_from"], LENGTH)
        except ValueError as error:
            given = show_value(headings["load_cell_from"])
            problems.append(f"load_cell_from = {given}: {error}")
    problems += [
        f"{name}: unknown heading{nearest(name, HEADINGS)}; allowed are {choices(HEADINGS)}"
        for name in headings
        if name not in HEADINGS
    ]
    folder = path.parent
    rows += _found_rows(headings, {str(row.get("file")) for _, row in rows}, folder, problems)
    if column := str(headings.get("direction_column", "")):
        rows = _with_directions(rows, column, folder, problems, allow_outside=allow_outside)
    words = {
        word.strip().lower(): name
        for name in (CLOSING, OPENING)
        for word in str(headings.get(name, name)).split(",")
    }
    read = [_run(*row, words, mounted_from=mounted_from, problems=problems) for row in rows]
    if not rows and "files" not in headings:
        problems.append("names no movement; give a line for each")
    runs = _numbered([run for run in read if run is not None])
    problems += _duplicates(runs)
    if problems:
        raise MeasurementError(problems, source=str(path))
    return RunSheet(
        runs=tuple(runs),
        title=str(headings.get("title", path.resolve().parent.name)),
        panel=str(headings.get("panel", "")),
        synthetic=str(headings.get("synthetic", "")),
        source=str(path),
    )


Rows = list[tuple[str, Mapping[str, Any]]]
_IN_BRACES = re.compile(r"\{(\w+)\}")
_WILD = {"**/": r"(?:.*/)?", "*": r"[^/]*", "?": r"[^/]"}


def _found_rows(
    headings: Mapping[str, Any], named: set[str], folder: Path, problems: list[str]
) -> Rows:
    """Return a row for each recording that the heading `files` finds and no row names.

    A name of a column in braces stands for its value: "day */{direction} {repeat}.csv".
    """
    pattern = str(headings.get("files", ""))
    names = _IN_BRACES.findall(pattern)
    wrong = [name for name in names if name not in (*NEEDED[1:], *OPTIONAL)]
    if wrong or len(set(names)) < len(names):
        allowed = choices((*NEEDED[1:], *OPTIONAL))
        problems.append(f'files = "{pattern}": in braces may stand, once each, {allowed}')
    elif ".." in pattern or Path(pattern).is_absolute():
        problems.append(f'files = "{pattern}": must be a pattern of names within the folder')
    if problems or not pattern:
        return []
    parts = re.split(r"(\{\w+\}|\*\*/|\*|\?)", pattern)
    named_parts = {part: f"(?P<{part[1:-1]}>[^/]+?)" for part in parts if part.startswith("{")}
    expression = re.compile(
        "".join({**_WILD, **named_parts}.get(part, re.escape(part)) for part in parts)
    )
    rows: Rows = []
    for path in sorted(folder.glob(_IN_BRACES.sub("*", pattern))):
        name = path.relative_to(folder).as_posix()
        match = expression.fullmatch(name)
        if match and path.is_file() and name not in named and name not in NOT_RECORDINGS:
            rows.append((name, {"file": name, "size": "0 m", "place": "none", **match.groupdict()}))
    if not rows:
        problems.append(f'files = "{pattern}": there is no such file beside those of the lines')
    return rows


def _with_directions(
    rows: Rows, column: str, folder: Path, problems: list[str], *, allow_outside: bool
) -> Rows:
    """Return rows whose directions stand in a column of the recording; one for each throw of it."""
    found: Rows = []
    read: dict[str, list[Recording | FileError]] = {}
    for where, row in rows:
        name = str(row.get("file", "")).strip()
        if row.get("direction") or not name:
            found.append((where, row))
            continue
        if name not in read:
            outside = not allow_outside and is_outside(folder / name, folder)
            read[name] = [] if outside else read_throws(folder / name, allow_outside=allow_outside)
        there = [item for item in read[name] if isinstance(item, Recording)]
        problems += [f"{where}: {item}" for item in read[name] if isinstance(item, FileError)]
        wanted = str(row.get("throw", "")).strip()
        for item in there or [Recording({}, name)]:
            throw = item.labels.get("throw", "")
            if wanted in ("", throw):
                place = f"{where}, throw {throw}" if throw else where
                more = {"throw": throw} if throw else {}
                if column in item.labels:
                    found.append((place, {**row, **more, "direction": item.labels[column]}))
                elif item.channels:
                    text = f"has no column '{column}' that holds one direction; there are "
                    problems.append(f"{place}: {text}{choices(item.labels) or 'none'}")
    return found


def _toml_rows(text: str, path: Path) -> tuple[dict[str, Any], Rows]:
    data = parse_toml(text, source=str(path)).data
    runs = data.pop("run", [])
    data.pop("schema_version", None)
    if not isinstance(runs, list) or not all(isinstance(run, dict) for run in runs):
        message = "run: must be tables, each under its own [[run]]"
        raise MeasurementError([message], source=str(path))
    return data, [(f"run {number}", run) for number, run in enumerate(runs, 1)]


def _csv_rows(text: str, path: Path) -> tuple[dict[str, Any], Rows]:
    try:
        comments, lines = sheet_rows(text)
    except ValueError as error:
        raise MeasurementError([str(error)], source=str(path)) from None
    headings = {
        key.strip(): value.strip()
        for key, sign, value in (comment.partition(":") for comment in comments)
        if sign and key.strip() in HEADINGS
    }
    columns = [_column(cell) for cell in lines[0][1]] if lines else []
    rows: Rows = []
    for number, cells in lines[1:]:
        row: dict[str, Any] = {}
        for (name, unit), cell in zip(columns, cells, strict=False):
            bare = name == "size" and unit and re.fullmatch(r"[-+]?[\d.,]+", cell)
            if cell:
                row[name] = f"{cell.replace(',', '.')} {unit}" if bare else cell
        rows.append((f"line {number}", row))
    if not columns and "files" not in headings:
        message = "has no line with the names of the columns"
        raise MeasurementError([message], source=str(path))
    return headings, rows


def _decoded(content: bytes, path: Path) -> str:
    """Decode a CSV file; spreadsheets on some systems write Latin-1."""
    try:
        return decode(content, source=str(path))
    except FileError:
        if b"\0" in content or not content.strip():
            raise
        return content.decode("latin-1")


def _column(cell: str) -> tuple[str, str]:
    """Return name and unit of a column's heading: "size [mm]", "Size (mm)"."""
    name, _, unit = re.sub(r"[\])]\s*\Z", "", cell).replace("(", "[").partition("[")
    return name.strip().lower().replace(" ", "_"), unit.strip()


def _run(
    where: str,
    row: Mapping[str, Any],
    words: Mapping[str, str],
    *,
    mounted_from: float,
    problems: list[str],
) -> SheetRow | None:
    """Make a run of a row, or add its faults."""
    allowed = (*NEEDED, *OPTIONAL)
    wrong = [f"{name}: unknown{nearest(name, allowed)}" for name in row if name not in allowed]
    wrong += [f"{name}: is missing" for name in NEEDED if row.get(name, "") == ""]

    def read(name: str, parse: Callable[[Any], Any], default: Any) -> Any:
        if row.get(name, "") == "":
            return default
        try:
            return parse(row[name])
        except ValueError as error:
            wrong.append(f"{name} = {show_value(row[name])}: {error}")
            return default

    size = read("size", object_size, 0.0)
    place = read("place", lambda value: normal_place(str(value)), "none")
    if size > 0 and place == "none" and not any(text.startswith("place") for text in wrong):
        wrong.append('place = "none": an object has a place, such as "sleeper 6"')
    values = {
        "throw": str(row.get("throw", "")).strip(),
        "movement": read("movement", whole_number, 1),
        "direction": read(
            "direction",
            lambda value: words.get(str(value).strip().lower()) or direction_name(value),
            CLOSING,
        ),
        "repeat": read("repeat", whole_number, 0),
        "slip": read("slip", parse_yes_no, None),
        "load_cell": read("load_cell", parse_yes_no, size >= mounted_from - 1e-9),
        "remark": str(row.get("remark", "")),
    }
    if wrong:
        problems += [f"{where}: {text}" for text in wrong]
        return None
    return SheetRow(where=where, file=str(row["file"]).strip(), size=size, place=place, **values)


def _numbered(runs: Sequence[SheetRow]) -> list[SheetRow]:
    """Return runs with repeats counted on in the order of the sheet, past those stated."""
    last: dict[tuple[object, ...], int] = {}
    for run in runs:
        last[run.what] = max(last.get(run.what, 0), run.repeat)
    found = []
    for run in runs:
        if not run.repeat:
            last[run.what] += 1
            run = replace(run, repeat=last[run.what])
        found.append(run)
    return found


def _duplicates(runs: list[SheetRow]) -> Iterator[str]:
    """Name movements that the sheet has twice."""
    first: dict[tuple[object, ...], str] = {}
    for run in runs:
        recorded, meant = (run.file, run.throw, run.movement), (*run.what, run.repeat)
        if recorded in first:
            yield (
                f"{run.where}: movement {run.movement} of {run.file} is also that of "
                f"{first[recorded]}; correct the file, or number the movements"
            )
        elif meant in first:
            yield (
                f"{run.where}: same direction, size, place and repeat as {first[meant]}; "
                "number the repeats"
            )
        first.setdefault(recorded, run.where)
        first.setdefault(meant, run.where)
