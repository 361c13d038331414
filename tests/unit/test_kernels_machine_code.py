"""Kernels: what they take and return, and machine code that is loaded without a compiler."""

import errno
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.faults.terminal import run_code

from turnout.kernels.arguments import ARRAY, NUMBER, add_argument
from turnout.kernels.compiled import CACHE_VARIABLE, Kernel, compiled
from turnout.kernels.machine_code import MachineCode, machine_digest
from turnout.solver.columns import invert

Floats = np.ndarray


class Factors(NamedTuple):
    """Numbers of several kinds."""

    share: float
    count: int
    wanted: bool


class Outcome(NamedTuple):
    """What a kernel returns."""

    total: float
    factors: Factors
    first: int


@compiled
def _weigh(factors: Factors, values: tuple[Floats, Floats], other: None, scale: float) -> Outcome:
    total = 0.0
    first, second = values
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            total += scale * (10 * i + j + 1) * first[i, j]
    for i in range(second.shape[0]):
        for j in range(second.shape[1]):
            total += scale * (10 * i + j + 1) * second[i, j]
    again = Factors(2 * factors.share, factors.count - 5, not factors.wanted)
    return Outcome(total if factors.wanted else 0.0, again, -7)


def weighed() -> tuple[Factors, tuple[Floats, Floats]]:
    rng = np.random.default_rng(4)
    return Factors(0.25, 3, True), (rng.normal(size=(3, 4))[:, ::2], rng.normal(size=(2, 5)).T)


def test_arguments_and_results_of_all_kinds_arrive() -> None:
    factors, values = weighed()
    found = _weigh(factors, values, None, 2.0)
    plain = _weigh.py_func(factors, values, None, 2.0)  # type: ignore[attr-defined]
    assert type(found) is Outcome
    assert type(found.factors) is Factors
    assert found.factors == plain.factors == (0.5, -2, False)
    assert found.first == -7
    assert math.isclose(found.total, plain.total, rel_tol=1e-14)


def test_names_and_numbers_of_numpy_are_taken() -> None:
    factors, values = weighed()
    given = Factors(np.float64(0.25), np.int64(3), np.bool_(True))
    found = _weigh(given, values, scale=np.float32(2.0), other=None)  # type: ignore[arg-type]
    assert found == _weigh(factors, values, None, 2.0)


@pytest.mark.parametrize("wrong", ["text", [1.0], {"a": 1}, object()])
def test_what_no_kernel_takes_is_refused(wrong: object) -> None:
    with pytest.raises(TypeError, match="a kernel takes numbers, arrays, records"):
        add_argument(wrong, [], [])


def test_arrays_that_are_not_aligned_are_refused() -> None:
    shifted = np.zeros(17, dtype=np.uint8)[1:].view(np.float64)
    with pytest.raises(TypeError, match="pass a copy"):
        add_argument(shifted, [], [])


def test_what_may_not_be_written_is_of_another_kind() -> None:
    values = np.zeros(3)
    values.flags.writeable = False
    kinds: list[object] = []
    add_argument(values, [], kinds)
    assert kinds == [(ARRAY, "<f8", 1, "C", False)]


@compiled
def _double(x: float) -> float:
    return 2.0 * x


@pytest.fixture
def double(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Kernel:
    """A kernel with a cache of its own."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    return Kernel(_double.py_func, loop=False, part=False)  # type: ignore[attr-defined]


def again(kernel: Kernel) -> Kernel:
    """The same kernel as a new process has it."""
    return Kernel(kernel.py_func, loop=False, part=False)


def test_machine_code_comes_from_its_file(double: Kernel, tmp_path: Path) -> None:
    assert not double.is_kept()
    assert (double(3.0), double.cache_hits) == (6.0, 0)
    assert double.is_kept()
    later = again(double)
    assert (later(3.0), later.cache_hits) == (6.0, 1)
    assert [file.suffix for file in tmp_path.iterdir()] == [".kernel"]


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty"])
def test_a_damaged_file_is_made_again(double: Kernel, damage: str) -> None:
    double(3.0)
    file = double.file_for((NUMBER,))
    assert file is not None
    content = bytearray(file.read_bytes())
    content[-9] ^= 1
    damaged = {"cut": content[:-20], "flipped": content, "empty": b""}
    file.write_bytes(damaged[damage])
    later = again(double)
    assert (later(3.0), later.cache_hits) == (6.0, 0)
    assert MachineCode.from_file(file) is not None


@pytest.mark.parametrize(
    ("variable", "value"),
    [("NUMBA_CPU_NAME", "x86-64"), ("NUMBA_BOUNDSCHECK", "1"), ("TURNOUT_KERNELS", "public")],
)
def test_another_processor_choice_or_kind_has_a_file_of_its_own(
    double: Kernel, monkeypatch: pytest.MonkeyPatch, variable: str, value: str
) -> None:
    monkeypatch.delenv(variable, raising=False)
    machine_digest.cache_clear()
    double(3.0)
    here = double.file_for((NUMBER,))
    assert double.file_for(("int",)) != here
    monkeypatch.setenv(variable, value)
    machine_digest.cache_clear()
    try:
        assert double.file_for((NUMBER,)) != here
        assert not again(double).is_kept()
    finally:
        monkeypatch.undo()
        machine_digest.cache_clear()


@pytest.mark.parametrize("disk", ["missing", "full"])
def test_a_file_that_cannot_be_written_stops_nothing(
    double: Kernel, disk: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    if disk == "missing":
        monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "missing"))
    else:
        monkeypatch.setattr("turnout.kernels.compiled.write_atomic", full)
    assert double(3.0) == 6.0
    assert not again(double).is_kept()


@pytest.mark.parametrize("count", [1, 7, 70, 130])
def test_an_inverse_is_that_of_lapack_in_numpy(count: int) -> None:
    matrix = np.random.default_rng(count).normal(size=(count, count)) + 3 * np.eye(count)
    found, plain = np.zeros_like(matrix), np.zeros_like(matrix)
    invert(matrix.copy(), found)
    invert.py_func(matrix.copy(), plain)  # type: ignore[attr-defined]
    np.testing.assert_allclose(found @ matrix, np.eye(count), rtol=0, atol=1e-11)
    np.testing.assert_array_equal(found, plain)


@pytest.mark.parametrize("wrong", [np.zeros((3, 3)), np.full((2, 2), np.nan), np.ones((2, 2))])
def test_what_has_no_inverse_gives_nan(wrong: Floats) -> None:
    found = np.zeros_like(wrong)
    invert(wrong.copy(), found)
    assert np.isnan(found).all()


THROW = """
import sys
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate
panel = load_panel("sb1")
simulate(panel, mode="quick")
print("numba" in sys.modules)
"""


def test_a_throw_with_kernels_at_hand_loads_no_compiler() -> None:
    # The first may have to compile.
    assert "False" in [run_code(THROW).strip() for _ in range(2)]
