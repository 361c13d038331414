"""Share of campaigns whose a90/95 lies above the true a90: 93 to 97 % is wanted.

    python -m benchmarks.studies.pod_coverage run --count 2000 --out DIR --workers 1
    python -m benchmarks.studies.pod_coverage report DIR

Even numbers are campaigns of responses with a floor and slip, odd ones of hits and misses. Each
has 6 switches with 10 sizes; the spread between switches is 0.8 of that between throws. The truth
is the size that 90 % of all switches and throws detect. A campaign is fixed by its number; a job
that was stopped continues. `report` writes into docs/evidence/blind-zones.md.
"""

from dataclasses import replace

import numpy as np

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, command_line
from turnout.detection.pod.pod_bound import confidence_bound, upper_bound
from turnout.detection.pod.pod_fit import detected_size, draw_campaigns, maximise
from turnout.detection.pod.pod_likelihood import Campaigns

SEED = 20261122
SWITCHES, SIZES, SPREAD = 6, 10, 0.8
DRAWN = 150
KINDS = ("responses", "hits and misses")
LEAST, MOST = 0.93, 0.97
PAGE = EVIDENCE / "blind-zones.md"


def design(kind: str) -> tuple[Campaigns, np.ndarray, float]:
    """Return the design of a campaign, the true parameters and the true a90."""
    count, binary = SWITCHES * SIZES, kind != "responses"
    campaigns = Campaigns(
        x=np.tile(np.linspace(-1.0, 1.0, SIZES), SWITCHES),
        switch=np.repeat(np.arange(SWITCHES), SIZES),
        y=np.zeros((1, count)),
        side=np.ones((1, count), dtype=np.int8),
        binary=binary,
        least=-np.inf if binary else -1.0,
        most=np.inf if binary else 1.5,
    )
    truth = np.array([0.3, 3.0, SPREAD, 1.0 if binary else 2.0])
    return campaigns, truth, float(detected_size(truth[np.newaxis], campaigns, 0.9)[0])


def result_of(index: int) -> Record:
    """Draw and evaluate one campaign: bounds of three methods."""
    kind = KINDS[index % 2]
    campaigns, truth, size = design(kind)
    drawn = draw_campaigns(campaigns, truth, 1, np.random.default_rng([SEED, index]))
    best = maximise(drawn)
    bound, plain, limit = confidence_bound(drawn, best, drawn=DRAWN, seed=index)
    pooled = replace(drawn, grouped=False)
    naive, _ = upper_bound(pooled, maximise(pooled), probability=0.9, limit=-1.6448536)
    values = {"calibrated": bound, "profile": plain, "pooled": naive}
    return {
        "index": index,
        "kind": kind,
        "truth": size,
        "limit": limit,
        **{name: value if np.isfinite(value) else None for name, value in values.items()},
    }


def covered(records: list[Record], name: str) -> float:
    """Return the share of bounds that are not below the truth; no bound at all counts as above."""
    return float(np.mean([r[name] is None or r[name] >= r["truth"] for r in records]))


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    lines = [
        f"{len(records)} simulated campaigns, seed {SEED}, of {SWITCHES} switches with {SIZES} "
        f"throws each; spread between switches {SPREAD} of that between throws. Written by "
        "`python -m benchmarks.studies.pod_coverage report DIR`.",
        "",
        "| campaigns | number | a90/95 (calibrated) | plain profile likelihood | naive pooling |",
        "|---|---|---|---|---|",
    ]
    for kind in KINDS:
        own = [record for record in records if record["kind"] == kind]
        cells = []
        for name in ("calibrated", "profile", "pooled"):
            share = covered(own, name)
            error = np.sqrt(share * (1.0 - share) / max(len(own), 1))
            cells.append(f"{100 * share:.1f} ± {100 * error:.1f} %")
        lines.append(f"| {kind} | {len(own)} | {' | '.join(cells)} |")
    return lines


def report(records: list[Record]) -> None:
    """Write the table into its page."""
    put_section(PAGE, name="coverage", heading="Does a90/95 hold?", lines=section(records))


if __name__ == "__main__":
    command_line(result_of, report, count=2000)
