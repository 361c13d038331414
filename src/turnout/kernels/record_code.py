"""Machine code of the records of `turnout.kernels.shared_record`."""

from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, lower_getattr_generic, models, register_model

from turnout.kernels.intrinsic import array_value
from turnout.kernels.shared_record import RecordKind

_WORD = ir.IntType(64)


class RecordType(types.Type):
    """Numba type of a shared record."""

    def __init__(self, kind: RecordKind) -> None:
        self.kind = kind
        super().__init__(name=str(kind))

    def array_at(self, wanted: str) -> tuple[types.Array, int] | None:
        """Return the type of an array and the index of its first word; None for an unknown name."""
        for name, kind, ndim in self.kind.fields:
            if name == wanted:
                array = types.Array(numba.from_dtype(np.dtype(kind)), ndim, "C")
                return array, self.kind.word_of[name]
        return None


@cache
def record_type(kind: RecordKind) -> RecordType:
    """Return the type of the records of a kind."""
    return RecordType(kind)


@register_model(RecordType)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: RecordType) -> None:
        super().__init__(manager, kind, _WORD)


@infer_getattr
class _SharedAttribute(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
        found = kind.array_at(name)
        return None if found is None else found[0]


@lower_getattr_generic(RecordType)
def _read_array(context: Any, builder: Any, kind: RecordType, address: Any, name: str) -> Any:
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
    return array_value(context, builder, array_type, read(first), shape, strides)
