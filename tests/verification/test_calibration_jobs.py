"""What the long jobs on coverage and drive laws count and write; the jobs themselves take hours."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.studies.calibration_coverage import coverage
from benchmarks.studies.calibration_coverage import section as coverage_section
from benchmarks.studies.law_rates import WANTED, near
from benchmarks.studies.law_rates import section as law_section
from benchmarks.studies.resumable import RESULTS, Record, put_section, read_records


def record(index: int, error: float) -> Record:
    return {
        "index": index,
        "failure": "",
        "truth": {"a": 1.0},
        "values": {"a": 1.0 + error},
        "deviations": {"a": 0.1},
        "intervals": {"a": [1.0 + error - 0.2, 1.0 + error + 0.2]},
        "states": {"a": "fitted"},
    }


def test_intervals_that_hold_the_truth_are_counted() -> None:
    records = [record(n, error) for n, error in enumerate((0.1, -0.1, 0.3, -0.3))]
    held, count, spread, bare = coverage(records)["a"]
    assert (held, count, bare) == (2, 4, 0.5)
    assert spread == pytest.approx(np.sqrt(5.0))
    assert "| `a` | 2 | 4 | 50.0 ± 25.0 % | 2.24 | 50.0 % |" in coverage_section(records)
    failed = {"index": 4, "truth": {"a": 1.0}, "failure": "no throw"}
    assert coverage([*records, failed])["a"][1] == 4


def test_choices_are_counted_by_truth() -> None:
    records = [
        {
            "index": n,
            "kind": WANTED[n % 3],
            "chosen": WANTED[0 if n == 4 else n % 3],
            "schwarz": {WANTED[0]: 0.0, WANTED[1]: -20.0 * n, WANTED[2]: -10.0 * n},
        }
        for n in range(6)
    ]
    lines = law_section(records)
    assert f"| {WANTED[0]} | 2 | 100 % | 2 | 0 | 0 |  |" in lines
    assert f"| {WANTED[1]} | 2 | 50 % | 1 | 1 | 0 | 20 |" in lines


def test_a_start_is_a_few_per_cent_from_the_truth() -> None:
    truth = {"chair.friction_coefficient": 0.4, "drive.2.stiffness": 8e5}
    values = near(truth, np.random.default_rng(0)).values
    assert values == pytest.approx(truth, rel=0.06)
    assert values != truth


def test_a_torn_line_is_left_out_and_a_section_is_replaced(tmp_path: Path) -> None:
    content = b'{"index": 1}\n{"index": 0}\n{"ind'
    (tmp_path / RESULTS).write_bytes(content)
    assert [item["index"] for item in read_records(tmp_path)] == [0, 1]
    page = tmp_path / "page.md"
    page.write_text("# Title\n\nText.\n", encoding="utf-8")
    put_section(page, name="x", heading="Heading", lines=["one"])
    put_section(page, name="x", heading="Heading", lines=["two"])
    text = page.read_text(encoding="utf-8")
    assert text.count("## Heading") == 1
    assert "two" in text
    assert "one" not in text
