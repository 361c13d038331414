"""Share of campaigns in which the right law of a drive is chosen.

    python -m benchmarks.studies.law_rates run --count 50 --out DIR --workers 2
    python -m benchmarks.studies.law_rates report DIR

Index 3 n is a campaign without a defect, 3 n + 1 with a worn clutch on Drive 2 (15 % above its
level, scattering by 5 %), 3 n + 2 with a soft build-up (a lag of 0.25 s after contact). Panel sb1,
9 closing movements, truth and start as in the job on coverage: the truth is solved with half the
mesh, twice the modes, quarter steps and other damping. A campaign is fixed by its index; a job that
was stopped goes on. `report` writes into docs/evidence/calibration.md.
"""

from dataclasses import replace

import numpy as np

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.calibration_coverage import (
    SB1_CASES,
    START,
    TRUTH,
    WINDOW,
    Twin,
    campaign,
    short_sb1,
)
from benchmarks.studies.resumable import Record, command_line
from turnout.calibration.drive_law.candidates import PLAIN, SOFT, WORN
from turnout.calibration.drive_law.compare import compare_laws
from turnout.calibration.evaluate import Evaluator
from turnout.calibration.parameter import Fitted
from turnout.calibration.result import Calibration
from turnout.calibration.stages import default_plan
from turnout.core.scheme import Scheme
from turnout.study.virtual.campaign_plan import CampaignPlan, Defects
from turnout.study.virtual.record_throw import finer_panel, finer_scheme

SEED = 20261123
WANTED = (PLAIN, WORN, SOFT)
DEFECTS = (
    Defects(),
    Defects(slip_excess=0.15, slip_scatter=0.05),
    Defects(build_up_lag=0.25),
)
PAGE = EVIDENCE / "calibration.md"


def near(truth: dict[str, float], rng: np.random.Generator) -> Calibration:
    """Return a calibration as an earlier fit may have left it: a few per cent from the truth."""
    parameters = []
    for name, value in truth.items():
        start = value * float(np.exp(START * rng.uniform(-1.0, 1.0)))
        parameters.append(
            Fitted(
                name=name,
                keys=(name,),
                unit="1" if name.endswith("coefficient") else "SI",
                value=start,
                deviation=START * start,
                lower=0.2 * value,
                upper=5.0 * value,
                interval=(0.9 * start, 1.1 * start),
                start=start,
            )
        )
    covariance = np.diag([item.deviation**2 for item in parameters])
    return Calibration(
        parameters=tuple(parameters),
        covariance=covariance,
        panel="sb1",
        panel_hash="",
        data="twin",
        data_hash="",
        movements=(),
        stages=(),
    )


def result_of(index: int) -> Record:
    """Make one campaign and compare the laws of Drive 2."""
    kind = index % len(WANTED)
    rng = np.random.default_rng([SEED, index])
    panel = short_sb1()
    truth = {
        p.name: p.start * float(np.exp(TRUTH * np.clip(rng.standard_normal(), -1.0, 1.0)))
        for p in default_plan(panel).parameters
    }
    plan = CampaignPlan(places=("drive 1",), window=WINDOW, seed=int(rng.integers(2**31)))
    twin = Twin(
        panel=finer_panel(panel),
        truth=truth,
        plan=replace(plan, defects=DEFECTS[kind]),
        cases=SB1_CASES,
        scheme=replace(finer_scheme(), output_interval=Scheme().output_interval),
    )
    known = near(truth, rng)
    with Evaluator(panel) as evaluator:
        found = compare_laws(campaign(twin), panel, known, drive="2", evaluator=evaluator)
        made = evaluator.made
    return {
        "index": index,
        "kind": WANTED[kind],
        "chosen": found.best.name,
        "schwarz": {item.name: item.schwarz - found.plain.schwarz for item in found.results},
        "samples": found.samples,
        "throws": made,
    }


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    names = list(dict.fromkeys([*WANTED, *(r["chosen"] for r in records)]))
    lines = [
        f"{len(records)} campaigns, seed {SEED}, {len(SB1_CASES)} movements each. Panel `sb1`, "
        "truth of a finer solver; written by `python -m benchmarks.studies.law_rates report DIR`.",
        "",
        f"| truth | campaigns | right | {' | '.join(f'chosen: {name}' for name in names)} | least "
        "gain in BIC over the plain law, of the right one |",
        f"|---|---|---|{'---|' * len(names)}---|",
    ]
    for kind in WANTED:
        own = [record for record in records if record["kind"] == kind]
        chosen = [record["chosen"] for record in own]
        cells = " | ".join(str(chosen.count(name)) for name in names)
        share = 100 * chosen.count(kind) / max(len(own), 1)
        gain = min((-record["schwarz"][kind] for record in own), default=float("nan"))
        text = "" if kind == PLAIN else f"{gain:.0f}"
        lines.append(f"| {kind} | {len(own)} | {share:.0f} % | {cells} | {text} |")
    return lines


def report(records: list[Record]) -> None:
    """Write the table into its page."""
    put_section(PAGE, name="laws", heading="Is the right law chosen?", lines=section(records))


if __name__ == "__main__":
    command_line(result_of, report, count=50)
