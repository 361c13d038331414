"""SIMD operations on eight floats at a time, for kernels whose loops are short.

A compiler vectorises long loops well, but a rail has a few lanes of most things, and such a loop
then consists of its prologue and its remainder. Here a kernel states the vector operations itself.
Reductions keep eight partial sums and add them in one order, and products are rounded before they
are added, so that results have the same bits on every processor.

Store-to-load forwarding works only where a load lies within one earlier store: eight floats of
which one was written alone have to wait for the cache. Kernels therefore write eight at once what
they read eight at once.

Vectors must be padded to whole cache lines, as those of `turnout.kernels.shared_record` are, since
the last eight may reach beyond the end. In Python the same functions work on padded vectors.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.cgutils import get_or_insert_function
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import models, register_model
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.int64] | NDArray[np.uint64]

LANES = 8
"""Floats of one SIMD operation; they fill a cache line."""

Count = TypeVar("Count", int, NDArray[np.int64])


def whole_lines(count: Count) -> Count:
    """Round numbers of floats up to whole cache lines.

    Examples
    --------
    >>> whole_lines(9), whole_lines(np.array([1, 8, 9])).tolist()
    (16, [8, 8, 16])
    """
    return -(-count // LANES) * LANES


def zeros_in_lines(*shape: int) -> Floats:
    """Return zeros that begin at a cache line and end with one.

    Examples
    --------
    >>> zeros_in_lines(2, 3).ctypes.data % (8 * LANES)
    0
    """
    count = int(math.prod(shape))
    memory = np.zeros(whole_lines(count) + LANES)
    first = (-(memory.ctypes.data // 8)) % LANES
    return memory[first : first + count].reshape(shape)


_NUMBER = ir.DoubleType()
_EIGHT = ir.VectorType(_NUMBER, LANES)
_FLAGS = ir.VectorType(ir.IntType(1), LANES)


class _Lanes(types.Type):
    """Numba type of eight floats."""


class _Flags(types.Type):
    """Numba type of eight logical values."""


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Lanes) -> None:
        super().__init__(manager, kind, _EIGHT)


@register_model(_Flags)
class _FlagsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Flags) -> None:
        super().__init__(manager, kind, _FLAGS)


_LANES, _FLAGGED = _Lanes("Lanes"), _Flags("Flags")
F = TypeVar("F", bound=Callable[..., Any])
Build = Callable[[Any, Any, tuple[Any, ...]], Any]


def _intrinsic(result: types.Type, build: Build, *wanted: Callable[[Any], Any]) -> Callable[[F], F]:
    """Register a function as an intrinsic: kernels inline the LLVM code that `build` emits.

    `wanted` maps the type of each argument to the type it is cast to, None where it does not fit.
    """

    def register(function: F) -> F:
        class Template(AbstractTemplate):
            key = function

            def generic(self, args: tuple[Any, ...], _kws: Any) -> Any:
                kinds = [kind(arg) for kind, arg in zip(wanted, args, strict=True)]
                return None if None in kinds else signature(result, *kinds)

        def lower(context: Any, builder: Any, sig: Any, args: tuple[Any, ...]) -> Any:
            given = tuple(
                make_array(kind)(context, builder, arg) if isinstance(kind, types.Array) else arg
                for kind, arg in zip(sig.args, args, strict=True)
            )
            found = build(context, builder, given)
            return context.get_dummy_value() if result is types.none else found

        infer_global(function, types.Function(Template))
        lower_builtin(function, types.VarArg(types.Any))(lower)
        return function

    return register


def _vector_of(*numbers: types.Type) -> Callable[[Any], Any]:
    def vector(kind: Any) -> Any:
        fits = isinstance(kind, types.Array) and kind.ndim == 1 and kind.layout == "C"
        return kind if fits and kind.dtype in numbers else None

    return vector


def _number(kind: Any) -> Any:
    return types.float64 if isinstance(kind, types.Number) else None


def _index(kind: Any) -> Any:
    return types.int64 if isinstance(kind, types.Integer) else None


def _eight(kind: Any) -> Any:
    return kind if kind == _LANES else None


def _flags(kind: Any) -> Any:
    return kind if kind == _FLAGGED else None


_values, _places = _vector_of(types.float64), _vector_of(types.int64, types.uint64)


def _eight_at(builder: Any, array: Any, at: Any) -> Any:
    return builder.bitcast(builder.gep(array.data, [at]), _EIGHT.as_pointer())


def _build_load(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.load(_eight_at(builder, *args), align=8)


def _build_store(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    eight, array, at = args
    builder.store(eight, _eight_at(builder, array, at), align=8)


def _build_store_nontemporal(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    eight, array, at = args
    instruction = builder.store(eight, _eight_at(builder, array, at), align=8 * LANES)
    one = ir.Constant(ir.IntType(32), 1)
    instruction.set_metadata("nontemporal", builder.module.add_metadata([one]))


def _build_gather(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    values, places, at = args
    found = ir.Constant(_EIGHT, ir.Undefined)
    for lane in range(LANES):
        place = builder.load(
            builder.gep(places.data, [builder.add(at, ir.Constant(ir.IntType(64), lane))])
        )
        value = builder.load(builder.gep(values.data, [place]))
        found = builder.insert_element(found, value, ir.Constant(ir.IntType(32), lane))
    return found


def _build_broadcast(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    zero = ir.Constant(ir.IntType(32), 0)
    one = builder.insert_element(ir.Constant(_EIGHT, ir.Undefined), args[0], zero)
    all_first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(_EIGHT, ir.Undefined), all_first)


def _build_horizontal_sum(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    part = args[0]
    for half in (4, 2, 1):
        low, high = (
            builder.shuffle_vector(
                part,
                ir.Constant(part.type, ir.Undefined),
                ir.Constant(ir.VectorType(ir.IntType(32), half), list(range(first, first + half))),
            )
            for first in (0, half)
        )
        part = builder.fadd(low, high)
    return builder.extract_element(part, ir.Constant(ir.IntType(32), 0))


def _build_absolute(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    kind = ir.FunctionType(_EIGHT, [_EIGHT])
    fabs = get_or_insert_function(builder.module, kind, f"llvm.fabs.v{LANES}f64")
    return builder.call(fabs, args)


def _build_greater(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.fcmp_ordered(">", *args)


def _build_logical_or(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.or_(*args)


def _build_select(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.select(*args)


def _build_any_true(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    together = builder.bitcast(args[0], ir.IntType(LANES))
    return builder.icmp_unsigned("!=", together, ir.Constant(ir.IntType(LANES), 0))


@_intrinsic(_LANES, _build_load, _values, _index)
def load(values: Floats, at: int) -> Floats:
    """Load eight neighbouring floats from index `at`.

    Examples
    --------
    >>> load(np.arange(20.0), 8).tolist()
    [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0]
    """
    return values[at : at + LANES].copy()


@_intrinsic(types.none, _build_store, _eight, _values, _index)
def store(eight: Floats, to: Floats, at: int) -> None:
    """Store eight floats from index `at`."""
    to[at : at + LANES] = eight


@_intrinsic(types.none, _build_store_nontemporal, _eight, _values, _index)
def store_nontemporal(eight: Floats, to: Floats, at: int) -> None:
    """Store eight floats, aligned to a cache line, past the caches: for what is not read soon."""
    to[at : at + LANES] = eight


@_intrinsic(_LANES, _build_gather, _values, _places, _index)
def gather(values: Floats, places: Indices, at: int) -> Floats:
    """Load ``values[places[at]]`` and the seven that follow."""
    found: Floats = values[places[at : at + LANES]]
    return found


@_intrinsic(_LANES, _build_broadcast, _number)
def broadcast(value: float) -> Floats:
    """Return eight floats of one value."""
    return np.full(LANES, float(value))


@_intrinsic(types.float64, _build_horizontal_sum, _eight)
def horizontal_sum(eight: Floats) -> float:
    """Return the sum of eight floats; the halves are added first.

    Examples
    --------
    >>> horizontal_sum(np.arange(8.0))
    28.0
    """
    part = eight
    for half in (4, 2, 1):
        part = part[:half] + part[half : 2 * half]
    return float(part[0])


@_intrinsic(_LANES, _build_absolute, _eight)
def absolute(eight: Floats) -> Floats:
    """Return eight magnitudes."""
    return np.abs(eight)


@_intrinsic(_FLAGGED, _build_greater, _eight, _eight)
def greater(a: Floats, b: Floats) -> Bools:
    """Compare eight by eight floats, ``a > b``; false where one is NaN."""
    return a > b


@_intrinsic(_FLAGGED, _build_logical_or, _flags, _flags)
def logical_or(one: Bools, other: Bools) -> Bools:
    """Combine eight by eight flags."""
    return one | other


@_intrinsic(_LANES, _build_select, _flags, _eight, _eight)
def select(where: Bools, yes: Floats, no: Floats) -> Floats:
    """Return `yes` where the flag is true, else `no`."""
    return np.where(where, yes, no)


@_intrinsic(types.boolean, _build_any_true, _flags)
def any_true(flags: Bools) -> bool:
    """Return whether any of eight flags is true."""
    return bool(flags.any())


def _arithmetic() -> None:
    """Register +, - and * of eight by eight floats."""
    for sign, name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):

        class Template(AbstractTemplate):
            key = sign

            def generic(self, args: tuple[Any, ...], _kws: Any) -> Any:
                if args == (_LANES, _LANES):
                    return signature(_LANES, *args)
                return None

        infer_global(sign)(Template)

        def lower(_c: Any, builder: Any, _s: Any, args: tuple[Any, ...], name: str = name) -> Any:
            return getattr(builder, name)(*args)

        lower_builtin(sign, _Lanes, _Lanes)(lower)


_arithmetic()
