"""Formats with a package of their own: Dewesoft, MDF, TDMS, Parquet."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from turnout.core.errors import FileError
from turnout.measurement.formats.file_format import read_recording

TIME = np.arange(500) / 1000
ROD = np.sin(20 * TIME)


@pytest.fixture
def dewesoft_file(pytestconfig: pytest.Config) -> Path:
    pytest.importorskip("dwdatareader", reason="the extra daq is not installed")
    file = pytestconfig.rootpath.parent / "shared/data/dewesoft/Example_Drive01.d7d"
    if not file.exists():
        pytest.skip("no Dewesoft file: ../shared/data is not beside this checkout")
    return file


def mdf(path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="the extra daq is not installed")
    rod = asammdf.Signal(ROD, TIME, name="Rod 1", unit="mV/V", comment="upper gauge")
    clamp = asammdf.Signal((100 * ROD[::2]).astype("int16"), TIME[::2] + 1, name="Clamp", unit="V")
    word = asammdf.Signal(np.array([b"a"] * 500), TIME, name="word", encoding="utf-8")
    with asammdf.MDF() as file:
        file.append([rod, word])
        file.append([clamp])
        file.save(path, overwrite=True)


def tdms(path: Path) -> None:
    nptdms = pytest.importorskip("nptdms", reason="the extra daq is not installed")
    reported = {"wf_increment": 0.001, "unit_string": "mV/V", "description": "upper gauge"}
    later = {"wf_increment": 0.002, "wf_start_offset": 1.0, "unit_string": "V"}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject("Throw", "Rod 1", ROD, reported)])
        values = (100 * ROD[::2]).astype("int16")
        file.write_segment([nptdms.ChannelObject("Throw", "Clamp", values, later)])
        file.write_segment([nptdms.ChannelObject("Throw", "word", ["a", "b"])])


def parquet(path: Path) -> None:
    pa = pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    import pyarrow.parquet as pq

    schema = pa.schema(
        [
            pa.field("Time (s)", pa.float64()),
            pa.field("Rod 1", pa.float64(), metadata={"unit": "mV/V"}),
            pa.field("Clamp [V]", pa.int16()),
            pa.field("word", pa.string()),
        ]
    )
    columns = [TIME, ROD, (100 * ROD).astype("int16"), ["a"] * 500]
    pq.write_table(pa.table(columns, schema=schema), path)


@pytest.mark.parametrize(("write", "suffix"), [(mdf, ".mf4"), (tdms, ".tdms")])
def test_groups_with_rates_of_their_own(tmp_path: Path, write: object, suffix: str) -> None:
    path = tmp_path / f"throw{suffix}"
    write(path)
    found = read_recording(path)
    rod, clamp = found.channel("Rod 1"), found.channel("Clamp")
    assert (rod.unit, rod.description) == ("mV/V", "upper gauge")
    assert (rod.rate, rod.start) == (pytest.approx(1000.0), 0.0)
    assert (clamp.rate, clamp.start) == (pytest.approx(500.0), 1.0)
    np.testing.assert_array_equal(rod.values, ROD)
    np.testing.assert_array_equal(clamp.values, (100 * ROD[::2]).astype("int16"))
    assert len(found.problems) == 1
    assert "'word' is left out" in found.problems[0]


def test_parquet(tmp_path: Path) -> None:
    parquet(tmp_path / "throw.parquet")
    found = read_recording(tmp_path / "throw.parquet")
    assert {n: (c.unit, c.rate) for n, c in found.channels.items()} == {
        "Rod 1": ("mV/V", 1000.0),
        "Clamp": ("V", 1000.0),
    }
    np.testing.assert_array_equal(found.channel("Rod 1").values, ROD)
    assert found.problems == ("column 'word' is left out: it holds no numbers",)


def test_parquet_with_timestamps(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    import pyarrow.parquet as pq

    moments = np.datetime64("2025-11-03T10:12:33.250") + np.arange(500) * np.timedelta64(1, "ms")
    pq.write_table(pa.table({"time": moments, "Rod 1": ROD}), tmp_path / "throw.parquet")
    found = read_recording(tmp_path / "throw.parquet")
    assert found.channel("Rod 1").rate == pytest.approx(1000.0)
    assert (found.start_time or "").startswith("2025-11-03T10:12:33.250")


@pytest.mark.parametrize(
    ("write", "suffix", "kept"),
    [(mdf, ".mf4", 0.02), (mdf, ".mf4", 0.95), (parquet, ".parquet", 0.5)],
)
def test_a_truncated_file_is_one_message(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], write: object, suffix: str, kept: float
) -> None:
    path = tmp_path / f"throw{suffix}"
    write(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(FileError, match=r"is no \w+ file, or a damaged one") as caught:
        read_recording(path)
    assert len(str(caught.value).splitlines()) == 1
    assert capfd.readouterr() == ("", "")


def test_a_truncated_tdms_file_says_so(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """What came before the cut is there to be had."""
    path = tmp_path / "throw.tdms"
    tdms(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    found = read_recording(path)
    values = found.channel("Rod 1").values
    np.testing.assert_array_equal(values, ROD[: values.size])
    assert 0 < values.size < ROD.size
    assert "less data than expected" in found.problems[0]
    assert capfd.readouterr() == ("", "")
    path.write_bytes(content[: len(content) // 100])
    with pytest.raises(FileError, match="no channel can be read: .*incomplete"):
        read_recording(path)


@pytest.mark.parametrize(
    ("name", "package", "extra"),
    [
        ("a.d7d", "dwdatareader", "daq"),
        ("a.mf4", "asammdf", "daq"),
        ("a.tdms", "nptdms", "daq"),
        ("a.parquet", "pyarrow", "parquet"),
        ("a.xlsx", "python_calamine", "sheets"),
        ("a.uff", "pyuff", "daq"),
    ],
)
def test_a_missing_package_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, package: str, extra: str
) -> None:
    path = tmp_path / name
    path.write_bytes(bytes(range(256)))
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "turnout.measurement.formats.file_format.find_spec",
        lambda n: None if n == package else find(n),
    )
    with pytest.raises(FileError, match=rf"need {package}; pip install 'turnout\[{extra}\]'"):
        read_recording(path)


@pytest.mark.parametrize("name", ["a.d7d", "a.mf4", "a.tdms", "a.parquet"])
def test_another_kind_of_file_under_a_known_name(tmp_path: Path, name: str) -> None:
    for package in ("dwdatareader", "asammdf", "nptdms", "pyarrow"):
        pytest.importorskip(package, reason="the extras daq and parquet are not installed")
    path = tmp_path / name
    path.write_bytes(bytes(range(256)) * 100)
    with pytest.raises(FileError, match=r"is no \w+ file, or a damaged one") as caught:
        read_recording(path)
    assert len(str(caught.value).splitlines()) == 1


def test_a_real_dewesoft_file(dewesoft_file: Path) -> None:
    """A car drive of 95.8 s: what can be read is, what cannot is named with its reason."""
    found = read_recording(dewesoft_file)
    assert {n: (c.unit, c.rate, c.values.size) for n, c in found.channels.items()} == {
        "GPSvel": ("kph", 100.0, 9580),
        "Math 0": ("", 100.0, 9580),
        "X absolute": ("", 2.0, 191),
        "Y absolute": ("", 2.0, 191),
        "Used sattelites": ("", 2.0, 191),
        "CNT 0": ("m", 100.0, 9580),
    }
    assert found.start_time == "2003-10-09T21:27:46.812004+00:00"
    assert found.channel("GPSvel").values[:2] == pytest.approx([89.2578125, 89.26391602])
    can = [text for text in found.problems if "not supported on CAN channel" in text]
    assert len(can) == 12
    assert can[3].startswith("channel 'ENG_RPM' is left out")
    assert "'Velocity', 'Direction' are left out: 61 of its 1838 times repeat" in found.problems[-1]


@pytest.mark.parametrize("kept", [0.02, 0.5])
def test_a_truncated_dewesoft_file_does_not_end_the_program(
    tmp_path: Path, dewesoft_file: Path, kept: float
) -> None:
    """Dewesoft's library crashes on it, in a process of its own."""
    content = dewesoft_file.read_bytes()
    path = tmp_path / "throw.d7d"
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(FileError, match="crashed on it .*truncated or damaged"):
        read_recording(path)
