"""Trends over many verdicts, and causes that stay."""

import numpy as np
import pytest

from turnout.detection.detector.throw_verdict import Verdict
from turnout.detection.detector.trends import cumulated, staying_causes, trend_of
from turnout.figures.report.detection import detection_page


def records(log_odds: np.ndarray) -> list[dict[str, object]]:
    from dataclasses import asdict

    return [
        asdict(
            Verdict(
                name=f"t{number}",
                status="sound",
                odds={"object": 1.0, "dry chairs": float(np.exp(value))},
                friction=0.3 + 0.001 * number,
                peaks={"1": 3000.0 + 0.0 * number},
            )
        )
        for number, value in enumerate(log_odds)
    ]


def test_a_weak_cause_shows_by_staying() -> None:
    """d = 1.5 against a known signature: log ratios of mean -+d^2/2 and deviation d."""
    rng = np.random.default_rng(5)
    sound = rng.normal(-1.125, 1.5, 60)
    dry = rng.normal(1.125, 1.5, 30)
    assert staying_causes(records(sound)) == {}
    (name, (since, total)), *more = staying_causes(records(np.concatenate([sound, dry]))).items()
    assert (name, more) == ("dry chairs", [])
    assert 55 < since < 70
    assert total > 9.2


def test_false_calls_of_a_sum_are_as_seldom_as_its_threshold_says() -> None:
    """Lorden: at least e^h throws between them, h = 4 here."""
    rng = np.random.default_rng(6)
    lengths = []
    for _ in range(200):
        total = cumulated(rng.normal(-1.125, 1.5, 4000))
        above = np.flatnonzero(total > 4.0)
        lengths.append(above[0] + 1 if above.size else 4000)
    assert np.mean(lengths) > np.exp(4.0)


def test_trends_have_intervals_that_hold() -> None:
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(400):
        found = trend_of(0.02 * np.arange(30) + rng.standard_normal(30))
        assert found is not None
        held += found.low < 2.0 < found.high
    assert held / 400 == pytest.approx(0.95, abs=0.035)
    assert trend_of([1.0, 2.0, np.nan]) is None


def test_the_page_names_causes_and_gaps_above_their_limits() -> None:
    gap = {"name": "drive 2", "limit": 5e-3, "middle": -1e-6, "low": -1e-4, "high": 7e-3}
    throws = records(np.full(2, 1.0))
    throws[1] |= {"status": "other cause", "cause": "clutch", "gaps": [gap | {"called": True}]}
    page = detection_page(throws, about={})
    (section,) = (item for item in page.sections if item.heading == "Throws")
    assert section.tables[0].columns[4] == "drive 2 [mm], limit 5"
    assert section.tables[0].rows[1][4:] == [
        "0.0 (-0.1 to 7.0)",
        "clutch; gap above its limit at drive 2",
    ]
    assert any(item.question == "Is a gap above its limit?" for item in page.findings)


def test_the_page_names_what_stays_and_what_changes() -> None:
    page = detection_page(records(np.full(20, 1.0)), about={})
    assert any("dry chairs" in item.detail for item in page.findings)
    (section,) = (item for item in page.sections if item.heading == "Trends")
    (friction, force) = section.tables[0].rows
    assert friction[-1] == "changes"
    assert force[-1] == "no clear change"
