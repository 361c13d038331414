"""Results of long jobs: lines and files of arrays come back as they were written, or not at all."""

from pathlib import Path

import numpy as np
import pytest

from turnout.core.errors import FileError
from turnout.core.kept_results import (
    append_line,
    claim_for,
    read_arrays,
    read_lines,
    write_arrays,
)


def test_lines_come_back_and_one_that_was_cut_off_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    for number in range(3):
        append_line(path, {"number": number, "values": (0.1 * number, float("nan"))})
    path.write_text(path.read_text()[:-20])
    assert [line["number"] for line in read_lines(path)] == [0, 1]
    append_line(path, {"number": 2})
    assert read_lines(path)[2] == {"number": 2}


def test_a_digit_that_was_flipped_in_a_line_is_named(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    for value in (1.25, 2.5):
        append_line(path, {"value": value})
    path.write_text(path.read_text().replace("2.5", "2.7"))
    with pytest.raises(FileError, match="line 2: is damaged .* remove the line or the folder"):
        read_lines(path)


def test_lines_of_before_have_no_digest_and_are_read(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    path.write_text('{"value": 1.0}\n')
    assert read_lines(path) == [{"value": 1.0}]


def test_a_line_whose_digest_lost_its_name_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    for value in (1.25, 2.5):
        append_line(path, {"value": value})
    first, last = path.read_text().splitlines()
    path.write_text(f"{first}\n{last.replace('line_digest', 'line_dijest')}\n")
    with pytest.raises(FileError, match="line 2: is damaged"):
        read_lines(path)


def test_files_of_arrays_are_of_their_key_and_whole_or_nothing(tmp_path: Path) -> None:
    path, arrays = tmp_path / "one.npz", {"a": np.arange(40.0)}
    write_arrays(path, "one", arrays, {"word": "held"})
    found = read_arrays(path, "one", lambda kept, about: (kept["a"].tolist(), about["word"]))
    assert found == (arrays["a"].tolist(), "held")
    assert read_arrays(path, "another", lambda *made: made) is None
    assert read_arrays(tmp_path / "none.npz", "one", lambda *made: made) is None
    content = bytearray(path.read_bytes())
    content[200] ^= 1
    path.write_bytes(content)
    assert read_arrays(path, "one", lambda *made: made) is None


def test_a_head_in_a_folder_of_its_own_claims_the_whole_folder(tmp_path: Path) -> None:
    folder, head = tmp_path / "job", ".state/plan.json"
    claim_for(folder, head, {"digest": "a" * 20}, what="job")
    (folder / "result.txt").write_text("made")
    claim_for(folder, head, {"digest": "a" * 20}, what="job")
    with pytest.raises(FileError, match="holds another job .* or give what it was begun with"):
        claim_for(folder, head, {"digest": "b" * 20}, what="job")
    (folder / head).write_text('{"seed": 3}')
    with pytest.raises(FileError, match="names no digest, as an older version wrote it"):
        claim_for(folder, head, {"digest": "a" * 20}, what="job")
    (folder / head).unlink()
    (folder / "result.txt").unlink()
    (folder / ".state" / "part.npz").write_text("of another plan")
    with pytest.raises(FileError, match="holds no job .part.npz is there"):
        claim_for(folder, head, {"digest": "a" * 20}, what="job")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "stranger").touch()
    with pytest.raises(FileError, match="is not empty and holds no job .stranger is there"):
        claim_for(tmp_path / "full", head, {"digest": "a" * 20}, what="job")
