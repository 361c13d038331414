"""Machine code of kernels: its files and its calls.

A file holds an object as LLVM made it, with a digest, so that damage is detected. Loading it takes
the linker of LLVM (llvmlite) and no compiler: Numba is imported where a kernel has to be compiled.
"""

import ctypes
import hashlib
import json
import os
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from llvmlite import binding

from turnout.core.sources import KERNELS, digest_of_sources
from turnout.kernels.arguments import NOTHING, Kind, result_from, struct_format

SUFFIX = ".kernel"
BUILDER_VARIABLE = "TURNOUT_KERNELS"
"""Environment variable: "public" leaves parts of Numba alone that are not public."""

LAPACK = "turnout_lapack_"
"""Begin of the names of procedures of LAPACK in machine code."""


@dataclass(frozen=True, slots=True)
class MachineCode:
    """An object of kernels that were compiled together, each for arguments of some kinds.

    Attributes
    ----------
    results : dict of str to kind
        What each of its functions ``int64 entry(void *words)`` leaves in the words, see
        `turnout.kernels.arguments`, by name. It returns 1 when all went well.
    content : bytes
        The object.
    """

    results: dict[str, Kind]
    content: bytes

    def to_bytes(self) -> bytes:
        """Return the content of its file."""
        line = json.dumps(self.results).encode() + b"\n"
        return digest_of(line + self.content) + line + self.content

    @classmethod
    def from_file(cls, file: Path) -> Self | None:
        """Return the content of a file; None if there is no file, or a damaged one."""
        try:
            content = file.read_bytes()
        except OSError:
            return None
        digest, rest = content[:DIGEST_SIZE], content[DIGEST_SIZE:]
        if digest_of(rest) != digest:
            return None
        head, _, code = rest.partition(b"\n")
        return cls(json.loads(head), code)


DIGEST_SIZE = 16


def digest_of(content: bytes) -> bytes:
    """Return a digest that reveals damage."""
    return hashlib.blake2b(content, digest_size=DIGEST_SIZE).digest()


CODE_VARIABLES = (
    *("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_BOUNDSCHECK", "NUMBA_DEBUGINFO"),
    BUILDER_VARIABLE,
)
"""Environment variables by which other code is made of the same source."""


@cache
def machine_digest() -> str:
    """Return a digest of this processor and of the compilers for it; 12 hexadecimal digits."""
    host = (binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten())
    chosen = [f"{name}={os.environ[name]}" for name in CODE_VARIABLES if name in os.environ]
    makers = [version(package) for package in ("numba", "llvmlite", "numpy")]
    known = (*host, binding.get_process_triple(), *makers, *chosen)
    return hashlib.blake2b("\n".join(known).encode(), digest_size=6).hexdigest()


def callable_code(
    code: MachineCode, entry: str, kinds: Sequence[Kind]
) -> Callable[[list[Any]], Any]:
    """Load machine code and return an entry as a function of the words of its arguments.

    It lets other threads of Python run. The arguments must live until it returns.
    """
    native, result = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p), code.results[entry]
    function = native(load_entry(code, entry))
    given, found = struct.Struct(struct_format(kinds)), struct.Struct(struct_format([result]))
    memory = ctypes.c_char * max(given.size, found.size, 8)
    spare = bytes(ctypes.sizeof(memory) - given.size)
    pack, unpack = given.pack, found.unpack_from

    def call(words: list[Any]) -> Any:
        place = memory.from_buffer_copy(pack(*words) + spare)
        if function(place) != 1:
            msg = f"{entry}: failed"
            raise RuntimeError(msg)
        return None if result == NOTHING else result_from(unpack(place), result)

    return call


_loaded = set[bytes]()
"""Digests of the objects in memory; kernels that were compiled together are one."""


def load_entry(code: MachineCode, entry: str) -> int:
    """Return the address of the entry of machine code, which stays in memory."""
    engine, digest = _engine(), digest_of(code.content)
    if digest not in _loaded:
        if LAPACK.encode() in code.content:
            name_lapack()
        engine.add_object_file(binding.ObjectFileRef.from_data(code.content))
        engine.finalize_object()
        _loaded.add(digest)
    address: int = engine.get_function_address(entry)
    if address == 0:
        msg = f"{entry}: is not in its machine code; delete the folder of compiled kernels"
        raise RuntimeError(msg)
    return address


def target_machine(**options: Any) -> Any:
    """Return a machine that makes or loads code in this process."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.Target.from_default_triple().create_target_machine(jit=True, **options)


@cache
def _engine() -> Any:
    return binding.create_mcjit_compiler(binding.parse_assembly(""), target_machine())


@cache
def name_lapack() -> None:
    """Give LLVM the addresses of the procedures of SciPy's LAPACK."""
    from scipy.linalg import cython_lapack

    address = ctypes.pythonapi.PyCapsule_GetPointer
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    name_of = ctypes.pythonapi.PyCapsule_GetName
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    for name in ("dgetrf", "dgetri"):
        capsule = cython_lapack.__pyx_capi__[name]
        binding.add_symbol(LAPACK + name, address(capsule, name_of(capsule)))


LEVELS = {
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"),
    "x86-64": (),
}
"""Processors that kernels are built ahead for, the best first, and what one must have."""
BUILT = Path(__file__).with_name("built")
"""Folder of kernels that were built ahead, in a wheel for one platform."""


def built_file(level: str) -> Path:
    """Return the file of kernels that were built ahead from the present sources."""
    return BUILT / f"{digest_of_sources(KERNELS)}-{level}{SUFFIX}"


@cache
def built_code() -> MachineCode:
    """Return the kernels built ahead for this processor, perhaps none."""
    nothing = MachineCode({}, b"")
    if not BUILT.is_dir() or any(name in os.environ for name in CODE_VARIABLES):
        return nothing
    has = binding.get_host_cpu_features()
    fits = [level for level, needed in LEVELS.items() if all(has.get(name) for name in needed)]
    found = (MachineCode.from_file(built_file(level)) for level in fits)
    return next((code for code in found if code is not None), nothing)
