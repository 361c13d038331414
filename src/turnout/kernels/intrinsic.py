"""Functions whose code in kernels is emitted by hand; imported only to compile kernels."""

from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.np.arrayobj import make_array

Build = Callable[[Any, Any, tuple[Any, ...]], Any]


def register_intrinsic(
    function: Callable[..., Any],
    result: types.Type,
    build: Build,
    *wanted: Callable[[Any], Any],
) -> None:
    """Register a function as an intrinsic: kernels inline the LLVM code that `build` emits.

    Parameters
    ----------
    function : callable
        What kernels call; in Python it does the same.
    result : type of Numba
        What it returns.
    build : callable
        Called with context, builder and values, arrays among them as `make_array` has them.
    *wanted : callable
        The type that each argument is cast to, from its own; None where it does not fit.
    """

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
