"""Panel files that cannot be read at all: one clear message, no traceback of a library."""

import re
from pathlib import Path

import pytest

from turnout.core.errors import FileError, TurnoutError
from turnout.panel.load import library_text, load_panel


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"\x7fELF\0\0", "is a binary file"),
        (b'name = "sb1"  # caf\xe9', "not UTF-8 text"),
        (library_text("sb1").partition(' kN/m"')[0].encode(), "not valid TOML"),
        (b"[drive\n", "not valid TOML.*line 1"),
        (b"x" * 5_000_000, "too large"),
    ],
    ids=["empty", "binary", "not UTF-8", "torn", "syntax", "too large"],
)
def test_unreadable_content(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "panel.toml"
    path.write_bytes(content)
    with pytest.raises(FileError, match=message) as caught:
        load_panel(path)
    assert str(caught.value).startswith(str(path))


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        load_panel(tmp_path / "panel.toml")
    with pytest.raises(FileError, match="is a folder"):
        load_panel(tmp_path)


def test_a_file_torn_anywhere_never_ends_in_a_traceback(tmp_path: Path) -> None:
    content = library_text("sb2").encode()
    path = tmp_path / "panel.toml"
    # What is cut inside the optional last table can still be a whole panel.
    for length in range(1, content.index(b"[flangeway]") - 100, 97):
        path.write_bytes(content[:length])
        with pytest.raises(TurnoutError, match=re.escape(str(path))):
            load_panel(path)
