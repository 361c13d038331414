"""A handler of signals in machine code, which sets a flag that kernels poll.

Python's own handler notes a signal, and what is to be done waits until the kernel returns. This one
may come at any instant and in any thread: all it does is to write a word of memory.
"""

import ctypes
import os
from functools import cache
from pathlib import Path

from turnout.kernels.compiled import CACHE_VARIABLE, SUFFIX
from turnout.kernels.machine_code import (
    assemble_entry,
    kept_code,
    load_entry,
    machine_digest,
    variable_address,
)

ENTRY, VARIABLE = "turnout_set_flag", "turnout_flag"
TEXT = f"""
@{VARIABLE} = global i64 0
define void @{ENTRY}(i32 %signal) {{
  %address = load volatile i64, ptr @{VARIABLE}
  %flag = inttoptr i64 %address to ptr
  store volatile i64 1, ptr %flag
  ret void
}}
"""

_prototype = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)
set_handler = _prototype(("PyOS_setsig", ctypes.pythonapi))
"""Sets the handler of a signal by its address, as Python does, and returns the one before."""
present_handler = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.c_int)(
    ("PyOS_getsig", ctypes.pythonapi)
)
"""Returns the address of the handler of a signal."""


@cache
def flag_setter() -> tuple[int, ctypes.c_int64]:
    """Return the address of the handler, and the word that holds the address of the flag."""
    folder = os.environ.get(CACHE_VARIABLE)
    name = f"{ENTRY}-{machine_digest()}{SUFFIX}"
    file = None if folder is None else Path(folder) / name
    code, _ = kept_code(file, lambda: assemble_entry(ENTRY, TEXT))
    handler = load_entry(code)
    return handler, ctypes.c_int64.from_address(variable_address(VARIABLE))
