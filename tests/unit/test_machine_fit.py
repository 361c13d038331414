"""Machines from currents: lines, lags, slip, worn clutches, anchors, and what is not identified.

The campaigns are written down here: a permanent magnet, i = 0.8 A + 0.2 A/kN F behind a lag of
30 ms (and 10 ms of the coil), a clutch that slips at 2 A.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from tests.unit.test_cli_json import printed
from typer.testing import CliRunner

from turnout.api.machine import fit_machines
from turnout.calibration.machine_estimates.current_fit import (
    STEP,
    LoadLine,
    NotIdentified,
    RunningSpan,
    fit_load_line,
    slip_estimate,
    slip_level,
)
from turnout.calibration.machine_estimates.force_anchor import Gauge, Sister
from turnout.cli.main import app
from turnout.core.errors import MachineError, MeasurementError
from turnout.core.moving_average import moving_average

Floats = NDArray[np.float64]
IDLE, SLOPE, SLIP, LAG, COIL = 0.8, 2e-4, 2.0, 0.030, 0.010


def lagged(load: Floats, step: float, *, lag: float = LAG, coil: float = COIL) -> Floats:
    """Solve y + lag y' + lag coil y'' = load by small Euler steps, from rest."""
    parts = 200
    y, rate, found = load[0], 0.0, np.empty_like(load)
    for number, value in enumerate(load):
        before = load[max(number - 1, 0)]
        for part in range(parts if number else 0):
            now = before + (value - before) * (part + 1) / parts
            rate += step / parts * (now - y - lag * rate) / (lag * coil)
            y += step / parts * rate
        found[number] = y
    return found


def span(name: str, load: Floats, current: Floats) -> RunningSpan:
    usable = np.arange(load.size) > 20
    others = np.full(load.size, 1e3)
    return RunningSpan(
        name=name,
        number=0,
        on=0.0,
        off=STEP * load.size,
        time=STEP * np.arange(load.size),
        current=current,
        load=load,
        others=others,
        usable=usable,
    )


def waving(seed: int) -> Floats:
    """Return a force that rises, with the oscillations of a rail at 4 Hz."""
    time = np.arange(0.0, 3.0, STEP)
    phase = np.random.default_rng(seed).uniform(0.0, 6.0)
    return 800.0 + 300.0 * time + 80.0 * np.sin(2 * np.pi * 4.0 * time + phase)


def line_of(spans: list[RunningSpan], **options: float) -> LoadLine:
    found = fit_load_line(spans, **options)  # type: ignore[arg-type]
    assert isinstance(found, LoadLine), found
    return found


def test_line_and_both_lags() -> None:
    spans = []
    for seed in range(3):
        load = waving(seed)
        spans.append(span(str(seed), load, IDLE + SLOPE * lagged(load, STEP)))
    found = line_of(spans)
    assert found.idle.value == pytest.approx(IDLE, rel=1e-3)
    assert found.slope.value == pytest.approx(SLOPE, rel=2e-3)
    assert (found.lag, found.lag_coil) == (LAG, COIL)
    assert found.rms < 5e-4


def test_intervals_widen_by_cross_talk() -> None:
    rng = np.random.default_rng(0)
    spans = []
    for seed in range(4):
        load = waving(seed)
        noise = 1e-3 * rng.standard_normal(load.size) + 2e-3 * rng.standard_normal()
        spans.append(span(str(seed), load, IDLE + SLOPE * load + noise))
    bare, wide = line_of(spans), line_of(spans, cross_talk=5e-3)
    assert bare.idle.low < IDLE < bare.idle.high
    # 0.5 % of 1 kN is 5 N, 1 mA
    assert wide.idle.deviation == pytest.approx(math.hypot(bare.idle.deviation, 1e-3), rel=1e-3)
    assert wide.slope.deviation == pytest.approx(bare.slope.deviation, rel=1e-3)


def test_a_load_that_drives_the_machine_back_has_its_own_slope() -> None:
    time = np.arange(0.0, 3.0, STEP)
    load = -600.0 + 600.0 * time
    current = IDLE + SLOPE * np.maximum(load, 0.0) + 0.81 * SLOPE * np.minimum(load, 0.0)
    found = line_of([span(name, load, current) for name in "abc"])
    assert found.slope.value == pytest.approx(SLOPE, rel=1e-6)
    assert found.slope_driven_back is not None
    assert found.slope_driven_back.value == pytest.approx(0.81 * SLOPE, rel=1e-6)


def test_a_series_motor_by_its_torque() -> None:
    """k(i) i = K i^2/(1 + i/i_s) is linear in the force: the current is not."""
    load, saturation = waving(1), 3.0
    torque = 0.3 + 4e-4 * load
    half = 0.5 * torque / saturation
    current = half + np.sqrt(half**2 + torque)
    spans = [span(name, load, current) for name in "abc"]
    found = fit_load_line(spans, saturation_current=saturation)
    assert isinstance(found, LoadLine)
    idle = 0.5 * 0.3 / saturation + math.sqrt((0.5 * 0.3 / saturation) ** 2 + 0.3)
    assert found.idle.value == pytest.approx(idle, rel=1e-4)
    straight = line_of(spans)
    assert abs(straight.idle.value / idle - 1) > 0.02


@pytest.mark.parametrize(
    ("load", "reason"),
    [
        (np.full(300, 900.0), "the force spans only 0 N"),
        (np.linspace(0.0, 2e3, 60), "less than 1.5 s"),
    ],
)
def test_what_cannot_be_identified_is_said(load: Floats, reason: str) -> None:
    found = fit_load_line([span("a", load, IDLE + SLOPE * load)])
    assert isinstance(found, NotIdentified)
    assert reason in found.reason


def campaign(
    *,
    wear: float = 0.0,
    slips: int = 6,
    free: int = 4,
    forces: bool = True,
    sign: float = 1.0,
    until: float = 3.2,
) -> xr.Dataset:
    """Return a campaign of one drive: free throws, then throws on an object until the time-out."""
    rate, time = 200.0, np.arange(-1.0, 11.0, 0.005)
    rng = np.random.default_rng(7)
    currents, loads = [], []
    for number in range(free + slips):
        slipping = number >= free
        rise = 2.5e3 if slipping else 0.0
        load = np.interp(time, [0.0, 0.3, 2.5, 3.2], [-500.0, 900.0, 1600.0, 1600.0 + rise])
        load = load + np.where(time > 3.2, 1.2e3 * (time - 3.2) if slipping else 0.0, 0.0)
        level = SLIP * (1.0 - wear * (number - free))
        current = np.minimum(IDLE + SLOPE * load, level)
        current = current + 9.0 * np.exp(-np.clip(time, 0.0, None) / 0.03)
        current[(time < 0.0) | (time > (8.0 if slipping else until))] = 0.0
        noise = 0.01 * rng.standard_normal(time.size) + 0.003  # the clamp's zero is off
        currents.append(sign * moving_average(current + noise, rate=rate))
        loads.append(moving_average(np.minimum(load, 6e3), rate=rate))
    names = [f"throw {number}" for number in range(free + slips)]
    variables = {"drive_current": (("movement", "drive", "time"), np.array(currents)[:, None])}
    if forces:
        variables["drive_force"] = (("movement", "drive", "time"), np.array(loads)[:, None])
    coords = {"time": time, "drive": ["1"], "movement": names}
    dataset = xr.Dataset(variables, coords)
    return dataset.assign_coords(direction=("movement", ["closing"] * len(names)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_campaign(sign: float) -> None:
    found = fit_machines(campaign(sign=sign)).of("1", "closing")
    assert isinstance(found.line, LoadLine)
    assert found.line.idle.value == pytest.approx(IDLE, rel=0.01)
    assert found.line.slope.value == pytest.approx(SLOPE, rel=0.01)
    assert found.slip is not None
    assert found.slip.low < SLIP < found.slip.high
    assert found.slip.value == pytest.approx(SLIP, rel=1e-3)
    assert found.held == pytest.approx(6e3, rel=0.1)
    assert found.trend is not None
    assert not found.trend.changes
    assert found.energised is not None
    # the moving average adds up to half of its 0.1 s at either end
    assert 3.2 <= found.energised.value <= 3.3
    force = found.force(1.4)
    assert force.low < 3000.0 < force.high
    assert found.anchor is not None
    assert found.anchor.kind == "force at the drive"


def test_a_drive_that_takes_longer_than_the_others_does_not_slip() -> None:
    slow = campaign(slips=2, until=4.6).assign_coords(drive=["2"])
    found = fit_machines(xr.concat([campaign(slips=2), slow], "drive", join="override"))
    for drive, length in (("1", 3.2), ("2", 4.6)):
        one = found.of(drive, "closing")
        assert len(one.levels) == 2
        assert one.energised is not None
        assert length <= one.energised.value <= length + 0.1


def test_the_end_of_another_movement_is_no_zero_of_the_clamp() -> None:
    braking = campaign(slips=2)
    current = braking["drive_current"]
    braking["drive_current"] = current.where(current["time"] > -0.15, current - 0.15)
    line = fit_machines(braking).of("1", "closing").line
    assert isinstance(line, LoadLine)
    assert line.idle.value == pytest.approx(IDLE, rel=0.01)


def test_a_worn_clutch_is_tracked() -> None:
    """Half a per cent of 2 A a throw is 0.83 % of the 1.2 A that the clutch itself takes."""
    trend = fit_machines(campaign(wear=0.005)).of("1", "closing").trend
    assert trend is not None
    assert trend.changes
    assert trend.per_throw.value == pytest.approx(-0.01, rel=0.02)
    assert trend.share is not None
    assert trend.share.low < -0.01 / 1.2 < trend.share.high


def test_without_forces_a_current_stays_amperes() -> None:
    fit = fit_machines(campaign(forces=False))
    found = fit.of("1", "closing")
    assert isinstance(found.line, NotIdentified)
    assert found.line.reason == "no force was measured at this drive"
    assert found.slip is not None
    assert found.anchor is None
    assert all(one.force_most is None for one in found.usage)
    assert any("without forces a current is only amperes" in text for text in fit.not_separated)
    with pytest.raises(MeasurementError, match="no anchor says what an ampere is"):
        found.force(1.4)


def test_anchors_give_newtons() -> None:
    bare = campaign(forces=False)
    gauged = fit_machines(bare, idle={"1": 0.8}, clutch_force={"1": (6e3, 150.0)})
    force = gauged.of("1", "closing").force(1.4)
    assert force.value == pytest.approx(3e3, rel=5e-3)
    assert force.deviation == pytest.approx(75.0, rel=0.05)
    sister = fit_machines(bare, idle={"1": 0.8}, sister={"1": (2e-4, 2e-5)})
    force = sister.of("1", "closing").force(1.4)
    assert force.value == pytest.approx(3e3)
    assert force.deviation == pytest.approx(300.0)
    assert sister.of("1", "closing").usage[0].force_most is not None


def test_anchors_that_cannot_be() -> None:
    with pytest.raises(MachineError, match="needs a force above 0"):
        Gauge(force=6e3, deviation=1e2).anchor(slip_current=0.7, idle=0.8)
    with pytest.raises(MachineError, match="spread is that from machine to machine"):
        Sister(slope=2e-4, spread=0.0).anchor(idle=0.8)
    with pytest.raises(MeasurementError, match="idle of drive '3': there are 1"):
        fit_machines(campaign(), idle={"3": 0.8})
    with pytest.raises(MeasurementError, match="drive_current: is missing"):
        fit_machines(campaign().drop_vars("drive_current"))
    with pytest.raises(MeasurementError, match="direction: is missing"):
        fit_machines(campaign().drop_vars("direction"))
    with pytest.raises(MeasurementError, match="no motor runs"):
        fit_machines(0.01 * campaign())
    with pytest.raises(MeasurementError, match="there are: 1 closing"):
        fit_machines(campaign()).of("1", "opening")


def test_the_command(tmp_path: Path) -> None:
    file = tmp_path / "campaign.nc"
    campaign().assign_attrs(schema_version=1).to_netcdf(file, engine="h5netcdf")
    quiet = CliRunner().invoke(app, ["machine", "fit", str(file), "--quiet"])
    assert (quiet.exit_code, quiet.output) == (0, "")
    found = printed("machine", "fit", file)
    drive = found["drives"][0]
    assert drive["slip"]["value"] == pytest.approx(SLIP, rel=1e-3)
    assert found["units"]["slope"] == "A/N"
    assert drive["anchor"]["kind"] == "force at the drive"
    assert json.dumps(found)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--idle", "1=0.8"], "has no unit"),
        (["--clutch-force", "1=6 kN"], "must be DRIVE='6 kN +- ...'"),
        (["--sister", "1=0.2 A/kN +- 20 mA/kN"], "no --idle 1"),
        (["--series-motor", "0 A"], "more than 0"),
        (
            ["--series-motor", "3 A", "--idle", "1=1 A", "--sister", "1=0.2 A/kN +- 20 mA/kN"],
            "does not rise straight",
        ),
        (["--idle", "1=1 A", "--sister", "1=0.2 A/kN +- 20 mA/kN to 4 m"], "--sister"),
    ],
)
def test_bad_options(options: list[str], words: str, tmp_path: Path) -> None:
    from tests.faults.terminal import run_here

    campaign().assign_attrs(schema_version=1).to_netcdf(tmp_path / "campaign.nc", engine="h5netcdf")
    code, errors = run_here("machine", "fit", "campaign.nc", *options, folder=tmp_path)
    assert code == 2
    assert words in errors
    assert "Traceback" not in errors


def test_a_series_motor_gives_back_the_forces_of_its_own_curve() -> None:
    """Noise-free: torque goes by i^2/(1 + i/i_s), from 1 A idle to 2 A at 4 kN."""
    saturation, idle, slip, force = 6.0, 1.0, 2.0, 4000.0

    def shape(current: float) -> float:
        return current**2 / (1.0 + current / saturation)

    gauge = Gauge(force=force, deviation=80.0)
    anchor = gauge.anchor(slip_current=slip, idle=idle, saturation_current=saturation)
    for current in (1.2, 1.5, 1.8, 2.0):
        wanted = force * (shape(current) - shape(idle)) / (shape(slip) - shape(idle))
        found = anchor.force(current)
        assert found.value == pytest.approx(wanted)
        assert found.deviation >= 0.0199 * wanted
    straight = gauge.anchor(slip_current=slip, idle=idle)
    assert straight.force(1.5).value == pytest.approx(2000.0)
    step = anchor.force(1.5, deviation=1e-3).deviation ** 2 - anchor.force(1.5).deviation ** 2
    slope = (anchor.force(1.501).value - anchor.force(1.499).value) / 0.002
    assert step**0.5 == pytest.approx(1e-3 * slope, rel=1e-3)


@pytest.mark.parametrize("size", [2, 15, 30, 49, 50, 99])
def test_a_short_slipping_span_has_an_interval(size: int) -> None:
    rng = np.random.default_rng(size)
    current, held = 2.0 + 0.01 * rng.standard_normal(size), np.full(size, np.nan)
    level = slip_level("a", number=0, current=current, held=held)
    found = slip_estimate([level])
    assert found is not None
    assert math.isfinite(level.deviation)
    assert found.low < found.value < found.high
    with pytest.raises(MachineError, match="1 sample"):
        slip_level("a", number=0, current=current[:1], held=held[:1])


@pytest.mark.parametrize("saturation", [None, 4.0])
def test_the_idle_error_of_a_gauge_counts_once(saturation: float | None) -> None:
    """Reference: all three drawn 20,000 times, F = F_s (g(i) - g(i_0))/(g(i_s) - g(i_0))."""
    slip, idle, force = 2.0, 0.8, 6e3
    anchor = Gauge(force=force, deviation=50.0).anchor(
        slip_current=slip, slip_deviation=0.01, idle=idle, idle_deviation=0.02,
        saturation_current=saturation,
    )  # fmt: skip

    def shape(current: Floats) -> Floats:
        return current if saturation is None else current**2 / (1.0 + current / saturation)

    rng = np.random.default_rng(1)
    i_s, i_0, f_s = (
        value + spread * rng.standard_normal(20_000)
        for value, spread in ((slip, 0.01), (idle, 0.02), (force, 50.0))
    )
    for current in (0.9, 1.4, 2.0):
        at = shape(np.full(1, current))
        drawn = f_s * (at - shape(i_0)) / (shape(i_s) - shape(i_0))
        assert anchor.force(current).deviation == pytest.approx(float(drawn.std()), rel=0.03)


def test_idle_and_slope_of_a_line_are_correlated() -> None:
    """The force at the middle of the fitted loads is known better than idle and slope alone say."""
    rng = np.random.default_rng(2)
    spans = []
    for seed in range(6):
        load = waving(seed)
        current = IDLE + SLOPE * load * (1.0 + 0.02 * rng.standard_normal())
        spans.append(span(str(seed), load, current + 2e-3 * rng.standard_normal()))
    line = line_of(spans)
    bound = line.idle.deviation * line.slope.deviation
    assert abs(line.covariance) <= bound * (1.0 + 1e-9)
    assert line.covariance != 0.0


@pytest.mark.parametrize("sister_idle", [None, 1.0, 0.7])
def test_a_sister_of_a_series_motor(sister_idle: float | None) -> None:
    """Torque by i^2/(1 + i/i_s): what machines of a type share is its rise with the force."""
    saturation, idle, reference, per_newton = 6.0, 1.0, 4000.0, 5e-4

    def shape(current: float) -> float:
        return current**2 / (1.0 + current / saturation)

    def current_of(torque: float) -> float:
        half = 0.5 * torque / saturation
        return half + math.sqrt(half**2 + torque)

    from_idle = idle if sister_idle is None else sister_idle
    rise = (current_of(shape(from_idle) + per_newton * reference) - from_idle) / reference
    sister = Sister(slope=rise, spread=0.1 * rise, reference=reference, idle=sister_idle)
    anchor = sister.anchor(idle=idle, saturation_current=saturation)
    for force in (0.0, 1500.0, 4000.0, 5000.0):
        found = anchor.force(current_of(shape(idle) + per_newton * force))
        assert found.value == pytest.approx(force, abs=1e-6)
        assert found.low - 1e-9 <= force <= found.high + 1e-9
    with pytest.raises(MachineError, match="reference force"):
        Sister(slope=rise, spread=1e-5).anchor(idle=idle, saturation_current=saturation)


def test_a_sister_of_a_series_motor_in_a_campaign() -> None:
    bare = campaign(forces=False)
    given = {"sister": {"1": (3e-4, 3e-5, 4e3)}, "idle": {"1": 0.8}}
    found = fit_machines(bare, motor="series", saturation_current=3.0, **given).of("1", "closing")
    assert found.anchor is not None
    assert found.force(0.8 + 1.2).value == pytest.approx(4e3)
    assert 600.0 < found.force(1.1).value < 1000.0  # below the chord's 1000 N


def test_the_command_with_a_sister_of_a_series_motor(tmp_path: Path) -> None:
    file = tmp_path / "campaign.nc"
    campaign(forces=False).assign_attrs(schema_version=1).to_netcdf(file, engine="h5netcdf")
    sister = "1=0.3 A/kN +- 0.03 A/kN to 4 kN from 0.9 A"
    options = ("--series-motor", "3 A", "--idle", "1=0.8 A", "--sister", sister)
    anchor = printed("machine", "fit", file, *options)["drives"][0]["anchor"]
    assert anchor["kind"] == "sister machine"
    assert anchor["series"] == [4000.0, 3.0]
    assert anchor["slope"] == pytest.approx(3.05e-4, rel=0.02)


def test_a_folder_of_clamps_alone(tmp_path: Path) -> None:
    """Currents of a DC machine without any force: an anchor makes newtons of them."""
    from tests.faults.terminal import run_here

    lines = ["file,direction,size [mm],place"]
    currents = campaign(forces=False)["drive_current"].isel(drive=0)
    for number, current in enumerate(currents.values):
        table = np.stack([currents["time"].values + 1.0, current], axis=1)
        head = "time [s],I [A]"
        name = f"{number}.csv"
        np.savetxt(tmp_path / name, table, delimiter=",", header=head, comments="", fmt="%.4f")
        lines.append(f"{name},closing,0,none")
    (tmp_path / "runs.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    channels = '[drive_current.1]\ncolumn = "I"\nkind = "scaled"\n'
    (tmp_path / "channels.toml").write_text(channels, encoding="utf-8")
    given = ("--idle", "1=0.8 A", "--clutch-force", "1=6.0 kN +- 0.2 kN")
    code, errors = run_here("machine", "fit", ".", *given, folder=tmp_path)
    assert code == 0, errors
    anchor = printed("machine", "fit", tmp_path, *given)["drives"][0]["anchor"]
    assert anchor["kind"] == "clutch-force gauge"
    assert anchor["slope"] == pytest.approx(SLOPE, rel=0.02)
    given = ("--idle", "1=0.8 A", "--sister", "1=0.21 A/kN +- 0.02 A/kN")
    found = printed("machine", "fit", tmp_path, *given)["drives"][0]
    assert found["anchor"]["kind"] == "sister machine"
    assert all(one["force_mean"]["value"] > 0.0 for one in found["usage"])
