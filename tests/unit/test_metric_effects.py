"""Indices and main effects against a function whose indices are known."""

import numpy as np
import pytest
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.metric.sensitivity import (
    first_order_index,
    main_effect,
    numeric_outputs,
    varying_inputs,
)
from turnout.study.design import Design, Drawn
from turnout.study.distribution import Distribution
from turnout.study.sweep.effects import sobol_indices

A, B = 7.0, 0.1


def ishigami(x: np.ndarray) -> np.ndarray:
    """Ishigami and Homma 1990, doi 10.1109/ISUMA.1990.151285."""
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


def known_indices() -> tuple[np.ndarray, np.ndarray]:
    """Return first and total indices, by integration."""
    one = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    two = A**2 / 8.0
    both = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    whole = one + two + both
    return np.array([one, two, 0.0]) / whole, np.array([one + both, two, both]) / whole


def design(method: str, count: int) -> Design:
    law = Distribution(kind="uniform", parameters={"minimum": -np.pi, "maximum": np.pi})
    drawn = tuple(Drawn(name=name, law=law) for name in "abc")
    return Design(axes=(), drawn=drawn, method=method, draws=count, copula=None, seed=2)


def drawn_by(made: Design) -> np.ndarray:
    return np.array([list(made.drawn_values(state).values()) for state in range(made.states)])


def test_sobol_indices_are_those_of_the_known_function() -> None:
    pytest.importorskip("SALib")
    made = design("saltelli", 1024)
    first, total = known_indices()
    found = sobol_indices(ishigami(drawn_by(made)), names="abc", draws=made.draws)
    np.testing.assert_allclose([item.first for item in found], first, atol=0.04)
    np.testing.assert_allclose([item.total for item in found], total, atol=0.04)
    for item, known in zip(found, total, strict=True):
        assert abs(item.total - known) < 2.0 * item.total_confidence
        assert 0 < item.first_confidence < 0.2


def test_blocks_with_a_failed_throw_are_left_out() -> None:
    pytest.importorskip("SALib")
    made = design("saltelli", 512)
    output = ishigami(drawn_by(made))
    output[::97] = np.nan
    found = sobol_indices(output, names="abc", draws=made.draws)
    np.testing.assert_allclose([item.first for item in found], known_indices()[0], atol=0.06)


def test_first_indices_of_any_design_are_those_of_the_known_function() -> None:
    x = drawn_by(design("latin hypercube", 2000))
    y = ishigami(x)
    found = [
        first_order_index(xr.DataArray(column, dims="scenario", name="x"), y).first
        for column in x.T
    ]
    # 24 classes average the square of the sine a little: its index is 2 % too small.
    np.testing.assert_allclose(found, known_indices()[0], atol=0.04)


def test_an_output_that_nothing_changes_has_no_index() -> None:
    x = xr.DataArray(np.arange(20.0), dims="scenario", name="x")
    assert first_order_index(x, np.full(20, 3.0)).first == 0.0


def test_main_effects_take_texts_in_their_order_and_leave_out_what_failed() -> None:
    place = xr.DataArray(["b", "a", "b", "a"], dims="scenario", name="object.at")
    effect = main_effect(place, np.array([1.0, 4.0, 3.0, np.nan]))
    assert effect.levels == ("b", "a")
    assert effect.mean.tolist() == [2.0, 4.0]
    assert np.isnan(effect.confidence[1])


def test_too_few_blocks_are_reported() -> None:
    made = design("saltelli", 8)
    output = np.full(made.states, np.nan)
    with pytest.raises(
        ResponseError, match="at least 8 whole blocks of 5 throws, this sweep has 0"
    ):
        sobol_indices(output, names="abc", draws=made.draws)


def test_a_logical_output_of_a_throw_that_failed_is_not_known() -> None:
    labels = xr.Dataset({"slipped": ("scenario", np.array([1, 0, -1], dtype=np.int8))})
    assert np.array_equal(
        numeric_outputs(labels, ("slipped",))[0].values, [1, 0, np.nan], equal_nan=True
    )


def test_outputs_are_distinguished_by_drive_and_unknown_ones_refused() -> None:
    labels = xr.Dataset(
        {"peak_force": (("scenario", "drive", "direction"), np.arange(8.0).reshape(2, 2, 2))},
        {
            "drive": ["1", "2"],
            "direction": ["opening", "closing"],
            "friction": ("scenario", [0.1, 0.2], {"input": 1}),
            "fixed": ("scenario", [0.1, 0.1], {"input": 1}),
        },
    )
    found = numeric_outputs(labels)
    assert [item.name for item in found] == ["peak_force, drive 1", "peak_force, drive 2"]
    assert found[1].values.tolist() == [3.0, 7.0]
    assert varying_inputs(labels) == ["friction"]
    with pytest.raises(ResponseError, match="no output 'peak' in this sweep; there are peak_force"):
        numeric_outputs(labels, ("peak",))
