"""Machine code of kernels: its files and its calls.

A file holds an object as LLVM made it, with a digest, so that damage is detected. Loading it takes
the linker of LLVM (llvmlite) and no compiler: Numba is imported where a kernel has to be compiled.
"""

import ctypes
import hashlib
import json
import os
import re
import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from llvmlite import binding

from turnout.core.errors import TurnoutError
from turnout.core.files import write_atomic
from turnout.kernels.arguments import NOTHING, Kind, result_from, struct_format

LAPACK = "turnout_lapack_"
"""Begin of the names of procedures of LAPACK in machine code."""


@dataclass(frozen=True, slots=True)
class MachineCode:
    """A kernel for arguments of some kinds.

    Attributes
    ----------
    entry : str
        Name of the function ``int entry(void *words)``, which returns zero when all went well.
    result : kind
        What it returns, see `turnout.kernels.arguments`.
    content : bytes
        The object that holds it.
    """

    entry: str
    result: Kind
    content: bytes

    def to_bytes(self) -> bytes:
        """Return the content of its file."""
        head = {name: value for name, value in asdict(self).items() if name != "content"}
        line = json.dumps(head).encode() + b"\n"
        return digest_of(line + self.content) + line + self.content

    @classmethod
    def from_bytes(cls, content: bytes) -> Self | None:
        """Return the content of a file; None if it is damaged."""
        digest, rest = content[:DIGEST_SIZE], content[DIGEST_SIZE:]
        if digest_of(rest) != digest:
            return None
        head, _, code = rest.partition(b"\n")
        return cls(**json.loads(head), content=code)


DIGEST_SIZE = 16


def digest_of(content: bytes) -> bytes:
    """Return a digest that reveals damage."""
    return hashlib.blake2b(content, digest_size=DIGEST_SIZE).digest()


CODE_VARIABLES = tuple(
    f"NUMBA_{name}"
    for name in (
        *("CPU_NAME", "CPU_FEATURES", "ENABLE_AVX", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE"),
        *("DISABLE_INTEL_SVML", "BOUNDSCHECK", "DEBUGINFO"),
    )
)
"""Environment variables by which Numba makes other code of the same source."""


@cache
def machine_digest() -> str:
    """Return a digest of this processor and of the compilers for it; 12 hexadecimal digits."""
    host = (binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten())
    chosen = [f"{name}={os.environ[name]}" for name in CODE_VARIABLES if name in os.environ]
    makers = [version(package) for package in ("numba", "llvmlite", "numpy")]
    known = (*host, binding.get_process_triple(), *makers, *chosen)
    return hashlib.blake2b("\n".join(known).encode(), digest_size=6).hexdigest()


def callable_code(code: MachineCode, kinds: Sequence[Kind]) -> Callable[[list[Any]], Any]:
    """Load machine code and return it as a function of the words of its arguments.

    It lets other threads of Python run. The arguments must live until it returns.
    """
    native = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)(load_entry(code))
    given, found = struct.Struct(struct_format(kinds)), struct.Struct(struct_format([code.result]))
    memory = ctypes.c_char * max(given.size, found.size, 8)
    spare = bytes(ctypes.sizeof(memory) - given.size)
    pack, unpack, result, entry = given.pack, found.unpack_from, code.result, code.entry

    def call(words: list[Any]) -> Any:
        place = memory.from_buffer_copy(pack(*words) + spare)
        if status := native(place):
            msg = f"{entry}: failed with status {status}"
            raise RuntimeError(msg)
        return None if result == NOTHING else result_from(unpack(place), result)

    return call


def load_entry(code: MachineCode) -> int:
    """Return the address of the entry of machine code, which stays in memory."""
    if LAPACK.encode() in code.content:
        _name_lapack()
    engine = _engine()
    engine.add_object_file(binding.ObjectFileRef.from_data(code.content))
    engine.finalize_object()
    address: int = engine.get_function_address(code.entry)
    if address == 0:
        msg = f"{code.entry}: is not in its machine code; delete the folder of compiled kernels"
        raise RuntimeError(msg)
    return address


@cache
def _machine() -> Any:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.Target.from_default_triple().create_target_machine(jit=True)


@cache
def _engine() -> Any:
    return binding.create_mcjit_compiler(binding.parse_assembly(""), _machine())


def assemble_entry(entry: str, text: str) -> MachineCode:
    """Return the machine code of a text in the language of LLVM, with plain pointers to words."""
    if binding.llvm_version_info[0] < 17:  # where each pointer names its type
        text = re.sub(r"\bptr\b", "i64*", text)
    return MachineCode(entry, NOTHING, _machine().emit_object(binding.parse_assembly(text)))


def variable_address(name: str) -> int:
    """Return the address of a variable of machine code that was loaded."""
    address: int = _engine().get_global_value_address(name)
    return address


@cache
def _name_lapack() -> None:
    """Give LLVM the addresses of the procedures of SciPy's LAPACK."""
    from scipy.linalg import cython_lapack

    address = ctypes.pythonapi.PyCapsule_GetPointer
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    name_of = ctypes.pythonapi.PyCapsule_GetName
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    for name in ("dgetrf", "dgetri"):
        capsule = cython_lapack.__pyx_capi__[name]
        binding.add_symbol(LAPACK + name, address(capsule, name_of(capsule)))


def read_machine_code(file: Path) -> MachineCode | None:
    """Return the machine code of a file; None if there is none, or it is damaged."""
    try:
        return MachineCode.from_bytes(file.read_bytes())
    except OSError:
        return None


def kept_code(file: Path | None, make: Callable[[], MachineCode]) -> tuple[MachineCode, bool]:
    """Return machine code from its file, or make and keep it; and True if it came from there."""
    code = None if file is None else read_machine_code(file)
    if code is not None:
        return code, True
    code = make()
    if file is not None:
        with suppress(OSError, TurnoutError):  # without a cache it is made again
            write_atomic(file, code.to_bytes(), durable=False)
    return code, False
