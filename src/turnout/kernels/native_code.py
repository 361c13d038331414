"""Machine code of the functions of `turnout.kernels.native`."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import alloca_once, get_or_insert_function

from turnout.kernels import native
from turnout.kernels.intrinsic import array_of, array_value, index_kind, intrinsic_code
from turnout.kernels.machine_code import LAPACK

_WORD, _INT, _NUMBER = ir.IntType(64), ir.IntType(32), ir.DoubleType()
_BYTES, _INTS, _NUMBERS = (kind.as_pointer() for kind in (ir.IntType(8), _INT, _NUMBER))
_MATRIX, _VECTOR = (types.Array(types.float64, ndim, "C") for ndim in (2, 1))
_EIGHT = ir.Constant(_WORD, 8)
"""Bytes of a number."""
_matrix, _vector = array_of(types.float64, ndim=2), array_of(types.float64)


def _call(builder: Any, name: str, result: Any, *args: Any) -> Any:
    """Emit a call of a function of C or Fortran."""
    kind = ir.FunctionType(result, [value.type for value in args])
    return builder.call(get_or_insert_function(builder.module, kind, name), args)


def _acquire(builder: Any, size: Any) -> Any:
    return _call(builder, "malloc", _BYTES, size)


def _release(builder: Any, place: Any) -> None:
    _call(builder, "free", ir.VoidType(), builder.bitcast(place, _BYTES))


@intrinsic_code(native.acquire_matrix, _MATRIX, index_kind, index_kind)
def _acquire_matrix(context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    rows, columns = args
    row = builder.mul(columns, _EIGHT)
    place = _acquire(builder, builder.add(builder.mul(rows, row), _EIGHT))
    address = builder.ptrtoint(place, _WORD)
    return array_value(context, builder, _MATRIX, address, [rows, columns], [row, _EIGHT])


@intrinsic_code(native.release_matrix, types.none, _matrix)
def _release_matrix(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    _release(builder, args[0].data)


@intrinsic_code(native.vector_at, _VECTOR, index_kind, index_kind)
def _vector_at(context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    address, size = args
    return array_value(context, builder, _VECTOR, address, [size], [_EIGHT])


def _integer(builder: Any, value: Any) -> Any:
    """Return the address of an integer as LAPACK takes it."""
    place = alloca_once(builder, _INT)
    builder.store(value, place)
    return place


def _order_and_pivots(builder: Any, args: tuple[Any, ...]) -> tuple[Any, Any, Any]:
    """Return the addresses of the order of a matrix, of its numbers and of its pivots."""
    matrix, pivots = args
    n = _integer(builder, builder.trunc(builder.extract_value(matrix.shape, 0), _INT))
    return n, matrix.data, builder.bitcast(pivots.data, _INTS)


@intrinsic_code(native.factorise_in_place, types.int64, _matrix, _vector)
def _factorise(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    n, data, pivots = _order_and_pivots(builder, args)
    info = _integer(builder, ir.Constant(_INT, 0))
    _call(builder, LAPACK + "dgetrf", ir.VoidType(), n, n, data, n, pivots, info)
    return builder.sext(builder.load(info), _WORD)


@intrinsic_code(native.invert_factors, types.int64, _matrix, _vector)
def _invert_factors(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    n, data, pivots = _order_and_pivots(builder, args)
    info, size = _integer(builder, ir.Constant(_INT, 0)), _integer(builder, ir.Constant(_INT, -1))

    def dgetri(memory: Any) -> None:
        given = (n, data, n, pivots, memory, size, info)
        _call(builder, LAPACK + "dgetri", ir.VoidType(), *given)

    best = alloca_once(builder, _NUMBER)
    dgetri(best)  # asks for the best size of its memory
    count = builder.fptosi(builder.load(best), _INT)
    builder.store(count, size)
    place = _acquire(builder, builder.mul(builder.sext(count, _WORD), _EIGHT))
    dgetri(builder.bitcast(place, _NUMBERS))
    _release(builder, place)
    return builder.sext(builder.load(info), _WORD)
