"""Compile kernels with Numba; imported only if a kernel is not in the cache.

Numba optimises each kernel with all that it calls and makes machine code of it, and does the same
again for whatever calls that kernel. Only the few kernels that Python calls need this. Every kernel
is therefore compiled to plain intermediate code, which is kept for other kernels that call it; what
Python calls is this code behind an entry that reads arguments from memory, optimised once, with all
that it calls. This halves the time of a first start and changes no bit.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from llvmlite.binding import parse_bitcode
from numba.core import cgutils, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CR_FIELDS, CompilerBase, CompileResult, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.np.arrayobj import make_array, populate_array

import turnout.kernels.inverse_code
import turnout.kernels.lane_code
import turnout.kernels.memory_code  # noqa: F401 - it registers what kernels call
from turnout.kernels.arguments import ARRAY, LOGICAL, NOTHING, NUMBER, TUPLE, WHOLE, Kind
from turnout.kernels.index_code import index_from_front
from turnout.kernels.machine_code import DIGEST_SIZE, MachineCode, digest_of, machine_digest
from turnout.kernels.record_code import record_type
from turnout.kernels.shared_record import RecordKind

CACHE_FOLDER = os.environ.get("NUMBA_CACHE_DIR", "")
# Numba unpickles what it keeps there; `turnout.kernels.compiled` chose a folder of the user alone.
setattr(numba.config, "CACHE_DIR", CACHE_FOLDER)  # noqa: B010

_WORD = ir.IntType(64)


class _PlainCode(JITCodeLibrary):
    """Code of a kernel for other kernels: neither optimised nor made machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _WholeCode(JITCodeLibrary):
    """Code of a kernel with its entry: optimised, and made an object instead of loaded."""

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def to_object(self) -> bytes:
        """Return the object."""
        found: bytes = self._codegen._tm.emit_object(self._final_module)
        return found


class _Inner(CompilerBase):
    """Compile a kernel to plain code."""

    def compile_extra(self, func: Any) -> CompileResult:
        """Compile; Numba calls this while no other thread compiles."""
        with index_from_front():
            found: CompileResult = super().compile_extra(func)
            return found

    def define_pipelines(self) -> list[object]:
        """Return the pipeline of Numba, which then ends with plain code."""
        state = self.state
        state.flags.no_cpython_wrapper = True
        state.flags.no_compile = True
        codegen = state.targetctx.codegen()
        state.library = _PlainCode(codegen, state.func_id.func_qualname)
        pipeline: object = DefaultPassBuilder.define_nopython_pipeline(state)
        return [pipeline]


class _InnerLoop(_Inner):
    """Compile with the flag `noalias`: no array that is written overlaps another.

    Without it a vectorised loop over several arrays begins with overlap checks, which short loops
    do not repay.
    """

    def define_pipelines(self) -> list[object]:
        """Return the pipeline with the flag set."""
        self.state.flags.noalias = True
        return super().define_pipelines()


class _PlainCodeFiles(CompileResultCacheImpl):
    """Plain code of a kernel in the cache."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Return the beginning of the names of its files."""
        return f"inner.{super().get_filename_base(fullname, abiflags)}.{machine_digest()}"

    def reduce(self, cres: Any) -> Any:
        """Return the stored form of compiled code."""
        cres.fndesc.typemap = cres.fndesc.calltypes = None  # of the compiler, and large
        code = cres.library._final_module.as_bitcode()
        return cres.library.name, code, cres.fndesc, cres.signature, cres.reload_init

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return compiled code from its stored form."""
        name, code, fndesc, signature, reload_init = payload
        library = _PlainCode(target_context.codegen(), name)
        library._final_module = parse_bitcode(code)
        library._finalize_final_module()
        known = {"fndesc": fndesc, "signature": signature, "reload_init": reload_init}
        blank: dict[str, Any] = dict.fromkeys(CR_FIELDS)
        known |= {"library": library, "target_context": target_context}
        return CompileResult(**blank | known | {"lifted": (), "entry_point": library})


class _DigestedFiles(IndexDataCacheFile):
    """Files of Numba's cache whose data end with a digest, by which damage is detected."""

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        if digest_of(content[:-DIGEST_SIZE]) != content[-DIGEST_SIZE:]:
            msg = "plain code in the cache is damaged"
            raise ValueError(msg)
        return super()._load_data(name)  # which passes over what follows its data

    def _dump(self, obj: Any) -> bytes:
        content = bytes(super()._dump(obj))
        return content + digest_of(content)


class _PlainCodeCache(FunctionCache):
    """Cache of the plain code of kernels; if it cannot serve, code is compiled again."""

    _impl_class = _PlainCodeFiles

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _DigestedFiles(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return kept code; None if there is none for these arguments, or it is damaged."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # whatever comes of unpickling what is damaged
            with suppress(OSError):
                self.flush()
            return None
        # Two processes may have given one name to the code of different arguments.
        return found if found is not None and found.signature.args == tuple(sig) else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep code, if the folder takes it."""
        with suppress(OSError):
            super().save_overload(sig, data)


class _InnerKernel(CPUDispatcher):
    """A kernel as Numba has it; its code has no address of its own."""

    def enable_caching(self) -> None:
        """Keep the plain code: another kernel may need it later."""
        self._cache = _PlainCodeCache(self.py_func)

    def add_overload(self, cres: Any) -> None:
        """Register compiled code under a mark in place of an address."""
        found = cres._replace(entry_point=object())
        mark, code = found.entry_point, found.library
        self.targetctx.insert_user_function(mark, found.fndesc, [code])
        self.overloads[tuple(found.signature.args)] = found


def inner_dispatcher(function: Callable[..., Any], *, loop: bool, part: bool) -> CPUDispatcher:
    """Return the dispatcher of Numba for a kernel."""
    options: dict[str, Any] = {
        "nopython": True,
        "error_model": "numpy",
        "_nrt": False,
        "no_cfunc_wrapper": True,  # no kernel is passed to another one
        # Left out where it is false, a kernel would take it over from the one that calls it first.
        "forceinline": loop or part,
    }
    compiler = _InnerLoop if loop else _Inner
    inner = _InnerKernel(function, targetoptions=options, pipeline_class=compiler)
    if CACHE_FOLDER:
        inner.enable_caching()
    return inner


def compile_kernel(dispatcher: Any, kinds: tuple[Kind, ...], *, name: str) -> MachineCode:
    """Return the machine code of a kernel for arguments of some kinds, its entry with a name."""
    given = tuple(_type_of(kind) for kind in kinds)
    with global_compiler_lock:
        dispatcher.compile(given)
        inner = dispatcher.overloads[given]
        result = _result_kind(inner.signature.return_type)
        context = dispatcher.targetctx
        library = _WholeCode(context.codegen(), name)
        module = library.create_ir_module(name)
        _write_entry(context, module, name, inner)
        library.add_ir_module(module)
        library.add_linking_library(inner.library)
        library.finalize()
        return MachineCode(name, result, library.to_object())


def _type_of(kind: Kind) -> types.Type:
    """Return the type of Numba of an argument."""
    if isinstance(kind, RecordKind):
        return record_type(kind)
    if isinstance(kind, tuple) and kind[0] == ARRAY:
        _, dtype, ndim, order, writeable = kind
        return types.Array(numba.from_dtype(np.dtype(dtype)), ndim, order, readonly=not writeable)
    if isinstance(kind, tuple):
        inner = tuple(_type_of(item) for item in kind[2:])
        found: types.Type = types.BaseTuple.from_types(inner, kind[1])
        return found
    plain: dict[Kind, types.Type] = {
        NUMBER: types.float64, WHOLE: types.int64, LOGICAL: types.boolean, NOTHING: types.none,
    }  # fmt: skip
    return plain[kind]


def _items(kind: Any) -> tuple[Any, ...]:
    """Return the types of the items of a tuple."""
    return tuple(kind.types)


def _result_kind(kind: Any) -> Kind:
    """Return the kind of a result from its type."""
    if isinstance(kind, types.BaseTuple):
        named = getattr(kind, "instance_class", None)
        place = f"{named.__module__}:{named.__qualname__}" if named else None
        return [TUPLE, place, *map(_result_kind, _items(kind))]
    for wanted, found in (
        (types.NoneType, NOTHING),
        (types.Float, NUMBER),
        (types.Boolean, LOGICAL),
        (types.Integer, WHOLE),
    ):
        if isinstance(kind, wanted):
            return found
    msg = f"a kernel that Python calls returns numbers and tuples of them, not {kind}"
    raise TypeError(msg)


def _write_entry(context: Any, module: Any, name: str, inner: Any) -> None:
    """Write ``int name(void *words)``, which calls the kernel and stores its result there."""
    kind = ir.FunctionType(ir.IntType(32), [_WORD.as_pointer()])
    function = ir.Function(module, kind, name)
    builder = ir.IRBuilder(function.append_basic_block("entry"))
    words = _Words(context, builder, function.args[0])
    given = [words.read(argument) for argument in inner.signature.args]
    callee = context.declare_function(module, inner.fndesc)
    result = inner.signature.return_type
    status, value = context.call_conv.call_function(
        builder, callee, result, inner.signature.args, given
    )
    words.at = 0
    words.write(value, result)
    builder.ret(status.code)


class _Words:
    """Words of eight bytes that an entry reads, and then writes, one after the other."""

    def __init__(self, context: Any, builder: Any, words: Any) -> None:
        self.context, self.builder, self.words, self.at = context, builder, words, 0

    def _next(self) -> Any:
        place = self.builder.gep(self.words, [ir.Constant(_WORD, self.at)])
        self.at += 1
        return place

    def _read(self) -> Any:
        return self.builder.load(self._next())

    def read(self, kind: Any) -> Any:
        """Return an argument as Numba has it."""
        if isinstance(kind, types.Array):
            return self._read_array(kind)
        if isinstance(kind, types.BaseTuple):
            return self.context.make_tuple(
                self.builder, kind, [self.read(one) for one in _items(kind)]
            )
        if isinstance(kind, types.NoneType):
            return self.context.get_dummy_value()
        word = self._read()
        if isinstance(kind, types.Float):
            return self.builder.bitcast(word, ir.DoubleType())
        if isinstance(kind, types.Boolean):
            return self.builder.icmp_unsigned("!=", word, ir.Constant(_WORD, 0))
        return word

    def _read_array(self, kind: Any) -> Any:
        array = make_array(kind)(self.context, self.builder)
        address = self._read()
        shape = [self._read() for _ in range(kind.ndim)]
        strides = [self._read() for _ in range(kind.ndim)]
        size = self.context.get_abi_sizeof(self.context.get_data_type(kind.dtype))
        populate_array(
            array,
            data=self.builder.inttoptr(address, array.data.type),
            shape=shape,
            strides=strides,
            itemsize=ir.Constant(_WORD, size),
            meminfo=None,
        )
        return array._getvalue()

    def write(self, value: Any, kind: Any) -> None:
        """Write a result."""
        if isinstance(kind, types.BaseTuple):
            items = cgutils.unpack_tuple(self.builder, value)
            for one, item in zip(_items(kind), items, strict=True):
                self.write(item, one)
        elif isinstance(kind, types.Float):
            wide = self.builder.fpext(value, ir.DoubleType()) if kind.bitwidth < 64 else value
            self.builder.store(self.builder.bitcast(wide, _WORD), self._next())
        elif not isinstance(kind, types.NoneType):
            signed = getattr(kind, "signed", False)
            widen = self.builder.sext if signed else self.builder.zext
            wide = value if value.type == _WORD else widen(value, _WORD)
            self.builder.store(wide, self._next())
