"""Functions whose code in kernels is emitted by hand; imported only to compile kernels."""

import inspect
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, type_callable

Build = Callable[[Any, Any, tuple[Any, ...]], Any]


def intrinsic_code(
    function: Callable[..., Any],
    result: types.Type,
    *wanted: Callable[[Any], Any],
    lowered: Sequence[Any] = (types.VarArg(types.Any),),
) -> Callable[[Build], Build]:
    """Register the code of a function that kernels inline: that which the decorated one emits.

    It is called with context, builder and values, arrays among them as structures of Numba.

    Parameters
    ----------
    function : callable
        What kernels call; in Python it does the same.
    result : type of Numba
        What it returns.
    *wanted : callable
        The type that each argument is cast to, from its own; None where it does not fit.
    lowered : sequence of types of Numba
        Of the arguments, for a function that takes others besides, such as an operator.
    """

    def typer(*args: Any) -> Any:
        kinds = [kind(arg) for kind, arg in zip(wanted, args, strict=True)]
        return None if None in kinds else result(*kinds)

    def register(build: Build) -> Build:
        def lower(context: Any, builder: Any, sig: Any, args: tuple[Any, ...]) -> Any:
            given = tuple(
                context.make_array(kind)(context, builder, arg)
                if isinstance(kind, types.Array)
                else arg
                for kind, arg in zip(sig.args, args, strict=True)
            )
            found = build(context, builder, given)
            return context.get_dummy_value() if result is types.none else found

        typer.pysig = inspect.signature(function)  # type: ignore[attr-defined]
        type_callable(function)(lambda _context: typer)
        lower_builtin(function, *lowered)(lower)
        return build

    return register


def array_value(
    context: Any, builder: Any, kind: Any, address: Any, shape: list[Any], strides: list[Any]
) -> Any:
    """Return an array of memory that is not Numba's, at an address as a word."""
    array = context.make_array(kind)(context, builder)
    size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    context.populate_array(
        array,
        data=builder.inttoptr(address, array.data.type),
        shape=shape,
        strides=strides,
        itemsize=ir.Constant(ir.IntType(64), size),
        meminfo=None,
    )
    return array._getvalue()


def array_of(*numbers: types.Type, ndim: int = 1) -> Callable[[Any], Any]:
    """Return a filter of C-contiguous arrays of some numbers."""

    def array(kind: Any) -> Any:
        fits = isinstance(kind, types.Array) and kind.ndim == ndim and kind.layout == "C"
        return kind if fits and kind.dtype in numbers else None

    return array


def number_kind(kind: Any) -> Any:
    """Cast any number to a float."""
    return types.float64 if isinstance(kind, types.Number) else None


def index_kind(kind: Any) -> Any:
    """Cast any integer to an index."""
    return types.int64 if isinstance(kind, types.Integer) else None
