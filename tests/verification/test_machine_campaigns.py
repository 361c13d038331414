"""Machines found again from one virtual campaign, and what the long job counts.

The long job `machine_campaigns` makes 200 such campaigns; its table is on docs/use/machines.md.
"""

import pytest
from benchmarks.studies.machine_campaigns import WITHIN, Record, counted, result_of, section


def test_a_virtual_campaign_within_two_per_cent() -> None:
    """Reference: closed form of the machines drawn; tolerance 2 %, as the long job's."""
    record = result_of(5)  # one in which Drive 2's clutch slips while it opens
    assert not record["failure"]
    assert len(record["found"]) == 10
    for row in record["found"]:
        assert row["value"] == pytest.approx(row["truth"], rel=WITHIN), row["case"]
    held = sum(row["low"] <= row["truth"] <= row["high"] for row in record["found"])
    assert held >= 8


def test_intervals_that_hold_the_truth_are_counted() -> None:
    def row(value: float) -> Record:
        return {"case": "a", "truth": 2.0, "value": value, "low": value - 0.1, "high": value + 0.1}

    records = [{"index": n, "failure": "", "found": [row(v)]} for n, v in enumerate((2.05, 2.2))]
    assert counted(records)["a"] == pytest.approx((1, 2, 0.1, 0.0625, 0.05))
    assert "| a | 10.00 % | +6.25 % | 5.00 % | 1 of 2, 50.0 % |" in section(records)
