"""Every refusal of `turnout sweep run` is one message, exit code 2, and leaves data untouched."""

import errno
import json
import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import pytest
from tests.unit.sweeps import STUDY, batch_names, here, small_study, study_file

from turnout.cli.main import main
from turnout.core import files
from turnout.core.errors import FileError
from turnout.core.json_files import sealed_json
from turnout.study.sweep.folder import BATCHES, IDENTITY
from turnout.study.sweep.run import throw_study

COUNT = 3


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of the small study, to be copied."""
    folder = tmp_path_factory.mktemp("made")
    throw_study(small_study(folder, count=COUNT), folder / "sweep", pool=here)
    return folder / "sweep"


@pytest.fixture
def swept(made: Path, tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    for path in sorted(made.rglob("*")):
        copy = tmp_path / "sweep" / path.relative_to(made)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            copy.write_bytes(path.read_bytes())
    return tmp_path / "sweep"


def content(folder: Path) -> dict[str, bytes]:
    """Return all that a folder holds, but for the file that only its lock is taken on."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != ".lock")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def run(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: object
) -> tuple[int, str]:
    """Run the program in this process; return its exit code and what it said of an error."""
    monkeypatch.setattr(sys, "argv", ["turnout", *map(str, words)])
    with pytest.raises(SystemExit) as caught:
        main()
    return int(caught.value.code or 0), capsys.readouterr().err


TEXTS = {
    "unknown key": (STUDY.replace("seed = 3", "sed = 3"), "sed: unknown key; nearest is 'seed'"),
    "unknown variable": (
        STUDY.replace("chair.friction_coefficient", "chair.friction"),
        "nearest is 'chair.friction_coefficient'",
    ),
    "impossible range": (STUDY.replace("maximum = 0.4", "maximum = 0.05"), "must be more than"),
    "range beyond the panel": (STUDY.replace("maximum = 0.4", "maximum = 40.0"), "at most 2"),
    "infinite range": (STUDY.replace("maximum = 0.4", "maximum = inf"), "maximum"),
    "zero scenarios": (STUDY.replace("{count}", "0"), "or there is no scenario"),
    "no variable": (STUDY.split("[[variable]]")[0], "so there is no scenario"),
    "too many scenarios": (STUDY.replace("{count}", "9999999999"), "sampling.count"),
    "no TOML": ("name = 'a", "study.toml"),
    "no text": ("\udcff", "study.toml"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_wrong_study_is_refused_before_anything_is_made(
    name: str,
    swept: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text, said = TEXTS[name]
    study = tmp_path / "study.toml"
    study.write_bytes(text.format(count=COUNT).encode(errors="surrogateescape"))
    before = content(swept)
    for folder in (swept, tmp_path / "new"):
        code, reported = run(capsys, monkeypatch, "sweep", "run", study, "-o", folder)
        assert code == 2, reported
        assert reported.startswith("turnout: ")
        assert said in reported
        assert "Traceback" not in reported
    assert content(swept) == before
    assert not (tmp_path / "new").exists()


def of_another_study(folder: Path) -> None:
    """Leave the folder as it is: the study that is run has one scenario more."""


def of_another_form(folder: Path) -> None:
    edit(folder, store_version=99)


def of_another_version(folder: Path) -> None:
    edit(folder, version="0.0.1")


def of_other_sources(folder: Path) -> None:
    edit(folder, code="0123456789abcdef")


def without_its_identity(folder: Path) -> None:
    (folder / IDENTITY).unlink()


def with_half_an_identity_and_no_batch(folder: Path) -> None:
    path = folder / IDENTITY
    path.write_bytes(path.read_bytes()[:40])
    for batch in (folder / BATCHES).iterdir():
        batch.unlink()


def with_an_identity_of_another_kind(folder: Path) -> None:
    """It is only replaced where all batches are of the study, which is another one here."""
    (folder / IDENTITY).write_text("[1, 2]", encoding="utf-8")


def with_a_file_for_batches(folder: Path) -> None:
    for path in (folder / BATCHES).iterdir():
        path.unlink()
    (folder / BATCHES).rmdir()
    (folder / BATCHES).write_text("in the way", encoding="utf-8")


def with_a_batch_too_many(folder: Path) -> None:
    path = next((folder / BATCHES).iterdir())
    (folder / BATCHES / path.name.replace("000000", "000007")).write_bytes(path.read_bytes())


def edit(folder: Path, **changes: object) -> None:
    path = folder / IDENTITY
    known = json.loads(path.read_text(encoding="utf-8"))
    known.pop("checksum")
    path.write_text(sealed_json(known | changes), encoding="utf-8")


@pytest.mark.parametrize(
    ("spoil", "count", "said"),
    [
        (of_another_study, COUNT + 1, "name another folder"),
        (of_another_form, COUNT, "read it with the version that made it"),
        (of_another_version, COUNT, "begun with turnout 0.0.1"),
        (of_other_sources, COUNT, "no results of two versions are mixed"),
        (without_its_identity, COUNT, "is not empty and holds no sweep"),
        (with_half_an_identity_and_no_batch, COUNT, "sweep.json: is damaged: no JSON"),
        (with_an_identity_of_another_kind, COUNT + 1, "sweep.json: is damaged: no table"),
        (with_a_file_for_batches, COUNT, "cannot be made"),
        (with_a_batch_too_many, COUNT, "is batch 0, not 7; move it out"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_folder_of_something_else_is_refused_and_stays_as_it_is(
    spoil: Callable[[Path], None],
    count: int,
    said: str,
    swept: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    study = study_file(tmp_path, count=count)
    spoil(swept)
    before = content(swept)
    code, reported = run(capsys, monkeypatch, "sweep", "run", study, "-o", swept)
    assert code == 2, reported
    assert said in reported
    assert "Traceback" not in reported
    assert content(swept) == before


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    study = study_file(tmp_path, count=COUNT)
    shut = tmp_path / "shut"
    shut.mkdir(mode=stat.S_IRUSR | stat.S_IXUSR)
    code, reported = run(capsys, monkeypatch, "sweep", "run", study, "-o", shut / "sweep")
    assert code == 2, reported
    assert "cannot be made" in reported


@pytest.mark.parametrize("moment", range(5), ids=["identity", "study", "batch", "log", "card"])
def test_no_space_at_any_moment_is_reported_and_goes_on(
    moment: int, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full from the so-many-eth file on; with space again the same bytes come."""
    study, folder = small_study(tmp_path, count=COUNT), tmp_path / "sweep"
    written: list[str] = []

    def count(path: Path) -> None:
        if len(written) == moment:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(path.name)

    def flush(path: Path, *, kept: Callable[[Path], None] = files._flush) -> None:
        count(path)
        kept(path)

    def opened(path: Path, mode: str = "r", **chosen: Any) -> IO[Any]:
        if mode == "a":
            count(path)
        return open(path, mode, **chosen)

    with monkeypatch.context() as full:
        full.setattr(files, "_flush", flush)
        full.setattr(Path, "open", opened)
        with pytest.raises(FileError, match="no space left; free some"):
            throw_study(study, folder, pool=here)
    assert len(written) == moment
    assert not [path for path in folder.rglob(".*") if path.name != ".lock"]
    throw_study(study, folder, pool=here)
    assert batch_names(folder) == batch_names(made)
