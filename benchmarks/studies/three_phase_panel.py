"""Three-phase machines of a virtual campaign, fitted by what its monitoring system stored.

    python -m benchmarks.studies.three_phase_panel

Simulated: Drive 1 of the default panel is the library's `three-phase`. Truth is its steady circuit
at the point of reference. Writes a table into docs/evidence/machines.md; two minutes.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.three_phase_campaigns import NAMES, RATED
from turnout.api.campaign import load_campaign
from turnout.api.machine import fit_three_phase
from turnout.calibration.machine_estimates.current_fit import Estimate
from turnout.calibration.machine_estimates.three_phase import ThreePhaseFit
from turnout.core.scheme import Scheme
from turnout.machine.components import Machine
from turnout.machine.steady import steady_point
from turnout.measurement.chain.monitoring import monitoring_of
from turnout.panel.load import load_panel
from turnout.study.virtual.campaign_plan import CampaignPlan
from turnout.study.virtual.make_campaign import make_virtual_campaign

CAMPAIGNS, REPEATS = 6, 20
MACHINE = "three-phase"
TORQUES = np.linspace(0.0, 1.5, 40)
"""At the clutch, of the steady points between which the truth is taken [N m]."""


def truths(machine: Machine, fit: ThreePhaseFit) -> dict[str, float]:
    """Return current, slopes and resistance of the steady circuit at the fit's reference."""

    def current(voltage: float, power: float) -> float:
        supply = machine.supply.model_copy(update={"voltage": voltage})
        fed = machine.model_copy(update={"supply": supply})
        points = [steady_point(fed, torque=torque) for torque in TORQUES]
        return float(np.interp(power, [p.power for p in points], [p.current for p in points]))

    u, p = fit.voltage, fit.power
    return {
        "current": current(RATED, p),
        "per_volt": (current(u + 2.0, p) - current(u - 2.0, p)) / 4.0,
        "per_watt": (current(u, p + 20.0) - current(u, p - 20.0)) / 40.0,
        "resistance": machine.motor.resistance + machine.supply.line_resistance,
    }


def main() -> None:
    """Throw and fit the campaigns, and write the table."""
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.1.machine": MACHINE})
    system = monitoring_of(rate="switchmonitor")
    rows: dict[str, list[tuple[float, Estimate]]] = {}
    for seed in range(CAMPAIGNS):
        plan = CampaignPlan(
            places=(), object_free=REPEATS, seed=seed, monitoring=system, scheme=Scheme.of("quick")
        )
        with tempfile.TemporaryDirectory() as folder:
            make_virtual_campaign(panel, Path(folder) / "made", plan=plan)
            data = load_campaign(Path(folder) / "made" / "monitoring").dataset.sel(drive=["1"])
        (fit,) = fit_three_phase(data, rated_voltage=RATED)
        for name, truth in truths(panel.machine[MACHINE], fit).items():
            found = getattr(fit, name)
            rows.setdefault(name, []).extend([(truth, found)] * isinstance(found, Estimate))
    lines = [
        f"{CAMPAIGNS} virtual campaigns of {2 * REPEATS} throws of the library's `{MACHINE}`, in "
        "the steps of `switchmonitor`; written by "
        "`python -m benchmarks.studies.three_phase_panel`.",
        "",
        "| quantity | identified | largest error | 95 % interval, ± | intervals that hold it |",
        "|---|--:|--:|--:|--:|",
    ]
    for name, known in rows.items():
        error = max(abs(found.value / truth - 1.0) for truth, found in known)
        width = np.mean([0.5 * (found.high - found.low) / abs(truth) for truth, found in known])
        held = sum(found.low <= truth <= found.high for truth, found in known)
        lines.append(
            f"| {NAMES[name]} | {len(known)} of {CAMPAIGNS} | {100 * error:.1f} % "
            f"| {100 * width:.1f} % | {held} of {len(known)} |"
        )
    put_section(
        EVIDENCE / "machines.md", name="three-phase-panel", heading="Three-phase campaigns",
        lines=lines,
    )  # fmt: skip


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
