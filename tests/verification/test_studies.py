"""Results of `benchmarks.studies` with small counts; with -m long those of whole jobs.

Reference: the truth that a campaign, a machine or a scenario was made with. Tolerances beside the
assertions. The tables of the documentation come from the same functions with larger counts.
"""

import json
import os
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from benchmarks.page import put_section
from benchmarks.studies import (
    assumptions,
    calibration_coverage,
    finer_twin,
    machine_campaigns,
    other_machine,
    pod_coverage,
    robustness,
    validation_verdicts,
)
from benchmarks.studies.resumable import RESULTS, Record, read_records, run_missing

ROOT = Path(__file__).parents[2]


def coverage_records() -> list[Record]:
    """Return campaigns of which two of four intervals hold the truth, and one that failed."""
    return [
        {
            "index": n,
            "failure": "",
            "truth": {"a": 1.0},
            "values": {"a": 1.0 + error},
            "deviations": {"a": 0.1},
            "intervals": {"a": [1.0 + error - 0.2, 1.0 + error + 0.2]},
            "states": {"a": "fitted"},
        }
        for n, error in enumerate((0.1, -0.1, 0.3, -0.3))
    ] + [{"index": 4, "truth": {"a": 1.0}, "failure": "no throw"}]


def verdict_records() -> list[Record]:
    """Return validations of four kinds of switches, of which the first two are accepted."""
    channel = {"rms": 30.0, "nrmse": 0.01, "spread": 10.0, "cover": 0.9}
    kinds = validation_verdicts.KINDS
    return [
        {
            "index": n,
            "kind": kinds[n % len(kinds)],
            "failure": "",
            "accepted": n % 4 < 2,
            "judged": 8,
            "used": 12,
            "cover": 0.93,
            "channels": {
                "drive 1": channel | {"spreads": 1.0 + n},
                "drive 2": channel | {"spreads": 0.5},
            },
        }
        for n in range(8)
    ]


def machine_records() -> list[Record]:
    """Return two fits, of which one interval holds the truth."""
    return [
        {
            "index": n,
            "failure": "",
            "found": [{"case": "a", "truth": 2.0, "value": v, "low": v - 0.1, "high": v + 0.1}],
        }
        for n, v in enumerate((2.05, 2.2))
    ]


def scenario_records() -> list[Record]:
    """Return two complete runs, and one that only finer steps complete."""
    sound = [robustness.result_of(index) for index in (0, 1)]
    early = {"index": 7, "complete": False, "outcome": "NOT_CONVERGED", "fine": "COMPLETE"}
    return [*sound, sound[0] | early | {"message": "not converged at t = 1 s"}]


def scenario_lines(records: list[Record]) -> list[str]:
    """Return the page on random scenarios."""
    job = {"machine": "a machine", "workers": 2, "seed": 1, "kernels": "k"}
    return robustness.page(records, job).splitlines()


@pytest.mark.parametrize(
    ("records", "lines", "wanted"),
    [
        (
            coverage_records,
            calibration_coverage.section,
            ["| `a` | 2 | 4 | 50.0 ± 25.0 % | 2.24 | 50.0 % |"],
        ),
        (
            verdict_records,
            validation_verdicts.section,
            [
                "| as calibrated | 2 | 2 | 8 | 1.0 to 5.0 | 93 % | 1.0 % |",
                "| without links | 2 | 0 | 8 | 4.0 to 8.0 | 93 % | 1.0 % |",
            ],
        ),
        (
            machine_records,
            machine_campaigns.section,
            ["| a | 10.00 % | +6.25 % | 5.00 % | 1 of 2, 50.0 % |"],
        ),
        (
            scenario_records,
            scenario_lines,
            ["| runs | 3 |", "| stopped early | 1 (33.33 %; allowed 1 %) |", "| defects | 1 |"],
        ),
    ],
    ids=["coverage", "verdicts", "machines", "scenarios"],
)
def test_a_report_counts_what_is_recorded(
    records: Callable[[], list[Record]],
    lines: Callable[[list[Record]], list[str]],
    wanted: list[str],
) -> None:
    assert set(wanted) <= set(lines(records()))


def test_a_job_that_was_stopped_continues_and_its_section_is_replaced(tmp_path: Path) -> None:
    asked: list[list[int]] = []

    def make(missing: list[int]):
        asked.append(missing)
        return islice(({"index": n} for n in reversed(missing)), 2)

    assert [item["index"] for item in run_missing(make, 3, folder=tmp_path)] == [1, 2]
    with (tmp_path / RESULTS).open("ab") as file:
        file.write(b'{"index": 0, "ki')  # torn by a kill
    assert [item["index"] for item in read_records(tmp_path)] == [1, 2]
    assert [item["index"] for item in run_missing(make, 4, folder=tmp_path)] == [0, 1, 2, 3]
    assert asked == [[0, 1, 2], [0, 3]]
    lines = (tmp_path / RESULTS).read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["index"] for line in lines] == [2, 1, 3, 0]
    page = tmp_path / "page.md"
    page.write_text("# Title\n\nText.\n", encoding="utf-8")
    for text in ("one", "two"):
        put_section(page, name="x", heading="Heading", lines=[text])
    marked = "<!-- x -->\ntwo\n<!-- end of x -->"
    assert page.read_text(encoding="utf-8") == f"# Title\n\nText.\n\n## Heading\n\n{marked}\n"


def test_rows_of_an_older_version_are_thrown_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second, third = assumptions.cases()[:3]
    whole = dict.fromkeys(assumptions.KEYS, 1)
    older = {key: value for key, value in whole.items() if key not in ("facts", "missed")}
    (tmp_path / assumptions.KEPT).write_text(json.dumps({first.name: whole, second.name: older}))
    thrown = []

    def figures(_: object, case: assumptions.Case, *__: object) -> dict[str, int]:
        thrown.append(case.name)
        return dict.fromkeys(assumptions.KEYS, 2)

    monkeypatch.setattr(assumptions, "cases", lambda: [first, second, third])
    monkeypatch.setattr(assumptions, "figures", figures)
    found = assumptions.all_figures(tmp_path)
    assert thrown == [second.name, third.name]
    assert found == json.loads((tmp_path / assumptions.KEPT).read_text())
    assert [found[case.name]["facts"] for case in (first, second, third)] == [1, 2, 2]


@pytest.mark.long
def test_machines_of_a_virtual_campaign_within_two_per_cent() -> None:
    """Reference: closed form of the machines drawn; tolerance 2 %, as the long job's."""
    record = machine_campaigns.result_of(5)  # Drive 2's clutch slips while it opens
    assert not record["failure"]
    assert len(record["found"]) == 10
    for row in record["found"]:
        assert row["value"] == pytest.approx(row["truth"], rel=machine_campaigns.WITHIN), row[
            "case"
        ]
    held = sum(row["low"] <= row["truth"] <= row["high"] for row in record["found"])
    assert held >= 8


def test_a90_95_of_some_campaigns_holds_and_naive_pooling_is_below() -> None:
    records = [pod_coverage.result_of(index) for index in range(6)]
    medians = {
        name: np.median([record[name] for record in records if record[name] is not None])
        for name in ("calibrated", "profile", "pooled")
    }
    assert medians["pooled"] < medians["profile"] < medians["calibrated"]
    # half a percent of sets of 6 at 94 % hold fewer
    assert pod_coverage.covered(records, "calibrated") >= 4 / 6
    assert len(pod_coverage.section(records)) == 6


@pytest.mark.long
@pytest.mark.parametrize("kind", pod_coverage.KINDS)
def test_a90_95_covers_93_to_97_per_cent(kind: str) -> None:
    """Of 1,000 campaigns, 12 minutes."""
    first = pod_coverage.KINDS.index(kind)
    records = [pod_coverage.result_of(index) for index in range(first, 1000, 2)]
    assert pod_coverage.LEAST <= pod_coverage.covered(records, "calibrated") <= pod_coverage.MOST
    assert pod_coverage.covered(records, "pooled") < 0.91


@pytest.mark.long
@pytest.mark.usefixtures("worker_processes")
def test_two_thousand_scenarios() -> None:
    """At most 1 % stop early, none without a reason, none that 0.1 ms would have saved."""
    count, chosen = 2000, os.environ.get("TURNOUT_ROBUSTNESS_DIR")
    folder = Path(chosen) if chosen else ROOT / "build" / "robustness"
    results = robustness.run_job(count, folder=folder, workers=os.cpu_count() or 1)
    assert len(results) == count
    defects = [record for record in results if robustness.is_defect(record)]
    assert not defects, "\n".join(str(record) for record in defects[:20])
    assert sum(not record["complete"] for record in results) <= 0.01 * count


@pytest.mark.long
@pytest.mark.skipif(
    not other_machine.playable(), reason="old instructions are played on x86 processors only"
)
def test_another_machine_answers_within_the_stated_tolerance() -> None:
    found = other_machine.differences()
    assert len(found) > 20
    assert {n: share for n, share in found.items() if share > other_machine.TOLERANCE} == {}
    assert max(found.values()) > 0.0  # another machine was played


@pytest.mark.long
@pytest.mark.parametrize("index", range(4), ids=validation_verdicts.KINDS)
def test_the_right_switch_is_accepted_and_others_are_refused(
    index: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["validation_verdicts", "run", "--out", str(tmp_path)])
    record = validation_verdicts.result_of(index)
    assert record["failure"] == ""
    accepted = record["kind"] in validation_verdicts.ACCEPTED
    assert record["accepted"] == accepted, record["text"]


@pytest.mark.long
def test_a_finer_twin_is_found_from_two_starts_within_one_per_cent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["finer_twin", "run", "--out", str(tmp_path)])
    records = [finer_twin.result_of(index) for index in range(len(finer_twin.STARTS))]
    for record in records:
        assert max(map(abs, record["errors"].values())) < finer_twin.LIMIT, record["errors"]
    assert "| `drive.2.stiffness` | 690000 |" in "\n".join(finer_twin.section(records))
