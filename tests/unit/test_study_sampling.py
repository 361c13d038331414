"""What is drawn has the distribution, the correlation and the field that the study asks for."""

import numpy as np
import pytest
from scipy import stats

from turnout.study.distribution import Choice, Distribution, parameter_faults
from turnout.study.random_inputs import RandomField, TemperatureLaw, correlation_root
from turnout.study.sampling import copula_factor, correlate, sample_points

SHARES = np.linspace(0.01, 0.99, 23)
# Distribution, its parameters, and the same one of scipy.
KNOWN = [
    ("uniform", {"minimum": 2.0, "maximum": 5.0}, stats.uniform(2.0, 3.0)),
    ("log-uniform", {"minimum": 2.0, "maximum": 5.0}, stats.loguniform(2.0, 5.0)),
    ("normal", {"mean": 3.0, "standard_deviation": 0.5}, stats.norm(3.0, 0.5)),
    (
        "truncated normal",
        {"mean": 3.0, "standard_deviation": 0.5, "minimum": 2.6, "maximum": 5.0},
        stats.truncnorm(-0.8, 4.0, 3.0, 0.5),
    ),
    ("lognormal", {"median": 3.0, "log_deviation": 0.4}, stats.lognorm(0.4, scale=3.0)),
    (
        "triangular",
        {"minimum": 1.0, "mode": 1.5, "maximum": 4.0},
        stats.triang(0.5 / 3.0, 1.0, 3.0),
    ),
    (
        "beta",
        {"minimum": 1.0, "maximum": 3.0, "alpha": 2.0, "beta": 5.0},
        stats.beta(2.0, 5.0, 1.0, 2.0),
    ),
]


@pytest.mark.parametrize(("kind", "parameters", "known"), KNOWN, ids=[row[0] for row in KNOWN])
def test_quantiles_are_those_of_scipy(kind: str, parameters: dict[str, float], known) -> None:
    assert parameter_faults(kind, parameters) == []
    law = Distribution(kind=kind, parameters=parameters)
    np.testing.assert_allclose(law.quantile(SHARES), known.ppf(SHARES), rtol=1e-9)
    shares = np.random.default_rng(1).random(100)
    assert law.drawn(shares) == [law.value(float(share)) for share in shares]  # to the last bit


def test_a_truncated_lognormal_keeps_between_its_bounds_and_its_shape() -> None:
    parameters = {"median": 0.2, "log_deviation": 0.5, "minimum": 0.1, "maximum": 0.3}
    law = Distribution(kind="lognormal", parameters=parameters)
    known = stats.lognorm(0.5, scale=0.2)
    inside = known.cdf(0.3) - known.cdf(0.1)
    values = law.quantile(SHARES)
    np.testing.assert_allclose((known.cdf(values) - known.cdf(0.1)) / inside, SHARES, rtol=1e-9)
    assert law.bounds == pytest.approx((0.1, 0.3))


def test_choices_come_by_their_weights() -> None:
    law = Choice(values=("a", "b", "c"), weights=(1.0, 2.0, 1.0))
    drawn = [law.value(share) for share in (np.arange(400) + 0.5) / 400]
    assert [drawn.count(item) for item in "abc"] == [100, 200, 100]


@pytest.mark.parametrize(
    ("method", "most"), [("random", 0.1), ("latin hypercube", 0.04), ("sobol", 0.02)]
)
def test_points_fill_the_cube(method: str, most: float) -> None:
    """The largest distance of the marginal from uniform: even designs are closer than chance."""
    count = 256
    given = {"count": count, "dimensions": 3, "seed": 4}
    points = np.array([sample_points(method, **given, states=[n])[0] for n in range(count)])
    np.testing.assert_array_equal(sample_points(method, **given, states=range(count)), points)
    for column in points.T:
        assert stats.kstest(column, "uniform").statistic < most
    assert np.abs(np.corrcoef(points.T) - np.eye(3)).max() < 0.15


def test_a_saltelli_block_changes_one_column_at_a_time() -> None:
    block = sample_points("saltelli", count=8, dimensions=3, seed=4, states=range(10, 15))
    first, last = block[0], block[-1]
    assert (first != last).all()
    for column in range(3):
        expected = first.copy()
        expected[column] = last[column]
        np.testing.assert_array_equal(block[column + 1], expected)


def test_the_copula_gives_the_rank_correlation_and_leaves_the_marginals() -> None:
    factor, fault = copula_factor(["a", "b", "c"], [("a", "c", 0.7)])
    assert factor is not None
    assert fault == ""
    rng = np.random.default_rng(5)
    shares = np.array([correlate(row, factor=factor) for row in rng.random((4000, 3))])
    ranks = stats.spearmanr(shares).statistic
    assert ranks[0, 2] == pytest.approx(0.7, abs=0.03)
    assert abs(ranks[0, 1]) < 0.05
    for column in shares.T:
        assert stats.kstest(column, "uniform").statistic < 0.03


def test_correlations_that_contradict_each_other_are_refused() -> None:
    pairs = [("a", "b", 0.9), ("b", "c", 0.9), ("a", "c", -0.9)]
    factor, fault = copula_factor(["a", "b", "c"], pairs)
    assert factor is None
    assert "not positive definite" in fault


@pytest.mark.parametrize("kind", ["exponential", "gaussian"])
def test_a_field_is_correlated_over_its_length_and_never_negative(kind: str) -> None:
    x = 0.6 * np.arange(25)
    law = Distribution(
        kind="lognormal",
        parameters={"median": 0.2, "log_deviation": 0.4, "minimum": 0.05, "maximum": 0.6},
    )
    field = RandomField(
        name="friction",
        key="chair.friction_coefficient",
        members=tuple(str(n) for n in range(25)),
        x=tuple(x),
        distribution=law,
        correlation_length=3.0,
        correlation=kind,
    )
    drawn = np.array(
        [list(field.values(np.random.default_rng([3, n])).values()) for n in range(2000)]
    )
    assert drawn.min() >= 0.05
    assert drawn.max() <= 0.6
    assert np.median(drawn) == pytest.approx(float(law.quantile(0.5)), rel=0.03)
    # Five chairs lie one correlation length apart, and ranks follow the normal scores closely.
    found = stats.spearmanr(drawn[:, 5], drawn[:, 10]).statistic
    assert found == pytest.approx(6 / np.pi * np.arcsin(np.exp(-1) / 2), abs=0.05)
    root = correlation_root(x, length=3.0, kind=kind)
    assert (root @ root.T)[0, 5] == pytest.approx(np.exp(-1), abs=1e-6)


def test_temperature_multiplies_by_its_law_and_holds_only_where_it_is_given() -> None:
    table = TemperatureLaw(temperatures=(250.0, 290.0), factors=(1.5, 1.0))
    assert table.factor(260.0) == pytest.approx(1.375)
    assert table.faults(250.0, 290.0) == []
    assert "is given from" in table.faults(240.0, 290.0)[0]
    line = TemperatureLaw(reference=293.15, coefficient=-0.02)
    assert line.factor(283.15) == pytest.approx(1.2)
    assert "must stay more than 0" in line.faults(283.15, 353.15)[0]
