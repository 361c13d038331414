"""The command `turnout import`: listing, suggestion, datasets and figures."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.channels import check_schema
from turnout.measurement.formats.file_format import write_recording
from turnout.measurement.recording import RecordedChannel, Recording
from turnout.throw.store import open_response

TIME = np.arange(3000) / 1000
COLUMNS = {
    "Rod 1": ("mV/V", 0.372611 * TIME / 3),
    "Rod 2": ("mV/V", 0 * TIME),
    "Clamp 1": ("V", 0.2 + 0 * TIME),
    "Clamp 2": ("V", 0 * TIME),
}


@pytest.fixture
def throw(tmp_path: Path) -> Path:
    channels = {n: RecordedChannel(n, unit, v, 1000.0) for n, (unit, v) in COLUMNS.items()}
    path = tmp_path / "throw.csv"
    write_recording(Recording(channels, "test", "2025-11-03T10:12:33"), path)
    return path


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, ["import", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_without_a_map_the_file_is_listed(throw: Path) -> None:
    text = run(throw)
    assert "text, started 2025-11-03T10:12:33" in text
    row = next(line for line in text.splitlines() if line.startswith("Rod 1"))
    assert row.split()[:8] == ["Rod", "1", "mV/V", "1000", "0", "3", "0", "0"]
    assert row.split()[-1][0] != row.split()[-1][-1]
    assert "[drive_force.1]" in text
    assert list(throw.parent.iterdir()) == [throw]


def test_the_suggested_map_is_ready_to_use(throw: Path) -> None:
    folder = throw.parent
    text = run(throw, "--map", folder / "map.toml", "--plot", folder / "raw.png")
    assert f"written     {folder / 'map.toml'}" in text
    assert (folder / "raw.png").read_bytes().startswith(b"\x89PNG")
    text = run(throw, "--channels", folder / "map.toml", "--out", folder / "throw.nc")
    assert "drive_current.2" in text
    dataset = open_response(folder / "throw.nc")
    check_schema(dataset)
    assert float(dataset["drive_current"].sel(drive="1")[5]) == pytest.approx(2.0)


def test_the_file_holds_forces_raw_and_filtered(throw: Path) -> None:
    out, plot = throw.with_suffix(".nc"), throw.with_suffix(".svg")
    text = run(throw, "--channels", "two-rods", "--out", out, "--plot", plot, "--smooth", "0.1s")
    assert "0 to 2.999 s at 1000 Hz" in text
    assert "strain bridge, 1 mV/V is 16.103 kN" in text
    dataset = open_response(out)
    raw = dataset["drive_force_unfiltered"].sel(drive="1").values
    np.testing.assert_allclose(raw, 6000 * TIME / 3, rtol=1e-5)
    assert float(dataset["drive_force"][0, 0]) == pytest.approx(raw[:51].mean())
    np.testing.assert_array_equal(dataset["recorded"].sel(column="Rod 1"), COLUMNS["Rod 1"][1])
    assert dataset.attrs["filter"] == "moving_average (window 0.1)"
    assert b"</svg>" in plot.read_bytes()
