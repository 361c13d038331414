"""Binary formats: there and back, as other programs lay them out, and damaged."""

import io
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_array

from turnout.core.errors import FileError
from turnout.measurement.formats.file_format import FORMATS, read_recording, write_recording
from turnout.measurement.formats.mat import check_mat5
from turnout.measurement.recording import RecordedChannel, Recording

TIME = np.arange(500) / 1000
ROD = np.sin(20 * TIME)


def recording() -> Recording:
    values = np.random.default_rng(1).normal(size=(3, 500))
    values[2, 7] = np.nan
    channels = (
        RecordedChannel("Rod 1", "mV/V", values[0], 1000.0, 0.25),
        RecordedChannel("Clamp/2 é", "V", values[1], 1000.0, 0.25),
        RecordedChannel("a.b", "", values[2], 1000.0, 0.25),
    )
    return Recording({item.name: item for item in channels}, "test", "2025-11-03T10:12:33.250")


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5"])
def test_there_and_back(tmp_path: Path, suffix: str) -> None:
    given = recording()
    write_recording(given, tmp_path / f"throw{suffix}")
    found = read_recording(tmp_path / f"throw{suffix}")
    assert list(found.channels) == list(given.channels)
    assert found.start_time == given.start_time
    for name, channel in given.channels.items():
        other = found.channel(name)
        assert (other.unit, other.rate, other.start) == (channel.unit, 1000.0, 0.25)
        np.testing.assert_allclose(other.values, channel.values, rtol=1e-15)


@pytest.mark.parametrize("suffix", [".mat", ".h5"])
def test_rates_and_descriptions_of_their_own(tmp_path: Path, suffix: str) -> None:
    slow = RecordedChannel("slow", "V", np.arange(5.0), 10.0, -1.0, "of the gauge")
    fast = RecordedChannel("fast", "V", np.arange(50.0), 100.0)
    write_recording(Recording({"slow": slow, "fast": fast}, "test"), tmp_path / f"a{suffix}")
    found = read_recording(tmp_path / f"a{suffix}")
    assert [(c.rate, c.start, c.description) for c in found.channels.values()] == [
        (10.0, -1.0, "of the gauge"),
        (100.0, 0.0, ""),
    ]
    np.testing.assert_array_equal(found.channel("fast").values, fast.values)


def test_the_suffix_must_be_writable(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"must end in \.csv or \.mat or \.h5"):
        write_recording(recording(), tmp_path / "throw.xlsx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content",
    [
        {"Data1_Rod_1": ROD, "Data1_time_Rod_1": TIME},
        {"t": TIME[:, None], "Rod_1": ROD[None, :]},
        {"Rod_1": ROD, "Fs": 1000.0},
        {"throw": {"time": TIME, "Rod_1": ROD}},
        {"data": np.column_stack((TIME, ROD)), "names": np.array(["Time (s)", "Rod_1"], object)},
    ],
)
def test_matlab_as_others_write_it(tmp_path: Path, content: dict[str, object]) -> None:
    savemat(tmp_path / "throw.mat", content)
    found = read_recording(tmp_path / "throw.mat")
    (channel,) = found.channels.values()
    assert channel.name.rsplit(".", 1)[-1] == "Rod_1"
    assert channel.rate == 1000.0
    np.testing.assert_array_equal(channel.values, ROD)


def matlab73(path: Path) -> None:
    """Lay a file out as MATLAB 7.3 does: HDF5 behind a header of 512 bytes, columns as rows."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("time", TIME), ("Rod_1", ROD)):
            item = file.create_dataset(name, data=values[None, :])
            item.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))


def test_matlab_73(tmp_path: Path) -> None:
    matlab73(tmp_path / "throw.mat")
    found = read_recording(tmp_path / "throw.mat").channel("Rod_1")
    assert found.rate == 1000.0
    np.testing.assert_array_equal(found.values, ROD)


def test_hdf5_as_others_write_it(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        file.create_dataset("drive/Rod 1", data=ROD).attrs["units"] = "mV/V"
        file.create_dataset("drive/time", data=TIME)
        file.create_dataset("clamp", data=ROD[::2]).attrs["sampling_rate"] = 500
        file.create_dataset("cube", data=np.zeros((2, 2, 2)))
    found = read_recording(tmp_path / "throw.h5")
    assert {n: (c.rate, c.unit) for n, c in found.channels.items()} == {
        "clamp": (500.0, ""),
        "drive/Rod 1": (1000.0, "mV/V"),
    }


@pytest.mark.parametrize(
    ("suffix", "kept"), [(".mat", 0.1), (".mat", 0.95), (".h5", 0.1), (".h5", 0.5)]
)
def test_a_truncated_file_is_one_message(tmp_path: Path, suffix: str, kept: float) -> None:
    path = tmp_path / f"throw{suffix}"
    write_recording(recording(), path)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(FileError, match=r"throw.*(damaged|no channel)"):
        read_recording(path)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_matlab_file_does_not_crash_its_reader(tmp_path: Path, compressed: bool) -> None:
    """Holes and changed sizes, which the reader would follow to memory that is not the file's."""
    path = tmp_path / "throw.mat"
    held = {"Fs": 1000.0, "a": ROD, "names": np.array(["x", "long"], object), "s": {"u": ROD}}
    savemat(path, held, do_compression=compressed)
    whole = path.read_bytes()
    assert read_recording(path).channel("a").values.size == ROD.size
    half, end = len(whole) // 2, len(whole) - 500
    damaged = [
        *(whole[:at] + whole[at + 400 :] for at in (140, 168, 200, half, end)),
        *(whole[:at] + bytes([whole[at] ^ 64]) + whole[at + 1 :] for at in (128, 132, 133)),
    ]
    for content in damaged[compressed::2]:
        path.write_bytes(content)
        with pytest.raises(FileError, match="is no MATLAB file, or a damaged one"):
            read_recording(path)


def test_a_cell_array_of_fewer_values_than_it_says(tmp_path: Path) -> None:
    """Its first dimension stands behind header, tag, flags and a tag: at byte 160."""
    path = tmp_path / "a.mat"
    savemat(path, {"c": np.array([["x", "yz"]], dtype=object)})
    content = bytearray(path.read_bytes())
    assert content[160] == 1
    content[160] = 3
    path.write_bytes(content)
    with pytest.raises(ValueError, match="a cell array does not hold as many values"):
        check_mat5(path)


@pytest.mark.parametrize(
    ("place", "bit", "reason", "kept"),
    [
        (134, 0, "cut off within a variable$", {"Fs"}),
        (312, 2, "as many numbers as it says", {"Fs", "a", "s"}),
        (328, 0, "as many values as it says", {"Fs", "a", "s"}),
    ],
)
def test_a_flipped_bit_that_scipy_does_not_notice(
    tmp_path: Path, place: int, bit: int, reason: str, kept: set[str]
) -> None:
    """One bit in a size or class: variables are lost, or a structure is none."""
    path = tmp_path / "a.mat"
    savemat(path, {"Fs": 1000.0, "a": np.arange(6.0), "s": {"u": np.arange(6.0)}})
    content = bytearray(path.read_bytes())
    content[place] ^= 1 << bit
    path.write_bytes(content)
    found = loadmat(path, squeeze_me=True, struct_as_record=False)
    assert {name for name in found if name[0] != "_"} == kept
    assert not hasattr(found.get("s"), "u")
    with pytest.raises(ValueError, match=reason):
        check_mat5(path)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda content: content[: len(content) // 2], "^it is cut off within a variable$"),
        (lambda content: content[:128] + b"\x0d" + content[129:], "^it holds .* of type 13 where"),
    ],
)
def test_what_is_wrong_with_the_elements_of_a_file(
    tmp_path: Path, change: Callable[[bytes], bytes], reason: str
) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"a": ROD})
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(ValueError, match=reason):
        check_mat5(path)


@pytest.mark.parametrize(
    "value",
    [
        np.array([[1 + 2j, 3]]),
        np.array([[True, False]]),
        "text é",
        np.zeros((0, 3)),
        {"inner": {"deep": np.arange(3, dtype="int16")}, "other": "x"},
        np.array([[ROD, "mixed"], [{"a": 1.0}, ROD]], dtype=object),
        np.array([(1.0, "a"), (2.0, "b")], dtype=[("f", "O"), ("g", "O")]),
        csc_array(np.eye(4)),
        np.zeros((2, 3, 4), dtype="float32"),
    ],
)
@pytest.mark.parametrize("compressed", [False, True])
def test_whatever_matlab_holds_passes_the_check(
    tmp_path: Path, value: object, compressed: bool
) -> None:
    savemat(tmp_path / "a.mat", {"value": value, "Fs": 1000.0}, do_compression=compressed)
    check_mat5(tmp_path / "a.mat")


@pytest.mark.parametrize("suffix", [".mat", ".h5"])
def test_another_kind_of_file_under_a_known_name(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"throw{suffix}"
    path.write_bytes(bytes(range(256)) * 20)
    with pytest.raises(FileError, match="damaged"):
        read_recording(path)
    path.write_text("t,a\n0,1\n0.1,2\n0.2,3\n")
    assert read_recording(path).channel("a").rate == pytest.approx(10.0)


def test_a_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="is a folder"):
        read_recording(tmp_path)
    with pytest.raises(FileError, match="no such file"):
        read_recording(tmp_path / "none.csv")


def test_content_without_channels(tmp_path: Path) -> None:
    file = io.BytesIO()
    savemat(file, {"text": "hello", "one": 3.0})
    (tmp_path / "a.mat").write_bytes(file.getvalue())
    with pytest.raises(FileError, match="no channel can be read: there are no numbers in it"):
        read_recording(tmp_path / "a.mat")


def test_every_reader_is_where_its_format_says() -> None:
    """Readers are named by text and imported in another process, so no other check sees them."""
    for item in FORMATS:
        module, _, function = item.reader.partition(":")
        if module:
            found = import_module(f"turnout.measurement.formats.{module}")
            assert callable(getattr(found, function))
