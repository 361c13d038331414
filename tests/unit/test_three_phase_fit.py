"""Three-phase machines from voltage, current and power: circuit, what is told and what is not.

The campaigns follow a circuit with 12 ohm, n = 4.2 and 15 ohm of leakage through 391 V, 390 W and
2.4 A. In warm throws all of the power is higher and the current lower, as it is with hot copper.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from benchmarks.studies.three_phase_campaigns import SUPPLY, drawn_motor, truths
from numpy.typing import NDArray
from tests.faults.terminal import run_here
from tests.unit.test_cli_json import printed

from turnout.api.machine import fit_three_phase
from turnout.calibration.machine_estimates.current_fit import Estimate, NotIdentified
from turnout.calibration.machine_estimates.three_phase import (
    ThreePhaseFit,
    ThrowMeans,
    fit_throws,
)
from turnout.calibration.machine_estimates.three_phase_circuit import SupplyCircuit
from turnout.cli.three_phase import three_phase_lines
from turnout.core.errors import MeasurementError
from turnout.throw.store import save_response

Floats = NDArray[np.float64]
CIRCUIT = SupplyCircuit(
    voltage=391.0, power=390.0, current=2.4, resistance=12.0, saturation=4.2, leakage=18.8
)
RATE = 25.0


def campaign(
    *,
    throws: int = 30,
    spread: float = 4.0,
    swing: float = 40.0,
    free: int = 0,
    warmth: float = 5.0,
) -> xr.Dataset:
    """Return throws of 5 s whose power swings within them, at supplies that differ."""
    rng, time = np.random.default_rng(3), np.arange(-0.4, 6.4, 1.0 / RATE)
    on = (time > 0.0) & (time < 5.0)
    rows: dict[str, list[Floats]] = {"voltage": [], "current": [], "power": []}
    for number in range(throws):
        voltage = 391.0 + spread * rng.standard_normal()
        warm, loaded = rng.standard_normal(), number >= free
        level = (390.0 if loaded else 280.0) + 15.0 * rng.standard_normal() * loaded + warmth * warm
        wave = np.sin(2.0 * np.pi * time / 5.0 + rng.uniform(0.0, 6.0))
        power = level + (swing * wave if loaded else 0.0)
        current = CIRCUIT.current_at(np.full(time.size, voltage), power) - 8e-4 * warmth * warm
        rows["voltage"].append(voltage + 0.1 * rng.standard_normal(time.size))
        rows["current"].append(np.where(on, current + 2e-3 * rng.standard_normal(time.size), 0.0))
        rows["power"].append(np.where(on, power + 3.0 * rng.standard_normal(time.size), 0.0))
    names = [f"throw {number}" for number in range(throws)]
    data = {
        f"drive_{what}": (("movement", "drive", "time"), np.stack(values)[:, None])
        for what, values in rows.items()
    }
    return xr.Dataset(
        data, {"movement": names, "drive": ["1"], "time": time}, {"schema_version": 1}
    )


def fit_of(data: xr.Dataset, **given: object) -> ThreePhaseFit:
    (found,) = fit_three_phase(data, rated_voltage=380.0, **given)  # type: ignore[arg-type]
    return found


def holds(value: Estimate | NotIdentified, truth: float, *, within: float) -> bool:
    assert isinstance(value, Estimate), value
    return value.low < truth < value.high and abs(value.value / truth - 1.0) < within


def test_the_circuit_is_that_of_its_phasors() -> None:
    """From the voltage E behind R and the rotor's current, everything follows by Ohm's law."""
    r, x_l, n, e_0, i_0 = 11.0, 20.0, 5.0, 212.0, 2.2

    def point(e: float, rotor: float) -> tuple[float, float, float]:
        main = i_0 * (e / e_0) ** n
        angle = math.asin(rotor * x_l / e)  # the rotor's current lags by its leakage
        current = rotor * complex(math.cos(angle), -math.sin(angle)) - 1j * main
        voltage = e + r * current
        return (
            math.sqrt(3.0) * abs(voltage),
            3.0 * (voltage * current.conjugate()).real,
            abs(current),
        )

    voltage, power, current = point(212.0, 0.3)
    circuit = SupplyCircuit(
        voltage=voltage, power=power, current=current, resistance=r, saturation=n, leakage=x_l
    )
    for e, rotor in ((205.0, 0.1), (212.0, 0.6), (222.0, 0.4)):
        u, p, i = point(e, rotor)
        # I_r = p_i/E of the circuit is its active part: within 1e-4 of the phasor's
        assert circuit.current_at(np.array([u]), np.array([p]))[0] == pytest.approx(i, rel=3e-4)
        # in an inrush: E over the rotor's current, R_r/s + j X_l
        z = circuit.rotor_impedances(np.array([u]), np.array([i]), np.array([p]))[1][0]
        assert z.real == pytest.approx(math.sqrt((e / rotor) ** 2 - x_l**2), rel=2e-3)
        assert z.imag == pytest.approx(x_l, rel=0.02)


def test_what_voltage_current_and_power_tell() -> None:
    found = fit_of(campaign())
    slopes = [
        CIRCUIT.current_at(np.array([found.voltage + du]), np.array([found.power + dp]))[0]
        for du, dp in ((0.5, 0.0), (-0.5, 0.0), (0.0, 5.0), (0.0, -5.0))
    ]
    at_rated = CIRCUIT.current_at(np.array([380.0]), np.array([found.power]))[0]
    assert holds(found.per_volt, slopes[0] - slopes[1], within=0.03)
    assert holds(found.per_watt, (slopes[2] - slopes[3]) / 10.0, within=0.05)
    assert holds(found.current, at_rated, within=0.01)
    # the assumed leakage, 0.2 U/(sqrt(3) I), is the true one
    assert holds(found.resistance, 12.0, within=0.05)
    assert "about the circuit" in found.verdict
    assert "does not follow" not in found.verdict
    assert found.starts == (9, 9)


def test_pooled_slopes_mislead_and_are_not_taken() -> None:
    """Warm throws take more power and less current: over throws the slope is steeper."""
    data = campaign(throws=60, warmth=20.0)
    means = {
        what: data[f"drive_{what}"].isel(drive=0).sel(time=slice(0.6, 4.6)).mean("time").values
        for what in ("voltage", "current", "power")
    }
    columns = np.stack([np.ones(60), means["voltage"] - 391.0, means["power"] - 390.0], axis=1)
    pooled = np.linalg.lstsq(columns, means["current"], rcond=None)[0][2]
    found = fit_of(data)
    assert isinstance(found.per_watt, Estimate)
    powers = np.array([found.power - 5.0, found.power + 5.0])
    truth = float(np.diff(CIRCUIT.current_at(np.full(2, found.voltage), powers))[0]) / 10.0
    assert abs(pooled / truth - 1.0) > 0.1
    assert abs(found.per_watt.value / truth - 1.0) < 0.03


def exact_throw(number: int, points: tuple[Floats, Floats, Floats], voltage: float) -> ThrowMeans:
    """Return blocks of a throw whose load rises within it, without noise."""
    current, power, torque = points
    running = slice(0, int(power.argmax()) + 1)
    load = np.linspace(0.7, 1.2, 12) * (1.0 + 0.2 * np.sin(float(number)))
    at = np.interp(load, torque[running], power[running])
    found = np.interp(at, power[running], current[running])
    rows = {"voltage": np.full(12, voltage), "current": found, "power": at}
    blocks = {what: np.stack([row, row]) for what, row in rows.items()}
    return ThrowMeans(name=str(number), blocks=blocks, inrush=None)


@pytest.mark.parametrize("index", [6, 14])
def test_a_motor_that_is_no_such_circuit_has_the_slope_of_its_throws(index: int) -> None:
    """Exact throws of a T circuit: the circuit alone has 3 to 5 % more per volt than it."""
    motor = drawn_motor(np.random.default_rng([20261130, index]), deep=False)
    voltages = SUPPLY + 4.0 * np.random.default_rng(5).standard_normal(60)
    throws = [
        exact_throw(number, motor.points(voltage, 50.0, 1.03), voltage)
        for number, voltage in enumerate(voltages)
    ]
    found = fit_throws("1", throws, rated_voltage=380.0)
    truth = truths(motor, found, 1.03, 0.0)
    assert holds(found.per_volt, truth["per_volt"], within=0.005)
    assert holds(found.current, truth["current"], within=0.005)
    assert holds(found.per_watt, truth["per_watt"], within=0.02)
    # without voltage the slope of a line is stated for the power at which the current has it
    without = [replace(one, blocks=dict(list(one.blocks.items())[1:])) for one in throws]
    bare = fit_throws("1", without, rated_voltage=380.0)
    assert bare.missing == ("U",)
    there = truths(motor, replace(bare, voltage=found.voltage), 1.03, 0.0)
    assert abs(there["per_watt"] / truth["per_watt"] - 1.0) > 0.02
    assert holds(bare.per_watt, there["per_watt"], within=0.01)


@pytest.mark.parametrize(
    ("missing", "told"),
    [("voltage", {"per_watt"}), ("power", {"current", "per_volt"}), ("current", set())],
)
def test_what_is_missing_is_said(missing: str, told: set[str]) -> None:
    found = fit_of(campaign(throws=60).drop_vars(f"drive_{missing}"))
    letter = {"voltage": "U", "power": "P", "current": "I"}[missing]
    assert found.missing == (letter,)
    for name in ("current", "per_volt", "per_watt", "resistance", "saturation", "loss"):
        value = getattr(found, name)
        assert isinstance(value, Estimate) == (name in told), (name, value)
        if isinstance(value, NotIdentified):
            assert f"{letter} not recorded" in value.reason
    assert letter in found.verdict or missing == "current"


def test_a_constant_load_tells_no_resistance() -> None:
    found = fit_of(campaign(swing=0.0))
    assert isinstance(found.resistance, NotIdentified)
    assert found.resistance.low < 12.0 < found.resistance.high
    assert isinstance(found.loss, NotIdentified)
    assert isinstance(found.per_volt, Estimate)


def test_one_voltage_tells_no_slope_with_it() -> None:
    noisy, exact = campaign(spread=0.0), campaign(spread=0.0)
    exact["drive_voltage"][:] = 391.0
    for data, reason in ((noisy, "more throws"), (exact, "the same voltage")):
        found = fit_of(data)
        assert isinstance(found.per_volt, NotIdentified)
        assert reason in found.per_volt.reason
        assert isinstance(found.current, NotIdentified)
        assert isinstance(found.per_watt, Estimate)
    (rated,) = fit_three_phase(exact, rated_voltage=391.0)
    assert isinstance(rated.current, Estimate)  # no slope is needed to come to it
    assert isinstance(rated.per_volt, NotIdentified)


def test_losses_need_throws_with_the_rod_off() -> None:
    data = campaign(throws=40, free=6)
    bare = fit_of(data).loss
    assert isinstance(bare, NotIdentified)
    assert "the rod never ran free: at most" in bare.reason
    loss = fit_of(data, free=[f"throw {k}" for k in range(6)]).loss
    assert isinstance(loss, NotIdentified)  # 280 W, of which the copper's 220 W is not known to 2 W
    assert "with a deviation of" in loss.reason
    assert "once, two throws are needed" in fit_of(data, free=["throw 0"]).loss.reason


def bad(data: xr.Dataset, channel: str, factor: float) -> xr.Dataset:
    return data.assign({f"drive_{channel}": factor * data[f"drive_{channel}"]})


@pytest.mark.parametrize(
    ("channel", "factor", "message"),
    [
        ("power", 5.0, "another unit, a phase that is missing"),
        ("power", 1.0 / 3.0, "or power of one phase"),
        ("power", 1e-3, "another unit"),
        ("current", 1e3, "another unit"),
        ("voltage", 1 / math.sqrt(3.0), "voltages of a phase to neutral"),
    ],
)
def test_what_contradicts_is_one_message(
    channel: str, factor: float, message: str, tmp_path: Path
) -> None:
    file = tmp_path / "campaign.nc"
    save_response(bad(campaign(throws=8), channel, factor), file)
    line = ["machine", "fit", "campaign.nc", "--three-phase", "380 V"]
    code, errors = run_here(*line, folder=tmp_path)
    assert code == 2
    assert message in errors
    assert errors.count("drive 1") == 1
    if channel == "voltage":
        assert run_here(*line, "--to-neutral", folder=tmp_path)[0] == 0


def test_copper_that_would_take_all_of_the_power_is_refused() -> None:
    """Two of three phases: the power factor is possible, the slopes are not with such power."""
    data = bad(campaign(throws=60), "power", 2.0 / 3.0)
    with pytest.raises(
        MeasurementError,
        match=r"drive 1: by its slopes line and stator take 8\d %.* leave the power",
    ):
        fit_of(data)
    assert isinstance(fit_of(data.drop_vars("drive_power")).per_volt, Estimate)


def test_leaving_the_power_out_is_no_remedy_without_voltages() -> None:
    data = bad(campaign(throws=10), "power", 0.05)
    with pytest.raises(MeasurementError, match="power factors .* leave the power out"):
        fit_of(data)
    with pytest.raises(MeasurementError, match=r"power factors .* channel map\)$"):
        fit_of(data.drop_vars("drive_voltage"))


def test_a_direct_current_is_none_of_three_phases() -> None:
    data = campaign(throws=10)
    power = data["drive_voltage"] * data["drive_current"]
    with pytest.raises(MeasurementError, match="P is U I in all throws: direct current"):
        fit_of(data.assign(drive_power=power))


def test_too_few_throws_and_unknown_names_are_refused() -> None:
    with pytest.raises(MeasurementError, match="runs steadily in 5 movements, 8 are needed"):
        fit_of(campaign(throws=5))
    with pytest.raises(MeasurementError, match="free movement 'x': is not in the campaign"):
        fit_of(campaign(throws=8), free=["x"])
    with pytest.raises(MeasurementError, match="at least two of drive_voltage"):
        fit_of(campaign(throws=8).drop_vars(["drive_voltage", "drive_power"]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--free", "a"], "give --three-phase"),
        (["--three-phase", "380 V", "--series-motor", "3 A"], "takes no --series-motor"),
        (["--three-phase", "380"], "--three-phase '380'"),
        (["--three-phase", "0 V"], "must be more than 0 V"),
    ],
)
def test_options_that_do_not_go_together(options: list[str], message: str, tmp_path: Path) -> None:
    code, errors = run_here("machine", "fit", "campaign.nc", *options, folder=tmp_path)
    assert code == 2
    assert message in errors


def test_the_command(tmp_path: Path) -> None:
    file = tmp_path / "campaign.nc"
    save_response(campaign(), file)
    found = printed("machine", "fit", file, "--three-phase", "380 V")
    (machine,) = found["three_phase"]
    assert machine["resistance"]["value"] == pytest.approx(12.0, rel=0.05)
    assert machine["not_identified"]["loss"].startswith("the rod never ran free")
    shown = "\n".join(three_phase_lines([fit_of(campaign())]))
    assert "line + stator" in shown
    assert "about the straight line in U and P" in shown


SHEET = "file,direction,size [mm],place\n"
MAP = """
[drive_current.1]
column = "I1"
phases = ["I2", "I3"]
kind = "scaled"
[drive_voltage.1]
column = "U1"
phases = ["U2", "U3"]
kind = "scaled"
[drive_power.1]
column = "P"
kind = "scaled"
"""


@pytest.mark.parametrize(
    ("third", "code", "message"),
    [
        (1.0, 0, ""),
        (0.8, 0, "unbalanced phases of drive_current.1: I1 +7 %, I2 +7 %, I3 -14 % of their mean"),
        (0.0, 2, "its phase 'I3' is silent"),
    ],
)
def test_a_folder_of_recordings_at_40_ms(
    third: float, code: int, message: str, tmp_path: Path
) -> None:
    data = campaign(throws=12).isel(drive=0)
    lines = []
    for k, one in enumerate(data.transpose("movement", ...)["movement"]):
        row = data.sel(movement=one)
        u, i, p = (row[f"drive_{w}"].values for w in ("voltage", "current", "power"))
        table = np.stack([row["time"].values + 0.4, u, u, u, i, i, third * i, p], axis=1)
        head = "time [s],U1 [V],U2 [V],U3 [V],I1 [A],I2 [A],I3 [A],P [W]"
        np.savetxt(
            tmp_path / f"{k}.csv", table, delimiter=",", header=head, comments="", fmt="%.3f"
        )
        lines.append(f"{k}.csv,closing,0,none\n")
    (tmp_path / "runs.csv").write_text(SHEET + "".join(lines), encoding="utf-8")
    (tmp_path / "channels.toml").write_text(MAP, encoding="utf-8")
    found, errors = run_here("machine", "fit", ".", "--three-phase", "380 V", folder=tmp_path)
    assert found == code, errors
    assert message in errors
    assert errors.count("unbalanced") == (third == 0.8)


def test_copies_of_a_throw_and_two_machines_in_one_current_are_refused() -> None:
    data = campaign()
    copied = data.isel(movement=[*range(29), 0]).assign_coords(movement=data["movement"])
    with pytest.raises(MeasurementError, match="throw 0 and throw 29 are one recording"):
        fit_of(copied)
    both = data.assign_coords(drive=["1+2"])
    with pytest.raises(MeasurementError, match="the current of two machines"):
        fit_of(both)


def test_milliamperes_are_seen_without_power() -> None:
    with pytest.raises(MeasurementError, match="another unit"):
        fit_of(bad(campaign(), "current", 1e3).drop_vars("drive_power"))


def test_the_slope_with_the_load_needs_no_other_voltages() -> None:
    data = campaign(spread=0.0)
    data["drive_voltage"][:] = 391.0
    found = fit_of(data).per_watt
    slope = np.diff(CIRCUIT.current_at(np.full(2, 391.0), np.array([389.5, 390.5])))[0]
    assert holds(found, slope, within=0.1)


def with_assumed_current(data: xr.Dataset) -> xr.Dataset:
    """Return a campaign with a drive 2 that is no machine: its current alone, in coarse steps."""
    second = xr.full_like(data, np.nan).assign_coords(drive=["2"])
    steps = 0.1 * np.arange(data.sizes["time"]) % 1.2 + 1.5
    second["drive_current"][:] = np.where(data["drive_current"] > 0.0, steps, 0.0)
    return xr.concat([data, second], "drive")


def test_a_drive_that_is_no_machine_is_left_out(tmp_path: Path) -> None:
    """Its movements are alike, which is no reason to refuse the other drive."""
    data = campaign()
    fit, other = fit_three_phase(with_assumed_current(data), rated_voltage=380.0)
    assert repr(fit) == repr(fit_of(data))  # NaN differs from NaN since Python 3.13
    assert (other.drive, other.throws, other.missing) == ("2", 0, ("U", "P"))
    lines = three_phase_lines([fit, other])
    assert [line for line in lines if "drive 2" in line] == [
        "drive 2: only I recorded; nothing to fit"
    ]
    assert len(lines) == len(three_phase_lines([fit])) + 1
    file = tmp_path / "campaign.nc"
    save_response(with_assumed_current(data), file)
    found = printed("machine", "fit", file, "--three-phase", "380 V")["three_phase"][1]
    assert found["verdict"] == "only I recorded; nothing to fit"
    assert set(found["not_identified"].values()) == {"U and P not recorded"}
    assert found["ranges"] == {}


def test_without_a_drive_to_fit_there_is_one_message(tmp_path: Path) -> None:
    data = with_assumed_current(campaign(throws=8))
    data["drive_voltage"][:] = np.nan
    data["drive_power"][:] = np.nan
    data["drive_current"].loc[{"drive": "1"}] = np.nan
    save_response(data, tmp_path / "campaign.nc")
    line = ["machine", "fit", "campaign.nc", "--three-phase", "380 V"]
    code, errors = run_here(*line, folder=tmp_path)
    assert code == 2
    assert errors.count("three-phase fit") == 1
    assert "at least two of drive_voltage, drive_current, drive_power of a drive" in errors
    assert "drive 1 has none, drive 2 has I" in errors
