"""Files of batches: copies of a template that are filled in, their chunks compressed."""

import importlib.util
import io
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest

from turnout.study.sweep import batch_bytes as batch_file
from turnout.study.sweep.batch import BatchOrigin, StoredVariable
from turnout.study.sweep.batch_bytes import LARGEST_CHUNK, deflate_chunk, file_bytes


def _variables(seed: int, *, name: str = "a", units: str = "N") -> dict[str, StoredVariable]:
    random = np.random.default_rng(seed)
    about = {"units": units, "long_name": "any"}
    return {
        "scenario": StoredVariable(("scenario",), np.arange(9), about, coordinate=True),
        "time": StoredVariable(("time",), random.normal(size=70), about, coordinate=True),
        "name": StoredVariable(("scenario",), np.array([name] * 9), about, coordinate=True),
        "short": StoredVariable(("scenario",), np.array([b"ab"] * 9), about, coordinate=True),
        "force": StoredVariable(("scenario", "time"), random.normal(size=(9, 70)), about, False),
        "slipped": StoredVariable(("scenario",), random.integers(0, 2, size=9), about, False),
    }


def _assert_holds(content: bytes, variables: dict[str, StoredVariable]) -> None:
    with h5py.File(io.BytesIO(content)) as file:
        assert set(file) == set(variables)
        for name, variable in variables.items():
            found = file[name]
            text = variable.values.dtype.kind == "U"
            values = found.asstr()[...] if text else found[...]
            np.testing.assert_array_equal(values, variable.values)
            assert {key: found.attrs[key] for key in variable.attributes} == variable.attributes
            if variable.dims != (name,):
                dims = tuple(scale[0].name.removeprefix("/") for scale in found.dims)
                assert dims == variable.dims
        assert file["force"].attrs["coordinates"] == "name short"


def test_values_are_the_same_without_isal(monkeypatch: pytest.MonkeyPatch) -> None:
    assert batch_file._zlib.__name__.startswith("isal")
    monkeypatch.setitem(sys.modules, "isal", None)
    found = importlib.util.find_spec(batch_file.__name__)
    assert found is not None
    assert found.loader is not None
    plain = importlib.util.module_from_spec(found)
    found.loader.exec_module(plain)
    assert plain._zlib is zlib
    values = _measured(8, 3000)
    chunks = [module.deflate_chunk(values) for module in (batch_file, plain)]
    assert zlib.decompress(chunks[0]) == zlib.decompress(chunks[1])
    assert len(chunks[0]) == pytest.approx(len(chunks[1]), rel=0.1)
    variables = _variables(1)
    variables["force"] = batch_file.StoredVariable(
        ("scenario", "time"), np.nan_to_num(_measured(9, 70)), variables["force"].attributes, False
    )
    _assert_holds(plain.file_bytes(variables), variables)


def test_file_of_a_template_that_served_others_has_its_own_values() -> None:
    first, second = _variables(1), _variables(2, name="another name")
    alone = []
    for variables in (first, second):
        batch_file._templates.clear()
        alone.append(file_bytes(variables))
        _assert_holds(alone[-1], variables)
    assert [file_bytes(first), file_bytes(second), file_bytes(first)] == [*alone, alone[0]]


@pytest.mark.parametrize(
    "change",
    [
        {"units": "m"},
        {"name": "scenarios of another length"},
    ],
)
def test_what_a_file_says_of_its_variables_is_its_own(change: dict[str, str]) -> None:
    file_bytes(_variables(1))
    _assert_holds(file_bytes(_variables(1, **change)), _variables(1, **change))


def test_origin_is_that_of_the_batch_and_not_of_the_template() -> None:
    for number in ("1", "2"):
        origin = BatchOrigin("study", "0.1", "code", number)
        with h5py.File(io.BytesIO(file_bytes(_variables(1), origin=origin))) as file:
            assert file.attrs["origin"] == str(origin)
    with h5py.File(io.BytesIO(file_bytes(_variables(1)))) as file:
        assert "origin" not in file.attrs


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
    noise = np.random.default_rng(2).integers(0, 256, size=1 << 18, dtype=np.uint8)
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


def test_files_made_at_once_are_those_made_one_by_one() -> None:
    given = [_variables(seed, name=f"name {seed % 3}") for seed in range(24)]
    origin = BatchOrigin(study="a", version="b", code="c", batch="1")
    alone = [file_bytes(variables, origin=origin) for variables in given]
    batch_file._templates.clear()
    with ThreadPoolExecutor(4) as pool:
        at_once = list(pool.map(lambda variables: file_bytes(variables, origin=origin), given))
    assert at_once == alone


@pytest.mark.parametrize("kind", ["<f4", "<f8", "i1"])
def test_rows_that_are_all_the_same_take_no_copies(kind: str) -> None:
    row = np.random.default_rng(5).normal(size=(2, 3000)).astype(kind)
    about = {"units": "m", "long_name": "any"}
    scenario = StoredVariable(("scenario",), np.arange(9), about, coordinate=True)
    axes = {
        "drive": StoredVariable(("drive",), np.arange(2), about, coordinate=True),
        "time": StoredVariable(("time",), np.arange(3000), about, coordinate=True),
    }
    dims, alike = ("scenario", "drive", "time"), np.broadcast_to(row, (9, 2, 3000))
    found = [
        file_bytes({"scenario": scenario, **axes, "a": StoredVariable(dims, values, about, False)})
        for values in (alike, alike.copy(), alike)
    ]
    assert found[0] == found[1] == found[2]
    with h5py.File(io.BytesIO(found[0])) as file:
        np.testing.assert_array_equal(file["a"][...], alike)
