"""The response data that MIL-HDBK-1823A (2009) publishes as Example 1, against another computation.

92 cracks, sizes in mils (here written as mm), responses of 50 are at the noise and known only to be
at most that; decision threshold 200 counts. The figures that the handbook gives for them were not
found as text, so the estimates are compared with a censored regression that shares no code with
`turnout pod`: its likelihood is maximised by Nelder-Mead, its bound is that of Wald by finite
differences, which differs from a profile likelihood by terms of second order.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from turnout.detection.pod.estimate import estimate_pod
from turnout.detection.pod.pod_result import PodModel
from turnout.detection.pod.pod_table import read_test_throws

FILE = Path(__file__).parent / "data" / "mil_hdbk_1823a_example_1.csv"
FLOOR, THRESHOLD = 50.0, 200.0


def censored_regression(*, logarithms: bool) -> tuple[float, float, float]:
    """Return a50, a90 and Wald's a90/95 of the handbook's data."""
    size, response = np.loadtxt(FILE, delimiter=",", skiprows=1).T
    x, scale = np.log(size), np.log if logarithms else np.asarray
    y, floor, threshold = scale(response), float(scale(FLOOR)), float(scale(THRESHOLD))
    unit = float(np.std(y))

    def loss(p: np.ndarray) -> float:
        mean, sigma = p[0] * unit + p[1] * unit * x, np.exp(p[2]) * unit
        at_floor = response <= FLOOR
        return float(
            -norm.logpdf(y[~at_floor], mean[~at_floor], sigma).sum()
            - norm.logcdf(floor, mean[at_floor], sigma).sum()
        )

    best = minimize(loss, [0.0, 1.0, -1.0], method="Nelder-Mead",
                    options={"xatol": 1e-9, "fatol": 1e-10, "maxiter": 5000}).x  # fmt: skip
    step = 1e-4 * np.eye(3)
    curvature = np.array([
        [(loss(best + a + b) - loss(best + a - b) - loss(best - a + b) + loss(best - a - b)) / 4e-8
         for b in step] for a in step
    ])  # fmt: skip

    def log_size(p: np.ndarray, share: float) -> float:
        return float((threshold / unit + norm.ppf(share) * np.exp(p[2]) - p[0]) / p[1])

    way = np.array([(log_size(best + a, 0.9) - log_size(best - a, 0.9)) / 2e-4 for a in step])
    error = float(np.sqrt(way @ np.linalg.solve(curvature, way)))
    a90 = log_size(best, 0.9)
    return tuple(np.exp([log_size(best, 0.5), a90, a90 + norm.ppf(0.95) * error]))  # type: ignore[return-value]


@pytest.mark.parametrize("scale", ["log", "linear"])
def test_the_handbooks_data_give_what_another_computation_gives(scale: str) -> None:
    model = PodModel(threshold=THRESHOLD, least=FLOOR, response_scale=scale, drawn=0)
    found = estimate_pod(read_test_throws(FILE), model)
    a50, a90, bound = censored_regression(logarithms=scale == "log")
    assert 1e3 * found.a50 == pytest.approx(a50, rel=1e-4)
    assert 1e3 * found.a90 == pytest.approx(a90, rel=1e-4)
    assert 1e3 * found.a90_95 == pytest.approx(bound, rel=0.02)  # Wald against profile
    assert found.a90_95 > found.a90
