"""Calibration from two starts to a truth that another solver setting made.

    python -m benchmarks.studies.finer_twin run --out DIR --workers 2
    python -m benchmarks.studies.finer_twin report DIR

Ten movements of the default panel, whose truth has elements half as long, modes to twice the
frequency, steps of a quarter and other numerical damping (`turnout campaign virtual --finer`), with
noise, drift, hum, cross-talk and friction that scatters by 2 % from throw to throw, written and
built as a measured campaign. Index 0 starts from the library's values, 1 far from them. Each value
must come within 1 %. `report` writes into docs/evidence/calibration.md.
"""

import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, command_line
from turnout.calibration.calibrate import calibrate
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.virtual.campaign_plan import CampaignPlan
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.study.virtual.record_throw import finer_panel, finer_scheme

NAME = "uic60-760-1-15"
PAGE = EVIDENCE / "calibration.md"
SEED = 20251106
LIMIT = 0.01
TRUTH = {
    "chair.friction_coefficient": 0.33,
    "drive.1.stiffness": 860e3,
    "drive.1.saturation_force": 6.5e3,
    "drive.2.stiffness": 690e3,
    "drive.2.saturation_force": 5.6e3,
}
STARTS: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("the library's values", {}),
    (
        "friction 0.5, stiffnesses 400 and 1200 kN/m, slip levels 7.5 kN",
        {
            "chair.friction_coefficient": 0.5,
            "drive.1.stiffness": 400e3,
            "drive.1.saturation_force": 7.5e3,
            "drive.2.stiffness": 1200e3,
            "drive.2.saturation_force": 7.5e3,
        },
    ),
)
PLAN = CampaignPlan(
    places=("drive 1", "sleeper 3", "sleeper 6", "sleeper 9", "drive 2", "sleeper 11"),
    sizes=(0.013,),
    object_free=2,
    formats=(".csv",),
    seed=SEED,
    scheme=finer_scheme(),
)


def true_values(truth: LoadedPanel, names: Iterable[str]) -> dict[str, float]:
    """Return the values of a panel that a fit gives, by their names; one that many have is one."""
    return {name: next(iter(truth.values_at(name).values())) for name in names}


def result_of(index: int) -> Record:
    """Make the campaign and calibrate to it from one start."""
    folder = Path(sys.argv[sys.argv.index("--out") + 1]) / f"start-{index}"
    folder.mkdir(parents=True, exist_ok=True)
    truth = finer_panel(load_panel(NAME).with_overrides(TRUTH))
    make_virtual_campaign(truth, folder / "campaign", plan=PLAN)
    dataset = build_campaign_dataset(folder / "campaign", strict=True).dataset
    assert dataset is not None
    name, start = STARTS[index]
    panel = load_panel(NAME).with_overrides(dict(start))
    began = time.monotonic()
    found = calibrate(dataset, panel, folder=folder / "throws").calibration
    found.save(folder / "calibration.toml")
    true = true_values(truth, [*TRUTH, *found.values])
    return {
        "index": index,
        "start": name,
        "movements": dataset.sizes["movement"],
        "throws": sum(stage.evaluations for stage in found.stages),
        "seconds": time.monotonic() - began,
        "truth": true,
        "errors": {key: found.values[key] / value - 1.0 for key, value in true.items()},
        "within": {
            item.name: item.interval[0] <= true[item.name] <= item.interval[1]
            for item in found.parameters
        },
        "warnings": list(found.warnings),
    }


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    lines = [
        f"{records[0]['movements']} movements of `{NAME}`, seed {SEED}, truth with half the mesh, "
        "quarter steps, twice the modes and other damping; within "
        f"{100 * LIMIT:g} % is wanted. Written by `python -m benchmarks.studies.finer_twin "
        "report DIR`.",
        "",
        "| parameter | truth | " + " | ".join(f"from {r['start']}" for r in records) + " |",
        "|---|---|" + "---|" * len(records),
    ]
    for key, value in records[0]["truth"].items():
        cells = [
            f"{100 * r['errors'][key]:+.2f} %{'' if r['within'][key] else ', out of its interval'}"
            for r in records
        ]
        lines.append(f"| `{key}` | {value:g} | {' | '.join(cells)} |")
    return lines


def report(records: list[Record]) -> None:
    """Write the table into its page."""
    put_section(
        PAGE,
        name="finer",
        heading="Is the truth of a finer solver found from two starts?",
        lines=section(records),
    )


if __name__ == "__main__":
    command_line(result_of, report, count=len(STARTS))
