"""Machine code of the functions of `turnout.kernels.memory`."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function

from turnout.kernels import memory
from turnout.kernels.intrinsic import array_of, array_value, index_kind, register_intrinsic

_WORD, _BYTES = ir.IntType(64), ir.IntType(8).as_pointer()
_MATRIX, _VECTOR = (types.Array(types.float64, ndim, "C") for ndim in (2, 1))


def acquire(builder: Any, size: Any) -> Any:
    """Emit a call that takes some bytes of memory."""
    kind = ir.FunctionType(_BYTES, [_WORD])
    return builder.call(get_or_insert_function(builder.module, kind, "malloc"), [size])


def release(builder: Any, place: Any) -> None:
    """Emit a call that gives memory back."""
    kind = ir.FunctionType(ir.VoidType(), [_BYTES])
    free = get_or_insert_function(builder.module, kind, "free")
    builder.call(free, [builder.bitcast(place, _BYTES)])


def _build_acquire_matrix(context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    rows, columns = args
    eight = ir.Constant(_WORD, 8)
    row = builder.mul(columns, eight)
    place = acquire(builder, builder.add(builder.mul(rows, row), eight))
    address = builder.ptrtoint(place, _WORD)
    return array_value(context, builder, _MATRIX, address, [rows, columns], [row, eight])


def _build_release_matrix(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    release(builder, args[0].data)


def _build_vector_at(context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    address, size = args
    return array_value(context, builder, _VECTOR, address, [size], [ir.Constant(_WORD, 8)])


register_intrinsic(memory.acquire_matrix, _MATRIX, _build_acquire_matrix, index_kind, index_kind)
register_intrinsic(
    memory.release_matrix, types.none, _build_release_matrix, array_of(types.float64, ndim=2)
)
register_intrinsic(memory.vector_at, _VECTOR, _build_vector_at, index_kind, index_kind)
