"""Processes for the workers of a sweep: fresh, and quick to start.

A new process loads this module before anything else, so it imports nothing else of turnout.
"""

import gc
import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import Any


class _Process(SpawnProcess):
    """A fresh process that does not import the program which started it.

    The program would take time to load, or start another sweep if it is a script without a guard.
    """

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:  # noqa: N802 - named by the library
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process_obj)
        finally:
            sys.modules["__main__"] = main


class _Context(SpawnContext):
    """Starts such processes."""

    Process = _Process


def worker_processes(workers: int) -> ProcessPoolExecutor:
    """Return an executor of fresh processes on this machine, which end when this one does."""
    return ProcessPoolExecutor(workers, mp_context=_Context(), initializer=_start_worker)


def _start_worker() -> None:
    """Ignore Ctrl-C, which is for the run, and end when the run does, however it ends.

    `initialize_worker` starts the garbage collector once all is loaded: to look through what is
    being loaded takes a tenth of the start.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_with_parent, args=(parent.sentinel,), daemon=True).start()


def _exit_with_parent(sentinel: int) -> None:
    from multiprocessing.connection import wait as wait_for

    wait_for([sentinel])
    os._exit(1)
