"""The studio's views of detection: maps of `turnout limit`, verdicts of a detector."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import h5py
import numpy as np
import pytest
from tests.unit.detector_files import detector_file, limit_file, table_file
from tests.unit.served import Client, Reply, served
from tests.unit.simulated import sb2_panel

from turnout.detection.detector.detector import Detector
from turnout.detection.detector.throw_rows import read_table
from turnout.panel.load import load_panel

SIZES = [0.0, 0.0, 0.0, 0.0, 0.0, 24e-3]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("detecting")
    return {
        "detector": detector_file(folder),
        "table": table_file(folder, SIZES),
        "limit": limit_file(folder),
    }


@pytest.fixture(scope="module")
def studio() -> Iterator[Client]:
    with served(sb2_panel()) as client:
        client.enter()
        yield client


def sent(client: Client, path: str, file: Path, **options: str) -> Reply:
    return client.ask(f"{path}?{urlencode({'name': file.name, **options})}", file.read_bytes())


@pytest.fixture(scope="module")
def mark(studio: Client, files: dict[str, Path]) -> str:
    reply = sent(studio, "/api/detector", files["detector"])
    assert reply.status == 200, reply.text
    return str(reply.json["mark"])


def judged(studio: Client, file: Path, mark: str) -> Any:
    reply = sent(studio, "/api/judge", file, detector=mark)
    assert reply.status == 200, reply.text
    return reply.json


def test_verdicts_are_those_of_the_detector(
    studio: Client, files: dict[str, Path], mark: str
) -> None:
    found = judged(studio, files["table"], mark)
    expected = Detector.load(files["detector"]).predict(read_table(files["table"]))
    for one, other in zip(found["verdicts"], expected, strict=True):
        assert (one["name"], one["status"], one["lines"]) == (
            other.name,
            other.status,
            other.lines(),
        )
    last = found["verdicts"][-1]
    assert last["status"] == "object"
    likeliest = max(last["blade"], key=lambda place: place["value"])
    assert likeliest["name"] == "sleeper 6"
    assert [row["label"] for row in found["trends"]["rows"]][0].startswith("Friction")
    assert found["trends"]["rows"][0]["lines"][0]["x"] == [1, 2, 3, 4, 5, 6]


def test_a_sound_throw_lies_in_its_band_and_one_with_an_object_leaves_it(
    studio: Client, files: dict[str, Path], mark: str
) -> None:
    found = judged(studio, files["table"], mark)["verdicts"]

    def outside(verdict: Any) -> float:
        """Return the share of windows outside the band of 95 %."""
        shares = []
        for row in verdict["band"]["rows"]:
            low, high, _, own = (np.array(line["y"]) for line in row["lines"])
            shares.append(np.mean((own < low) | (own > high)))
        return float(np.mean(shares))

    sound = [outside(verdict) for verdict in found[:-1]]
    assert max(sound) < 0.1
    assert outside(found[-1]) > 2 * max(sound)


def test_a_detector_outlives_its_process(studio: Client, files: dict[str, Path], mark: str) -> None:
    worker = judged(studio, files["table"], mark)
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # another process has just ended
            parent = (folder / "stat").read_text().rsplit(")", 1)[1].split()[1]
            if int(parent) == os.getpid() and "spawn_main" in (folder / "cmdline").read_text():
                os.kill(int(folder.name), signal.SIGKILL)
    time.sleep(0.5)  # until the server can know
    assert judged(studio, files["table"], mark)["verdicts"] == worker["verdicts"]


def test_a_limit_keeps_its_numbers(studio: Client, files: dict[str, Path]) -> None:
    reply = sent(studio, "/api/limit", files["limit"])
    assert reply.status == 200, reply.text
    found = reply.json
    assert [place["name"] for place in found["places"]] == [
        *("drive 1", "sleeper 3", "sleeper 6", "drive 2"),
    ]
    assert found["panel"] == {"panel": "sb2", "panel_hash": load_panel("sb2").hash}
    assert found["places"][2]["floor"] == pytest.approx(6e-3)
    both = found["channels"]["both drives"]
    at = int(np.argmin(np.abs(np.array(found["sizes"]) - 11e-3)))
    assert both["pod"][2][at] == pytest.approx(0.5, abs=0.01)
    assert found["channels"]["drive 1"]["a90"] == [None] * 4
    assert both["known_pod"][2][at] == pytest.approx(0.45, abs=0.01)
    assert both["known_a90"][2] == pytest.approx(12.8e-3)
    assert found["channels"]["drive 1"]["known_a90"] == [None] * 4
    assert both["pod"][3][-1] is None  # 30 mm were not thrown at Drive 2
    assert both["untouched"][2] == [size < 6e-3 for size in found["sizes"]]


@pytest.mark.parametrize(
    ("path", "content", "words"),
    [
        ("/api/limit", b"no netCDF", "no netCDF-4 file"),
        ("/api/detector", b"no detector", "x.nc"),
        ("/api/judge", b"throw,rate\n1,2", "no longer loaded"),
    ],
)
def test_what_is_no_such_file_is_one_message(
    studio: Client, tmp_path: Path, path: str, content: bytes, words: str
) -> None:
    file = tmp_path / "x.nc"
    file.write_bytes(content)
    reply = sent(studio, path, file, detector="unknown")
    assert reply.status == 422
    assert words in reply.json["message"]
    assert str(tmp_path) not in reply.json["message"]


def test_a_dataset_takes_nothing_from_other_files(studio: Client, tmp_path: Path) -> None:
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["numbers"] = np.arange(3.0)
    sly = tmp_path / "sly.nc"
    with h5py.File(sly, "w") as file:
        file["pod"] = h5py.ExternalLink(str(secret), "/numbers")
    reply = sent(studio, "/api/limit", sly)
    assert reply.status == 422
    assert "another file" in reply.json["message"]
