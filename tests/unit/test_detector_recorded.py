"""Recordings: features whatever the sampling, what cannot be judged and why, tables."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from tests.unit.detector_toy import RATE, toy_detector, toy_throw

import turnout
from turnout.core.errors import FileError
from turnout.detection.detector.reading import read_throws
from turnout.detection.detector.recorded import (
    LEAST_RATE,
    SPIKE,
    ForcesAtRest,
    Recorded,
    features_of_recorded,
    recording_fault,
    sums_about,
)
from turnout.detection.detector.throw_layout import Layout, layout_of, throw_features
from turnout.detection.detector.throw_rows import read_table
from turnout.detection.detector.throws_of_dataset import throws_of_dataset
from turnout.measurement.campaign.motion_signals import without_spikes

LAYOUT = layout_of([("opening", 0.2, 3.2), ("closing", 4.4, 3.4)], end=8.5, drives=["1", "2"])
ONSETS = {"opening": 0.2, "closing": 4.4}


def force_at(time: np.ndarray) -> np.ndarray:
    closing = 4000.0 * np.clip((time - 4.4) / 3.4, 0.0, 1.0) ** 3
    opening = -1500.0 * np.clip((time - 0.2) / 3.2, 0.0, 1.0) * np.clip((5.4 - time), 0.0, 1.0)
    return np.array([opening + closing, 0.5 * opening + 1.3 * closing])


def throw(rate: float = 125.0, *, begin: float = 0.0, noise: float = 5.0) -> Recorded:
    time = np.arange(0.0, 8.5, 1.0 / rate)
    rng = np.random.default_rng(4)
    force = force_at(time) + noise * rng.standard_normal((2, time.size))
    return Recorded(
        name="t",
        time=time + begin,
        force=force,
        drives=("1", "2"),
        onsets={key: value + begin for key, value in ONSETS.items()},
    )


@pytest.mark.parametrize("rate", [50.0, 100.0, 125.0, 1000.0])
@pytest.mark.parametrize("begin", [0.0, -3.217])
def test_features_do_not_depend_on_sampling_or_clock(rate: float, begin: float) -> None:
    fine = throw(4000.0, noise=0.0)
    expected = features_of_recorded(fine, LAYOUT, fine.onsets)
    own = throw(rate, begin=begin, noise=0.0)
    found = features_of_recorded(own, LAYOUT, own.onsets)
    np.testing.assert_allclose(found, expected, atol=12.0 if rate < 100.0 else 4.0)


def test_uneven_samples_give_the_means_of_the_lines_between_them() -> None:
    rng = np.random.default_rng(5)
    time = np.sort(np.concatenate([[0.0, 8.5], rng.uniform(0.0, 8.5, 500)]))
    found = throw_features(
        time, (3.0 + 2.0 * time) * np.ones((1, 2, 1)), layout=LAYOUT, onsets=[[0.2, 4.4]]
    )
    np.testing.assert_allclose(found[0], 3.0 + 2.0 * LAYOUT.time, rtol=1e-10)


def test_a_good_recording_has_no_fault() -> None:
    assert recording_fault(throw(), LAYOUT) == ""


def spoiled(case: str) -> Recorded:
    good = throw()
    force = good.force.copy()
    if case == "clipped":
        force[1] = np.minimum(force[1], 3000.0)
        return replace(good, force=force)
    if case == "dead":
        force[0] = 12.0
        return replace(good, force=force)
    if case == "holes":
        force[0, 700:740] = np.nan
        return replace(good, force=force)
    if case == "nothing":
        return replace(good, force=np.full_like(force, np.nan))
    if case == "unit":
        return replace(good, force=1000.0 * force)
    if case == "short":
        return replace(good, time=good.time[:850], force=force[:, :850])
    if case == "late":
        return replace(good, time=good.time[600:], force=force[:, 600:])
    if case == "slow":
        return replace(good, time=good.time[::10], force=force[:, ::10])
    if case == "one drive":
        return replace(good, force=force[:1], drives=("1",))
    return replace(good, onsets={})


@pytest.mark.parametrize(
    ("case", "why"),
    [
        ("clipped", "drive 2: clipped at 3.00 kN"),
        ("dead", "dead channel"),
        ("holes", "without samples"),
        ("nothing", "holds no numbers"),
        ("unit", "is the unit right"),
        ("short", "are needed"),
        ("late", "begins after the onset"),
        ("slow", "samples a second"),
        ("one drive", "no force of drive 2"),
        ("no closing", "no closing movement"),
    ],
)
def test_what_cannot_be_judged_says_why(case: str, why: str) -> None:
    assert why in recording_fault(spoiled(case), LAYOUT)


@pytest.mark.parametrize("rate", [20.0, 25.0, 100.0])
def test_a_stone_that_breaks_is_no_spike(rate: float) -> None:
    """It stands up to 3.1 kN above the samples around at 20 a second, less at more."""
    stone = turnout.ForeignObject(size=0.013, at="drive 1", kind="stone")
    run = turnout.simulate(turnout.load_panel("60e1-300-1-9"), foreign_object=stone)
    time, (force,) = run["time"].values, run["drive_force"].transpose("drive", "time").values
    heights = []
    for phase in np.linspace(0.0, 0.75, 4):
        samples = np.interp(np.arange(time[0] + phase / rate, time[-1], 1.0 / rate), time, force)
        heights.append(np.abs(samples - without_spikes(samples, rate=np.inf, least=0.0)).max())
    assert max(heights) < 0.65 * SPIKE
    if rate == LEAST_RATE:
        assert max(heights) > 0.55 * SPIKE


@pytest.mark.parametrize("rest", [2800.0, 3200.0])
def test_forces_zeroed_at_rest_are_noticed_and_an_unloaded_start_is_not_mistaken_for_it(
    rest: float,
) -> None:
    """Sound switches hold 3 kN at rest, before opening and before closing."""
    size, before = LAYOUT.size, LAYOUT.before_onset
    usual = np.where(before, np.where(LAYOUT.part == 0, 3000.0, -1000.0), 500.0)
    spread = np.full(size, 200.0)
    view = SimpleNamespace(usual=np.array([usual, spread]), features=np.arange(size))
    own = np.where(before & (LAYOUT.part == 0), rest, usual)
    assert not ForcesAtRest(view, LAYOUT).zeroed(own)
    assert ForcesAtRest(view, LAYOUT).zeroed(own - rest)
    pressed = np.where(before & (LAYOUT.part == 0), 10.0, usual)
    assert not ForcesAtRest(view, LAYOUT).zeroed(pressed)
    # one drive at zero is a fault of that drive, not of the recorder
    one = np.where(before & (LAYOUT.part == 0) & (LAYOUT.drive == 0), 0.0, usual)
    assert not ForcesAtRest(view, LAYOUT).zeroed(one)
    # a recording of the closing alone, zeroed before it
    rows = np.flatnonzero(LAYOUT.part == 1)
    spread = np.full(rows.size, 100.0)
    closing = SimpleNamespace(usual=np.array([usual[rows], spread]), features=rows)
    assert not ForcesAtRest(closing, LAYOUT).zeroed(usual)
    assert ForcesAtRest(closing, LAYOUT).zeroed(usual + 1000.0)


def test_a_table_has_a_row_a_throw(tmp_path: Path) -> None:
    own = throw(100.0)
    cells = [" ".join(f"{value:.1f}" for value in row) for row in own.force]
    path = tmp_path / "throws.csv"
    head = "throw,rate [Hz],direction,force 1 [N],force 2 [N]"
    lines = [head, f"a,100,closing,{cells[0]},{cells[1]}", f"b,100,opening,{cells[0]},{cells[1]}"]
    path.write_text("\n".join([*lines, f"c,100,closing,1 2 x,{cells[1]}"]))
    first, second, third = read_table(path)
    assert first.name == "a"
    assert first.onsets["closing"] == pytest.approx(4.4, abs=0.6)
    assert "opening" in second.fault
    assert "no number" in third.fault
    path.write_text("time,force\n0,1\n")
    with pytest.raises(FileError, match="rate"):
        read_throws(path)


def test_a_table_of_currents_is_read_as_such(tmp_path: Path) -> None:
    samples = " ".join(f"{value:.3f}" for value in np.sin(np.arange(500) / 50.0))
    path = tmp_path / "throws.csv"
    head = "throw,rate [Hz],start [s],current 1 [A],current 2 [A]"
    path.write_text(f"{head}\na,100,-0.2,{samples},{samples}\n")
    (found,) = read_throws(path, quantity="current")
    assert (found.drives, found.onsets, found.fault) == (("1", "2"), {"closing": 0.0}, "")
    assert found.force[0, 50] == pytest.approx(np.sin(1.0), abs=1e-3)
    with pytest.raises(FileError, match=r"force NAME \[N\]"):
        read_throws(path)


def test_what_is_not_recorded_cannot_be_judged() -> None:
    own = throw(100.0)
    dataset = xr.Dataset(
        {"drive_force": (("drive", "time"), own.force)},
        {"time": own.time, "drive": list(own.drives)},
    )
    (found,) = throws_of_dataset(dataset, quantity="current")
    assert found.fault == "no drive currents are recorded"
    layout = Layout(parts=LAYOUT.parts, drives=("3",))
    said = recording_fault(own, layout, "power")
    assert said == "no power of drive 3 is recorded; there are 1, 2: name them as the panel does"


@pytest.mark.parametrize(
    ("cut", "held"),
    [(slice(None), []), (slice(12, None), ["opening"]), (slice(0, -14), ["closing"])],
)
def test_features_about_several_onsets_are_those_of_each(cut: slice, held: list[str]) -> None:
    whole = throw(100.0)
    own = replace(whole, time=whole.time[cut], force=whole.force[:, cut])
    closing = np.array([4.37, 4.4, 4.43])
    tried = {"opening": np.array([0.2]), "closing": closing}
    sums = {part.name: sums_about(own, LAYOUT, part, tried[part.name]) for part in LAYOUT.parts}
    assert [name for name, (_, any_held) in sums.items() if any_held] == held
    for at in closing:
        onsets = {"opening": 0.2, "closing": float(at)}
        found = features_of_recorded(
            own, LAYOUT, onsets, {n: item for n, (item, _) in sums.items()}
        )
        # what is held after the last sample is reached on another line
        apart = 2.0 if "closing" in held else 1e-6
        expected = features_of_recorded(own, LAYOUT, onsets)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=apart)


def test_means_over_windows_belong_to_their_middle(tmp_path: Path) -> None:
    """A monitoring system writes 25 root mean squares a second, each at the end of its window."""
    time = np.arange(0.0, 9.0, 1e-3)
    force = 500.0 + force_at(time)[1] ** 2 / 4e3
    squares = np.sqrt(np.mean(force[: 40 * (len(force) // 40)].reshape(-1, 40) ** 2, axis=1))
    samples = " ".join(f"{value:.1f}" for value in squares)
    path = tmp_path / "throws.csv"
    head = "throw,rate [Hz],start [s],window [s],force 1 [N],force 2 [N]"
    start = 0.04 - 4.4
    lines = [f"a,25,{start},0.04,{samples},{samples}", f"b,25,{start},,{samples},{samples}"]
    path.write_text("\n".join([head, *lines, f"c,25,{start},0.5,{samples},{samples}"]))
    right, late, long = read_table(path)
    fine = replace(throw(), time=time - 4.4, force=np.tile(force, (2, 1)))
    wanted = features_of_recorded(fine, LAYOUT, {"closing": 0.0})
    off = [
        np.nanmax(np.abs(features_of_recorded(item, LAYOUT, {"closing": 0.0}) - wanted))
        for item in (right, late)
    ]
    assert off[0] < 0.5 * off[1]
    assert "window [s]" in long.fault


def test_one_current_for_two_motors_cannot_be_judged(tmp_path: Path) -> None:
    path = tmp_path / "throws.csv"
    samples = " ".join(["1.5"] * 500)
    path.write_text(f"throw,rate [Hz],start [s],current 1+2 [A]\na,100,-0.2,{samples}\n")
    (found,) = read_throws(path, quantity="current")
    assert found.fault == (
        "one channel stands for the motors of drives 1+2; currents of each are needed"
    )


@pytest.mark.parametrize("size", [0.0, 15e-3])
def test_a_clock_that_is_off_by_a_thousandth_changes_no_verdict(size: float) -> None:
    """3 ms at the end of a movement; onsets of both movements are found again."""
    detector = toy_detector()
    right = toy_throw(level=0.3, seed=8, size=size, x=3.6)
    for factor in (0.999, 1.001):
        onsets = {name: factor * at for name, at in right.onsets.items()}
        off = replace(right, time=factor * right.time, onsets=onsets, exact=False)
        assert detector.judge(off).status == detector.judge(right).status
    assert detector.judge(right).status == ("object" if size else "sound")


def test_a_row_that_ends_early_cannot_be_judged(tmp_path: Path) -> None:
    path = tmp_path / "throws.csv"
    samples = " ".join(["1"] * 20)
    head = "throw,rate [Hz],direction,force 1 [N],force 2 [N]\n"
    path.write_text(f"{head}a,125,closing,{samples},{samples}\nb,125,closing\n", encoding="utf-8")
    *_, short = read_table(path)
    assert short.name == "b"
    assert short.fault


def test_a_row_whose_forces_go_on_changing_at_rest_holds_one_throw(tmp_path: Path) -> None:
    """What a discrepancy shows at rest looks like further closings to the forces alone."""
    whole = toy_throw(level=0.3, seed=8)
    parts = np.repeat(whole.force[:, :1], 300, 1), np.repeat(whole.force[:, -1:], 1000, 1)
    force = np.concatenate([parts[0], whole.force, parts[1]], axis=1)
    time = np.arange(force.shape[1]) / RATE
    force += 300.0 * np.sin(np.pi * np.clip((time - 13.9) / 3.0, 0.0, 1.0))
    force += 5.0 * np.random.default_rng(1).standard_normal(force.shape)
    cells = [" ".join(f"{value:.1f}" for value in row) for row in force]
    path = tmp_path / "throws.csv"
    path.write_text(f"throw,rate [Hz],force 1 [N],force 2 [N]\na,{RATE:g},{cells[0]},{cells[1]}\n")
    (found,) = read_throws(path)
    assert found.fault == ""
    assert len(found.shown) > 1
    (verdict,) = toy_detector().predict(found)
    assert verdict.status == "sound"


def test_what_is_not_there_needs_no_channel_map(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"nix: there is no such file or folder"):
        read_throws(tmp_path / "nix")
