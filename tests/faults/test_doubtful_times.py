"""Recordings whose clock may be meant in two ways, or changes: refused by that name, or said."""

import json
from collections import OrderedDict
from collections.abc import Callable
from datetime import datetime
from itertools import product
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io as scipy_io
from tests.unit.recording_kinds import COUNT, CURRENT, FORCE, HEAD, VALUES, moment, rows, stated

from turnout.core.errors import FileError
from turnout.measurement.formats.clock import stated_number
from turnout.measurement.formats.file_format import read_recording
from turnout.measurement.formats.numbers import is_number
from turnout.measurement.recording import Recording, time_grid

LISTS = {"Force": FORCE.tolist(), "Speed": CURRENT.tolist()}


def read(path: Path, content: str | object) -> Recording:
    text = content if isinstance(content, str) else json.dumps(content)
    path.write_text(text, encoding="utf-8")
    return read_recording(path)


@pytest.mark.parametrize(
    "line",
    [
        "Every 40th sample",
        "every 10th value stored",
        "Jeder 10. Wert",
        "# jeder zehnte Messwert gespeichert",
        "decimation 40",
        "Decimation factor;40",
        "Downsampled by 40",
        "Reduction 1:40",
        "1 of 40",
        "Storage: 1 of 40",
        "Stored values: 1/10",
        "Saved every 10 samples",
        "Save every nth;40",
        "Note: every second value",
        "Data: downsampled",
        "every tenth sample",
        "every twentieth value",
        "jeder vierte Wert",
        "jede zwanzigste Zeile",
        "varje tionde värde",
    ],
)
def test_a_rate_beside_samples_that_were_left_out(tmp_path: Path, line: str) -> None:
    path = tmp_path / "throw.csv"
    shown = line.lstrip("# ").replace(";", ".")
    with pytest.raises(FileError, match=rf"{shown}' is stated beside a sample rate of 1000 Hz"):
        read(path, stated(f"Sample rate: 1000 Hz\n{line}"))
    # Times are those of the rows.
    timed = f"Sample rate: 25 Hz\n{line}\n{HEAD}{rows(time=lambda n: f'{n * 0.04:.2f}')}"
    assert read(path, timed).channel("Force").rate == 25.0


@pytest.mark.parametrize("more", [{"decimation": 40}, {"note": "every 40th sample"}])
def test_samples_left_out_of_named_arrays(tmp_path: Path, more: dict[str, object]) -> None:
    with pytest.raises(FileError, match="is stated beside a sample rate of 1000 Hz"):
        read(tmp_path / "throw.json", {"fs": 1000, **more, **LISTS})
    scipy_io.savemat(tmp_path / "throw.mat", {"fs": 1000.0, "Force": FORCE, **more})
    with pytest.raises(FileError, match="is stated beside a sample rate of 1000 Hz"):
        read_recording(tmp_path / "throw.mat")
    for rated, left_out in product((False, True), repeat=2):
        with h5py.File(tmp_path / "throw.h5", "w") as file:
            channel = file.create_dataset("Force", data=FORCE)
            (channel if rated else file).attrs["fs"] = 1000.0
            (channel if left_out else file).attrs.update(more)
        if rated and not left_out:  # the rate of the rows
            assert read_recording(tmp_path / "throw.h5").channel("Force").rate == 1000.0
            continue
        with pytest.raises(FileError, match="is stated beside a sample rate of 1000 Hz"):
            read_recording(tmp_path / "throw.h5")


def test_a_column_that_repeats_how_many_samples_were_left_out(tmp_path: Path) -> None:
    text = "Sample rate: 1000 Hz\ndecimation,Force\n" + "".join(f"40,{f}\n" for f in FORCE)
    with pytest.raises(FileError, match="is stated beside a sample rate of 1000 Hz"):
        read(tmp_path / "throw.csv", text)


@pytest.mark.parametrize(
    "line",
    [
        "Decimation: 1",
        "Decimation: none",
        "not decimated",
        "Downsampling: off",
        "every sample",
        "Page 1 of 3",
    ]
    + [
        "DecimationLevel: 2",
        "Channel: 1 of 2",
        "Gear reduction 10",
        "Samples: 40",
        "Sampling: every 40 ms",
        "Alle gefilterten Werte in kN",
        "alle korrigierten Messwerte",
        "only with values",
        "only 40 values",
        "Replaced every month, values ok",
    ],
)
def test_no_samples_were_left_out(tmp_path: Path, line: str) -> None:
    recording = read(tmp_path / "throw.csv", stated(f"Sample rate: 1000 Hz\n{line}"))
    assert {channel.rate for channel in recording.channels.values()} == {1000.0}


@pytest.mark.parametrize("line", ["Resampled to 25 Hz", "Downsampling rate: 25 Hz"])
def test_a_rate_after_another(tmp_path: Path, line: str) -> None:
    with pytest.raises(FileError, match="two clocks are stated"):
        read(tmp_path / "throw.csv", stated(f"Sample rate: 1000 Hz\n{line}"))
    assert read(tmp_path / "throw.csv", stated(line)).channel("Force").rate == 25.0


def test_a_number_of_samples_is_no_interval(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="neither times nor a sample rate"):
        read(tmp_path / "throw.csv", stated("Samples: 5"))


@pytest.mark.parametrize(
    "held",
    [
        {"rate": 25, "rpm": CURRENT.tolist(), "Force": FORCE.tolist()},
        {"rate": 25, "units": {"Speed": "1/min"}, **LISTS},
        {"rate": 25, "rpm": 1500, **LISTS},
        {"rate": 25, "shaft": {"rpm": 1500}, "Force": FORCE.tolist()},
        {"rate": 25, "motor": {"rated_rpm": 1500}, "Force": FORCE.tolist()},
        {"rate": 25, "Force": FORCE.tolist(), "rotation_speed": CURRENT.tolist()},
        {"rate": 25, "Force": FORCE.tolist(), "speed (r/min)": CURRENT.tolist()},
        {"rate": 25, "data": [{"F (N)": f, "n (rpm)": 1e3} for f in FORCE]},
        f"Rate: 25\nRPM: 1500\n{VALUES}{rows()}",
        f"Rate: 25\nForce (N),Drehzahl (U/min)\n{rows()}",
    ],
)
def test_a_rate_beside_a_speed_of_rotation(tmp_path: Path, held: object) -> None:
    suffix = ".csv" if isinstance(held, str) else ".json"
    with pytest.raises(FileError, match=r"'[Rr]ate: 25' is not taken for the sample rate"):
        read(tmp_path / f"throw{suffix}", held)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (stated("Sample interval: 40 Ms"), "'Sample interval: 40 Ms' may be ms or 1e6 s"),
        (stated("dt_Ms: 40"), "'dt_Ms: 40' may be ms or 1e6 s"),
        (stated("Sample rate: 25 mHz"), "'Sample rate: 25 mHz' may be MHz or 1e-3 Hz"),
        (HEAD.replace("(s)", "(Ms)") + rows(time=str), "column 'Time .Ms.': the unit of 'Ms'"),
        (HEAD.replace(" (s)", "_Ms") + rows(time=str), "column 'Time_Ms': the unit of 'Ms'"),
    ],
)
def test_a_unit_that_may_be_two(tmp_path: Path, text: str, shown: str) -> None:
    with pytest.raises(FileError, match=shown):
        read(tmp_path / "throw.csv", text)


MOMENT = np.datetime64("2026-11-28T08:14:00", "us")


@pytest.mark.parametrize(
    ("key", "first", "second"),
    [
        ("wf_increment", 0.04, 0.08),
        ("wf_start_offset", 1.0, 5.0),
        ("wf_start_offset", 0.0, 5.0),
        ("wf_start_time", MOMENT, MOMENT + 5_000_000),
        ("sr", 25.0, 50.0),
    ],
)
@pytest.mark.parametrize("whole", [False, True])
def test_a_clock_that_changes_between_segments(
    tmp_path: Path, key: str, first: object, second: object, *, whole: bool
) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "throw.tdms"
    for values in ((first, first), (first, second)):
        with nptdms.TdmsWriter(path) as file:
            for value in values:
                own = {"wf_increment": 0.04} if key.startswith("wf_start") else {}
                given = {**own, key: value}
                channel = nptdms.ChannelObject("g", "Force", FORCE, {} if whole else given)
                file.write_segment([nptdms.RootObject(given if whole else {}), channel])
        if values == (first, first):
            assert read_recording(path).channel("Force").rate == 25.0
    with pytest.raises(FileError, match=f"{key} changes between segments: {str(first)[:4]}"):
        read_recording(path)
    # The library is left as it was.
    assert nptdms.reader.OrderedDict is OrderedDict


@pytest.mark.parametrize("digits", [3, 2])
def test_a_short_channel_without_a_third_of_its_samples(digits: int) -> None:
    time = np.delete(np.arange(12), [2, 5, 8, 11]) / 10.0**digits
    assert time_grid(time).remark.startswith("check the time: taken as rounded to")
    time = np.delete(np.arange(15), [1, 3, 4, 6, 8, 9, 11]) * 0.04
    with pytest.raises(ValueError, match="samples may be missing or times are rounded"):
        time_grid(time)


@pytest.mark.parametrize(
    ("heading", "factor", "turn"),
    [
        ("Time (ms)", 1e-3, 86_400_000),
        ("ms of day (ms)", 1e-3, 86_400_000),
        ("ms", 1e-3, 86_400_000),
        ("Time (us)", 1e-6, 86_400_000_000),
        ("Time_ms", 1e-3, 3_600_000),
        ("Time (us)", 1e-6, 2**32),
        ("t_ms", 1e-3, 2**16),
    ],
)
def test_times_go_on_past_midnight_and_the_end_of_a_counter(
    tmp_path: Path, heading: str, factor: float, turn: int
) -> None:
    step = round(0.04 / factor)
    time = [f"{(turn + (n - 20) * step) % turn}" for n in range(COUNT)]
    text = HEAD.replace("Time (s)", heading) + rows(time=time.__getitem__)
    channel = read(tmp_path / "throw.csv", text).channel("Force")
    assert channel.rate == pytest.approx(25.0)
    assert channel.start == pytest.approx((turn - 20 * step) * factor)
    np.testing.assert_array_equal(channel.values, FORCE)


def test_an_interval_in_a_column_beside_a_rate(tmp_path: Path) -> None:
    text = "dt,Force\n" + "".join(f"0.04,{f}\n" for f in FORCE)
    path = tmp_path / "throw.csv"
    assert read(path, f"Sample rate: 25 Hz\n{text}").channel("Force").rate == 25.0
    with pytest.raises(FileError, match="two clocks are stated: 'Sample rate: 100 Hz' and 'dt: "):
        read(path, f"Sample rate: 100 Hz\n{text}")


@pytest.mark.parametrize(
    ("unit", "counts"),
    [(" (1/100 s)", 4), (" [10 ms]", 4), (" in 1/10 ms", 400), (" (100 ns)", 400_000)],
)
def test_times_in_multiples_of_a_unit(tmp_path: Path, unit: str, counts: int) -> None:
    text = HEAD.replace(" (s)", unit) + rows(time=lambda n: f"{n * counts}")
    assert read(tmp_path / "throw.csv", text).channel("Force").rate == pytest.approx(25.0)


@pytest.mark.parametrize(
    ("time", "words"),
    [
        (lambda n: f"08:14:{n // 25:02d}:{n % 25:02d}", "may end in frames or hundredths"),
        (lambda n: f"{n * 0.04 + 0.03 * (n > 20):.2f}", "it jumps from 0.8 to 0.87 s"),
        (lambda n: f"{n * 0.04 - 0.02 * (n > 20):.2f}", "it jumps from 0.8 to 0.82 s"),
    ],
)
def test_times_that_jump(tmp_path: Path, time: Callable[[int], str], words: str) -> None:
    with pytest.raises(FileError, match=words):
        read(tmp_path / "throw.csv", HEAD.replace(" (s)", "") + rows(time=time))


def test_a_last_time_that_is_late(tmp_path: Path) -> None:
    heading, last = HEAD.replace(" (s)", ""), COUNT - 1
    text = heading + rows(time=lambda n: f"{n * 0.04 + 0.012 * (n == last):.3f}")
    recording = read(tmp_path / "throw.csv", text)
    assert recording.channel("Force").rate == 25.0
    assert recording.problems == (
        "channels 'Force', 'Current': check the time: its last, 1.572 s, is taken as 1.56 s",
    )
    text = heading + rows(time=lambda n: f"{n * 0.04 + 0.012 * (n >= last - 1):.3f}")
    with pytest.raises(FileError, match=r"1.48 to 1.532 s; save each part in a file of its own"):
        read(tmp_path / "throw.csv", text)


def test_a_unit_between_underscores(tmp_path: Path) -> None:
    text = HEAD.replace("Time (s)", "Time_ms_") + rows(time=lambda n: f"{n * 40}")
    assert read(tmp_path / "throw.csv", text).channel("Force").rate == 25.0


def test_stamps_a_day_apart(tmp_path: Path) -> None:
    text = HEAD.replace(" (s)", "") + rows(time=moment("%Y-%m-%d %H:%M:%S", step=86400.0))
    force = read(tmp_path / "throw.csv", text).channel("Force")
    assert force.rate == pytest.approx(1.0 / 86400.0)


def test_a_clock_of_twelve_hours_without_am(tmp_path: Path) -> None:
    begin = datetime(2026, 11, 28, 12, 59, 59)
    text = HEAD.replace(" (s)", "") + rows(time=moment("%I:%M:%S.%f", begin=begin))
    assert read(tmp_path / "throw.csv", text).channel("Force").rate == 25.0


@pytest.mark.parametrize(
    "line",
    ["Actual sample rate: 250 Hz", "Sample rate Ch1: 25 Hz", "Rate after decimation: 25 Hz"],
)
def test_another_rate_beside_the_one_that_is_taken(tmp_path: Path, line: str) -> None:
    recording = read(tmp_path / "throw.csv", stated(f"Sample rate: 1000 Hz\n{line}"))
    assert recording.problems == (f"check the time: '{line}' is stated as well",)


@pytest.mark.parametrize("words", ["aggregate", "(total)"])
def test_a_rate_of_all_channels_together(tmp_path: Path, words: str) -> None:
    with pytest.raises(FileError, match="of all channels together; state the rate of one"):
        read(tmp_path / "throw.csv", stated(f"Sample rate: 50 Hz {words}"))


def test_an_exponent_has_no_thousands_before_it() -> None:
    assert stated_number("4.000E-02", ",") == (0.04, "")
    assert not is_number("4.000E-02", ",")


@pytest.mark.parametrize("line", ["Time unit: ms", "Horizontal Units,ms", "Zeiteinheit: ms"])
def test_a_unit_of_times_that_stands_apart(tmp_path: Path, line: str) -> None:
    path = tmp_path / "throw.csv"
    timed = HEAD.replace(" (s)", "") + rows(time=lambda n: f"{n * 40 + 0.5}")
    assert read(path, f"{line}\n{timed}").channel("Force").rate == pytest.approx(25.0)
    for text in (f"{line}\nX Increment: 40", f"X Increment: 40\n{line}"):
        assert read(path, stated(text)).channel("Force").rate == 25.0


@pytest.mark.parametrize(
    ("lines", "rate", "start"),
    [
        ("Sample rate: 25 Hz\nTime unit: 10 ms\nX0: 5", 25.0, 0.05),
        ("Time unit: 10 ms\nX Increment: 4\nX0: 5", 25.0, 0.05),
        ("Time unit: ms\nX unit: msec\ndt: 40\nX0: 5 s", 25.0, 5.0),
        ("Sample rate: 25 Hz\nX0: 5 mm", 25.0, 0.0),
    ],
)
def test_a_unit_of_times_and_a_start(tmp_path: Path, lines: str, rate: float, start: float) -> None:
    force = read(tmp_path / "throw.csv", stated(lines)).channel("Force")
    assert (force.rate, force.start) == (pytest.approx(rate), pytest.approx(start))


def test_a_rate_of_another_object(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="neither times nor a sample rate"):
        read(tmp_path / "throw.json", {"gear": {"rate": 25}, **LISTS})


def test_two_units_of_times(tmp_path: Path) -> None:
    text = stated("Time unit: s\nX unit: ms\ndt: 0.04")
    with pytest.raises(FileError, match="two units of times are stated, 's' and 'ms'"):
        read(tmp_path / "throw.csv", text)
    with pytest.raises(FileError, match="the unit of 'Ms' may be ms or 1e6 s"):
        read(tmp_path / "throw.csv", stated("Sample rate: 25 Hz\nX0: 5 Ms"))


@pytest.mark.parametrize(
    "held",
    [
        {"meta": {"dt": 40}, "time_unit": "ms", **LISTS},
        {"dt": 40, "meta": {"time_unit": "ms"}, **LISTS},
        {"dt": 40, "recording": {"time_unit": "ms", **LISTS}},
        {"time_unit": "ms", "channels": [{"name": "Force", "dt": 40, "data": FORCE.tolist()}]},
    ],
)
def test_a_unit_of_times_in_another_object(tmp_path: Path, held: object) -> None:
    assert read(tmp_path / "throw.json", held).channel("Force").rate == 25.0


def test_a_unit_of_times_around_a_channel(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        file.attrs["time_unit"] = np.bytes_("ms")
        group = file.create_group("group")
        group.create_dataset("Force", data=FORCE).attrs.update({"dt": 40.0, "start": 500.0})
        group.create_dataset("Speed", data=[FORCE, FORCE]).attrs.update(
            {"dt": 40.0, "start": 500.0}
        )
        inner = file.create_group("inner")
        inner.attrs.update({"dt": 40.0, "x_unit": "ms"})
        inner.create_dataset("Current", data=CURRENT).attrs["start"] = 500.0
    for channel in read_recording(tmp_path / "throw.h5").channels.values():
        assert (channel.rate, channel.start) == (25.0, 0.5), channel.name
    held = {"time_unit": "ms", "held": {"dt": 40.0, "Force": FORCE}}
    scipy_io.savemat(tmp_path / "throw.mat", held)
    (force,) = read_recording(tmp_path / "throw.mat").channels.values()
    assert force.rate == 25.0


def test_a_unit_of_times_in_named_arrays(tmp_path: Path) -> None:
    time = (np.arange(COUNT) * 40 + 0.5).tolist()
    held = {"time": time, "time_unit": "ms", **LISTS}
    assert read(tmp_path / "throw.json", held).channel("Force").rate == pytest.approx(25.0)
    scipy_io.savemat(tmp_path / "throw.mat", {k: v for k, v in held.items() if k != "Speed"})
    force = read_recording(tmp_path / "throw.mat").channel("Force")
    assert force.rate == pytest.approx(25.0)
    assert force.start == pytest.approx(0.0005)


def test_a_start_of_its_own_beside_a_rate_of_the_file(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        file.attrs["fs"] = 25.0
        file.create_dataset("Force", data=FORCE)
        file.create_dataset("Current", data=CURRENT).attrs["start"] = 1.5
    channels = read_recording(tmp_path / "throw.h5").channels
    assert (channels["Force"].start, channels["Current"].start) == (0.0, 1.5)
    with h5py.File(tmp_path / "throw.h5", "a") as file:
        file.attrs["start"] = 3.0
        file["Current"].attrs["start"] = 0.0
    channels = read_recording(tmp_path / "throw.h5").channels
    assert (channels["Force"].start, channels["Current"].start) == (3.0, 0.0)


def test_a_place_of_a_file_is_no_start(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        file.attrs.update({"fs": 25.0, "x0": 12.5})
        file.create_dataset("Force", data=FORCE)
    recording = read_recording(tmp_path / "throw.h5")
    assert recording.channel("Force").start == 0.0
    (problem,) = recording.problems
    assert problem.startswith("'x0' (12.5) is not applied, as it may be a place")


def test_a_rate_of_a_group_within_samples_left_out_of_the_file(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        file.attrs.update({"fs": 1000.0, "decimation": 40})
        group = file.create_group("slow")
        group.attrs["fs"] = 25.0
        group.create_dataset("Force", data=FORCE)
    assert read_recording(tmp_path / "throw.h5").channel("slow/Force").rate == 25.0
    outer = {"fs": 1000, "decimation": 40}
    channel = {"name": "Force", "data": FORCE.tolist()}
    path = tmp_path / "throw.json"
    assert read(path, {**outer, "channels": [{**channel, "fs": 25}]}).channel("Force").rate == 25.0
    with pytest.raises(FileError, match="is stated beside a sample rate of 1000 Hz"):
        read(path, {**outer, "channels": [channel]})


def test_gains_of_channels_in_json_are_said(tmp_path: Path) -> None:
    channels = [{"name": "Force", "fs": 25, "scale": 0.001, "data": FORCE.tolist()}]
    recording = read(tmp_path / "throw.json", {"channels": channels})
    assert recording.problems == ("channel 'Force': its attribute 'scale' (0.001) is not applied",)


@pytest.mark.parametrize("seconds", [60.0, 3600.0])
def test_times_without_a_unit_that_are_those_of_no_throw(tmp_path: Path, seconds: float) -> None:
    said = "check the time: '{}' states no unit and is taken as seconds"
    text = HEAD.replace(" (s)", "") + rows(time=lambda n: f"{n * 0.04 / seconds:.8f}")
    assert said.format("Time") in read(tmp_path / "throw.csv", text).problems
    held = {"t": np.arange(COUNT) * 0.04 / seconds, "Force": FORCE}
    scipy_io.savemat(tmp_path / "throw.mat", held)
    assert read_recording(tmp_path / "throw.mat").problems == (
        f"channel 'Force': {said.format('t')}",
    )
    rated = {**held, "fs": seconds * 25.0}
    scipy_io.savemat(tmp_path / "throw.mat", rated)
    assert read_recording(tmp_path / "throw.mat").problems == ()


@pytest.mark.parametrize("swapped", [False, True])
def test_stamps_beside_times_that_disagree(tmp_path: Path, swapped: bool) -> None:
    stamp, name = moment("%Y-%m-%d %H:%M:%S.%f"), ("Stamp", "Time ms")
    for step, rate in ((40, 25), (20, 50)):
        cells = [(stamp(n), f"{step * n}") for n in range(COUNT)]
        lines = [",".join(pair[:: -1 if swapped else 1]) for pair in (name, *cells)]
        text = "".join(f"{line},{v}\n" for line, v in zip(lines, ("Force", *FORCE), strict=True))
        shown = ["'Time' shows 50 Hz, 'Stamp' 25 Hz", "'Stamp' shows 25 Hz, 'Time' 50 Hz"]
        remark = f"check the time: {shown[not swapped]}, which is taken"
        problems = read(tmp_path / "throw.csv", text).problems
        assert problems == ((remark,) if rate == 50 else ())


def test_an_index_that_leaves_rows_out_beside_times(tmp_path: Path) -> None:
    text = "Sample,Time (s),Force\n" + "".join(
        f"{2 * n},{n * 0.08:.2f},{force}\n" for n, force in enumerate(FORCE)
    )
    (problem,) = read(tmp_path / "throw.csv", text).problems
    assert problem.endswith("check the time: its steps are 2, are rows missing?")


def test_a_last_time_half_a_step_off() -> None:
    grid = time_grid(np.append(np.arange(200) * 0.08, 15.96))
    assert grid.step == pytest.approx(0.08)
    assert grid.remark == "check the time: its last, 15.96 s, is taken as 16 s"
    with pytest.raises(ValueError, match="it jumps from 8 to 8.04 s"):
        time_grid(np.concatenate((np.arange(101) * 0.08, 8.04 + np.arange(100) * 0.08)))


@pytest.mark.parametrize(
    "clock",
    [
        {"sample_rate": {"value": 25, "unit": "Hz"}},
        {"sample_rate": {"Value": "0.025", "Units": "kHz"}},
        {"sampling": {"interval": {"magnitude": 40, "unit": "ms"}}},
        {"meta": {"sampling": {"interval": {"value": 40, "unit": "ms"}}, "site": {"no": 7}}},
    ],
)
def test_a_rate_with_its_unit_in_an_object(tmp_path: Path, clock: dict[str, object]) -> None:
    path = tmp_path / "throw.json"
    start = {"start": {"value": 200, "unit": "ms"}}
    for held in (
        {**clock, **start, **LISTS},
        {"channels": [{"name": k, **clock, **start, "values": v} for k, v in LISTS.items()]},
    ):
        force = read(path, held).channel("Force")
        assert (force.rate, force.start) == (25.0, 0.2)
    if "sample_rate" in clock:
        row = [{"throw": 1, **clock, "Force": FORCE.tolist()}]
        assert read(path, row).channel("Force").rate == 25.0


def test_channels_that_stand_under_their_names(tmp_path: Path) -> None:
    path = tmp_path / "throw.json"
    named = {name: {"unit": "kN", "values": values} for name, values in LISTS.items()}
    time = {"time": {"unit": "ms", "values": [40 * n for n in range(COUNT)]}}
    rated = {name: {**item, "fs": 25, "start": 1} for name, item in named.items()}
    tagged = {"tags": ["a", "b"], "fs": 25, **named}
    for held, start in ((tagged, 0.0), ({**time, **named}, 0.0), (rated, 1.0)):
        recording = read(path, held)
        assert list(recording.channels) == list(LISTS)
        force = recording.channel("Force")
        assert (force.rate, force.start, force.unit) == (25.0, start, "kN")


def test_a_rate_of_its_own_within_a_start_of_the_file(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        file.attrs["start"] = 2.0
        table = np.array(list(zip(FORCE, CURRENT, strict=True)), [("Speed", "f8"), ("U", "f8")])
        for name, data in (("Force", FORCE), ("Matrix", np.array([FORCE, FORCE])), ("T", table)):
            file.create_dataset(name, data=data).attrs["fs"] = 25.0
        file.create_dataset("Current", data=CURRENT).attrs.update({"fs": 50.0, "start": 1.0})
        group = file.create_group("group")
        group.attrs["start"] = 3.0
        group.create_dataset("Force", data=FORCE).attrs["fs"] = 25.0
    starts = {
        k: channel.start for k, channel in read_recording(tmp_path / "throw.h5").channels.items()
    }
    assert starts == {
        **{"Force": 2.0, "Matrix 1": 2.0, "Matrix 2": 2.0, "Current": 1.0, "group/Force": 3.0},
        **{"Speed": 2.0, "U": 2.0},
    }


def test_a_column_of_milliseconds_is_no_number_of_a_channel(tmp_path: Path) -> None:
    stamp = moment("%Y/%m/%d,%H:%M:%S")
    text = "Date,Time,sec,Force\n" + "".join(
        f"{stamp(n)},{40 * n % 1000:03d},{FORCE[n % COUNT]}\n" for n in range(100)
    )
    with pytest.raises(FileError, match="'Time': its times are in whole seconds, coarser than"):
        read(tmp_path / "throw.csv", text)


def test_a_column_ts_of_unix_milliseconds(tmp_path: Path) -> None:
    text = "ts,Force\n" + "".join(f"{1795853640000 + 40 * n},{f}\n" for n, f in enumerate(FORCE))
    recording = read(tmp_path / "throw.csv", text)
    assert recording.start_time == "2026-11-28T08:14:00"
    assert recording.channel("Force").rate == pytest.approx(25.0)


def test_a_first_row_whose_time_is_a_word(tmp_path: Path) -> None:
    text = "Time (s),Force\n" + "".join(
        f"{'start' if n == 0 else f'{n * 0.04:.2f}'},{force}\n" for n, force in enumerate(FORCE)
    )
    with pytest.raises(FileError, match="line 2: 'start' is not a number, in a row of numbers"):
        read(tmp_path / "throw.csv", text)


def test_throws_whose_curves_stand_in_inner_objects(tmp_path: Path) -> None:
    rows = [
        {"throw": number, "fs": 25, "signals": {**LISTS, "throw": 9}, "site": {"name": "W12"}}
        for number in (3, 4)
    ]
    path = tmp_path / "throw.json"
    with pytest.raises(FileError, match=r"2 throws in one table \(column 'throw'\): '3', '4'"):
        read(path, rows)
    recording = read_recording(path, throw="4")
    assert list(recording.channels) == list(LISTS)
    assert recording.channel("Force").rate == 25.0
    assert recording.labels["name"] == "W12"


def test_a_number_of_each_row_is_no_channel(tmp_path: Path) -> None:
    text = "Sample rate: 25 Hz\nthrow,Force\n" + "".join(f"{n},{f}\n" for n, f in enumerate(FORCE))
    assert list(read(tmp_path / "throw.csv", text).channels) == ["Force"]


ROWS = list(zip(FORCE, CURRENT, strict=True))
NAMED = {name: {"values": values} for name, values in LISTS.items()}


@pytest.mark.parametrize(
    "inner", [{"adc": {"sample_rate": 8000}}, {"trigger": {"t0": 0.5}}, {"filter": {"dt": 0.001}}]
)
def test_facts_of_a_part_of_a_channel_are_none_of_its_clock(
    tmp_path: Path, inner: dict[str, object]
) -> None:
    channels = [{"name": name, "fs": 25, "values": v, **inner} for name, v in LISTS.items()]
    force = read(tmp_path / "throw.json", {"channels": channels}).channel("Force")
    assert (force.rate, force.start) == (25.0, 0.0)


def test_equal_names_in_objects_of_a_row(tmp_path: Path) -> None:
    rows = [
        {"t": n * 0.04, "left": {"force": f}, "right": {"force": -f, "current": i}}
        for n, (f, i) in enumerate(ROWS)
    ]
    recording = read(tmp_path / "throw.json", rows)
    assert list(recording.channels) == ["left.force", "right.force", "current"]
    np.testing.assert_array_equal(recording.channel("left.force").values, FORCE)
    row = {"throw": 1, "fs": 25, "signals": {"Force": FORCE.tolist()}, "sensor": {"Force": 3.0}}
    recording = read(tmp_path / "throw.json", [row])
    np.testing.assert_array_equal(recording.channel("signals.Force").values, FORCE)


@pytest.mark.parametrize(
    "more",
    [
        {"data": LISTS},
        {"rows": [{"Force": force} for force in FORCE]},
        {"channels": NAMED},
        {"channels": [{"name": name, **item} for name, item in NAMED.items()]},
    ],
)
def test_a_list_in_an_object_beside_the_recording(tmp_path: Path, more: dict[str, object]) -> None:
    with pytest.raises(FileError, match="holds no table, or more than one"):
        read(tmp_path / "throw.json", {"fs": 25, "limits": {"unit": "N", "values": [1, 2]}, **more})


@pytest.mark.parametrize("more", [{"fs": 50}, {"time": [0.08 * n for n in range(COUNT)]}])
def test_a_clock_of_its_own_beside_times_of_all(tmp_path: Path, more: dict[str, object]) -> None:
    held = {"time": {"values": [0.04 * n for n in range(COUNT)]}, **NAMED}
    with pytest.raises(FileError, match="'Force' has a clock of its own beside 'time'; leave one"):
        read(tmp_path / "throw.json", {**held, "Force": {**NAMED["Force"], **more}})
    named = {**held, "Force": {**NAMED["Force"], "name": "Rod 1"}}
    assert list(read(tmp_path / "throw.json", named).channels) == ["Rod 1", "Speed"]


def test_a_rate_around_channels_by_name(tmp_path: Path) -> None:
    assert read(tmp_path / "throw.json", {"rate": 25, **NAMED}).channel("Force").rate == 25.0
    with pytest.raises(FileError, match="neither times nor a sample rate are known"):
        read(tmp_path / "throw.json", {"rate": 25, "rpm": 1400, **NAMED})


@pytest.mark.parametrize("names", ["TS1;TS2", "Tempo 1;Tempo 2"])
def test_numbered_columns_that_rise_behind_a_time(tmp_path: Path, names: str) -> None:
    rows = "".join(f"{n * 0.04:.2f};{20 + n / 100};{n / 50};{f}\n" for n, f in enumerate(FORCE))
    recording = read(tmp_path / "throw.csv", f"Time (s);{names};Force\n{rows}")
    assert list(recording.channels) == [*names.split(";"), "Force"]
    assert recording.channel("Force").rate == 25.0
    again = "".join(f"{n * 0.04:.2f};{f};{n / 50};{f}\n" for n, f in enumerate(FORCE))
    recording = read(tmp_path / "throw.csv", f"Time;Force;Time 2;Current\n{again}")
    assert recording.channel("Current").rate == 50.0


@pytest.mark.parametrize(("left", "right"), [("", ""), ("|", "|"), ("", "|"), ("|", "")])
@pytest.mark.parametrize("rule", ["---|---|---", "---+---+---"])
def test_an_empty_cell_at_the_side_of_a_table_with_bars(
    tmp_path: Path, left: str, right: str, rule: str
) -> None:
    cells = [["" if n == 1 else f"{f}", f"{i}", f"{n % 7}"] for n, (f, i) in enumerate(ROWS)]
    cells[2][2] = ""
    table = [["F", "I", "K"], *cells]
    lines = [f"{left}{'|'.join(row)}{right}" for row in table]
    text = "\n".join(["Sample rate: 25 Hz", lines[0], f"{left}{rule}{right}", *lines[1:], ""])
    recording = read(tmp_path / "throw.txt", text)
    assert list(recording.channels) == ["F", "I", "K"]
    assert np.flatnonzero(np.isnan(recording.channel("F").values)).tolist() == [1]
    assert np.flatnonzero(np.isnan(recording.channel("K").values)).tolist() == [2]
    np.testing.assert_array_equal(recording.channel("I").values, CURRENT)


def test_a_line_of_dashes_among_samples_is_a_gap(tmp_path: Path) -> None:
    rows = [f"{f}|{i}" for f, i in ROWS]
    text = "\n".join(["Sample rate: 25 Hz", "F|I", *rows[:3], "---|----", *rows[3:], ""])
    assert read(tmp_path / "throw.csv", text).channel("F").values.size == COUNT + 1


@pytest.mark.parametrize("line", ["Sample rate;25;25", "Sampling rate [Hz];25;25", "dt [ms];40;40"])
def test_a_rate_below_a_heading_with_a_time(tmp_path: Path, line: str) -> None:
    lines = [f"{n * 0.04:.2f};{f};{i}" for n, (f, i) in enumerate(ROWS)]
    recording = read(tmp_path / "throw.csv", "\n".join(["Time;F;I", line, *lines, ""]))
    assert recording.channel("F").rate == 25.0


def test_names_with_the_numbers_of_their_columns(tmp_path: Path) -> None:
    lines = [f"{n * 40};{f};{i}" for n, (f, i) in enumerate(ROWS)]
    heading = "1=Time [ms];2=Force [N];3=Current [A]"
    recording = read(tmp_path / "throw.csv", "\n".join([heading, *lines, ""]))
    assert [(c.name, c.unit) for c in recording.channels.values()] == [
        ("Force", "N"),
        ("Current", "A"),
    ]
    assert recording.channel("Force").rate == 25.0


def test_a_dataset_of_one_sample_with_its_rate(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "throw.h5", "w") as file:
        for name, data in (("Force", FORCE), ("Current", CURRENT[:1]), ("no", [7])):
            file.create_dataset(name, data=data).attrs.update({} if name == "no" else {"fs": 25.0})
    recording = read_recording(tmp_path / "throw.h5")
    assert {name: c.values.size for name, c in recording.channels.items()} == {
        "Force": COUNT,
        "Current": 1,
    }


def test_bars_in_names_below_a_line_drawn(tmp_path: Path) -> None:
    lines = [f"{n * 0.04:.2f};{f};{i}" for n, (f, i) in enumerate(ROWS)]
    text = "\n".join(["Time (s);|F|;|I|", "-----|-----", *lines, ""])
    assert list(read(tmp_path / "throw.csv", text).channels) == ["|F|", "|I|"]
