"""The two ways of compiling kernels, what neither lets into machine code, and building ahead."""

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.cpython import slicing

from turnout.kernels import compiled as kept
from turnout.kernels import compiler, machine_code, plain_code
from turnout.kernels.compiled import Kernel, compiled, compiled_loop
from turnout.kernels.machine_code import BUILDER_VARIABLE, LEVELS, built_code, machine_digest
from turnout.kernels.shared_record import shared_record

Floats = np.ndarray
WAYS = ("plain", "public", "unknown")
"""Each way of compiling, and what becomes of a Numba that nobody has tried."""


class Terms(NamedTuple):
    """Arrays of a record."""

    weights: Floats
    matrix: Floats


@compiled_loop
def _add_scaled(a: float, x: Floats, y: Floats) -> None:
    for i in range(y.size):
        y[i] += a * x[i]


@compiled
def _combine(terms: Terms, to: Floats, first: int) -> float:
    """Call another kernel, index from the front and the end, and sum in one order."""
    total = 0.0
    for k in range(first, terms.weights.size):
        _add_scaled(terms.weights[k], terms.matrix[k], to)
        total += math.exp(-abs(to[k])) * terms.weights[-1]
    return total + to[first:].sum()


@compiled
def _fails(values: Floats, count: int) -> float:
    if count > values.size:
        raise ValueError
    return values[0]


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Compile all anew."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.delenv(BUILDER_VARIABLE, raising=False)
    forget()
    yield
    monkeypatch.undo()
    forget()


def forget() -> None:
    for known in (compiler.plain_code, built_code, machine_digest):
        known.cache_clear()


def choose(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", f"{os.environ['NUMBA_CACHE_DIR']}/{way}")
    if way == "public":
        monkeypatch.setenv(BUILDER_VARIABLE, "public")
    if way == "unknown":
        monkeypatch.setattr(plain_code, "KNOWN", ())
    forget()
    for kernel in (_combine, _add_scaled, _fails):
        kernel.__dict__.pop("dispatcher", None)


def again(kernel: object) -> Kernel:
    """The same kernel as a new process has it."""
    assert isinstance(kernel, Kernel)
    return Kernel(kernel.py_func, loop=False, part=False)


def test_all_ways_give_the_same_bits(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    terms, start = Terms(rng.normal(size=9), rng.normal(size=(9, 13))), rng.normal(size=13)
    expected, totals = start.copy(), set[float]()
    plain = _combine.py_func(terms, expected, 2)  # type: ignore[attr-defined]
    for way in WAYS:
        with monkeypatch.context() as changed:
            choose(way, changed)
            to = start.copy()
            totals.add(again(_combine)(shared_record(terms), to, 2))
        np.testing.assert_array_equal(to, expected)
        said = f"the first start takes longer with numba {numba.__version__}\n"
        assert capsys.readouterr().err == (said if way == "unknown" else "")
    assert len(totals) == 1
    assert math.isclose(totals.pop(), plain, rel_tol=1e-14)


@pytest.mark.parametrize("way", WAYS[:2])
def test_a_kernel_that_fails_says_so_and_ends_nothing(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    choose(way, monkeypatch)
    kernel = again(_fails)
    assert kernel(np.array([2.5]), 1) == 2.5
    with pytest.raises(RuntimeError, match=r"_fails-\w+: failed"):
        kernel(np.array([2.5]), 2)


def test_what_is_in_no_process_without_numba_is_refused() -> None:
    @compiled
    def gamma(x: float) -> float:
        return math.gamma(x)

    with pytest.raises(TypeError, match="calls numba_gamma, which no kernel can"):
        gamma(2.0)


def test_numba_is_left_as_it_was() -> None:
    before = slicing.fix_index, numba.config.OPT
    again(_fails)(np.array([2.5]), 1)
    assert (slicing.fix_index, numba.config.OPT) == before

    @numba.njit  # type: ignore[misc]
    def last(values: Floats, at: int) -> float:
        return values[at]

    assert last(np.arange(4.0), -1) == 3.0


def test_kernels_built_ahead_are_loaded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(machine_code, "BUILT", tmp_path)
    kernel, kinds = again(_fails), (("array", "<f8", 1, "C", True), "int")
    name = kernel.identity(kinds)
    assert name is not None
    assert not kernel.is_kept()
    files = compiler.build_ahead([(kernel.dispatcher, kinds)], [name])
    assert [file.name.partition("-")[2] for file in files] == [f"{one}.kernel" for one in LEVELS]
    built_code.cache_clear()
    later = again(_fails)
    assert later.is_kept()
    monkeypatch.setattr(kept, "machine_digest", None)  # which a look into the cache asks for
    assert later(np.array([2.5]), 1) == 2.5
    monkeypatch.undo()
    monkeypatch.setenv("NUMBA_CPU_NAME", "x86-64")  # for which other code is made
    monkeypatch.setattr(machine_code, "BUILT", tmp_path)
    forget()
    assert not again(_fails).is_kept()
