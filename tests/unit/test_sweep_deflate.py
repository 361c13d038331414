"""Chunks of a sweep's files: any reader finds the numbers that were given."""

import io
import zlib

import h5py
import numpy as np
import pytest

from turnout.sweep.batch import StoredVariable
from turnout.sweep.batch_file import LARGEST_CHUNK, file_bytes
from turnout.sweep.deflate import SMALL, deflate_chunk


def _measured(rows: int, count: int) -> np.ndarray:
    """Return noise, silence and what repeats itself, a third of each row."""
    rng = np.random.default_rng(1)
    values = np.zeros((rows, count), dtype=np.float32)
    values[:, : count // 3] = rng.standard_normal((rows, count // 3))
    values[:, -(count // 3) :] = np.sin(np.arange(count // 3))
    values[0, 0] = np.nan
    return values


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64, np.int8])
@pytest.mark.parametrize("rows", [1, 40])
def test_chunk_is_a_stream_of_shuffled_bytes(dtype: type, rows: int) -> None:
    values = np.nan_to_num(_measured(rows, 2000) * 50).astype(dtype)
    wanted = np.ascontiguousarray(values.reshape(-1).view(np.uint8).reshape(values.size, -1).T)
    assert zlib.decompress(deflate_chunk(values)) == wanted.tobytes()


def test_noise_takes_no_more_than_itself() -> None:
    noise = np.random.default_rng(2).integers(0, 256, size=4 * SMALL, dtype=np.uint8)
    assert len(deflate_chunk(noise.view(np.float32))) < 1.01 * noise.nbytes


@pytest.mark.parametrize("extra", [0, 7])
def test_file_has_the_values_in_one_chunk_or_several(extra: int) -> None:
    count = 1000
    rows = 2 * LARGEST_CHUNK // (4 * count) + extra
    values = _measured(rows, count)
    variables = {
        "x": StoredVariable(("x",), np.arange(rows), {}, coordinate=True),
        "y": StoredVariable(("y",), np.arange(count), {}, coordinate=True),
        "signal": StoredVariable(("x", "y"), values, {}, coordinate=False),
    }
    content = file_bytes(variables)
    assert content == file_bytes(variables)
    assert len(content) < 0.6 * values.nbytes
    with h5py.File(io.BytesIO(content)) as file:
        np.testing.assert_array_equal(file["signal"][...], values)
        np.testing.assert_array_equal(file["x"][...], np.arange(rows))
        chunk = file["signal"].chunks
        assert chunk is not None
        assert values.itemsize * np.prod(chunk) <= LARGEST_CHUNK


@pytest.mark.parametrize("dtype", ["<f4", "<f8", ">f4", ">f8", "i1", "<i8", ">i4", "S700"])
@pytest.mark.parametrize("shape", [(130, 900), (130, 9, 100), (3, 2, 45_000)])
def test_file_has_values_of_every_kind_and_shape(dtype: str, shape: tuple[int, ...]) -> None:
    values = (100 * _measured(1, int(np.prod(shape)))).reshape(shape)
    if dtype.startswith("S"):
        values = np.char.encode(values[..., :9].astype(str)).astype(dtype)
    elif np.dtype(dtype).kind == "i":
        values = np.nan_to_num(values).clip(-128, 127)
    values = values.astype(dtype)
    dims = ("x", "y", "z")[: values.ndim]
    variables = {
        name: StoredVariable((name,), np.arange(size), {}, coordinate=True)
        for name, size in zip(dims, values.shape, strict=True)
    }
    variables["signal"] = StoredVariable(dims, values, {}, coordinate=False)
    with h5py.File(io.BytesIO(file_bytes(variables))) as file:
        found = file["signal"]
        assert found.chunks is not None
        np.testing.assert_array_equal(found[...], values)
        assert found.dtype == values.dtype
