"""Machine code of the functions of `turnout.kernels.lanes`."""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.extending import models, register_model

from turnout.kernels import lanes
from turnout.kernels.intrinsic import array_of, index_kind, number_kind, register_intrinsic
from turnout.kernels.lanes import LANES

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


def _eight(kind: Any) -> Any:
    return kind if kind == _LANES else None


def _flags(kind: Any) -> Any:
    return kind if kind == _FLAGGED else None


_values, _places = array_of(types.float64), array_of(types.int64, types.uint64)


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


def _build_gather_neighbours(context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    values, places, at = args
    whole = ir.IntType(64)
    eight = ir.VectorType(whole, LANES)
    start = builder.bitcast(builder.gep(places.data, [at]), eight.as_pointer())
    found_places = builder.load(start, align=8)
    first = builder.extract_element(found_places, ir.Constant(ir.IntType(32), 0))
    zero = ir.Constant(ir.IntType(32), 0)
    one = builder.insert_element(ir.Constant(eight, ir.Undefined), first, zero)
    all_first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    splat = builder.shuffle_vector(one, ir.Constant(eight, ir.Undefined), all_first)
    expected = builder.add(splat, ir.Constant(eight, list(range(LANES))))
    same = builder.bitcast(builder.icmp_unsigned("==", found_places, expected), ir.IntType(LANES))
    neighbours = builder.icmp_unsigned("==", same, ir.Constant(ir.IntType(LANES), 2**LANES - 1))
    with builder.if_else(neighbours, likely=True) as (then, otherwise):
        with then:
            together, after_together = _build_load(context, builder, (values, first)), builder.block
        with otherwise:
            apart, after_apart = _build_gather(context, builder, args), builder.block
    found = builder.phi(_EIGHT)
    found.add_incoming(together, after_together)
    found.add_incoming(apart, after_apart)
    return found


def _build_turn(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    values, step, to, to_step = args

    def place(array: Any, row: int, width: Any) -> Any:
        return _eight_at(builder, array, builder.mul(width, ir.Constant(ir.IntType(64), row)))

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
    kind, beside = ir.VectorType(ir.IntType(32), LANES), LANES - size
    left = [lane + beside if lane & size else lane for lane in range(LANES)]
    right = [lane + size for lane in left]
    for row in range(LANES):
        if not row & size:
            pair = rows[row], rows[row + size]
            found[row] = builder.shuffle_vector(*pair, ir.Constant(kind, left))
            found[row + size] = builder.shuffle_vector(*pair, ir.Constant(kind, right))
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


def _build_multiply_add(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    kind = ir.FunctionType(_EIGHT, [_EIGHT, _EIGHT, _EIGHT])
    fma = get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f64")
    return builder.call(fma, args)


def _build_multiply_add_one(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()] * 3)
    return builder.call(get_or_insert_function(builder.module, kind, "llvm.fma.f64"), args)


def _build_greater(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.fcmp_ordered(">", *args)


def _build_greater_or_nan(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.fcmp_unordered(">", *args)


def _build_logical_or(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.or_(*args)


def _build_select(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    return builder.select(*args)


def _build_any_true(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    together = builder.bitcast(args[0], ir.IntType(LANES))
    return builder.icmp_unsigned("!=", together, ir.Constant(ir.IntType(LANES), 0))


def _register_lanes() -> None:
    register_intrinsic(lanes.load, _LANES, _build_load, _values, index_kind)
    register_intrinsic(lanes.store, types.none, _build_store, _eight, _values, index_kind)
    register_intrinsic(
        lanes.store_nontemporal, types.none, _build_store_nontemporal, _eight, _values, index_kind
    )
    register_intrinsic(lanes.gather, _LANES, _build_gather, _values, _places, index_kind)
    register_intrinsic(
        lanes.gather_neighbours, _LANES, _build_gather_neighbours, _values, _places, index_kind
    )
    register_intrinsic(
        lanes.turn, types.none, _build_turn, _values, index_kind, _values, index_kind
    )
    register_intrinsic(lanes.broadcast, _LANES, _build_broadcast, number_kind)
    register_intrinsic(lanes.horizontal_sum, types.float64, _build_horizontal_sum, _eight)
    register_intrinsic(lanes.multiply_add, _LANES, _build_multiply_add, _eight, _eight, _eight)
    one = (number_kind, number_kind, number_kind)
    register_intrinsic(lanes.multiply_add_one, types.float64, _build_multiply_add_one, *one)
    register_intrinsic(lanes.absolute, _LANES, _build_absolute, _eight)
    register_intrinsic(lanes.greater, _FLAGGED, _build_greater, _eight, _eight)
    register_intrinsic(lanes.greater_or_nan, _FLAGGED, _build_greater_or_nan, _eight, _eight)
    register_intrinsic(lanes.logical_or, _FLAGGED, _build_logical_or, _flags, _flags)
    register_intrinsic(lanes.select, _LANES, _build_select, _flags, _eight, _eight)
    register_intrinsic(lanes.any_true, types.boolean, _build_any_true, _flags)


def _arithmetic() -> None:
    """Register +, -, * and / of eight by eight floats."""
    for sign, name in (
        *((operator.add, "fadd"), (operator.sub, "fsub")),
        *((operator.mul, "fmul"), (operator.truediv, "fdiv")),
    ):

        def build(_context: Any, builder: Any, args: tuple[Any, ...], name: str = name) -> Any:
            return getattr(builder, name)(*args)

        register_intrinsic(sign, _LANES, build, _eight, _eight, lowered=(_Lanes, _Lanes))


_register_lanes()
_arithmetic()
