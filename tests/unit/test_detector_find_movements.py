"""Movements in recordings of forces alone, whose discrepancy goes on at rest."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.detector_toy import TIME, toy_detector, toy_throw

from turnout.detection.detector.detector import Detector
from turnout.detection.detector.reading import read_throws
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throws_of_dataset import throws_of_dataset

RATE = 125.0
PEAK = 3000.0
SHARE = 0.03
"""Of the discrepancy, as the toy detector assumes it."""
MAP = "".join(
    f'[drive_force.{name}]\ncolumn = "force {name}"\nkind = "scaled"\n' for name in ("1", "2")
)


def wandering(size: int, rng: np.random.Generator, *, share: float = SHARE) -> np.ndarray:
    """Return a discrepancy with the kernel exp(-|t| / 0.5 s), shape (2, size) [N]."""
    keep = np.exp(-1.0 / (RATE * 0.5))
    steps = np.sqrt(1.0 - keep**2) * rng.standard_normal((2, size))
    found = np.empty((2, size))
    found[:, 0] = rng.standard_normal(2)
    for number in range(1, size):
        found[:, number] = keep * found[:, number - 1] + steps[:, number]
    return share * PEAK * found


def recording(*throws: Recorded, wait: float = 2.3, seed: int = 0) -> xr.Dataset:
    """Return throws one after another, forces alone, with discrepancy and late commands."""
    rng = np.random.default_rng([seed, 7])
    parts = []
    for item in throws:
        rest = round(wait * RATE)
        parts += [np.repeat(item.force[:, :1], rest, axis=1), item.force]
    parts.append(np.repeat(throws[-1].force[:, -1:], round(1.7 * RATE), axis=1))
    force = np.concatenate(parts, axis=1)
    force = force + wandering(force.shape[1], rng) + 20.0 * rng.standard_normal(force.shape)
    return xr.Dataset(
        {"drive_force": (("drive", "time"), force)},
        {"time": np.arange(force.shape[1]) / RATE + 100.0, "drive": ["1", "2"]},
    )


def fresh() -> Detector:
    return Detector(toy_detector().knowledge)


def test_throws_are_judged_where_forces_wander_at_rest() -> None:
    """No channel says when the movements begin, and the forces do not rest before them."""
    detector = toy_detector()
    levels = np.linspace(0.24, 0.48, 4)
    sound = [recording(toy_throw(level=level, seed=i), seed=i) for i, level in enumerate(levels)]
    held = [
        recording(toy_throw(level=level, seed=i, size=26e-3), seed=i)
        for i, level in enumerate(levels)
    ]
    found = [verdict for item in sound for verdict in detector.predict(item)]
    assert [item.status for item in found] == ["sound"] * len(sound)
    found = [verdict for item in held for verdict in detector.predict(item)]
    assert [item.status for item in found] == ["object"] * len(held)


def test_onsets_are_found_to_some_hundredths_of_a_second() -> None:
    detector = fresh()
    for seed in range(3):
        (whole,) = throws_of_dataset(recording(toy_throw(seed=seed), wait=1.1, seed=seed))
        (throw,) = detector.located(whole)
        assert throw.fault == ""
        assert throw.onsets["opening"] == pytest.approx(101.3, abs=0.05)
        assert throw.onsets["closing"] == pytest.approx(105.5, abs=0.05)


def test_a_recording_may_hold_several_throws() -> None:
    detector = fresh()
    throws = [toy_throw(seed=1), toy_throw(seed=2, size=26e-3), toy_throw(seed=3)]
    found = detector.predict(recording(*throws, seed=4))
    assert [item.name for item in found] == ["throw#1", "throw#2", "throw#3"]
    assert [item.status for item in found] == ["sound", "object", "sound"]
    (whole,) = throws_of_dataset(recording(*throws, seed=4))
    assert "3 throws" in detector.judge(whole).reason
    assert len(detector.learn([whole])) == 3
    assert detector.known.throws == 2


def test_what_looks_like_no_closing_is_refused_with_its_likeness() -> None:
    rng = np.random.default_rng(8)
    detector = fresh()
    rest = xr.Dataset(
        {"drive_force": (("drive", "time"), wandering(2500, rng, share=0.2))},
        {"time": np.arange(2500) / RATE, "drive": ["1", "2"]},
    )
    (verdict,) = detector.predict(rest)
    assert verdict.status == "cannot judge"
    assert "likeness to sound throws" in verdict.reason
    small = recording(toy_throw())
    small["drive_force"] = 0.1 * small["drive_force"]
    (verdict,) = detector.predict(small)
    assert verdict.status == "cannot judge"
    assert "times the size of a sound one" in verdict.reason
    swapped = recording(toy_throw())
    swapped["drive_force"] = -swapped["drive_force"]
    assert [item.status for item in detector.predict(swapped)] == ["cannot judge"]
    alone = recording(toy_throw()).isel(time=slice(0, round((2.3 + 4.0) * RATE)))
    assert [item.status for item in detector.predict(alone)] == ["cannot judge"]


def test_a_closing_without_steps_has_no_clear_onset() -> None:
    """Both drives pull along a straight line: any instant explains them about as well."""
    detector = fresh()
    force = np.linspace(-1500.0, 3500.0, TIME.size) * np.ones((2, 1))
    force += wandering(TIME.size, np.random.default_rng(9), share=0.02)
    data = xr.Dataset(
        {"drive_force": (("drive", "time"), force)}, {"time": TIME, "drive": ["1", "2"]}
    )
    assert {item.status for item in detector.predict(data)} == {"cannot judge"}


def test_a_lost_closing_is_named_and_never_silent() -> None:
    detector = fresh()
    stalled = toy_throw(seed=2)
    stalled.force[:, TIME > 3.0] = stalled.force[:, TIME <= 3.0][:, -1:]
    sound, lost = detector.predict(recording(toy_throw(seed=1), stalled))
    assert (sound.status, lost.status) == ("sound", "cannot judge")
    assert "no closing movement was found after the opening at 113." in lost.reason


def test_a_campaign_of_forces_alone_is_judged(tmp_path: Path) -> None:
    (tmp_path / "channels.toml").write_text(f"schema_version = 1\n{MAP}")
    lines = ["file,movement,direction,size [mm],place,repeat"]
    for number, size in enumerate((0.0, 0.026, 0.0), 1):
        data = recording(toy_throw(seed=number, size=size), seed=number)
        rows = np.column_stack([data["time"], data["drive_force"].T])
        np.savetxt(
            tmp_path / f"t{number}.csv",
            rows,
            delimiter=",",
            fmt="%.4f",
            header="time [s],force 1 [N],force 2 [N]",
            comments="",
        )
        place = "sleeper 6" if size else "none"
        lines += [
            f"t{number}.csv,1,opening,0,none,{number}",
            f"t{number}.csv,2,closing,{1e3 * size:g},{place},{number}",
        ]
    (tmp_path / "runs.csv").write_text("\n".join(lines))
    found = fresh().predict(read_throws(tmp_path))
    assert [item.name for item in found] == ["t1#2", "t2#2", "t3#2"]
    assert [item.status for item in found] == ["sound", "object", "sound"]
