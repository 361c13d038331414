"""Run sheets in CSV and TOML: what they say, and every mistake in them at once."""

import json
from pathlib import Path

import pytest

from turnout.core.errors import FileError, MeasurementError
from turnout.measurement.campaign.run_sheet import RunSheet, find_sheet, normal_place, read_sheet

CSV = """# title: Two days in autumn
# synthetic: no, but say so
# load_cell_from: 13 mm
file,direction,Size [mm],place,repeat,slip,load cell,remark
a.csv,closing,0,-,1,,,
b.csv,closing,10,sleeper 6,1,no,,
c.csv,closing,13,Sleeper6,1,no,,"greased, twice"
d.csv,opening,31,drive 2,2,yes,no,
"""
TOML = """
title = "One day"
load_cell_from = "15 mm"
[[run]]
file = "a.mat"
direction = "closing"
size = "13 mm"
place = "x = 3.6 m"
[[run]]
file = "a.mat"
movement = 2
direction = "opening"
size = "0 mm"
place = "none"
slip = "no"
"""


def sheet_of(text: str, folder: Path, name: str = "runs.csv") -> RunSheet:
    (folder / name).write_text(text, encoding="utf-8")
    return read_sheet(find_sheet(folder))


def test_a_csv_sheet_is_read(tmp_path: Path) -> None:
    sheet = sheet_of(CSV, tmp_path)
    assert sheet.title == "Two days in autumn"
    assert sheet.synthetic == "no, but say so"
    assert [run.size for run in sheet.runs] == [0.0, 0.010, 0.013, 0.031]
    assert [run.place for run in sheet.runs] == ["none", "sleeper 6", "sleeper 6", "drive 2"]
    assert [run.load_cell for run in sheet.runs] == [False, False, True, False]
    assert [run.slip for run in sheet.runs] == [None, False, False, True]
    assert sheet.runs[2].remark == "greased, twice"
    assert sheet.runs[3].repeat == 2
    assert sheet.runs[3].where == "line 8"


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("file;direction;size (mm);place\na.csv;closing;13,5;sleeper 1\n", 0.0135),
        ("file\tdirection\tsize (mm)\tplace\na.csv\tclosing\t13,5\tsleeper 1\n", 0.0135),
        ("file,direction,size,place\na.csv,closing,1.3 cm,sleeper 1\n", 0.013),
    ],
    ids=["semicolon", "tab", "own unit"],
)
def test_other_separators_decimal_commas_and_units_are_read(
    text: str, size: float, tmp_path: Path
) -> None:
    sheet = sheet_of(text, tmp_path)
    assert sheet.runs[0].size == size
    assert sheet.title == tmp_path.name, "where none is given"


def test_a_toml_sheet_is_read(tmp_path: Path) -> None:
    sheet = sheet_of(TOML, tmp_path, "runs.toml")
    assert sheet.title == "One day"
    assert [run.name for run in sheet.runs] == ["a", "a#2"]
    assert [run.load_cell for run in sheet.runs] == [False, False]
    assert sheet.runs[0].place == "x = 3.6 m"


@pytest.mark.parametrize(
    ("given", "place"),
    [
        ("Sleeper 6", "sleeper 6"),
        ("sleeper_6", "sleeper 6"),
        ("", "none"),
        ("TKK1", "TKK1"),
        ("x=3600 mm", "x = 3.6 m"),
    ],
)
def test_places_are_written_one_way(given: str, place: str) -> None:
    assert normal_place(given) == place


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("b.csv,closing,10", "b.csv,closing,ten", "line 6: size"),
        ("Size [mm]", "Size", "write the unit"),
        ("b.csv,closing", "b.csv,sideways", 'direction = "sideways": must be "closing"'),
        ("b.csv,", ",", "line 6: file: is missing"),
        ("1,no,,\nc.csv", "one,no,,\nc.csv", "repeat"),
        ("c.csv", "b.csv", "also that of line 6"),
        ("13,Sleeper6", "10,Sleeper6", "number the repeats"),
        ("remark\n", "remarks\n", "nearest is 'remark'"),
        ("10,sleeper 6", "10,-", "an object has a place"),
        ("1,no,,\nc", "1,perhaps,,\nc", "must be yes or no"),
        ("load_cell_from: 13 mm", "load_cell_from: 13", "load_cell_from"),
        ("closing,10", "closing,-10", "must be at least 0"),
        ("closing,10", "closing,10 m", 'line 6: size = "10 m": 10 m is too large for an object'),
        ("sleeper 6,1", "sleper 6,1", "nearest is 'sleeper'"),
        ("sleeper 6,1", "x = 3.6,1", "write the unit"),
    ],
)
def test_a_mistake_is_named(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert old in CSV
    text = CSV.replace(old, new, 1).replace('"greased, twice"', "seen")
    with pytest.raises(MeasurementError) as caught:
        sheet_of(text, tmp_path)
    assert words in str(caught.value)
    assert "runs.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "count"),
    [
        (CSV.replace("closing,10", "closing,ten").replace("opening,31", "up,31"), 2),
        (CSV.replace("sleeper 6", "sleper 6"), 1),
    ],
    ids=["size and direction", "place"],
)
def test_all_mistakes_come_at_once(text: str, count: int, tmp_path: Path) -> None:
    with pytest.raises(MeasurementError) as caught:
        sheet_of(text, tmp_path)
    assert len(caught.value.problems) == count


def test_unknown_headings_of_toml_are_named(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="nearest is 'title'"):
        sheet_of("titel" + TOML.strip()[5:], tmp_path, "runs.toml")


@pytest.mark.parametrize(
    ("text", "words"), [("", "is empty"), ("# title: x\n", "names of the columns")]
)
def test_an_empty_sheet_says_so(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises((FileError, MeasurementError), match=words):
        sheet_of(text, tmp_path)


def test_a_sheet_must_be_there_once(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="is empty"):
        find_sheet(tmp_path)
    (tmp_path / "a.csv").write_text("1", encoding="utf-8")
    with pytest.raises(FileError, match="has no run sheet"):
        find_sheet(tmp_path)
    (tmp_path / "runs.csv").write_text("1", encoding="utf-8")
    (tmp_path / "runs.toml").write_text("1", encoding="utf-8")
    with pytest.raises(FileError, match="two run sheets"):
        find_sheet(tmp_path)
    with pytest.raises(FileError, match="no such folder"):
        find_sheet(tmp_path / "none")


@pytest.mark.parametrize("line", [0, 1])
def test_a_cell_that_csv_refuses_is_one_message(tmp_path: Path, line: int) -> None:
    rows = ["file,direction,size [mm],place,remark", "a.csv,closing,13,sleeper 6,"]
    rows[line] += "x" * 140_000
    path = tmp_path / "runs.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    with pytest.raises(
        MeasurementError, match=rf"line {line + 1}: .*field limit.*shorten the cell"
    ):
        read_sheet(path)


def test_repeats_are_numbered_in_the_order_of_the_sheet(tmp_path: Path) -> None:
    rows = "a,closing,0,none,\nb,closing,0,none,\nc,opening,0,none,\nd,closing,0,none,5\n"
    path = tmp_path / "runs.csv"
    path.write_text("file,direction,size [mm],place,repeat\n" + rows, encoding="utf-8")
    assert [run.repeat for run in read_sheet(path).runs] == [6, 7, 1, 5]
    first = "a,closing,0,none\nb,closing,0,none\n"
    path.write_text("file,direction,size [mm],place\n" + first, encoding="utf-8")
    assert [run.repeat for run in read_sheet(path).runs] == [1, 2]


def test_a_pattern_finds_recordings_and_reads_columns_from_their_names(tmp_path: Path) -> None:
    for name in ("N_1.csv", "R_2.csv", "other.csv"):
        path = tmp_path / "day 1" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("Sample rate: 25 Hz\nP [W]\n" + "300\n" * 9, encoding="utf-8")
    head = "# files: **/{direction}_{repeat}.csv\n# closing: N\n# opening: R, back\n"
    sheet = sheet_of(head, tmp_path)
    assert [(run.file, run.direction, run.repeat) for run in sheet.runs] == [
        ("day 1/N_1.csv", "closing", 1),
        ("day 1/R_2.csv", "opening", 2),
    ]
    line = "file,direction,size [mm],place\nday 1/N_1.csv,back,13,sleeper 6\n"
    runs = sheet_of(head + line, tmp_path).runs
    assert [(run.direction, run.size) for run in runs] == [("opening", 0.013), ("opening", 0.0)]


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        ("{when}.csv", "in braces may stand, once each, 'direction'"),
        ("../*.csv", "must be a pattern of names within the folder"),
        ("*.mat", "there is no such file"),
    ],
)
def test_a_pattern_that_finds_nothing_is_refused(tmp_path: Path, pattern: str, words: str) -> None:
    with pytest.raises(MeasurementError, match=words):
        sheet_of(f"# files: {pattern}\n", tmp_path)


def test_directions_stand_in_a_column_of_the_table(tmp_path: Path) -> None:
    throws = [
        {"id": 7 + k, "way": "NR"[k % 2], "power": [300.0 + n for n in range(9)]} for k in range(3)
    ]
    text = json.dumps({"sample_rate": 25, "throws": throws})
    (tmp_path / "throws.json").write_text(text, encoding="utf-8")
    head = "# files: throws.json\n# closing: N\n# opening: R\n"
    runs = sheet_of(head + "# direction_column: way\n", tmp_path).runs
    assert [(run.throw, run.direction) for run in runs] == [
        ("1", "closing"),
        ("2", "opening"),
        ("3", "closing"),
    ]
    with pytest.raises(MeasurementError, match="throw 1: has no column 'direction' that holds one"):
        sheet_of(head + "# direction_column: direction\n", tmp_path)
