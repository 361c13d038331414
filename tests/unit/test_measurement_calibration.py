"""Known loads: the line, its errors against many noisy repetitions, and tables that give none."""

import numpy as np
import pytest

from turnout.measurement.chain.channel_map import fit_load_calibration


def test_two_points_leave_nothing_to_judge_by() -> None:
    line = fit_load_calibration([0.0, 2.0], [1.0, 5.0])
    assert (line.scale, line.offset, line.nonlinearity) == (2.0, -0.5, 0.0)
    assert np.isnan(line.scale_error)
    assert np.isnan(line.offset_error)


def test_a_bent_table() -> None:
    """Points 0, 1, 4 at 0, 1, 2: the line is 2 r - 1/3; they are 1/3, 2/3, 1/3 off; range 4."""
    line = fit_load_calibration([0.0, 1.0, 2.0], [0.0, 1.0, 4.0])
    assert line.scale == pytest.approx(2.0)
    assert line.offset == pytest.approx(1 / 6)
    assert line.nonlinearity == pytest.approx((2 / 3) / 4)
    # residuals squared sum to 2/3, one degree of freedom, spread of r is 2
    assert line.scale_error == pytest.approx(np.sqrt(2 / 3 / 2))


def test_the_errors_are_those_of_repetitions() -> None:
    rng = np.random.default_rng(3)
    raw = np.linspace(0.2, 1.0, 9)
    lines = [
        fit_load_calibration(list(raw), list(5000 * (raw - 0.1) + rng.normal(scale=20, size=9)))
        for _ in range(2000)
    ]
    for value, error in (("scale", "scale_error"), ("offset", "offset_error")):
        scatter = np.std([getattr(line, value) for line in lines])
        stated = np.sqrt(np.mean([getattr(line, error) ** 2 for line in lines]))
        assert stated == pytest.approx(scatter, rel=0.05)


@pytest.mark.parametrize(
    ("raw", "load", "words"),
    [
        ([1.0], [1.0], "at least 2 points"),
        ([1.0, 2.0], [1.0], "2 readings and 1 loads"),
        ([1.0, 1.0], [1.0, 2.0], "all readings are the same"),
        ([1.0, 2.0], [1.0, 1.0], "all loads are the same"),
        ([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], "do not depend on the load"),
    ],
)
def test_tables_without_a_line(raw: list[float], load: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        fit_load_calibration(raw, load)
