"""Machines fitted to currents of virtual campaigns, and how often intervals hold the truth.

    python -m benchmarks.studies.machine_campaigns run --count 200 --out DIR --workers 1
    python -m benchmarks.studies.machine_campaigns report DIR

Each campaign is thrown on the default panel with the machines of the paper's drives, whose supply,
resistance, motor constant, losses, gear and clutch are drawn, recorded as files with the noise of a
measuring chain (clamps: 10 mA, drift, hum, 16 bits; cross-talk between the force channels, drawn
from what the intervals allow for), read back, averaged over 0.1 s and fitted:
four throws in each direction and three objects at each drive, on which its clutch slips. The truth
is the closed form of the machine drawn. A campaign is fixed by its index; a job that was stopped
continues. `report` writes into docs/evidence/machines.md.
"""

import tempfile
from pathlib import Path

import numpy as np
from tests.verification.machine_panels import default_panel

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, command_line
from turnout.api.campaign import load_campaign
from turnout.calibration.comparison import Uncertainty
from turnout.calibration.machine_estimates.current_fit import LoadLine
from turnout.calibration.machine_estimates.machine_fit import MachineFit, fit_machines
from turnout.core.errors import TurnoutError
from turnout.core.scheme import Scheme
from turnout.machine.steady import slip_point, steady_point, torque_for
from turnout.mechanism.drive_machines import fitted_machine
from turnout.panel.load import LoadedPanel
from turnout.study.virtual.campaign_plan import CampaignPlan
from turnout.study.virtual.disturbance import Disturbance, Transducer
from turnout.study.virtual.make_campaign import make_virtual_campaign

SEED = 20261121
CLAMP = Transducer(noise=0.010, drift=0.005, hum=0.02, step=60.0 / 2**16)
SIZES = (0.009, 0.011, 0.013)
# Standard deviations, as shares of the library's values; at most two of them are drawn.
SPREADS = {
    "motor.voltage": 0.05,
    "motor.resistance": 0.05,
    "motor.constant": 0.03,
    "motor.loss_torque": 0.10,
    "stroke.ratio": 0.03,
    "gear.efficiency": 0.03,
    "clutch.torque": 0.05,
}
WITHIN, LEAST, MOST = 0.02, 0.90, 0.98
PAGE = EVIDENCE / "machines.md"


def drawn_panel(rng: np.random.Generator) -> LoadedPanel:
    """Return the default panel with machines of its own."""
    panel = default_panel({"chair.friction_coefficient": float(rng.uniform(0.3, 0.5))})
    changes: dict[str, object] = {}
    for name, machine in panel.machine.items():
        for key, spread in SPREADS.items():
            table, field = key.split(".")
            value = getattr(getattr(machine, table), field)
            drawn = float(np.clip(rng.standard_normal(), -2.0, 2.0))
            changes[f"machine.{name}.{key}"] = value * float(np.exp(spread * drawn))
    return panel.with_overrides(changes)


def fit_of(panel: LoadedPanel, seed: int, cross_talk: float) -> MachineFit:
    """Throw and record a campaign, read it back and fit it."""
    plan = CampaignPlan(
        places=("drive 1", "drive 2"),
        sizes=SIZES,
        at_least=1.0,  # so that a series goes on after a slip
        object_free=4,
        seed=seed,
        disturbance=Disturbance(drive_current=CLAMP, cross_talk=cross_talk),
        scheme=Scheme.of("quick", output_interval=1e-3),
    )
    with tempfile.TemporaryDirectory() as folder:
        make_virtual_campaign(panel, Path(folder) / "campaign", plan=plan)
        return fit_machines(load_campaign(Path(folder) / "campaign").dataset)


def result_of(index: int) -> Record:
    """Make and fit one campaign; return true, fitted and stated values."""
    rng = np.random.default_rng([SEED, index])
    panel, seed = drawn_panel(rng), int(rng.integers(2**31))
    try:
        fit = fit_of(panel, seed, Uncertainty().cross_talk * float(rng.standard_normal()))
    except TurnoutError as error:
        return {"index": index, "failure": str(error), "found": []}
    return {"index": index, "failure": "", "found": list(_found(panel, fit))}


def _found(panel: LoadedPanel, fit: MachineFit) -> list[Record]:
    rows = []
    for item in fit.drives:
        machine, line = fitted_machine(panel, item.drive), item.line
        idle = steady_point(machine, torque=0.0).current
        loaded = steady_point(machine, torque=torque_for(machine, 1e3)).current
        pairs = []
        if isinstance(line, LoadLine):
            pairs.append(("idle current", line.idle, idle))
            pairs.append(("A per kN", line.slope, (loaded - idle) / 1e3))
        if item.slip is not None:
            pairs.append(("slip current", item.slip, slip_point(machine).current))
        rows += [
            {
                "case": f"Drive {item.drive} {item.direction}, {name}",
                "truth": truth,
                "value": estimate.value,
                "low": estimate.low,
                "high": estimate.high,
            }
            for name, estimate, truth in pairs
        ]
    return rows


def counted(records: list[Record]) -> dict[str, tuple[int, int, float, float, float]]:
    """Return by case: intervals that hold the truth, intervals, and three errors as shares.

    These are the largest error, the mean error, and the mean half width of the intervals.
    """
    found: dict[str, list[Record]] = {}
    for record in records:
        for row in record["found"]:
            found.setdefault(row["case"], []).append(row)
    counts = {}
    for case, rows in found.items():
        held = sum(row["low"] <= row["truth"] <= row["high"] for row in rows)
        error = np.array([row["value"] / row["truth"] - 1.0 for row in rows])
        width = np.mean([0.5 * (row["high"] - row["low"]) / row["truth"] for row in rows])
        worst = float(np.abs(error).max())
        counts[case] = (held, len(rows), worst, float(error.mean()), float(width))
    return counts


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    failed = sum(bool(record["failure"]) for record in records)
    lines = [
        f"{len(records)} virtual campaigns, {failed} of them not fitted; written by "
        "`python -m benchmarks.studies.machine_campaigns report DIR`.",
        "",
        "| | largest error | mean error | 95 % interval, ± | intervals that hold the truth |",
        "|---|--:|--:|--:|--:|",
    ]
    for case, (held, count, worst, mean, width) in counted(records).items():
        lines.append(
            f"| {case} | {100 * worst:.2f} % | {100 * mean:+.2f} % | {100 * width:.2f} % | "
            f"{held} of {count}, {100 * held / count:.1f} % |"
        )
    return lines


def report(records: list[Record]) -> None:
    """Write the table into its page."""
    put_section(PAGE, name="campaigns", heading="Currents of campaigns", lines=section(records))


if __name__ == "__main__":
    command_line(result_of, report, count=200)
