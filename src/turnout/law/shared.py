"""Records of arrays that kernels take by reference.

A kernel that takes a named tuple of arrays by value gets every pointer and every length of it on
each call, hundreds of numbers, which costs more than what a small kernel does. `shared` lays these
numbers down in memory once and hands kernels the address alone. In Python as in a kernel the arrays
are read as attributes of the same names; which arrays they are can no longer be changed, what is
in them can.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np.arrayobj import make_array, populate_array

from turnout.law.lanes import LANES

T = TypeVar("T", bound=NamedTuple)

_WORD = ir.IntType(64)


class _SharedType(types.Type):
    """What a kernel knows of a shared record: names, kinds and places of its arrays."""

    def __init__(self, record: str, fields: tuple[tuple[str, str, int], ...]) -> None:
        self.record = record
        self.fields = fields
        kinds = ", ".join(f"{name}: {kind}{ndim}" for name, kind, ndim in fields)
        super().__init__(name=f"Shared({record}: {kinds})")

    def array_at(self, wanted: str) -> tuple[types.Array, int] | None:
        """Return the type of an array and the word where its numbers begin."""
        word = 0
        for name, kind, ndim in self.fields:
            if name == wanted:
                return types.Array(numba.from_dtype(np.dtype(kind)), ndim, "C"), word
            word += 1 + ndim
        return None


@register_model(_SharedType)
class _SharedModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _SharedType) -> None:
        super().__init__(manager, kind, _WORD)


class Shared:
    """A named tuple of arrays with its address; made by `shared`."""

    __slots__ = ("_arrays", "_words", "address", "kind")

    def __init__(self, arrays: NamedTuple, beyond: Mapping[str, float]) -> None:
        for name, array in zip(arrays._fields, arrays, strict=True):
            if not (isinstance(array, np.ndarray) and array.flags.c_contiguous):
                msg = f"{type(arrays).__name__}.{name} must be an array without gaps"
                raise TypeError(msg)
        self.kind = _kind(type(arrays), tuple([(array.dtype.str, array.ndim) for array in arrays]))
        self._arrays, words = _in_lines(arrays, beyond)
        self._words = np.array(words, dtype=np.int64)
        self.address = int(self._words.ctypes.data)

    def __getattr__(self, name: str) -> Any:
        """Return one of the arrays."""
        return getattr(self._arrays, name)


@cache
def _kind(record: type[Any], arrays: tuple[tuple[str, int], ...]) -> _SharedType:
    named = zip(record._fields, arrays, strict=True)
    return _SharedType(record.__name__, tuple((name, *array) for name, array in named))


def _in_lines(arrays: NamedTuple, beyond: Mapping[str, float]) -> tuple[NamedTuple, list[int]]:
    """Copy all vectors to one piece of memory, each in whole lines of it.

    Returns the arrays, and the address and lengths of each.
    """
    lines = [-(-array.size // LANES) if array.ndim == 1 else 0 for array in arrays]
    memory = np.zeros((sum(lines) + 1) * LANES)
    first = memory.ctypes.data
    at, words, found = (-(first // 8)) % LANES, [], []
    for name, array, count in zip(arrays._fields, arrays, lines, strict=True):
        if array.ndim != 1:
            found.append(array)
            words += [array.ctypes.data, *array.shape]
            continue
        vector = memory[at : at + array.size]
        if array.dtype != memory.dtype:
            vector = vector.view(array.dtype)
        vector[:] = array
        if name in beyond:
            memory[at + array.size : at + count * LANES] = beyond[name]
        found.append(vector)
        words += [first + 8 * at, array.size]
        at += count * LANES
    return type(arrays)(*found), words


def shared(arrays: T, **beyond: float) -> T:
    """Return a named tuple of arrays as a record that kernels take by reference.

    Parameters
    ----------
    arrays : named tuple of ndarray
        Contiguous arrays of floats or integers, of 8 bytes each.
    **beyond : float
        What stands behind the end of a vector of floats, up to the end of its line of memory; else zero.

    Returns
    -------
    named tuple of ndarray
        It has the attributes of `arrays` but is no tuple. Vectors are copies, which lie next to
        each other and begin and end with whole lines of memory, see `turnout.law.lanes`; what has
        more dimensions is the same memory.

    Raises
    ------
    TypeError
        If something in it is not a contiguous array.

    Examples
    --------
    >>> import numpy as np
    >>> from turnout.law.table import LawTableBuilder
    >>> builder = LawTableBuilder()
    >>> law = builder.add_contact(0, stiffness=2.0, clearance=0.5)
    >>> shared(builder.table()).offset.tolist()
    [0.5]
    """
    return cast("T", Shared(arrays, beyond))


@typeof_impl.register(Shared)
def _kind_of(record: Shared, _context: Any) -> _SharedType:
    return record.kind


@unbox(_SharedType)
def _address_of(_kind: _SharedType, record: Any, compiler: Any) -> NativeValue:
    address = compiler.pyapi.object_getattr_string(record, "address")
    value = compiler.unbox(types.int64, address)
    compiler.pyapi.decref(address)
    return NativeValue(value.value, is_error=value.is_error)


@infer_getattr
class _SharedAttribute(AttributeTemplate):
    key = _SharedType

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
        found = kind.array_at(name)
        return None if found is None else found[0]


@lower_getattr_generic(_SharedType)
def _read_array(context: Any, builder: Any, kind: _SharedType, address: Any, name: str) -> Any:
    found = kind.array_at(name)
    assert found is not None
    array_type, first = found
    words = builder.inttoptr(address, _WORD.as_pointer())

    def read(at: int) -> Any:
        word = builder.load(builder.gep(words, [ir.Constant(_WORD, at)]))
        # never written while kernels run, so that it need not be read again after every store
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word

    shape = [read(first + 1 + axis) for axis in range(array_type.ndim)]
    size = context.get_abi_sizeof(context.get_data_type(array_type.dtype))
    step = ir.Constant(_WORD, size)
    strides = [step]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    array = make_array(array_type)(context, builder)
    populate_array(
        array,
        data=builder.inttoptr(read(first), array.data.type),
        shape=shape,
        strides=strides,
        itemsize=step,
        meminfo=None,
    )
    return array._getvalue()
