"""Compile kernels with Numba; imported only if a kernel is not in the cache.

Numba turns a kernel and all that it calls into intermediate code, behind an entry that reads
arguments from words in memory and stores its result there. LLVM, by llvmlite, then optimises the
whole and makes an object of it. Only names that Numba and llvmlite document are used here, so that
any Numba will do; it optimises each kernel for itself as well, though, and makes machine code of it
that nobody calls. `turnout.kernels.plain_code` takes this away for versions of Numba it knows.
"""

import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

import turnout.kernels.lane_code
import turnout.kernels.native_code  # noqa: F401 - they register what kernels call
from turnout.core.files import write_atomic
from turnout.kernels.arguments import ARRAY, LOGICAL, NOTHING, NUMBER, TUPLE, WHOLE, Kind
from turnout.kernels.intrinsic import array_value
from turnout.kernels.machine_code import (
    BUILDER_VARIABLE,
    LAPACK,
    LEVELS,
    MachineCode,
    built_file,
    name_lapack,
    target_machine,
)
from turnout.kernels.record_code import record_type
from turnout.kernels.shared_record import RecordKind

_WORD = ir.IntType(64)
config: Any = numba.config
_PLAIN: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
"""Options of all that is compiled: it raises no exception of its own and counts no references."""
LIBRARIES = frozenset(
    ["malloc", "free", "memcpy", "memmove", "memset", "fma", "sqrt", "exp", "log", "pow"]
    + ["sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "hypot"]
)
"""Functions of the libraries of C that kernels may call."""
_RAISING = "gil_ensure|gil_release|do_raise|unpickle|runtime_build_excinfo_struct"
"""Functions of Numba's runtime by which an exception comes to Python."""
_RUNTIME = re.compile(rf'^declare ([^@\n]*)(@"?(?:_?Py\w+|numba_(?:{_RAISING}))"?\(.*\)).*$')
_VARIABLE = re.compile(r'^(@"?_?Py\w*"?) = external (.*global) ([^,\n]*)')


def _machine(processor: str, features: str) -> Any:
    """Return a machine that makes code for a processor."""
    made_for = {"cpu": processor, "features": features}
    return target_machine(**made_for, opt=3, codemodel="jitdefault")


@cache
def _this_machine() -> Any:
    """Return a machine that makes code for this processor, or the one that Numba is told."""
    if config.CPU_NAME:
        return _machine(config.CPU_NAME, config.CPU_FEATURES or "")
    return _machine(binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten())


@cache
def plain_code() -> Any:
    """Return the module that restricts Numba to intermediate code; None for an unknown version."""
    if os.environ.get(BUILDER_VARIABLE) == "public":
        return None
    from turnout.kernels import plain_code as found

    if found.is_known():
        return found
    print(f"the first start takes longer with numba {numba.__version__}", file=sys.stderr)
    return None


def inner_dispatcher(function: Callable[..., Any], *, loop: bool, part: bool) -> Any:
    """Return a kernel as Numba has it."""
    options: dict[str, Any] = {
        **_PLAIN,
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,  # no kernel is passed to another one
        # Left out where it is false, a kernel would take it over from the one that calls it first.
        "forceinline": loop or part,
    }
    found = plain_code()
    return numba.njit(**options, **({} if found is None else found.options(loop)))(function)


Parts = Sequence[tuple[Any, tuple[Kind, ...]]]
"""Dispatchers, each with the kinds of its arguments."""


def compiled_together(parts: Parts, names: Sequence[str]) -> MachineCode:
    """Return the machine code of kernels for this processor, their entries named."""
    return _codes(parts, names, [_this_machine()])[0]


def build_ahead(parts: Parts, names: Sequence[str]) -> list[Path]:
    """Write the machine code of kernels for each of `LEVELS` beside the sources."""
    machines = [_machine(level, "") for level in LEVELS]
    files = [built_file(level) for level in LEVELS]
    for file, code in zip(files, _codes(parts, names, machines), strict=True):
        file.parent.mkdir(exist_ok=True)
        write_atomic(file, code.to_bytes())
    return files


def _codes(parts: Parts, names: Sequence[str], machines: Sequence[Any]) -> list[MachineCode]:
    given = zip(parts, names, strict=True)
    found = [_intermediate_code(dispatcher, kinds, name) for (dispatcher, kinds), name in given]
    texts, results = [text for text, _ in found], [result for _, result in found]
    return [
        MachineCode(dict(zip(names, results, strict=True)), _object_of(texts, names, machine))
        for machine in machines
    ]


def _intermediate_code(dispatcher: Any, kinds: tuple[Kind, ...], name: str) -> tuple[str, Kind]:
    """Return the code of a kernel and of all that it calls, and the kind of its result.

    The code holds ``int64 name(void *words)``, which returns 1 when all went well.
    """
    name_lapack()
    read, results = _reader(kinds), list[Any]()
    write = _writer(results)
    wanted = types.int64(types.int64)

    def entry(words: int) -> int:
        write(words, dispatcher(*read(words)))
        return 1

    found = plain_code()
    with _unoptimised() if found is None else found.made():
        function = numba.cfunc(wanted, **_PLAIN)(entry)
        text = function.inspect_llvm()
    return _without_runtime(text.replace(function.native_name, name)), _result_kind(results[0])


@contextmanager
def _unoptimised() -> Iterator[None]:
    """Switch Numba's optimisation off for a while."""
    _have_compiled()
    before = config.OPT
    config.OPT = type(before)(0)
    try:
        yield
    finally:
        config.OPT = before


@cache
def _have_compiled() -> None:
    """Compile something: how well Numba makes machine code is settled the first time."""
    numba.njit("float64(float64)", cache=False)(lambda x: x)


def _without_runtime(text: str) -> str:
    """Return code with empty functions in place of those that raise an exception in Python.

    An entry then returns zero where a kernel fails. What is missing in an object ends the process.
    """
    lines = []
    for line in text.splitlines():
        called, variable = _RUNTIME.match(line), _VARIABLE.match(line)
        if called:
            kind, rest = called[1].split()[-1], called[2].replace("...", "")
            value = "void" if kind == "void" else f"{kind} zeroinitializer"
            line = f"define internal {kind} {rest} {{ ret {value} }}"
        elif variable:
            line = f"{variable[1]} = internal {variable[2]} {variable[3]} zeroinitializer"
        lines.append(line)
    return "\n".join(lines)


def _object_of(texts: Sequence[str], entries: Sequence[str], machine: Any) -> bytes:
    """Return an object of some code, which has been optimised as a whole.

    Raises
    ------
    TypeError
        If a kernel calls what is in no process without Numba.
    """
    whole = binding.parse_assembly(texts[0])
    for text in texts[1:]:
        whole.link_in(binding.parse_assembly(text))
    for function in whole.functions:
        if not function.is_declaration and function.name not in entries:
            function.linkage = "internal"
    tuning = binding.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization, tuning.slp_vectorization = True, False
    passes = binding.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(whole, passes)
    declared = {function.name for function in whole.functions if function.is_declaration}
    missing = {name for name in declared if not name.startswith(("llvm.", LAPACK))} - LIBRARIES
    if missing:
        msg = f"{entries[0]}: calls {', '.join(sorted(missing))}, which no kernel can"
        raise TypeError(msg)
    found: bytes = machine.emit_object(whole)
    return found


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


def _reader(kinds: tuple[Kind, ...]) -> Any:
    """Return a function for kernels that reads arguments of some kinds from words."""
    given = types.Tuple([_type_of(kind) for kind in kinds])

    @intrinsic
    def read(_typing: Any, words: Any) -> Any:
        def build(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return _Words(context, builder, args[0]).read(given)

        return given(words), build

    return read


def _writer(results: list[Any]) -> Any:
    """Return a function for kernels that writes a result to words; its type is put in a list."""

    @intrinsic
    def write(_typing: Any, words: Any, result: Any) -> Any:
        results.append(result)

        def build(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            _Words(context, builder, args[0]).write(args[1], result)
            return context.get_dummy_value()

        return types.none(words, result), build

    return write


class _Words:
    """Words of eight bytes that an entry reads, and then writes, one after the other."""

    def __init__(self, context: Any, builder: Any, address: Any) -> None:
        self.context, self.builder, self.at = context, builder, 0
        self.words = builder.inttoptr(address, _WORD.as_pointer())

    def _next(self) -> Any:
        place = self.builder.gep(self.words, [ir.Constant(_WORD, self.at)])
        self.at += 1
        return place

    def _read(self) -> Any:
        return self.builder.load(self._next())

    def read(self, kind: Any) -> Any:
        """Return an argument as Numba has it."""
        if isinstance(kind, types.Array):
            data = self._read()
            shape = [self._read() for _ in range(kind.ndim)]
            strides = [self._read() for _ in range(kind.ndim)]
            return array_value(self.context, self.builder, kind, data, shape, strides)
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
