"""Machine code of the functions of `turnout.kernels.lanes`."""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.extending import models, register_model

from turnout.kernels import lanes
from turnout.kernels.intrinsic import array_of, index_kind, intrinsic_code, number_kind
from turnout.kernels.lanes import LANES

_EIGHT = ir.VectorType(ir.DoubleType(), LANES)
_FLAGS = ir.VectorType(ir.IntType(1), LANES)
_WHOLE, _AT = ir.IntType(64), ir.IntType(32)
"""Indices of an array, and within eight values."""


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


def _eight(kind: Any) -> Any:
    return kind if kind == _LANES else None


def _flags(kind: Any) -> Any:
    return kind if kind == _FLAGGED else None


_values, _places = array_of(types.float64), array_of(types.int64, types.uint64)


def _eight_at(builder: Any, array: Any, at: Any) -> Any:
    return builder.bitcast(builder.gep(array.data, [at]), _EIGHT.as_pointer())


def _shuffle(builder: Any, lanes_of: list[int], one: Any, other: Any = None) -> Any:
    """Return lanes of one vector, or of two of which those of the second are counted on."""
    other = ir.Constant(one.type, ir.Undefined) if other is None else other
    kind = ir.VectorType(_AT, len(lanes_of))
    return builder.shuffle_vector(one, other, ir.Constant(kind, lanes_of))


@intrinsic_code(lanes.load, _LANES, _values, index_kind)
def _load(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.load(_eight_at(builder, *args), align=8)


@intrinsic_code(lanes.store, types.none, _eight, _values, index_kind)
def _store(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    eight, array, at = args
    builder.store(eight, _eight_at(builder, array, at), align=8)


@intrinsic_code(lanes.store_nontemporal, types.none, _eight, _values, index_kind)
def _store_nontemporal(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    eight, array, at = args
    instruction = builder.store(eight, _eight_at(builder, array, at), align=8 * LANES)
    one = ir.Constant(_AT, 1)
    instruction.set_metadata("nontemporal", builder.module.add_metadata([one]))


@intrinsic_code(lanes.gather, _LANES, _values, _places, index_kind)
def _gather(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    values, places, at = args
    found = ir.Constant(_EIGHT, ir.Undefined)
    for lane in range(LANES):
        index = builder.add(at, ir.Constant(_WHOLE, lane))
        place = builder.load(builder.gep(places.data, [index]))
        value = builder.load(builder.gep(values.data, [place]))
        found = builder.insert_element(found, value, ir.Constant(_AT, lane))
    return found


@intrinsic_code(lanes.turn, types.none, _values, index_kind, _values, index_kind)
def _turn(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    values, step, to, to_step = args

    def place(array: Any, row: int, width: Any) -> Any:
        return _eight_at(builder, array, builder.mul(width, ir.Constant(_WHOLE, row)))

    rows = [builder.load(place(values, row, step), align=8) for row in range(LANES)]
    apart = 1
    while apart < LANES:  # rows and columns change places in blocks of 1, then 2, then 4
        rows = _exchange_blocks(builder, rows, apart)
        apart *= 2
    for row, eight in enumerate(rows):
        builder.store(eight, place(to, row, to_step), align=8)


def _exchange_blocks(builder: Any, rows: list[Any], size: int) -> list[Any]:
    """Exchange the blocks beside the diagonal, of all blocks of twice the size."""
    found = list(rows)
    left = [lane + LANES - size if lane & size else lane for lane in range(LANES)]
    right = [lane + size for lane in left]
    for row in range(LANES):
        if not row & size:
            pair = rows[row], rows[row + size]
            found[row] = _shuffle(builder, left, *pair)
            found[row + size] = _shuffle(builder, right, *pair)
    return found


@intrinsic_code(lanes.broadcast, _LANES, number_kind)
def _broadcast(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    nothing = ir.Constant(_EIGHT, ir.Undefined)
    return _shuffle(
        builder, [0] * LANES, builder.insert_element(nothing, args[0], ir.Constant(_AT, 0))
    )


@intrinsic_code(lanes.horizontal_sum, types.float64, _eight)
def _horizontal_sum(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    part = args[0]
    for half in (4, 2, 1):
        low, high = (
            _shuffle(builder, list(range(first, first + half)), part) for first in (0, half)
        )
        part = builder.fadd(low, high)
    return builder.extract_element(part, ir.Constant(_AT, 0))


@intrinsic_code(lanes.any_true, types.boolean, _flags)
def _any_true(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    together = builder.bitcast(args[0], ir.IntType(LANES))
    return builder.icmp_unsigned("!=", together, ir.Constant(ir.IntType(LANES), 0))


def _register_instructions() -> None:
    """Register functions and operators that are one instruction or function of LLVM each."""

    def instruction(name: str, *first: str) -> Any:
        return lambda _context, builder, args: getattr(builder, name)(*first, *args)

    def function(name: str) -> Any:
        def build(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
            kinds = [value.type for value in args]
            kind = ir.FunctionType(kinds[0], kinds)
            return builder.call(get_or_insert_function(builder.module, kind, name), args)

        return build

    two = (_eight, _eight)
    for of, result, build, *wanted in (
        (lanes.greater, _FLAGGED, instruction("fcmp_ordered", ">"), *two),
        (lanes.greater_or_nan, _FLAGGED, instruction("fcmp_unordered", ">"), *two),
        (lanes.logical_or, _FLAGGED, instruction("or_"), _flags, _flags),
        (lanes.select, _LANES, instruction("select"), _flags, *two),
        (lanes.absolute, _LANES, function(f"llvm.fabs.v{LANES}f64"), _eight),
        (lanes.multiply_add, _LANES, function(f"llvm.fma.v{LANES}f64"), _eight, *two),
    ):
        intrinsic_code(of, result, *wanted)(build)
    for sign, name in (
        *((operator.add, "fadd"), (operator.sub, "fsub")),
        *((operator.mul, "fmul"), (operator.truediv, "fdiv")),
    ):
        intrinsic_code(sign, _LANES, *two, lowered=(_Lanes, _Lanes))(instruction(name))


_register_instructions()
