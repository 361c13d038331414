"""Machine code of the functions of `turnout.kernels.inverse`."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import alloca_once, get_or_insert_function

from turnout.kernels import inverse
from turnout.kernels.intrinsic import array_of, register_intrinsic
from turnout.kernels.machine_code import LAPACK
from turnout.kernels.memory_code import acquire, release

_WORD, _INT, _NUMBER = ir.IntType(64), ir.IntType(32), ir.DoubleType()


def _integer(builder: Any, value: Any) -> Any:
    """Return the address of an integer as LAPACK takes it."""
    place = alloca_once(builder, _INT)
    builder.store(value, place)
    return place


def _procedure(builder: Any, name: str, *kinds: Any) -> Any:
    kind = ir.FunctionType(ir.VoidType(), kinds)
    return get_or_insert_function(builder.module, kind, LAPACK + name)


def _build_factorise(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    matrix, pivots = args
    whole, numbers = _INT.as_pointer(), _NUMBER.as_pointer()
    n = _integer(builder, builder.trunc(builder.extract_value(matrix.shape, 0), _INT))
    info = _integer(builder, ir.Constant(_INT, 0))
    dgetrf = _procedure(builder, "dgetrf", whole, whole, numbers, whole, whole, whole)
    builder.call(dgetrf, [n, n, matrix.data, n, builder.bitcast(pivots.data, whole), info])
    return builder.sext(builder.load(info), _WORD)


def _build_invert_factors(_context: Any, builder: Any, args: tuple[Any, ...]) -> Any:
    matrix, pivots = args
    whole, numbers = _INT.as_pointer(), _NUMBER.as_pointer()
    n = _integer(builder, builder.trunc(builder.extract_value(matrix.shape, 0), _INT))
    info, size = _integer(builder, ir.Constant(_INT, 0)), _integer(builder, ir.Constant(_INT, -1))
    dgetri = _procedure(builder, "dgetri", whole, numbers, whole, whole, numbers, whole, whole)
    given = [n, matrix.data, n, builder.bitcast(pivots.data, whole)]
    best = alloca_once(builder, _NUMBER)
    builder.call(dgetri, [*given, best, size, info])  # asks for the best size of its memory
    count = builder.fptosi(builder.load(best), _INT)
    builder.store(count, size)
    place = acquire(builder, builder.mul(builder.sext(count, _WORD), ir.Constant(_WORD, 8)))
    builder.call(dgetri, [*given, builder.bitcast(place, numbers), size, info])
    release(builder, place)
    return builder.sext(builder.load(info), _WORD)


_matrix, _vector = array_of(types.float64, ndim=2), array_of(types.float64)
register_intrinsic(inverse.factorise_in_place, types.int64, _build_factorise, _matrix, _vector)
register_intrinsic(inverse.invert_factors, types.int64, _build_invert_factors, _matrix, _vector)
