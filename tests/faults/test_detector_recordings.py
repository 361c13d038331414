"""Recordings that are connected, written or cut wrongly: said, and never called sound."""

import os
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.detector_files import detector_file
from tests.unit.detector_toy import RATE, TIME, toy_detector, toy_throw
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import FileError, TurnoutError
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_rows import read_table
from turnout.figures.report.detection import detection_page

HEAD = "throw,rate [Hz],start [s],force 1 [N],force 2 [N]"
Numbers = np.ndarray


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return detector_file(tmp_path_factory.mktemp("detector"))


def cells(force: Numbers) -> list[str]:
    return [" ".join(f"{value:.1f}" for value in row) for row in force]


def table(
    folder: Path, force: Numbers, *, head: str = HEAD, rate: str = f"{RATE:g}", start: str = ""
) -> Path:
    path = folder / "throws.csv"
    path.write_text(f"{head}\na,{rate},{start},{','.join(cells(force))}\n", encoding="utf-8")
    return path


def judged(path: Path) -> list[tuple[str, str]]:
    found = toy_detector().predict(read_table(path))
    return [(item.status, item.reason) for item in found]


WRONG: dict[str, tuple[Callable[[Numbers], Numbers], str]] = {
    "all turned round": (lambda force: -force, "forces are turned round"),
    "one turned round": (
        lambda force: force * np.array([[-1.0], [1.0]]),
        "the force of drive 1 is turned round",
    ),
    "one channel twice": (lambda force: force[[0, 0]], "drives 1 and 2 hold the same samples"),
}


@pytest.mark.parametrize("size", [0.0, 24e-3])
@pytest.mark.parametrize("start", ["", "-4.4"])
@pytest.mark.parametrize("case", WRONG)
def test_channels_connected_wrongly_are_named(
    case: str, start: str, size: float, tmp_path: Path
) -> None:
    """Forces turned round were called a fault of their sensors, with an object or without."""
    change, words = WRONG[case]
    force = change(toy_throw(seed=3, size=size).force)
    ((status, reason),) = judged(table(tmp_path, force, start=start))
    assert status == "cannot judge"
    assert words in reason


@pytest.mark.parametrize("start", ["", "-4.4"])
@pytest.mark.parametrize("value", [-9999.0, 9999.0, 32767.0])
@pytest.mark.parametrize("at", [700, 900])
def test_a_sample_that_was_not_measured_is_no_object(
    at: int, value: float, start: str, tmp_path: Path
) -> None:
    """One -9999 among good samples was called an object at sleeper 11, or dry chairs."""
    force = toy_throw(seed=3).force
    force[1, at] = value
    ((status, reason),) = judged(table(tmp_path, force, start=start))
    assert status == "cannot judge"
    assert f"a spike of {value:.0f} N" in reason or "is not clear" in reason


def test_right_channels_are_judged(tmp_path: Path) -> None:
    force = toy_throw(seed=3).force
    assert [status for status, _ in judged(table(tmp_path, force))] == ["sound"]
    assert [status for status, _ in judged(table(tmp_path, force, start="-4.4"))] == ["sound"]


def test_a_second_throw_in_a_row_is_not_passed_over(tmp_path: Path) -> None:
    """Only the first one was judged where the row says when it begins."""
    sound, trapped = toy_throw(seed=3), toy_throw(seed=4, size=24e-3)
    both = np.concatenate([sound.force, trapped.force], axis=1)
    ((status, reason),) = judged(table(tmp_path, both, start="-4.4"))
    assert status == "cannot judge"
    assert "holds a closing movement at 8." in reason
    alone = Recorded(
        name="a",
        time=TIME - 4.4,
        force=sound.force,
        drives=("1", "2"),
        onsets={"closing": 0.0},
        single=True,
    )
    judge = toy_detector().judge
    assert judge(alone).status == "sound"
    time = np.arange(both.shape[1]) / RATE - 4.4
    assert "one row is one throw" in judge(replace(alone, time=time, force=both)).reason


@pytest.mark.parametrize(
    ("separator", "comma", "encoding"),
    [(";", True, "utf-8"), (";", False, "latin-1"), ("\t", True, "utf-16"), (",", False, "utf-8")],
)
def test_tables_of_other_countries_are_read(
    separator: str, comma: bool, encoding: str, tmp_path: Path
) -> None:
    force = toy_throw(seed=3).force
    row = ["Süd", "125,0" if comma else "125.0", "", *cells(force / 1e3 * 1e3)]
    if comma:
        row[3:] = [text.replace(".", ",") for text in row[3:]]
    path = tmp_path / "throws.csv"
    head = HEAD.replace(",", separator).replace("start [s]", " start  [s] ")
    path.write_text(f"{head}\r\n{separator.join(row)}\r\n", encoding=encoding)
    (found,) = read_table(path)
    assert (found.name, found.fault) == ("Süd", "")
    np.testing.assert_allclose(found.force, force, atol=0.06)


def test_a_column_in_kilonewtons_is_taken_as_such(tmp_path: Path) -> None:
    force = toy_throw(seed=3).force
    text = [" ".join(f"{1e-3 * value:.4f}" for value in row) for row in force]
    path = tmp_path / "throws.csv"
    head = HEAD.replace("[N]", "[kN]")
    path.write_text(f"{head}\na,{RATE:g},,{text[0]},{text[1]}\n", encoding="utf-8")
    (found,) = read_table(path)
    np.testing.assert_allclose(found.force, force, atol=0.06)


def test_a_long_row_is_read(tmp_path: Path) -> None:
    """`csv` refuses cells of more than 131,072 characters, 17 s at 1 kHz."""
    force = np.tile(toy_throw(seed=3).force, (1, 20))
    (found,) = read_table(table(tmp_path, force, rate="2500", start="-4.4"))
    assert found.force.shape == force.shape


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (
            "throw,rate [Hz],force 1 [lbf],force 2 [lbf]",
            "its heading has 'throw', 'rate [Hz]', 'fo",
        ),
        ("throw,rate [Hz],force 1 [N],force 1 [kN]", "'force 1' more than once"),
        ("throw,rate [Hz],rate [Hz],force 1 [N]", "'rate [Hz]' more than once"),
        (HEAD, "but no row"),
        ("", "its heading has nothing"),
    ],
)
def test_what_is_no_table_says_why(head: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "throws.csv"
    path.write_text(f"{head}\n", encoding="utf-8")
    with pytest.raises(FileError) as raised:
        read_table(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert words in str(raised.value)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("a,inf,,1 2,1 2", "'rate [Hz]' is inf"),
        ("a,,,1 2,1 2", "'rate [Hz]' is empty"),
        ("a,1e300,,1 2,1 2", "'rate [Hz]' is 1e300"),
        ("a,125,,1 2 3", "3 of drive 1, 0 of drive 2"),
        ("a,125,,1 x,1 2", "is no number"),
        ("a,125,,1,5 2,5 1,5,2", "decimal commas need semicolons"),
        ("a,100 125,,1 2,1 2", "'rate [Hz]' is 100 125"),
    ],
)
def test_a_row_that_cannot_be_read_says_why(row: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "throws.csv"
    path.write_text(f"{HEAD}\n{row}\n", encoding="utf-8")
    (found,) = read_table(path)
    assert words in found.fault


def test_a_page_without_a_throw_that_could_be_judged_shows_no_good_news(tmp_path: Path) -> None:
    """It showed 'Not called' in green, with '0 of 1 throws are called sound'."""
    lost = toy_detector().predict(read_table(table(tmp_path, -toy_throw(seed=3).force)))
    rows = [
        {name: getattr(item, name) for name in item.__dataclass_fields__} | {"gaps": []}
        for item in lost
    ]
    first = detection_page(rows, about={}).findings[0]
    assert (first.level, first.answer) == ("bad", "Unknown")
    some = [*rows, rows[0] | {"status": "sound"}]
    first = detection_page(some, about={}).findings[0]
    assert (first.level, first.answer) == ("look", "Not called")


def said(*arguments: str) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["detect", *arguments])
    failed = isinstance(found.exception, FileError)
    return (2 if failed else found.exit_code), " ".join(f"{found.output} {found.exception}".split())


def test_learning_nothing_is_an_error_and_writes_nothing(detector: Path, tmp_path: Path) -> None:
    path = table(tmp_path, toy_throw(seed=4, size=24e-3).force)
    out = tmp_path / "learned.detector"
    code, text = said("learn", str(detector), str(path), "-o", str(out))
    assert code == 2
    assert "none of 1 throws is called sound" in text
    assert not out.exists()


def test_a_quantity_that_no_detector_judges_is_refused(tmp_path: Path) -> None:
    out = ["-o", str(tmp_path / "a.detector"), "--folder", str(tmp_path / "throws")]
    code, text = said("train", "--channels", "all", *out)
    assert code == 2
    assert "--channels all: allowed are force, current, power" in text


@pytest.mark.parametrize("place", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_a_detector_with_a_wrong_byte_is_one_message(
    place: float, detector: Path, tmp_path: Path
) -> None:
    content = bytearray(detector.read_bytes())
    at = int(place * len(content))
    content[at : at + 40] = bytes(255 - value for value in content[at : at + 40])
    path = tmp_path / "damaged.detector"
    path.write_bytes(content)
    with pytest.raises(FileError, match="damaged.detector: "):
        Detector.load(path)


def test_a_detector_that_another_program_packed_is_one_message(
    detector: Path, tmp_path: Path
) -> None:
    path = tmp_path / "packed.detector"
    with zipfile.ZipFile(detector) as old, zipfile.ZipFile(path, "w") as new:
        for item in old.infolist():
            new.writestr(item.filename, old.read(item))
    content = path.read_bytes().replace(
        b"PK\x03\x04\x14\x00\x00\x00", b"PK\x03\x04\x14\x00\x01\x00"
    )
    content = content.replace(
        b"PK\x01\x02\x14\x03\x14\x00\x00\x00", b"PK\x01\x02\x14\x03\x14\x00\x01\x00"
    )
    path.write_bytes(content)
    with pytest.raises(FileError, match="cannot be read as a detector"):
        Detector.load(path)


SAID = ("bad.csv: cannot judge", "a: cannot judge: 'rate [Hz]' is inf", "a: sound")
"""Of each file, in the order in which they are whole."""


def test_watching_goes_on_whatever_comes(detector: Path, tmp_path: Path) -> None:
    """A file that grows is judged once it is whole; a bad one, or no folder, ends nothing."""
    inbox = tmp_path / "Eingang Süd"
    inbox.mkdir()
    (inbox / "bad.csv").write_bytes(b"\x89HDF\r\n\x1a\n\0\0")
    (inbox / "rate.csv").write_text(f"{HEAD}\na,inf,,1 2,1 2\n", encoding="utf-8")
    run = subprocess.Popen(
        [sys.executable, "-m", "turnout", "detect", "watch", str(detector), str(inbox)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    try:
        whole = table(tmp_path, toy_throw(seed=3).force).read_text(encoding="utf-8")
        with (inbox / "growing.csv").open("w", encoding="utf-8") as file:
            for at in range(0, len(whole), len(whole) // 6 + 1):
                file.write(whole[at : at + len(whole) // 6 + 1])
                file.flush()
                time.sleep(0.5)
        assert run.stdout is not None
        text = ""
        while not all(said in text for said in SAID):
            line = run.stdout.readline()
            assert line, text
            text += line
        inbox.rename(tmp_path / "away")
        time.sleep(3.0)
        assert run.poll() is None
        run.send_signal(signal.SIGINT)
        _, problems = run.communicate(timeout=60)
    finally:
        run.kill()
    assert run.returncode == 130
    assert "cannot be read now" in problems
    assert "Traceback" not in problems


def test_what_is_no_throw_is_named() -> None:
    detector = toy_detector()
    with pytest.raises(TypeError, match=r"read_throws\('today'\)"):
        detector.predict("today")  # type: ignore[arg-type]
    throw = toy_throw(seed=3)
    one = xr.Dataset({"drive_force": (("time",), throw.force[0])}, {"time": throw.time})
    (verdict,) = detector.predict(one)
    assert verdict.reason == "'drive_force' has no dimension 'drive'"


def test_times_of_day_are_instants() -> None:
    throw = toy_throw(seed=3)
    day = np.datetime64("2026-11-23T08:00:00", "ns") + (1e9 * throw.time).astype("timedelta64[ns]")
    dataset = xr.Dataset(
        {"drive_force": (("drive", "time"), throw.force)}, {"time": day, "drive": ["1", "2"]}
    )
    (verdict,) = toy_detector().predict(dataset)
    assert verdict.status == "sound"


def test_a_rate_without_threshold_names_those_that_are_known() -> None:
    detector = Detector(toy_detector().knowledge, 0.01)
    with pytest.raises(
        TurnoutError, match=r"at 0.01 false alarms a throw; it has for 0.001, 0.0001"
    ):
        detector.predict(toy_throw(seed=3))
