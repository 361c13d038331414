"""Files of batches: copies of a template that are filled in."""

import io

import h5py
import numpy as np
import pytest

from turnout.sweep import batch_file
from turnout.sweep.batch import BatchOrigin, StoredVariable
from turnout.sweep.batch_file import file_bytes


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
