"""Validations on the default panel of the right switch and of others that must be refused.

    python -m benchmarks.studies.validation_verdicts run --count 8 --out DIR --workers 2
    python -m benchmarks.studies.validation_verdicts report DIR

Index 4 n is the default panel with other friction, stiffnesses and slip levels; 4 n + 1 the same
measured without motor currents, so that forces mark the onsets; 4 n + 2 a switch that is free for
1 m more; 4 n + 3 one without links. Each campaign is written as a data acquisition system leaves
it, built, calibrated as the library's panel on part of its movements, and judged on the others.
Campaign, calibration and validation of an index stay in DIR; a job that was stopped goes on.
"""

import re
import sys
import time
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, command_line
from turnout.calibration.calibrate import calibrate
from turnout.calibration.evaluate import Evaluator
from turnout.calibration.stages import default_plan
from turnout.calibration.validation.acceptance import judge
from turnout.calibration.validation.validate import validate
from turnout.core.errors import TurnoutError
from turnout.figures.validation import plot_comparison, plot_error_map
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.virtual.campaign_files import CHANNELS
from turnout.study.virtual.campaign_plan import CampaignPlan
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.throw.store import open_response, save_response

NAME = "uic60-760-1-15"
LIBRARY = Path(__file__).parents[2] / "src" / "turnout" / "panel" / "library" / f"{NAME}.toml"
PAGE = EVIDENCE / "calibration.md"
KINDS = ("as calibrated", "as calibrated, no currents", "free for 1 m more", "without links")
ACCEPTED = KINDS[:2]
SEED = 20251105
# Of the truth from the library, as a share.
TRUTH = 0.12
PLACES = ("drive 1", "sleeper 3", "sleeper 6", "sleeper 9", "drive 2")
SIZES = (0.008, 0.013, 0.020)
HELD_PLACES = ("sleeper 6", "sleeper 9")
# Repeats in each direction as in the published campaign; from this one on they are held back.
REPEATS, HELD_FREE = 5, 4
MOST = 12


def without_links(text: str) -> str:
    """Return a panel file whose links hold nothing; shapes still follow from their lengths."""
    text, count = re.subn(r'(?ms)(^\[link\].*?^stiffness = )"[^"]*"', r'\1"1 kN/m"', text, count=1)
    assert count == 1
    return text


def longer(text: str) -> str:
    """Return a panel file whose switch rail is free for 1 m more, on two chairs more."""
    for old, new in (
        (r'(\[chair\]\nx = \{ start = "0 m", step = "0.6 m", count = )25', r"\g<1>27"),
        (r'(\[fastening\]\nx = \{ start = )"15 m", step = "0.6 m", count = 6', r'\1"16 m", '
         r'step = "0.6 m", count = 5'),
    ):  # fmt: skip
        text, count = re.subn(old, new, text)
        assert count == 1, old
    return text


def truth_of(kind: str, folder: Path, rng: np.random.Generator) -> LoadedPanel:
    """Return the switch that is measured."""
    change = {"free for 1 m more": longer, "without links": without_links}.get(kind)
    panel = load_panel(NAME)
    if change is not None:
        path = folder / "other.toml"
        path.write_text(change(LIBRARY.read_text(encoding="utf-8")), encoding="utf-8")
        panel = load_panel(path)
    drawn = {
        item.name: item.start * float(np.exp(TRUTH * np.clip(rng.standard_normal(), -1.5, 1.5)))
        for item in default_plan(panel).parameters
    }
    return panel.with_overrides(drawn)


def held_back(dataset: xr.Dataset) -> list[str]:
    """Return the movements that a fit must not see: two places, and the last repeats."""
    names, places = dataset["movement"].values, dataset["place"].values
    free = (places == "none") & (dataset["repeat"].values >= HELD_FREE)
    return [str(name) for name in names[np.isin(places, HELD_PLACES) | free]]


def result_of(index: int) -> Record:
    """Make, calibrate and judge one campaign, in the folder of the job."""
    kind, number = KINDS[index % len(KINDS)], index // len(KINDS)
    folder = job_folder() / f"{index:03d}"
    folder.mkdir(parents=True, exist_ok=True)
    truth = truth_of(kind, folder, np.random.default_rng([SEED, number]))
    plan = CampaignPlan(
        places=PLACES,
        sizes=SIZES,
        at_least=max(SIZES),
        object_free=REPEATS,
        formats=(".csv",),
        seed=SEED + number,
    )
    make_virtual_campaign(truth, folder / "campaign", plan=plan)
    channels = (folder / "campaign" / CHANNELS).read_text(encoding="utf-8")
    if "no currents" in kind:
        channels = re.sub(r"(?ms)^\[drive_current\..*?(?=^\[|\Z)", "", channels)
    (folder / CHANNELS).write_text(channels, encoding="utf-8")
    dataset = build_campaign_dataset(folder / "campaign", channels=folder / CHANNELS).dataset
    assert dataset is not None
    began = time.monotonic()
    panel = load_panel(NAME)
    record: Record = {"index": index, "kind": kind, "movements": dataset.sizes["movement"]}
    try:
        known = calibrate(
            dataset,
            panel,
            plan=default_plan(panel, most=MOST),
            exclude=held_back(dataset),
            folder=folder / "throws",
        ).calibration
        known.save(folder / "calibration.toml")
        with Evaluator(panel, folder=folder / "throws") as evaluator:
            found = validate(dataset, panel, known, evaluator=evaluator)
    except TurnoutError as error:
        return record | {"failure": str(error)}
    save_response(found, folder / "validation.nc")
    verdict = judge(found)
    return record | {
        "failure": "",
        "accepted": verdict.accepted,
        "judged": verdict.judged,
        "used": verdict.used,
        "cover": verdict.cover,
        "text": verdict.text,
        "seconds": time.monotonic() - began,
        "values": {p.name: p.value for p in known.parameters},
        "channels": {
            item.channel: {
                "rms": item.rms,
                "nrmse": item.nrmse,
                "spread": item.spread,
                "spreads": item.spreads,
                "cover": item.cover,
                "errors": {name: list(pair) for name, pair in item.errors.items()},
            }
            for item in verdict.channels
        },
    }


def job_folder() -> Path:
    """Return the folder that the command line names."""
    return Path(sys.argv[sys.argv.index("--out") + 1])


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    good = [record for record in records if not record["failure"]]
    lines = [
        f"{len(records)} campaigns of {2 * REPEATS} movements without an object and up to "
        f"{len(PLACES) * len(SIZES)} with one, seed {SEED}; {len(records) - len(good)} of them not "
        f"calibrated. Panel `{NAME}`; written by "
        "`python -m benchmarks.studies.validation_verdicts report DIR`.",
        "",
        "| measured switch | campaigns | accepted | judged movements | RMS over repeat spread, of "
        "the worst channel | cover of band | NRMSE, of the worst channel |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        own = [record for record in good if record["kind"] == kind]
        if not own:
            continue
        cells = [
            str(len(own)),
            str(sum(record["accepted"] for record in own)),
            _range([record["judged"] for record in own], "{:.0f}"),
            _range([_worst(record, "spreads") for record in own], "{:.1f}"),
            _range([100 * record["cover"] for record in own], "{:.0f}") + " %",
            _range([100 * _worst(record, "nrmse") for record in own], "{:.1f}") + " %",
        ]
        lines.append(f"| {kind} | {' | '.join(cells)} |")
    return lines


def _worst(record: Record, name: str) -> float:
    return max(channel[name] for channel in record["channels"].values())


def _range(values: list[float], form: str) -> str:
    low, high = form.format(min(values)), form.format(max(values))
    return low if low == high else f"{low} to {high}"


def report(records: list[Record]) -> None:
    """Write the table into its page, and draw the first campaign for the guide."""
    put_section(
        PAGE,
        name="verdicts",
        heading="Does a validation distinguish the right switch from another?",
        lines=section(records),
    )
    drawn = open_response(Path(sys.argv[-1]) / "000" / "validation.nc")
    figures = PAGE.parents[1] / "figures"
    plot_comparison(drawn, place="sleeper 6").savefig(figures / "validation_comparison.png", dpi=90)
    plot_error_map(drawn).savefig(figures / "validation_errors.png", dpi=90)


if __name__ == "__main__":
    command_line(result_of, report, count=8)
