"""TOML files: origin comments, and one clear message for each way a file can be wrong."""

from pathlib import Path

import pytest

from turnout.core.errors import FileError
from turnout.core.toml import LARGEST_FILE, Origin, parse_toml, read_toml

TEXT = '''
title = "a # that is text"    # paper: the title
plain = 3                      # just a remark
[table]                        # assumption: covers the table
a = "1 m"
"quoted key".b = 2             # computed: by hand
text = """
# source: this is text, not a comment
"""
list = [                       # source: the list
    1, 2,                      # paper: first row
    3,
]
late = [
    1,                         # computed: first
    [2, 3]
]                              # assumption: at the end
inline = { a = 1, b = [1, 2] } # source: inline
[other."x.y"]
c = 1                          # source : with a space
'''


def test_origins_are_kept_where_they_stand() -> None:
    origins = parse_toml(TEXT, source="text").origins
    assert origins == {
        ("title",): Origin("paper", "the title"),
        ("table",): Origin("assumption", "covers the table"),
        ("table", "quoted key", "b"): Origin("computed", "by hand"),
        ("table", "list"): Origin("source", "the list"),
        ("table", "list", "0"): Origin("paper", "first row"),
        ("table", "list", "1"): Origin("paper", "first row"),
        ("table", "late", "0"): Origin("computed", "first"),
        ("table", "late"): Origin("assumption", "at the end"),
        ("table", "inline"): Origin("source", "inline"),
        ("other", "x.y", "c"): Origin("source", "with a space"),
    }


def test_data_are_those_of_the_toml_standard() -> None:
    data = parse_toml(TEXT, source="text").data
    assert data["table"]["list"] == [1, 2, 3]
    assert data["table"]["quoted key"] == {"b": 2}


def write(folder: Path, content: bytes) -> Path:
    path = folder / "panel.toml"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b" \n\t\n", "the file is empty"),
        (b"a = 1\n\x00\x00", r"binary file \(NUL byte at 6\)"),
        (b'a = 1\nb = "\xe9"', r"not UTF-8 text \(byte 0xe9 at position 11, line 2\)"),
        (b"\xff\xfea\x00", "UTF-16 text; save it as UTF-8"),
        (b"a = 1\nb = = 2\n", r"at line 2, column 5: b = = 2"),
        (b'a = 1\n[table\nb = "x', r"line 2, column"),
        (b'a = 1\nb = ["x",', r"the file ends too early, after: b = \[\"x\","),
        (b"a = 1\na = 2\n", r"line 2"),
        (b"a = " + b"[" * 5000, "nested more than 30 deep at line 1"),
    ],
)
def test_wrong_content_is_one_clear_message(tmp_path: Path, content: bytes, message: str) -> None:
    path = write(tmp_path, content)
    with pytest.raises(FileError, match=message) as caught:
        read_toml(path)
    assert str(path) in str(caught.value)


def test_byte_order_mark_is_no_content(tmp_path: Path) -> None:
    assert read_toml(write(tmp_path, b"\xef\xbb\xbfa = 1")).data == {"a": 1}


def test_missing_file_folder_and_large_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        read_toml(tmp_path / "none.toml")
    with pytest.raises(FileError, match="is a folder"):
        read_toml(tmp_path)
    with pytest.raises(FileError, match="too large"):
        read_toml(write(tmp_path, b"#" * (LARGEST_FILE + 1)))
    with pytest.raises(FileError, match="cannot be read"):
        read_toml(tmp_path / ("x" * 300))
    with pytest.raises(FileError, match="cannot be read"):
        read_toml("bad\0name.toml")
