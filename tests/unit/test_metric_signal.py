"""Features of channels and movements on hand-made datasets."""

import json

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb2_dataset

from turnout.metric.channel_features import filtered, first_time
from turnout.metric.summary import LEAST_SCALE, numerical_share, residual_share
from turnout.throw.checks import Check, margins
from turnout.throw.slip import movements, slips

TIME = np.linspace(0.0, 9.0, 9001)
MOVEMENTS = [
    {"name": "throw", "to": "open", "start": 1.0, "end": 4.0},
    {"name": "return", "to": "closed", "start": 5.0, "end": 8.2},
]


def hand_made(*periods: tuple[float, float]) -> xr.Dataset:
    """A drive that slips during the given periods."""
    slipping = np.zeros((2, TIME.size), dtype=bool)
    for first, last in periods:
        slipping[1] |= (first <= TIME) & (last >= TIME)
    return xr.Dataset(
        {"drive_slipping": (("drive", "time"), slipping)},
        {"drive": ["1", "2"], "time": TIME},
        {"movements": json.dumps(MOVEMENTS)},
    )


def test_filter_does_not_shift_a_ramp_and_works_along_time_only() -> None:
    ramp = xr.DataArray(np.outer(TIME, [1.0, 2.0]), {"time": TIME}, ("time", "drive"))
    smooth = filtered(ramp, window=0.2)
    assert smooth.dims == ramp.dims
    inner = slice(200, -200)
    np.testing.assert_allclose(smooth[inner], ramp[inner], atol=1e-9)


def test_filter_of_a_single_instant_is_that_instant() -> None:
    one = xr.DataArray([4.0], {"time": [0.0]}, "time")
    assert filtered(one).values.tolist() == [4.0]


def test_first_time_of_what_never_happens_is_nan() -> None:
    flag = xr.DataArray(np.zeros(3, dtype=bool), {"time": [0.0, 1.0, 2.0]}, "time")
    assert np.isnan(float(first_time(flag)))
    assert np.isnan(float(first_time(flag[:0])))


def test_movements_come_from_the_attributes() -> None:
    assert [span.to for span in movements(hand_made())] == ["open", "closed"]
    assert movements(xr.Dataset()) == ()


@pytest.mark.parametrize(
    ("periods", "expected"),
    [
        ([], []),
        ([(2.0, 2.5), (3.0, 3.5), (7.5, 9.0)], [(2.0, "open"), (7.5, "closed")]),
        # A drive rests at its saturation force until the return relieves it.
        ([(2.0, 5.4)], [(2.0, "open")]),
    ],
    ids=["none", "in each movement", "held into the next"],
)
def test_a_slip_counts_once_and_in_its_movement(
    periods: list[tuple[float, float]], expected: list[tuple[float, str]]
) -> None:
    found = slips(hand_made(*periods))
    assert [(s.time, s.movement.to) for s in found if s.movement] == [
        (pytest.approx(time), to) for time, to in expected
    ]
    assert [s.drive for s in found] == ["2"] * len(expected)


def test_without_movements_the_first_slip_counts() -> None:
    found = slips(hand_made((2.0, 2.5)).drop_attrs())
    assert [(s.time, s.movement) for s in found] == [(pytest.approx(2.0), None)]


def test_shares_of_the_books() -> None:
    dataset = sb2_dataset()
    assert residual_share(dataset) < 1e-6
    assert 0 < numerical_share(dataset) < 5e-3
    still = residual_share(dataset.assign_attrs(energy_scale=0.0))
    assert still == pytest.approx(float(abs(dataset["energy_residual"]).max()) / LEAST_SCALE)


def test_margins_are_tight_below_a_tenth() -> None:
    made = [
        Check(kind="slip", name="", criterion="slip", met=True, drive=drive, value=f, limit=6e3)
        for drive, f in (("2", 5399.0), ("3", np.nan), ("1", 5401.0))
    ]
    assert [(m.drive, m.tight) for m in margins(made)] == [("1", True), ("2", False)]
