"""A campaign or recording from elsewhere reads and writes its own files only."""

import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.faults.terminal import no_longer_than, run_here, run_shell
from tests.unit.campaigns import copied, edited

from turnout.core.errors import FileError, MeasurementError
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.measurement.formats.file_format import read_recording

ROD = np.sin(np.arange(500) / 50)
SECRET = "not to be read or replaced\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a campaign whose first recording has been moved out of it."""
    made = copied(tmp_path)
    first = _first(made)
    shutil.move(made / first, tmp_path / first)
    return made


def _first(folder: Path) -> str:
    lines = (folder / "runs.csv").read_text(encoding="utf-8").splitlines()
    return next(line.split(",")[0] for line in lines if ".csv" in line or ".mat" in line)


@pytest.mark.parametrize("how", ["..", "absolute", "link"])
def test_a_recording_outside_the_folder(folder: Path, how: str) -> None:
    name, outside = _first(folder), folder.parent / _first(folder)
    if how == "link":
        (folder / name).symlink_to(outside)
    else:
        edited(folder, name, f"../{name}" if how == ".." else str(outside))
    code, said = run_here("campaign", "check", "campaign", folder=folder.parent)
    assert code == 2
    assert f"{name} lies outside" in said
    assert "--allow-outside" in said
    assert "Traceback" not in said
    given = ("campaign", "check", "campaign", "--allow-outside", "--quiet")
    assert run_here(*given, folder=folder.parent) == (0, "")


def test_a_file_outside_is_not_looked_for(folder: Path) -> None:
    """Whether a file is there is not revealed: the message is the same."""
    name = _first(folder)
    edited(folder, name, "../none.csv")
    with pytest.raises(MeasurementError, match=r"\.\./none\.csv lies outside"):
        build_campaign_dataset(folder)


@pytest.mark.parametrize("name", ["runs.csv", "channels.toml"])
def test_a_sheet_or_map_that_is_a_link_is_not_quoted(tmp_path: Path, name: str) -> None:
    folder, secret = copied(tmp_path), tmp_path / "secret"
    secret.write_text(SECRET, encoding="utf-8")
    (folder / name).unlink()
    (folder / name).symlink_to(secret)
    with pytest.raises(FileError, match="lies outside") as caught:
        build_campaign_dataset(folder)
    assert "not to be read" not in str(caught.value)


def _external_link(path: Path, other: Path) -> None:
    with h5py.File(path, "w") as file:
        file["rod"] = h5py.ExternalLink(str(other), "rod")


def _external_storage(path: Path, other: Path) -> None:
    with h5py.File(path, "w") as file:
        item = file.create_dataset(
            "rod", shape=(100,), dtype="int8", external=[(str(other), 0, 100)]
        )
        item.attrs["rate"] = 1000.0


def _virtual_dataset(path: Path, other: Path) -> None:
    layout = h5py.VirtualLayout(shape=(500,), dtype="float64")
    layout[:] = h5py.VirtualSource(str(other), "rod", shape=(500,))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("rod", layout).attrs["rate"] = 1000.0


@pytest.mark.parametrize("write", [_external_link, _external_storage, _virtual_dataset])
@pytest.mark.parametrize("suffix", [".h5", ".mat"])
def test_a_recording_that_refers_to_another_file(
    tmp_path: Path, write: object, suffix: str
) -> None:
    other, path = tmp_path / "other.h5", tmp_path / f"throw{suffix}"
    with h5py.File(other, "w") as file:
        file.create_dataset("rod", data=ROD).attrs["rate"] = 1000.0
    write(path, other)
    with pytest.raises(FileError, match=r"another file \(.*other\.h5\).*--allow-outside"):
        read_recording(path)
    assert read_recording(path, allow_outside=True).channel("rod").values.size in (100, 500)


@pytest.mark.parametrize("arguments", [("build",), ("build", "--out", "campaign/a.nc")])
@pytest.mark.parametrize("allow", [(), ("--allow-outside",)])
def test_a_dataset_is_not_written_through_a_link(
    tmp_path: Path, arguments: tuple[str, ...], allow: tuple[str, ...]
) -> None:
    folder, secret = copied(tmp_path), tmp_path / "secret.nc"
    secret.write_text(SECRET, encoding="utf-8")
    for name in ("campaign.nc", "a.nc"):
        (folder / name).symlink_to(secret)
    code, said = run_here("campaign", arguments[0], "campaign", *arguments[1:], *allow,
                         folder=tmp_path)  # fmt: skip
    assert code == 2
    assert "is not written through" in said
    assert secret.read_text(encoding="utf-8") == SECRET


def test_a_map_is_not_written_through_a_link(tmp_path: Path) -> None:
    secret = tmp_path / "secret.toml"
    secret.write_text(SECRET, encoding="utf-8")
    received = tmp_path / "received"
    received.mkdir()
    (received / "throw.csv").write_text("t,rod\n0,1\n1,2\n2,3\n", encoding="utf-8")
    (received / "channels.toml").symlink_to(secret)
    code, said = run_here("import", "throw.csv", "--map", "channels.toml", folder=received)
    assert code == 2
    assert "is not written through" in said
    assert secret.read_text(encoding="utf-8") == SECRET


@pytest.mark.parametrize("depth", [0, 1])
def test_what_is_kept_of_a_campaign_stays_in_it(tmp_path: Path, depth: int) -> None:
    folder, elsewhere = copied(tmp_path, built=False), tmp_path / "elsewhere"
    elsewhere.mkdir()
    if depth:
        (folder / ".turnout").mkdir()
    (folder / ".turnout" / "throws" if depth else folder / ".turnout").symlink_to(elsewhere)
    with pytest.raises(FileError, match="is not written through"):
        build_campaign_dataset(folder, allow_outside=True)
    assert not list(elsewhere.iterdir())


def test_a_piece_that_unpacks_to_much_is_cut_again(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    whole = build_campaign_dataset(folder).dataset
    for path in (folder / ".turnout").iterdir():
        with np.load(path) as arrays:
            content = dict(arrays)
        np.savez_compressed(path, **{**content, "time": np.zeros(1_000_000)})
    again = build_campaign_dataset(folder)
    assert again.reused == 0
    assert again.dataset is not None
    assert whole is not None
    assert again.dataset.equals(whole)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="only POSIX has pipes with names")
@pytest.mark.parametrize("name", ["throw.csv", "throw.h5", "channels.toml"])
def test_a_pipe_is_refused_at_once(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    (tmp_path / "good.csv").write_text("t,rod\n0,1\n1,2\n2,3\n", encoding="utf-8")
    given = ("good.csv", "--channels", name) if name == "channels.toml" else (name,)
    with no_longer_than(60.0):
        code, said = run_here("import", *given, folder=tmp_path)
    assert code == 2
    assert f"{name}: is a pipe, not a file" in said


def test_code_beside_a_recording_is_not_run(tmp_path: Path) -> None:
    """The process that reads must not look for its modules in the current folder."""
    for name in ("json", "h5py", "numpy"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()\n", encoding="utf-8")
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        file.create_dataset("rod", data=ROD).attrs["rate"] = 1000.0
    assert run_shell("import", "throw.h5", folder=tmp_path) == (0, "")
    assert not (tmp_path / "ran").exists()
