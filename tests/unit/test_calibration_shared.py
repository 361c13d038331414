"""Gains and a discrepancy that all movements share: closed forms, and coverage by simulation."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement

from turnout.calibration.candidate_causes import CHAIR_SPREAD, FRICTION, GROUP
from turnout.calibration.comparison import peaks_of
from turnout.calibration.covariance import (
    chair_uncertainty,
    scale_doubt,
    spread_of,
)
from turnout.calibration.fit import fit
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.misfit import Misfit, common_gain, framed
from turnout.calibration.sensors import common_lead, found_sensors
from turnout.calibration.shared import (
    CLEARLY,
    Shared,
    discrepancy_modes,
    effective_samples,
    missing_more,
    shared_discrepancy,
    shared_of,
)
from turnout.calibration.stages import Parameter

Floats = NDArray[np.float64]
KEY = ("drive_force", "1")


def shared(columns: Floats) -> Shared:
    gram = columns.T @ columns
    squares, vectors = np.linalg.eigh(gram)
    sizes = np.sqrt(squares)
    basis = columns @ vectors / sizes
    return Shared(
        sensors=(), columns=columns, gram=gram, plain=(columns,), basis=basis, sizes=sizes
    )


def test_the_cost_is_that_of_the_whole_covariance() -> None:
    rng = np.random.default_rng(0)
    columns, row = rng.standard_normal((30, 4)), rng.standard_normal(30)
    whole = np.eye(30) + columns @ columns.T
    item = shared(columns)
    assert float(item.whitened(row) @ item.whitened(row)) == pytest.approx(
        float(row @ np.linalg.solve(whole, row)), rel=1e-12
    )
    assert item.log_determinant == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-12)
    # The mean of the columns' posterior, by conditioning a joint normal distribution.
    expected = columns.T @ np.linalg.solve(whole, row)
    np.testing.assert_allclose(item.estimates(row), expected, rtol=1e-10)


def test_the_covariance_of_a_linear_model_is_that_of_its_joint_posterior() -> None:
    rng = np.random.default_rng(1)
    J, columns = rng.standard_normal((40, 2)), 0.5 * rng.standard_normal((40, 3))
    both = np.hstack((J, columns))
    joint = np.linalg.inv(both.T @ both + np.diag([0.0, 0.0, 1.0, 1.0, 1.0]))
    slopes = shared(columns).whitened(J)
    np.testing.assert_allclose(np.linalg.inv(slopes.T @ slopes), joint[:2, :2], rtol=1e-10)


@pytest.mark.parametrize("known", [True, False])
def test_intervals_hold_the_truth_where_the_discrepancy_is_in_the_likelihood(known: bool) -> None:
    """A level seen by eight movements of 50 bins that all miss the same wave of ten noises."""
    rng = np.random.default_rng(2)
    modes = discrepancy_modes(0.02 * np.arange(50), size=10.0, length=0.3)
    columns = np.tile(modes, (8, 1))
    item, ones, hits = shared(columns), np.ones((400, 1)), 0
    for _ in range(400):
        row = columns @ rng.standard_normal(modes.shape[1]) + rng.standard_normal(400)
        whitened, slopes = (item.whitened(row), item.whitened(ones)) if known else (row, ones)
        variance = 1.0 / float((slopes.T @ slopes)[0, 0])
        error = variance * float((slopes.T @ whitened)[0])
        hits += abs(error) < 1.96 * np.sqrt(variance)
    assert (0.925 < hits / 400 < 0.975) if known else (hits / 400 < 0.1)


def movements(*, gain: float = 0.0, wave: float = 0.0, seed: int = 3) -> list[MeasuredMovement]:
    rng = np.random.default_rng(seed)
    made = []
    for number in range(6):
        item = movement(f"m{number}", rng=rng)
        signal = item.signals[0]
        missed = wave * np.sin(5.0 * signal.time) * (signal.time > 0)
        values = (1.0 + gain) * signal.values + missed
        made.append(replace(item, signals=(replace(signal, values=values),)))
    return made


def gauged(known: float, **off: float) -> Misfit:
    """Movements behind gauges whose gain is known to a share; it and more may be off."""
    whole = misfit(movements(**off))
    return replace(whole, comparison=replace(whole.comparison, gains={KEY: known}))


def test_what_movements_share_is_separated_from_their_own() -> None:
    rng = np.random.default_rng(4)
    own = [3.0 * rng.standard_normal(150) for _ in range(8)]
    key = (*KEY, "closing")
    noise = misfit(movements()).comparison.noise
    assert shared_discrepancy({key: own}, noise).get(key, (0.0, 0.0))[0] < 1.0
    wave = 20.0 * np.sin(np.arange(150) / 15.0)
    size, length = shared_discrepancy({key: [row + wave for row in own]}, noise)[key]
    assert size == pytest.approx(20.0 / np.sqrt(2.0), rel=0.1)
    assert 0.2 < length < 0.5


def test_a_gain_is_found_as_far_as_the_movements_show_it_and_widens_the_intervals() -> None:
    """Friction and a slip level that is fixed: only the level shows the gain."""
    free = gauged(0.01, gain=0.03)
    (gain,) = found_sensors(fit(free, PARAMETERS, TRUE))
    assert gain.value == pytest.approx(0.03, abs=4 * gain.deviation + 1e-3)
    assert gain.deviation < 0.01
    assert gain.leaves
    right = misfit(movements())
    widths = []
    for gains in ({}, {KEY: 0.01}):
        again = replace(right, comparison=replace(right.comparison, gains=gains))
        found = fit(again, PARAMETERS, TRUE)
        (_, (low, high)) = spread_of(found).intervals
        assert low < TRUE["k"] < high
        widths.append(high - low)
    # Gains that are free never cost more than the quadrature sum of what is known beside them.
    assert widths[1] < 1.3 * np.hypot(widths[0], 2 * 1.96 * 0.01 * TRUE["k"])


def test_gains_that_are_alike_count_where_chance_does_not_make_them_so() -> None:
    """One channel: its gain is the scale. By 2 stated deviations it may be off, not by 4."""
    widths = []
    for gain in (0.02, 0.04):
        free = gauged(0.01, gain=gain)
        # With the slip level as good as known, the gain is.
        found = fit(free, PARAMETERS[:1], TRUE)
        mean, stated = common_gain(found.local, found.frame, free.comparison) or (0.0, 0.0)
        assert mean == pytest.approx(gain, rel=0.1)
        assert stated == pytest.approx(0.01)
        spread = spread_of(replace(found, parameters=(replace(PARAMETERS[0], unit="N"),)))
        widths.append(spread.deviations[0] / found.values["mu"])
        doubted = [text for text in spread.findings if text.startswith("all sensors read")]
        assert bool(doubted) == (gain > 0.03)
    # As good as certain that the model's scale is off: by 4 % less a share for chance, and 1.6
    # deviations more, from a normal distribution cut at one end.
    assert 1.96 * widths[1] == pytest.approx(
        0.04 / 1.04 + 1.645 * 0.01 / np.hypot(1.0, 0.2), rel=0.05
    )


def test_the_scale_of_the_model_moves_all_forces_together() -> None:
    """It was added to each alone: their ratio, which it leaves as it is, seemed uncertain too."""
    free = gauged(0.01, gain=0.04)
    found = fit(free, PARAMETERS, TRUE)
    both = tuple(replace(item, unit="N") for item in PARAMETERS)
    covariance = spread_of(replace(found, parameters=both)).coordinate_covariance
    plain = spread_of(replace(found, parameters=tuple(replace(item, unit="1") for item in both)))
    added = covariance - plain.coordinate_covariance
    assert added[0, 1] == pytest.approx(np.sqrt(added[0, 0] * added[1, 1]), rel=1e-6)
    assert added[0, 1] > 0.01**2


@pytest.mark.parametrize("channels", [1, 3])
def test_doubt_of_the_scale_grows_from_nothing_with_no_step(channels: int) -> None:
    """With 3 channels of 1 % each, 2.8 deviations off together, it is below that 1 %."""
    deviation = 0.01 / np.sqrt(channels)
    doubts = [scale_doubt(off * deviation, deviation) for off in np.arange(0.0, 6.0, 0.1)]
    assert doubts[:24] == [0.0] * 24
    assert np.all(np.diff(doubts) >= 0.0)
    assert np.all(np.array(doubts) <= np.arange(0.0, 6.0, 0.1) * deviation + 1e-12)
    if channels == 3:
        assert doubts[28] < 1.0e-2


def test_shared_discrepancies_make_movements_worth_less() -> None:
    whole = misfit(movements())
    local = whole.local(TRUE, ["mu", "k"])
    alignments = framed(local, whole).alignments
    plain = effective_samples(alignments, whole.comparison)
    missing = replace(whole.comparison, discrepancy={(*KEY, "closing"): (20.0, 0.3)})
    assert effective_samples(alignments, missing) < 0.2 * plain
    many = effective_samples((*alignments, *alignments), missing)
    assert many < 0.3 * effective_samples((*alignments, *alignments), whole.comparison)
    assert shared_of(alignments, whole.comparison) is None


def test_a_wave_that_all_movements_miss_is_not_averaged_out() -> None:
    free = gauged(1e-4, wave=15.0)
    found = fit(free, PARAMETERS, TRUE)
    assert (*KEY, "closing") in found.misfit.comparison.discrepancy
    for item, (low, high) in zip(PARAMETERS, spread_of(found).intervals, strict=True):
        assert low <= TRUE[item.name] <= high


def test_motors_that_lead_are_noticed_by_all_onsets() -> None:
    late = [
        replace(movement(f"m{n}", rng=np.random.default_rng(n), late=0.15), clocked=True)
        for n in range(4)
    ]
    found = fit(misfit(late), PARAMETERS, TRUE)
    assert common_lead(found) == pytest.approx(0.15, abs=0.005)
    even = [replace(item, clocked=True) for item in movements()]
    assert common_lead(fit(misfit(even), PARAMETERS, TRUE)) == 0.0


def test_friction_that_differs_between_chairs_is_known_as_their_mean_only() -> None:
    """With weights that fall to nothing, N chairs of spread s know their mean to s / sqrt(3 N)."""
    chairs = 16
    weights = 2.0 * np.arange(chairs, 0, -1) / (chairs * (chairs + 1))
    exact = CHAIR_SPREAD * np.sqrt(np.sum((weights - 1.0 / chairs) ** 2))
    own = CHAIR_SPREAD / np.sqrt(3.0 * chairs)
    # The sum is short of the integral by (N - 1) / (N + 1).
    assert own * np.sqrt((chairs - 1) / (chairs + 1)) == pytest.approx(exact)
    parameters = [replace(PARAMETERS[0], name=FRICTION), PARAMETERS[1]]
    rng = np.random.default_rng(0)
    found = fit(misfit([movement(f"m{n}", rng=rng) for n in range(6)]), PARAMETERS, TRUE)
    found = replace(
        found,
        parameters=tuple(parameters),
        values={**found.values, FRICTION: found.values["mu"]},
    )
    panel = found.misfit.evaluator.panel
    assert len(panel.chair) == chairs
    assert chair_uncertainty(found) == 0.0
    plain = spread_of(found)
    group = Parameter(
        name=f"{GROUP}1", keys=(), start=0.0, lower=-0.9, upper=0.9, transform="linear"
    )
    by_chair = replace(
        found,
        parameters=(*parameters, group),
        values={**found.values, group.name: 0.0},
        jacobian=np.column_stack([found.jacobian, 0.0 * found.jacobian[:, 0]]),
    )
    assert chair_uncertainty(by_chair) == pytest.approx(own)
    wide = spread_of(by_chair)
    spread = float(np.hypot(plain.deviations[0], own * found.values[FRICTION]))
    assert wide.deviations[0] == pytest.approx(spread, rel=1e-6)
    # What no chair's friction is in stays as it was.
    assert wide.deviations[1] == pytest.approx(plain.deviations[1], rel=1e-6)


@pytest.mark.parametrize(
    ("white", "missed", "found"),
    [
        (1e-4, 0.004, False),
        (1e-4, 0.005, True),
        (3e-3, 0.013, False),
        (3e-3, 0.014, True),
        (2e-2, 0.019, False),
        (2e-2, 0.021, True),
    ],
)
def test_a_model_that_misses_much_is_found_in_a_noisy_channel_too(
    white: float, missed: float, found: bool
) -> None:
    """Three times what another solver or the noise hides, 2 % of the peak at most."""
    whole = misfit([movement("m", rng=np.random.default_rng(1))])
    ((key, peak),) = peaks_of(whole.movements).items()
    noise = replace(whole.comparison.noise[key], white=white * peak, missed=missed * peak)
    comparison = replace(whole.comparison, noise={key: noise})
    assert bool(missing_more(comparison, whole.movements, share=CLEARLY)) is found
