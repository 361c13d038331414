"""Machine code of the functions of `turnout.kernels.memory`."""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.cgutils import get_or_insert_function
from numba.np.arrayobj import make_array, populate_array

from turnout.kernels import memory
from turnout.kernels.intrinsic import array_of, index_kind, register_intrinsic

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
    array = make_array(_MATRIX)(context, builder)
    eight = ir.Constant(_WORD, 8)
    row = builder.mul(columns, eight)
    place = acquire(builder, builder.add(builder.mul(rows, row), eight))
    populate_array(
        array,
        data=builder.bitcast(place, array.data.type),
        shape=[rows, columns],
        strides=[row, eight],
        itemsize=eight,
        meminfo=None,
    )
    return array._getvalue()


def _build_release_matrix(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    release(builder, args[0].data)


def _build_vector_at(context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    address, size = args
    array, eight = make_array(_VECTOR)(context, builder), ir.Constant(_WORD, 8)
    populate_array(
        array,
        data=builder.inttoptr(address, array.data.type),
        shape=[size],
        strides=[eight],
        itemsize=eight,
        meminfo=None,
    )
    return array._getvalue()


register_intrinsic(memory.acquire_matrix, _MATRIX, _build_acquire_matrix, index_kind, index_kind)
register_intrinsic(
    memory.release_matrix, types.none, _build_release_matrix, array_of(types.float64, ndim=2)
)
register_intrinsic(memory.vector_at, _VECTOR, _build_vector_at, index_kind, index_kind)
