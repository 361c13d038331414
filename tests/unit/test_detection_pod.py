"""Probability of detection from campaigns: against closed forms, published fits and drawn data."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import minimize
from scipy.stats import norm

from turnout.core.errors import StudyError
from turnout.detection.pod.estimate import estimate_pod
from turnout.detection.pod.pod_bound import confidence_bound, upper_bound
from turnout.detection.pod.pod_fit import detected_size, draw_campaigns, maximise
from turnout.detection.pod.pod_likelihood import Campaigns, Constraint, evaluate, margin
from turnout.detection.pod.pod_result import PodModel, curve_of, key_figures, pod_dataset
from turnout.detection.pod.pod_table import TestThrows, response_value
from turnout.figures.pod import plot_pod
from turnout.figures.style import rendered

Floats = NDArray[np.float64]

# Bliss (1935): beetles killed by 8 doses of carbon disulphide, a classic of hits and misses.
# Estimates as in Dobson (2002, An Introduction to Generalized Linear Models, table 7.3 and text).
DOSE = (1.6907, 1.7242, 1.7552, 1.7842, 1.8113, 1.8369, 1.8610, 1.8839)
GIVEN = (59, 60, 62, 56, 63, 59, 62, 60)
KILLED = (6, 13, 18, 28, 52, 53, 61, 60)
PUBLISHED = {"logit": (-60.72, 34.27), "probit": (-34.94, 19.73)}

# Travel times of ultrasound in six rails (Pinheiro and Bates 2000, Mixed-Effects Models, data
# Rail); their maximum-likelihood deviations between and within rails, and log-likelihood.
RAILS = ((55, 53, 54), (26, 37, 32), (78, 91, 85), (92, 100, 96), (49, 51, 50), (80, 85, 83))
BETWEEN, WITHIN, LOG_LIKELIHOOD = 22.624, 4.0208, -64.28


def beetles(link: str) -> Campaigns:
    x = np.repeat(DOSE, GIVEN)
    pairs = zip(KILLED, GIVEN, strict=True)
    side = np.concatenate([[1] * dead + [-1] * (all_ - dead) for dead, all_ in pairs])
    return Campaigns(
        x=x, switch=np.zeros(x.size, np.intp), y=np.zeros((1, x.size)),
        side=side.astype(np.int8)[None], link=link, grouped=False,
    )  # fmt: skip


@pytest.mark.parametrize("link", ["logit", "probit"])
def test_hits_and_misses_give_the_published_fit(link: str) -> None:
    row = maximise(beetles(link)).parameters[0]
    np.testing.assert_allclose(row[:2], PUBLISHED[link], rtol=2e-4)


def test_rails_that_differ_give_the_published_deviations() -> None:
    y = np.ravel(RAILS).astype(float)
    rails = Campaigns(
        x=np.tile([-1.0, 0.0, 1.0], 6), switch=np.repeat(np.arange(6), 3),
        y=y[None] - 66.5, side=np.zeros((1, 18), np.int8), binary=False,
    )  # fmt: skip
    # no size grows along a rail: the slope is held at 0 by a constraint far away
    fits = [
        evaluate(rails, np.array([[0.0, 0.0, BETWEEN / sd, 1.0 / sd]]))
        for sd in (WITHIN, 1.01 * WITHIN, 0.99 * WITHIN)
    ]
    value = float(fits[0].value[0]) - 9.0 * np.log(2.0 * np.pi)
    assert value == pytest.approx(LOG_LIKELIHOOD, abs=0.005)
    assert fits[0].gradient[0, 2:] == pytest.approx([0.0, 0.0], abs=0.02)


def campaign(
    *, binary: bool, link: str = "probit", spread: float = 0.8, switches: int = 6
) -> Campaigns:
    count = 12 * switches
    empty = Campaigns(
        x=np.tile(np.linspace(-1.0, 1.0, 12), switches), switch=np.repeat(np.arange(switches), 12),
        y=np.zeros((1, count)), side=np.ones((1, count), np.int8), link=link, binary=binary,
        least=-np.inf if binary else -1.0, most=np.inf if binary else 1.5,
    )  # fmt: skip
    truth = np.array([0.3, 3.0, spread, 1.0 if binary else 2.0])
    return draw_campaigns(empty, truth, 1, np.random.default_rng(4))


@pytest.mark.parametrize(("binary", "link"), [(True, "probit"), (True, "logit"), (False, "probit")])
def test_likelihood_is_the_integral_over_each_switch(binary: bool, link: str) -> None:
    data = campaign(binary=binary, link=link)
    a0, a1, w, scale = row = np.array([0.2, 2.5, 1.3, 1.0 if binary else 1.7])

    def log_above(u: np.ndarray) -> np.ndarray:
        return norm.logsf(u) if link == "probit" else -np.logaddexp(0.0, u)

    total = 0.0
    for number in range(6):
        own = data.switch == number
        side, y, x = data.side[0, own], data.y[0, own], data.x[own]

        def density(v: float, side=side, y=y, x=x) -> float:  # type: ignore[no-untyped-def]
            residual = scale * y - a0 - a1 * x - w * v
            known = np.where(
                side == 0, np.log(scale) - 0.5 * residual**2, log_above(side * residual)
            )
            return float(np.exp(known.sum() + 20.0) * norm.pdf(v))

        total += np.log(quad(density, -8, 8, epsabs=0, limit=400)[0]) - 20.0
    found = evaluate(data, row[None])
    assert float(found.value[0]) == pytest.approx(total, abs=2e-3)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("constraint", [None, Constraint(x=0.4, probability=0.9)])
def test_gradient_and_hessian_are_differences(binary: bool, constraint: Constraint | None) -> None:
    data = campaign(binary=binary)
    row = np.array([0.2, 2.5, 1.0, 1.0 if binary else 1.7])
    found = evaluate(data, row[None], constraint)
    free = [item for item in data.free if constraint is None or item > 0]
    for number, column in enumerate(free):
        ends = [
            evaluate(data, (row + sign * 1e-5 * np.eye(4)[column])[None], constraint)
            for sign in (1, -1)
        ]
        slope = (ends[0].value - ends[1].value) / 2e-5
        bend = (ends[0].gradient - ends[1].gradient) / 2e-5
        np.testing.assert_allclose(found.gradient[:, number], slope, atol=1e-4)
        np.testing.assert_allclose(found.hessian[:, number], bend, atol=1e-3)


@pytest.mark.parametrize("link", ["probit", "logit"])
def test_the_margin_detects_its_share(link: str) -> None:
    data, spread = campaign(binary=True, link=link), np.array([0.0, 0.7, 2.0])
    mean, first, second = margin(spread, data, 0.9)
    cdf = norm.cdf if link == "probit" else (lambda u: 1.0 / (1.0 + np.exp(-u)))
    for m, w in zip(mean, spread, strict=True):
        share = quad(lambda v, m=m, w=w: cdf(m + w * v) * norm.pdf(v), -9, 9)[0]
        assert share == pytest.approx(0.9, abs=1e-6)
    up, down = margin(spread + 1e-4, data, 0.9), margin(spread - 1e-4, data, 0.9)
    np.testing.assert_allclose(first, (up[0] - down[0]) / 2e-4, atol=1e-5)
    np.testing.assert_allclose(second, (up[1] - down[1]) / 2e-4, atol=1e-4)


@pytest.mark.parametrize("binary", [True, False])
def test_many_switches_give_back_the_truth(binary: bool) -> None:
    data = campaign(binary=binary, switches=150)
    truth = np.array([0.3, 3.0, 0.8, 1.0 if binary else 2.0])
    expected = detected_size(truth[None], data, 0.9)
    found = detected_size(maximise(data).parameters, data, 0.9)
    assert found == pytest.approx(expected, abs=0.08)


def test_the_bound_is_where_the_likelihood_ratio_says() -> None:
    data = campaign(binary=False)
    best = maximise(data)
    bound, _ = upper_bound(data, best, probability=0.9, limit=-1.645)
    held = maximise(data, Constraint(x=bound, probability=0.9), start=best.parameters)
    assert 2.0 * float(best.value[0] - held.value[0]) == pytest.approx(1.645**2, rel=1e-3)
    assert bound > float(detected_size(best.parameters, data, 0.9)[0])


def test_few_switches_need_a_wider_bound_and_pooling_gives_a_narrower() -> None:
    data = campaign(binary=False)
    bound, plain, limit = confidence_bound(data, maximise(data), drawn=100)
    pooled = replace(data, grouped=False)
    naive, _ = upper_bound(pooled, maximise(pooled), probability=0.9, limit=-1.645)
    assert limit < -1.7
    assert naive < plain < bound


# ---- tables


def table(*, switches: int = 5, seed: int = 3, spread: float = 0.25) -> TestThrows:
    rng = np.random.default_rng(seed)
    size = np.tile(np.geomspace(5e-3, 31e-3, 11), switches)
    names = np.repeat(np.arange(switches), 11)
    effect = spread * rng.standard_normal(switches)[names]
    y = np.log(60.0) + 2.0 * np.log(size / 6e-3) + effect + 0.3 * rng.standard_normal(size.size)
    response = np.clip(np.exp(y), 40.0, 1500.0)
    sound = np.full(20, 40.0)
    return TestThrows(
        size=np.concatenate([size, np.zeros(20)]),
        response=np.concatenate([response, sound]),
        hit=np.concatenate([response > 250.0, np.zeros(20, bool)]),
        switch=tuple(map(str, [*names, *[0] * 20])),
        simulated=np.zeros(size.size + 20, bool),
        unit="N",
    )


def hits(size: Floats, hit: NDArray[np.bool_], switches: tuple[str, ...] = ()) -> TestThrows:
    """Return a table of hits and misses, of one switch unless others are named."""
    names = switches or ("1",) * size.size
    simulated = np.zeros(size.size, bool)
    return TestThrows(size=size, response=None, hit=hit, switch=names, simulated=simulated)


QUICK = PodModel(threshold=250.0, least=40.0, most=1500.0, drawn=100)
PLAIN = replace(QUICK, drawn=0)


def test_responses_give_the_size_at_which_nine_of_ten_exceed_the_threshold() -> None:
    found = estimate_pod(table(switches=40), PLAIN)
    spread = np.hypot(0.25, 0.3)
    expected = 6e-3 * np.exp((np.log(250.0 / 60.0) + 1.2816 * spread) / 2.0)
    assert found.a90 == pytest.approx(expected, rel=0.04)
    assert found.slope == pytest.approx(2.0, rel=0.05)
    assert found.switch_deviation == pytest.approx(0.25, rel=0.3)
    assert found.error_deviation == pytest.approx(0.3, rel=0.1)
    assert curve_of(found, np.array([found.a50, found.a90])) == pytest.approx([0.5, 0.9], abs=1e-6)


def test_hits_say_the_same_with_a_wider_bound() -> None:
    responses = estimate_pod(table(), PLAIN)
    hits = estimate_pod(table(), PodModel(drawn=0))
    assert hits.a90 == pytest.approx(responses.a90, rel=0.15)
    assert hits.a90_95 / hits.a90 > responses.a90_95 / responses.a90
    assert hits.sound_throws == 20
    assert hits.alarm_rate_high == pytest.approx(1.0 - 0.05 ** (1 / 20), rel=1e-6)


def test_censored_responses_do_not_bend_the_line() -> None:
    free = estimate_pod(table(switches=20), PLAIN)
    cut = table(switches=20)
    assert cut.response is not None
    cut = replace(cut, response=np.clip(cut.response, 100.0, 700.0))
    found = estimate_pod(cut, replace(QUICK, least=100.0, most=700.0, drawn=0))
    assert found.slope == pytest.approx(free.slope, rel=0.05)
    bent = estimate_pod(cut, replace(QUICK, least=0.0, most=np.inf, drawn=0))
    assert bent.slope < 0.85 * free.slope


def test_floor_and_ceiling_are_kept_where_the_data_ask_for_them() -> None:
    rng = np.random.default_rng(8)
    size = np.tile(np.geomspace(3e-3, 30e-3, 20), 20)
    hit = rng.uniform(size=400) < 0.08 + 0.87 * norm.cdf(4.0 * np.log(size / 0.01))
    clean = rng.uniform(size=400) < norm.cdf(4.0 * np.log(size / 0.01))
    found = estimate_pod(hits(size, hit), PodModel(drawn=0))
    assert 0.02 < found.low < 0.15
    assert 0.9 < found.high < 0.99
    plain = estimate_pod(hits(size, clean), PodModel(drawn=0))
    assert (plain.low, plain.high) == (0.0, 1.0)
    assert any("one switch" in note for note in plain.notes)


def test_simulated_throws_are_said_to_be_model_assisted() -> None:
    given = table()
    found = estimate_pod(replace(given, simulated=np.ones_like(given.simulated)), PLAIN)
    assert found.model_assisted
    assert "model-assisted" in found.notes[0]
    assert "model-assisted" in plot_pod(pod_dataset(found)).get_suptitle()


def test_the_dataset_holds_curve_throws_and_key_figures() -> None:
    found = estimate_pod(table(), QUICK)
    dataset = pod_dataset(found)
    at = dataset.sel(probability=0.9)
    assert float(at["required_size"]) == pytest.approx(found.a90)
    assert float(at["required_size_bound"]) == pytest.approx(found.a90_95, rel=1e-3)
    assert dataset["response"].attrs["units"] == "N"
    assert key_figures(found)["switches"] == 5
    figure = plot_pod(dataset)
    assert len(figure.axes) == 2
    assert rendered(figure, ".png").startswith(b"\x89PNG")


SIZES = np.append(np.arange(1, 31) * 1e-3, 14e-3)


@pytest.mark.parametrize(
    ("throws", "words"),
    [
        (replace(table(), hit=np.ones(75, bool)),
         "every object from 5 to 31 mm was hit; throw smaller ones"),
        (replace(table(), hit=np.zeros(75, bool)), "was missed; throw larger ones"),
        (replace(table(), hit=None), "has no column hit"),
        (replace(table(), size=np.concatenate([np.full(5, 0.01), np.zeros(70)])),
         "has 5 throws with objects"),
        (replace(table(spread=0.0), hit=table().size > 12e-3), "do not overlap"),
        (hits(SIZES, SIZES > 13.5e-3), "do not overlap"),
        (hits(SIZES, np.append(SIZES[:-1] > 13.5e-3, False)), "do not overlap"),
    ],
    ids=["all hit", "all missed", "no hits", "few", "apart", "of one switch", "tied"],
)  # fmt: skip
def test_a_campaign_that_says_too_little_is_refused(throws: TestThrows, words: str) -> None:
    with pytest.raises(StudyError, match=words):
        estimate_pod(throws, PodModel(drawn=0))


@pytest.mark.parametrize("scatter", [0.02, 0.05])
def test_a_sharp_change_has_the_likeliest_a90_and_a_bound_above(scatter: float) -> None:
    rng = np.random.default_rng(0)
    size = np.concatenate([np.linspace(1, 31, 60), rng.uniform(11, 15, 80)]) * 1e-3
    hit = np.log(size / 13e-3) + scatter * rng.standard_normal(size.size) > 0.0

    def height(values: Floats) -> float:
        u = (np.log(size) - values[0]) / np.exp(values[1])
        return -float(np.sum(np.where(hit, norm.logcdf(u), norm.logsf(u))))

    best = minimize(height, [np.log(13e-3), -3.0], method="Nelder-Mead", tol=1e-9).x
    found = estimate_pod(hits(size, hit), PodModel(drawn=100))
    assert found.a90 == pytest.approx(np.exp(best[0] + norm.ppf(0.9) * np.exp(best[1])), rel=1e-4)
    assert found.a90_95 > found.a90 * (1.0 + 0.4 * scatter)


def test_switches_that_change_at_one_size_each_have_no_bound_and_say_so() -> None:
    size = np.tile(np.arange(1, 31) * 1e-3, 4)
    ends = np.repeat([8.5e-3, 11.5e-3, 14.5e-3, 17.5e-3], 30)
    names = tuple(np.repeat(list("abcd"), 30))
    found = estimate_pod(hits(size, size > ends, names), PodModel(drawn=100))
    deviation = np.log([8.5, 11.5, 14.5, 17.5]).std()
    expected = np.exp(np.log([8.5, 11.5, 14.5, 17.5]).mean() + norm.ppf(0.9) * deviation)
    assert 1e3 * found.a90 == pytest.approx(expected, rel=0.02)
    assert np.isnan(found.a90_95)
    assert any("no a90/95" in note for note in found.notes)


def test_an_a90_beyond_the_sizes_thrown_is_said_to_be_extrapolated() -> None:
    found = estimate_pod(table(), replace(PLAIN, threshold=1400.0))
    assert found.a90 > 31e-3
    assert any("a90 is extrapolated: the largest object was 31 mm" in note for note in found.notes)


def test_models_without_meaning_are_refused_together() -> None:
    with pytest.raises(StudyError) as found:
        PodModel(size_scale="square", link="cauchit", threshold=1.0, least=2.0, drawn=-1)
    assert len(found.value.problems) == 4
    for drawn in (1, 99):
        with pytest.raises(StudyError, match="must be 0, or 100 or more"):
            PodModel(drawn=drawn)


@pytest.mark.parametrize(
    ("text", "expected"), [("250", 250.0), ("2.5e2", 250.0), ("250 N", 250.0), ("0,25 kN", 250.0)]
)
def test_a_threshold_may_have_a_unit(text: str, expected: float) -> None:
    assert response_value(text, throws=table()) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("250 mm", "N", "needs one of force"),
        ("250 N", "", "must be a number without a unit"),
        ("much", "N", "must be a number"),
    ],
)
def test_a_threshold_of_another_unit_is_refused(text: str, unit: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        response_value(text, throws=replace(table(), unit=unit))
