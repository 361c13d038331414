"""Eight numbers at a time, for kernels whose loops are too short to be left to the compiler.

A compiler turns a long loop into wide instructions, but what a rail has of each kind fits in a few:
loops then consist of their beginnings and ends. Here a kernel says itself what is done to eight
neighbours at once. Sums keep eight parts and add them up in one order, products are rounded before
they are added, so that the numbers are the same on every processor.

A processor hands on what it has just written to what reads just that or a part of it. What reads
eight numbers of which one was written alone must wait for memory: where a number comes from a
kernel, eight are written at once.

Vectors must end with whole lines of memory, as those of `turnout.kernels.records` do: the last
eight may reach beyond the end. In Python the same functions work on vectors of whole lines.
"""

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
"""So many numbers are worked on at a time; they fill a line of the cache."""


def zeros_in_lines(*shape: int) -> Floats:
    """Return zeros that begin with a line of memory and end with one.

    Examples
    --------
    >>> zeros_in_lines(2, 3).ctypes.data % (8 * LANES)
    0
    """
    count = int(np.prod(shape))
    memory = np.zeros(-(-count // LANES) * LANES + LANES)
    first = (-(memory.ctypes.data // 8)) % LANES
    return memory[first : first + count].reshape(shape)


_NUMBER = ir.DoubleType()
_EIGHT = ir.VectorType(_NUMBER, LANES)
_FLAGS = ir.VectorType(ir.IntType(1), LANES)


class _Lanes(types.Type):
    """Eight numbers."""


class _Flags(types.Type):
    """Eight answers."""


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


def _built_by(result: types.Type, build: Build, *wanted: Callable[[Any], Any]) -> Callable[[F], F]:
    """Let kernels do what `build` writes where they call a function with arguments as `wanted`."""

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


def _answers(kind: Any) -> Any:
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
    kept = builder.store(eight, _eight_at(builder, array, at), align=8 * LANES)
    one = ir.Constant(ir.IntType(32), 1)
    kept.set_metadata("nontemporal", builder.module.add_metadata([one]))


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


@_built_by(_LANES, _build_load, _values, _index)
def load(values: Floats, at: int) -> Floats:
    """Return eight neighbours.

    Examples
    --------
    >>> load(np.arange(20.0), 8).tolist()
    [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0]
    """
    return values[at : at + LANES].copy()


@_built_by(types.none, _build_store, _eight, _values, _index)
def store(eight: Floats, to: Floats, at: int) -> None:
    """Write eight neighbours."""
    to[at : at + LANES] = eight


@_built_by(types.none, _build_store_nontemporal, _eight, _values, _index)
def store_nontemporal(eight: Floats, to: Floats, at: int) -> None:
    """Write eight neighbours that begin with a line of memory, which are not read soon."""
    to[at : at + LANES] = eight


@_built_by(_LANES, _build_gather, _values, _places, _index)
def gather(values: Floats, places: Indices, at: int) -> Floats:
    """Return the values at eight neighbouring entries of a list of places."""
    found: Floats = values[places[at : at + LANES]]
    return found


@_built_by(_LANES, _build_broadcast, _number)
def broadcast(value: float) -> Floats:
    """Return a number eight times."""
    return np.full(LANES, float(value))


@_built_by(types.float64, _build_horizontal_sum, _eight)
def horizontal_sum(eight: Floats) -> float:
    """Return the sum, halves first.

    Examples
    --------
    >>> horizontal_sum(np.arange(8.0))
    28.0
    """
    part = eight
    for half in (4, 2, 1):
        part = part[:half] + part[half : 2 * half]
    return float(part[0])


@_built_by(_LANES, _build_absolute, _eight)
def absolute(eight: Floats) -> Floats:
    """Return the magnitudes."""
    return np.abs(eight)


@_built_by(_FLAGGED, _build_greater, _eight, _eight)
def greater(a: Floats, b: Floats) -> Bools:
    """Tell which of eight numbers exceed which others; nothing exceeds NaN, nor NaN anything."""
    return a > b


@_built_by(_FLAGGED, _build_logical_or, _answers, _answers)
def logical_or(one: Bools, other: Bools) -> Bools:
    """Tell where one or the other answer is yes."""
    return one | other


@_built_by(_LANES, _build_select, _answers, _eight, _eight)
def select(where: Bools, yes: Floats, no: Floats) -> Floats:
    """Return one number where the answer is yes, the other where it is no."""
    return np.where(where, yes, no)


@_built_by(types.boolean, _build_any_true, _answers)
def any_true(answers: Bools) -> bool:
    """Tell whether any answer is yes."""
    return bool(answers.any())


def _arithmetic() -> None:
    """Let kernels add, subtract and multiply eights with the usual signs."""
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
