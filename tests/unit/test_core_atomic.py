"""Atomic writes: all or nothing, nothing left behind, clear reasons."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from turnout.core.errors import FileError
from turnout.core.files import atomic_path, make_durable, write_atomic, write_fault


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_file_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    target = tmp_path / "run.nc"
    with atomic_path(target) as temporary:
        temporary.write_text("new")
        assert not target.exists()
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".nc"
    assert target.read_text() == "new"
    assert names(tmp_path) == ["run.nc"]


@pytest.mark.parametrize("fault", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_failure_keeps_the_old_file_and_leaves_nothing(
    tmp_path: Path, fault: type[BaseException]
) -> None:
    target = tmp_path / "run.txt"
    target.write_text("old")

    def fail() -> None:
        with atomic_path(target) as temporary:
            temporary.write_text("half")
            raise fault

    with pytest.raises(fault):
        fail()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["run.txt"]


def test_permissions_are_those_of_any_new_file_or_of_the_old_one(tmp_path: Path) -> None:
    plain, target = tmp_path / "plain", tmp_path / "target"
    plain.write_text("")
    write_atomic(target, "x")
    assert stat.S_IMODE(target.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)
    target.chmod(0o600)
    write_atomic(target, b"y")
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    assert target.read_text() == "y"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (".", "is a folder; name a file"),
        ("none/run.txt", r"no such folder '.*none'; create it"),
        ("file/run.txt", "no such folder"),
        pytest.param(
            "locked/run.txt",
            "is not writable; choose another folder",
            marks=pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere"),
        ),
    ],
)
def test_places_where_no_file_can_be_are_refused(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(FileError, match=message):
        write_atomic(tmp_path / name, "x")
    assert names(tmp_path) == ["file", "locked"]


def test_refused_temporary_file_is_a_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.mkstemp", refuse)
    with pytest.raises(FileError, match=r"run\.txt: is not writable"):
        write_atomic(tmp_path / "run.txt", "x")


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (errno.ENOSPC, "no space left"),
        (errno.EACCES, "is not writable"),
        (errno.EROFS, "is not writable"),
        (errno.EIO, "cannot be written"),
    ],
)
def test_reasons_name_the_remedy(tmp_path: Path, number: int, message: str) -> None:
    assert message in write_fault(tmp_path / "x", OSError(number, os.strerror(number)))


SCRIPT = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
from turnout.core.errors import FileError
from turnout.core.files import write_atomic
try:
    write_atomic(sys.argv[1], b"x" * 100_000)
except FileError as error:
    print(error)
    sys.exit(2)
"""


def test_no_space_is_an_error_not_a_killed_process(tmp_path: Path) -> None:
    target = tmp_path / "run.bin"
    target.write_bytes(b"old")
    done = subprocess.run(
        [sys.executable, "-B", "-c", SCRIPT, str(target)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.returncode == 2, done.stderr
    assert f"{target}: cannot be written, no space left" in done.stdout
    assert target.read_bytes() == b"old"
    assert names(tmp_path) == ["run.bin"]


def test_a_link_stays_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    target, link = tmp_path / "far" / "run.txt", tmp_path / "run.txt"
    link.symlink_to(target)
    write_atomic(link, "first")
    write_atomic(link, "second")
    assert link.is_symlink()
    assert target.read_text(encoding="utf-8") == "second"
    assert [path.name for path in tmp_path.iterdir() if not path.is_dir()] == ["run.txt"]
    assert [path.name for path in target.parent.iterdir()] == ["run.txt"]


def test_what_can_be_made_again_does_not_wait_for_the_disk_until_it_is_asked_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []
    monkeypatch.setattr("os.fsync", calls.append)
    for name in ("a.txt", "b.txt"):
        write_atomic(tmp_path / name, "whole", durable=False)
        assert (tmp_path / name).read_text(encoding="utf-8") == "whole"
    assert not calls
    make_durable([tmp_path / "a.txt", tmp_path / "b.txt"])
    assert len(calls) == 3, "the files and their folder"
    write_atomic(tmp_path / "a.txt", "whole", durable=True)
    assert len(calls) > 3
    with pytest.raises(FileError, match=r"c\.txt: was removed while"):
        make_durable([tmp_path / "c.txt"])
