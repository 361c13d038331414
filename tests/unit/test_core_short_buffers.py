"""Buffers of another length change the time that NumPy takes, and no bit."""

from collections.abc import Callable

import numpy as np
import pytest

from turnout.study.sweep.row import short_buffers

ALONG_AN_AXIS = (
    lambda values: values.mean(axis=-1, keepdims=True),
    lambda values: values.sum(axis=0),
    lambda values: np.cumsum(values, axis=-1),
    lambda values: (values - values[:, :1]) / np.arange(1, values.shape[1] + 1),
    lambda values: values.astype(np.float32).sum(axis=-1),
)


@pytest.mark.parametrize("count", [100, 1076, 9000])
@pytest.mark.parametrize("made", ALONG_AN_AXIS)
def test_no_bit_depends_on_them(made: Callable[[np.ndarray], np.ndarray], count: int) -> None:
    values = np.random.default_rng(count).normal(size=(32, count + 3))[:, :count]
    expected = made(values)
    with short_buffers():
        found = made(values)
    assert found.tobytes() == expected.tobytes()


def test_the_length_is_restored_after_an_error() -> None:
    before = np.getbufsize()
    with pytest.raises(ValueError, match="some"), short_buffers():
        int("some")
    assert np.getbufsize() == before
