"""Intervals, sets of places and what widens them, against exact answers."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm
from tests.unit.detector_toy import toy_detector, toy_evidence

from turnout.detection.detector import interval_widths
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.interval_widths import (
    OpenGap,
    level_of_places,
    likelier,
    signed_misses,
)
from turnout.detection.detector.judging import SPEED, UNUSUAL
from turnout.detection.detector.object_posterior import (
    EndGaps,
    Interval,
    gaps_of,
    mixture_intervals,
    object_of,
    objects_near,
)

CAUSES = ("dry chairs", "adjustment")


def test_quantiles_of_mixtures_are_exact() -> None:
    """Wide, narrow, and two parts far apart with nothing between, all at once."""
    means = np.array([[0.0, 5.0, 0.0], [1.0, 5.0, 100.0], [4.0, 5.1, 101.0]])
    deviations = np.array([[1.0, 1e-3, 0.1], [0.2, 1e-3, 0.1], [3.0, 1e-3, 2.0]])
    weights = np.array([0.2, 0.5, 0.3])
    for number, found in enumerate(mixture_intervals(means, deviations, weights)):
        mean, deviation = means[:, number], deviations[:, number]
        for value, share in ((found.low, 0.025), (found.middle, 0.5), (found.high, 0.975)):
            exact = brentq(
                lambda at, m=mean, d=deviation, s=share: weights @ norm.cdf(at, m, d) - s,
                -50.0,
                200.0,
                xtol=1e-12,
            )
            assert value == pytest.approx(exact, abs=1e-4)


def said(factor: tuple[float | tuple[float, float], ...], limits: np.ndarray) -> EndGaps:
    view, evidence = toy_evidence()
    return gaps_of(view, evidence, 0, limits=limits, factor=factor)


def test_quantiles_of_many_parts_are_those_of_all_of_them() -> None:
    """Parts that lie close are joined by two moments: to 3 % of the least deviation."""
    rng = np.random.default_rng(4)
    means = np.concatenate([rng.normal(0.0, 3.0, (150, 1)), rng.normal(12.0, 0.5, (100, 1))])
    deviations = rng.uniform(0.5, 1.0, means.shape)
    weights = rng.dirichlet(np.ones(len(means)))
    (found,) = mixture_intervals(means, deviations, weights)
    for value, share in ((found.low, 0.025), (found.middle, 0.5), (found.high, 0.975)):
        below = weights @ norm.cdf(value, means[:, 0], deviations[:, 0])
        steepness = weights @ norm.pdf(value, means[:, 0], deviations[:, 0])
        assert abs(below - share) / steepness < 0.03 * deviations.min()


def test_place_and_size_are_widened_by_their_own_factors() -> None:
    view, evidence = toy_evidence()
    near = objects_near(view, evidence, 0)
    plain, wide = (object_of(view, evidence, 0, near=near, x_factor=own) for own in (1.0, 2.0))
    assert wide.size == plain.size
    assert wide.x.middle == plain.x.middle
    assert wide.x.high - wide.x.middle == pytest.approx(2.0 * (plain.x.high - plain.x.middle))


def test_each_gap_is_widened_by_its_own_factor_about_its_median() -> None:
    plain = said((1.0,), np.zeros(2))
    middles = np.array([gap.middle for gap in plain.gaps])
    wide = said((3.0, 1.0), middles)
    for one, other, factor in zip(plain.gaps, wide.gaps, (3.0, 1.0), strict=True):
        assert other.middle == pytest.approx(one.middle)
        assert other.high - other.middle == pytest.approx(factor * (one.high - one.middle))
        assert other.middle - other.low == pytest.approx(factor * (one.middle - one.low))
    assert wide.above == pytest.approx(0.5, abs=1e-3)
    uneven = said(((0.5, 2.0), (1.0, 1.0)), middles)
    assert uneven.gaps[1] == plain.gaps[1]
    ends = plain.gaps[0], uneven.gaps[0]
    assert ends[1].middle - ends[1].low == pytest.approx(0.5 * (ends[0].middle - ends[0].low))
    assert ends[1].high - ends[1].middle == pytest.approx(2.0 * (ends[0].high - ends[0].middle))
    for limit in (ends[1].high, ends[1].low):
        at = said(((0.5, 2.0), (1.0, 1.0)), np.array([limit, 0.0])).above[0]
        assert min(at, 1.0 - at) == pytest.approx(0.025, abs=1e-3)
    edge = said((3.0, 1.0), np.array([gap.high for gap in wide.gaps]))
    assert edge.above == pytest.approx(0.025, abs=1e-3)


def test_factors_hold_kinds_of_throws_the_same_and_leave_out_small_ones() -> None:
    many, few = np.linspace(0.0, 1.0, 4000), np.linspace(0.0, 3.0, 400)
    # of a mixture in equal parts 95 % lie below q: 1/2 + 1/2 q/3 = 0.95
    assert interval_widths.factor_of(many, few, otherwise=9.0) == pytest.approx(2.7, abs=0.01)
    assert interval_widths.factor_of(many, few[:10], otherwise=9.0) == pytest.approx(0.95, abs=0.01)
    assert interval_widths.factor_of(many[:3], few[:3], otherwise=9.0) == 9.0


def test_intervals_are_wide_enough_for_objects_in_doubt_and_for_all() -> None:
    """Misses of even shares up to 1, and up to 3 of the half in doubt or of the other half."""
    rng = np.random.default_rng(6)
    misses, ratios = rng.random(8000), np.arange(8000.0)
    for worse, wanted in ((ratios < 4000, 0.95 * 3.0), (ratios >= 4000, 0.9 * 3.0)):
        found = list(zip(ratios, np.where(worse, 3.0, 1.0) * misses, strict=True))
        factor = interval_widths.factor_of_objects(found, otherwise=9.0)
        assert factor == pytest.approx(wanted, rel=0.02)
    assert interval_widths.factor_of_objects(found[:9], otherwise=9.0) == 9.0


def test_sets_of_places_hold_the_true_one_in_nine_of_ten_new_throws() -> None:
    """With probabilities that are far too sure."""
    rng = np.random.default_rng(2)
    logs = rng.standard_normal((4000, 8))
    share = np.exp(logs) / np.exp(logs).sum(axis=1, keepdims=True)
    true = np.array([rng.choice(8, p=row) for row in share])
    sure = share**3 / (share**3).sum(axis=1, keepdims=True)
    scores = [likelier(row, at) for row, at in zip(sure, true, strict=True)]
    assert np.mean(np.array(scores) < 0.9) < 0.8
    level = level_of_places(scores[:2000], otherwise=0.9)
    assert np.mean(np.array(scores[2000:]) < level) == pytest.approx(0.9, abs=0.025)
    assert level_of_places(scores[:5], otherwise=0.9) == 0.9


def test_a_file_keeps_each_factor(tmp_path: Path) -> None:
    path = tmp_path / "a.detector"
    toy_detector().save(path)
    own, again = toy_detector().knowledge.calibrated, Detector.load(path).knowledge.calibrated
    assert [item.gap_factor for item in own] == [item.gap_factor for item in again]
    assert [item.place_level for item in own] == [item.place_level for item in again]
    assert all(len(item.gap_factor) == 2 for item in own)
    assert [item.cause_thresholds for item in own] == [item.cause_thresholds for item in again]
    assert all(
        set(item.cause_thresholds) == {*CAUSES, "force sensor", SPEED, UNUSUAL} for item in own
    )
    assert [item.gap_reach for item in own] == [item.gap_reach for item in again]


def test_gaps_clearly_above_their_limit_are_called_in_97_percent_with_confidence() -> None:
    """Medians scatter by one half-interval about a limit 0.5 half-intervals below the truth.

    Throws are used six times each, with the same result. Of 150 switches drawn with replacement
    the limit is a little low: nearly nine in ten in place of 95 %.
    """
    rng = np.random.default_rng(3)
    one = {"factors": [1.0, 1.0], "object_factors": [1.0, 1.0], "otherwise": [0.3, 0.1]}
    kept = 0
    for _ in range(50):
        away = np.repeat(rng.standard_normal(150) / 1.96 - 0.5, 6)
        gaps = [OpenGap(0, at // 6, False, float(value)) for at, value in enumerate(away)]
        reach, few = interval_widths.reach_of_call(gaps, **one)
        kept += bool(norm.cdf(1.96 * (reach + 0.5)) >= 0.97)
        assert few == 0.1
    assert 0.8 <= kept / 50 <= 0.99
    some = [OpenGap(1, 0, True, 0.2), OpenGap(1, 1, True, -0.4), OpenGap(0, 0, True, 0.2)]
    assert interval_widths.reach_of_call(some, **one) == (0.3, 0.2)


def test_gaps_with_several_errors_say_their_width_better_than_with_one() -> None:
    """Of intervals as narrow as these errors: one draw leaves the share to chance."""
    rng = np.random.default_rng(5)
    interval = Interval(middle=0.0, low=-1.0, high=1.0)

    def factor(draws: int) -> float:
        truths = rng.standard_normal((draws, 400))
        misses = [signed_misses([interval], own[:, np.newaxis]) for own in truths.T]
        return interval_widths.factor_of(np.array(misses), otherwise=9.0)

    once, several = (np.array([factor(draws) for _ in range(50)]) for draws in (1, 8))
    assert abs(several.mean() - 1.96) < 0.03
    assert several.std() < 0.5 * once.std()


def test_halves_of_an_interval_hold_sound_throws_and_unnoticed_objects_alike() -> None:
    """Gaps of unnoticed objects are wider than their median: one factor holds 99 % of sound."""
    rng = np.random.default_rng(4)

    def thrown(count: int) -> tuple[np.ndarray, np.ndarray]:
        sound = rng.normal(-0.1, 0.5, count)
        return sound, rng.normal(-0.1, 0.5, count) + rng.exponential(0.7, count)

    low, high = interval_widths.sides_of(*thrown(8000), otherwise=(1.0, 1.0))
    one = interval_widths.factor_of(*thrown(8000), otherwise=1.0)
    sound, unnoticed = thrown(100_000)
    assert np.mean((sound > -low) & (sound < high)) == pytest.approx(0.95, abs=0.015)
    assert np.mean((unnoticed > -low) & (unnoticed < high)) == pytest.approx(0.95, abs=0.015)
    assert np.mean(np.abs(sound) < one) > 0.985
    few = interval_widths.sides_of(sound[:5], unnoticed[:5], otherwise=(1.5, 2.5))
    assert few == (1.5, 2.5)
