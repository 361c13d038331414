"""Three-phase machines fitted to virtual campaigns with hidden values.

    python -m benchmarks.studies.three_phase_campaigns run --count 40 --out DIR --workers 1
    python -m benchmarks.studies.three_phase_campaigns report DIR

Each campaign has 120 throws of a motor that is no Gamma circuit with a power law: a T circuit with
leakage on both sides, a main branch i = a psi + b psi^m, iron loss, in every other campaign a
rotor of deep bars and a loss that grows with the square of the speed. Line, stator, rotor, leakage,
saturation, load, supply voltage, frequency and the temperature of the copper are drawn, the last
five anew for each throw. The run-up is integrated. A recorder takes 25 samples a second, by
campaigns in turn in steps of 19.6 W and 0.039 A and of 0.1 W and 1 mA, 0.1 V always. Truth is the
circuit itself at the point of reference. A campaign is fixed by its index; a job that was stopped
continues. `report` writes into docs/evidence/machines.md.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, command_line
from turnout.calibration.machine_estimates.current_fit import Estimate
from turnout.calibration.machine_estimates.three_phase import ThreePhaseFit, fit_three_phase
from turnout.core.errors import TurnoutError

Floats = NDArray[np.float64]
SEED = 20261202
THROWS, FREE = 120, 8
RATED, SUPPLY = 380.0, 391.0
RATE, STEP = 25.0, 1e-3
COARSE, FINE = (19.6, 0.039), (0.1, 0.001)
ALPHA = 3.9e-3
FINE_SLIP, COARSE_SLIP, BETWEEN = 5e-4, 0.02, 0.12
SLIPS = np.concatenate([np.arange(0.0, BETWEEN, FINE_SLIP), np.arange(BETWEEN, 1.001, COARSE_SLIP)])
PAGE = EVIDENCE / "machines.md"


@dataclass(frozen=True, slots=True, kw_only=True)
class TMotor:
    """A motor and its line by their T circuit, phase values in ohm at 50 Hz.

    The main branch takes i = i_0 ((1 - share) v + share v^power) with v = E_m/(u_0 f/50).
    """

    line: float
    stator: float
    rotor: float
    leakage: tuple[float, float]
    magnetising: float
    share: float
    exponent: float
    iron: float
    deep: float
    drag: float
    inertia: float

    def points(
        self, voltage: float, frequency: float, copper: float
    ) -> tuple[Floats, Floats, Floats]:
        """Return current [A], power [W] and torque [N m] at each of `SLIPS`."""
        per = frequency / 50.0
        u, base = voltage / math.sqrt(3.0), SUPPLY / math.sqrt(3.0) * per
        slips = np.maximum(SLIPS, 1e-9)
        bars = np.sqrt(slips * per)
        rotor = self.rotor * copper * (1.0 + self.deep * bars)
        x_2 = self.leakage[1] * per / (1.0 + 0.5 * self.deep * bars)
        rest = 1.0 / (rotor / slips + 1j * x_2) + 1.0 / self.iron
        front = self.line + self.stator * copper + 1j * self.leakage[0] * per
        low, high = np.zeros(slips.size), np.full(slips.size, 1.3 * u)
        for _ in range(45):
            e = 0.5 * (low + high)
            whole = rest - 1j * self.main(e / base) / e
            above = np.abs(1.0 + front * whole) * e > u
            low, high = np.where(above, low, e), np.where(above, e, high)
        current = np.abs(whole) * e
        gap = 3.0 * e**2 * (1.0 / (rotor / slips + 1j * x_2)).real
        power = 3.0 * e**2 * whole.real + 3.0 * front.real * current**2
        return current, power, gap / (math.pi * frequency)  # two pole pairs

    def main(self, v: Floats) -> Floats:
        """Return the magnetising current [A]."""
        return np.asarray(
            self.magnetising * ((1.0 - self.share) * v + self.share * v**self.exponent)
        )

    def current_at(self, voltage: float, power: float, copper: float) -> float:
        """Return the running current at a power [A]."""
        current, powers, _ = self.points(voltage, 50.0, copper)
        rising = slice(0, int(powers.argmax()) + 1)
        return float(np.interp(power, powers[rising], current[rising]))


def drawn_motor(rng: np.random.Generator, *, deep: bool) -> TMotor:
    """Return a motor of the 0.4 kW class that takes 2.3 to 2.5 A at 391 V."""
    motor = TMotor(
        line=rng.uniform(3.0, 8.0),
        stator=rng.uniform(6.0, 9.0),
        rotor=rng.uniform(7.0, 11.0),
        leakage=(rng.uniform(5.0, 9.0), rng.uniform(5.0, 9.0)),
        magnetising=2.4,
        share=rng.uniform(0.5, 0.8),
        exponent=rng.uniform(6.0, 9.0),
        iron=rng.uniform(3e3, 6e3),
        deep=rng.uniform(0.3, 0.8) if deep else 0.0,
        drag=rng.uniform(1e-4, 3e-4) * (1.0 / 150.0 if deep else 1.0),
        inertia=rng.uniform(2e-3, 15e-3),
    )
    wanted = rng.uniform(2.3, 2.5)
    low, high = 1.0, 12.0
    for _ in range(50):
        motor = replace(motor, magnetising=0.5 * (low + high))
        current = motor.points(SUPPLY, 50.0, 1.0)[0][40]
        low, high = (low, motor.magnetising) if current > wanted else (motor.magnetising, high)
    return motor


def loss_torque(motor: TMotor, speed: Floats | float, *, deep: bool) -> Floats | float:
    """Return drag and fan [N m]."""
    return 0.12 + motor.drag * (speed**2 if deep else speed)


def throw_of(
    motor: TMotor, rng: np.random.Generator, *, deep: bool, free: bool, copper: float
) -> tuple[Floats, Floats, Floats, float]:
    """Return voltage, current and power of one throw as a recorder's windows have them.

    The last value is the mean power behind line and stator resistance while it runs.
    """
    count = round(6.4 / STEP)
    voltage, frequency = SUPPLY + rng.normal(0.0, 4.0), 50.0 + rng.normal(0.0, 0.02)
    current, power, torque = motor.points(voltage, frequency, copper)
    time = np.arange(count) * STEP
    place = np.clip((time - 0.4) / 4.6, 0.0, 1.0)
    mean = 0.12 if free else rng.uniform(0.55, 0.85)
    bumps = rng.uniform(0.1, 0.5) * np.exp(-(((place - 0.08) / 0.06) ** 2))
    bumps += rng.uniform(0.2, 0.8) * np.clip((place - 0.75) / 0.25, 0.0, 1.0)
    bumps += rng.uniform(0.05, 0.2) * np.sin(
        2 * np.pi * (place * rng.uniform(1, 3) + rng.uniform())
    )
    rough = np.repeat(rng.normal(0.0, 0.03, count // 40 + 1), 40)[:count]
    load = mean * (1.0 + (0.0 if free else 1.0) * (bumps + rough))
    w_0 = math.pi * frequency
    fine = round(BETWEEN / FINE_SLIP)
    speed, slips = 0.0, np.empty(count)
    grid, drive = SLIPS.tolist(), torque.tolist()
    begin = round(rng.uniform(0.2, 0.24) / STEP)
    turned, last = 0.0, count
    for k in range(count):
        if k < begin:
            slips[k] = 1.0
            continue
        s = 1.0 - speed / w_0
        slips[k] = s
        if s < BETWEEN:
            at = int(s / FINE_SLIP)
        else:
            at = min(fine + int((s - BETWEEN) / COARSE_SLIP), SLIPS.size - 2)
        part = (s - grid[at]) / (grid[at + 1] - grid[at])
        t = drive[at] + part * (drive[at + 1] - drive[at])
        need = load[k] + float(loss_torque(motor, speed, deep=deep))
        speed = max(speed + STEP * (t - need) / motor.inertia, 0.0)
        turned += STEP * speed
        if turned > 4.9 * 150.0:
            last = k
            break
    on = np.zeros(count, dtype=bool)
    on[begin:last] = True
    i, p = (np.where(on, np.interp(slips, SLIPS, v), 0.0) for v in (current, power))
    width = round(1.0 / RATE / STEP)
    windows = count // width
    i, p, on_share = (v[: windows * width].reshape(windows, width) for v in (i, p, on))
    i, p = np.sqrt(np.mean(i**2, axis=1)), p.mean(axis=1)
    steady = on_share.all(axis=1) & (np.arange(windows) > 20)
    r = motor.line + motor.stator * copper
    inside = float(np.mean(p[steady] - 3.0 * r * i[steady] ** 2))
    u = voltage + rng.normal(0.0, 0.2, windows)
    i = i * (1.0 + rng.normal(0.0, 1e-3, windows))
    p = p + np.where(p > 0.0, rng.normal(0.0, 3.0, windows), 0.0)
    return u, i, p, inside


def campaign_of(
    motor: TMotor, rng: np.random.Generator, *, deep: bool, steps: tuple[float, float]
) -> tuple[xr.Dataset, float, float]:
    """Return a campaign of one machine, mean copper factor and loss with the rod off [W]."""
    rows: dict[str, list[Floats]] = {"drive_voltage": [], "drive_current": [], "drive_power": []}
    names, coppers, losses = [], [], []
    for number in range(THROWS):
        free = number < FREE
        copper = 1.0 + ALPHA * (rng.normal(0.0, 12.0) + rng.uniform(0.0, 15.0))
        u, i, p, inside = throw_of(motor, rng, deep=deep, free=free, copper=copper)
        rows["drive_voltage"].append(np.round(u / 0.1) * 0.1)
        rows["drive_current"].append(np.round(i / steps[1]) * steps[1])
        rows["drive_power"].append(np.round(p / steps[0]) * steps[0])
        names.append(f"{'free' if free else 'throw'}-{number:03d}")
        coppers.append(copper)
        losses += [inside] if free else []
    time = np.arange(len(rows["drive_voltage"][0])) / RATE
    data = {
        name: (("movement", "drive", "time"), np.stack(values)[:, None])
        for name, values in rows.items()
    }
    dataset = xr.Dataset(data, {"movement": names, "drive": ["1"], "time": time})
    return dataset, float(np.mean(coppers)), float(np.mean(losses))


def truths(motor: TMotor, fit: ThreePhaseFit, copper: float, loss: float) -> dict[str, float]:
    """Return what the circuit itself has at the fit's point of reference."""
    u, p = fit.voltage, fit.power

    def current(du: float = 0.0, dp: float = 0.0) -> float:
        return motor.current_at(u + du, p + dp, copper)

    return {
        "current": motor.current_at(RATED, p, copper),
        "per_volt": (current(du=2.0) - current(du=-2.0)) / 4.0,
        "per_watt": (current(dp=20.0) - current(dp=-20.0)) / 40.0,
        "resistance": motor.line + motor.stator * copper,
        "loss": loss,
    }


def result_of(index: int) -> Record:
    """Make and fit one campaign; return true, fitted and stated values."""
    rng = np.random.default_rng([SEED, index])
    deep, steps = index % 2 == 1, (COARSE, FINE)[index // 2 % 2]
    motor = drawn_motor(rng, deep=deep)
    dataset, copper, loss = campaign_of(motor, rng, deep=deep, steps=steps)
    free = [str(name) for name in dataset["movement"].values if str(name).startswith("free")]
    record: Record = {"index": index, "steps": "fine" if steps == FINE else "real", "failure": ""}
    try:
        (fit,) = fit_three_phase(dataset, rated_voltage=RATED, free=free)
    except TurnoutError as error:
        return {**record, "failure": str(error), "found": []}
    found = []
    for name, truth in truths(motor, fit, copper, loss).items():
        value = getattr(fit, name)
        row: Record = {"case": name, "truth": truth}
        if isinstance(value, Estimate):
            row |= {"value": value.value, "low": value.low, "high": value.high}
        found.append(row)
    more = {"left": fit.left, "starts": fit.starts, "power": fit.power}
    more["leakage"] = [fit.leakage.value if fit.leakage else None, sum(motor.leakage)]
    return {**record, **more, "found": found}


NAMES = {
    "current": "current at 380 V",
    "per_volt": "slope with the voltage",
    "per_watt": "slope with the power",
    "resistance": "R of line and stator",
    "loss": "iron and mechanical loss",
}


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    failed = sum(bool(record["failure"]) for record in records)
    lines = [
        f"{len(records)} virtual three-phase campaigns of {THROWS} throws at {RATE:g} Hz, {failed} "
        "of them not fitted; written by "
        "`python -m benchmarks.studies.three_phase_campaigns report DIR`.",
        "",
        "| quantity, steps of the recorder | identified | largest error | mean error "
        "| 95 % interval, ± | intervals that hold the truth |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    held_all = count_all = 0
    for steps, text in (("real", "19.6 W, 0.039 A"), ("fine", "0.1 W, 1 mA")):
        own = [record for record in records if record["steps"] == steps and record["found"]]
        for case, name in NAMES.items():
            rows = [row for record in own for row in record["found"] if row["case"] == case]
            known = [row for row in rows if "value" in row]
            if not known:
                lines.append(f"| {name}, {text} | 0 of {len(rows)} | | | | |")
                continue
            error = np.array([row["value"] / row["truth"] - 1.0 for row in known])
            width = np.mean([0.5 * (row["high"] - row["low"]) / abs(row["truth"]) for row in known])
            held = sum(row["low"] <= row["truth"] <= row["high"] for row in known)
            held_all, count_all = held_all + held, count_all + len(known)
            largest = 100 * np.abs(error).max()
            lines.append(
                f"| {name}, {text} | {len(known)} of {len(rows)} | {largest:.1f} % | "
                f"{100 * error.mean():+.1f} % | {100 * width:.1f} % | {held} of {len(known)} |"
            )
    share = 100.0 * held_all / max(count_all, 1)
    return [*lines, "", f"All intervals: {held_all} of {count_all} hold the truth, {share:.1f} %."]


def report(records: list[Record]) -> None:
    """Write the table into its page."""
    heading = "Three-phase campaigns"
    put_section(PAGE, name="three-phase", heading=heading, lines=section(records))


if __name__ == "__main__":
    command_line(result_of, report, count=40)
