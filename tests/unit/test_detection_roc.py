"""Detections against false alarms: the best detector lies on the bound, a cheating one above."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit.detection_throws import toy_map
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import StudyError
from turnout.detection.pod.pod_table import TestThrows
from turnout.detection.pod.roc import RATES, bound_curve, campaign_roc
from turnout.throw.store import response_bytes

PLACE = "sleeper 1"


def campaign(*, gain: float = 1.0, throws: int = 4000) -> TestThrows:
    """Scores of the matched filter for 2 mm objects, in the states of the map."""
    rng = np.random.default_rng(4)
    of_size = toy_map()["index_quantile"].sel(place=PLACE, channel="both drives")
    index = of_size.interp(size=2.0e-3).to_numpy()
    seen = gain * rng.choice(index, throws) + rng.standard_normal(throws)
    size = np.repeat([2.0e-3, 0.0], throws)
    return TestThrows(
        size=size, response=np.concatenate([seen, rng.standard_normal(throws)]), hit=None,
        switch=("1",) * size.size, simulated=np.ones(size.size, bool),
    )  # fmt: skip


def test_the_matched_filter_lies_on_the_bound() -> None:
    found = campaign_roc(campaign(), toy_map(), place=PLACE)
    at = np.interp([0.003, 0.01, 0.1, 0.5], found.false_alarms, found.detections)
    expected = np.interp([0.003, 0.01, 0.1, 0.5], found.rate, found.bound)
    np.testing.assert_allclose(at, expected, atol=0.04)  # 12 false alarms at the first


def test_a_detector_above_the_bound_stands_out() -> None:
    found = campaign_roc(campaign(gain=1.5), toy_map(), place=PLACE)
    low = np.interp(0.01, found.false_alarms, found.intervals[:, 0])
    assert low > np.interp(0.01, found.rate, found.bound)


def test_the_bound_is_that_of_the_map_at_its_rate() -> None:
    curve = bound_curve(toy_map(), [2.0e-3], place=PLACE, channel="both drives")
    pod = toy_map()["pod"].sel(place=PLACE, channel="both drives").interp(size=2.0e-3)
    assert float(np.interp(1e-3, RATES, curve)) == pytest.approx(float(pod), abs=0.01)
    nothing = bound_curve(toy_map(), [0.0], place=PLACE, channel="both drives")
    np.testing.assert_allclose(nothing, norm.cdf(-norm.isf(RATES)), rtol=1e-9)


def test_hits_and_misses_give_one_point_and_sound_throws_are_needed() -> None:
    given = campaign(throws=50)
    assert given.response is not None
    hits = TestThrows(
        size=given.size, response=None, hit=given.response > 2.0, switch=given.switch,
        simulated=given.simulated,
    )  # fmt: skip
    found = campaign_roc(hits, toy_map(), place=PLACE)
    assert len(found.detections) == 2  # the other is that of no threshold
    with pytest.raises(StudyError, match="a curve needs both"):
        campaign_roc(
            TestThrows(
                size=given.size[:50], response=given.response[:50], hit=None,
                switch=given.switch[:50], simulated=given.simulated[:50],
            ),
            toy_map(), place=PLACE,
        )  # fmt: skip
    with pytest.raises(StudyError, match="the map has"):
        campaign_roc(given, toy_map(), place="sleeper 77")


def test_the_command_draws_it(tmp_path: Path) -> None:
    file, limit, figure = (tmp_path / name for name in ("r.csv", "limit.nc", "roc.png"))
    limit.write_bytes(response_bytes(toy_map()))
    rng = np.random.default_rng(2)
    rows = [f"{s},{300 * s * rng.lognormal(0.0, 0.3):.1f}" for s in (1, 2, 3, 5, 8) * 6]
    rows += [f"0,{100 * rng.lognormal(0.0, 0.5):.1f}" for _ in range(30)]
    file.write_text("\n".join(["size [mm],response [N]", *rows]) + "\n")
    line = ["pod", str(file), "--threshold", "0.3 kN", "--campaigns", "0", "--roc", str(figure)]
    refused = CliRunner().invoke(app, line)
    assert "--limit FILE.nc" in str(refused.exception)
    assert not figure.exists()
    found = CliRunner().invoke(app, [*line, "--limit", str(limit), "--at", PLACE])
    assert found.exit_code == 0, found.exception
    assert figure.read_bytes().startswith(b"\x89PNG")
