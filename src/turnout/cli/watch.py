"""Progress on stderr: a bar on a terminal, a plain line now and then elsewhere."""

import functools
import math
import os
import sys
import threading
import time
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from turnout.core.value_text import duration_text

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from turnout.core.progress import Progress

FIRST_LINE_AFTER = 2.0
SECONDS_BETWEEN_LINES = 5.0
COMPILING = "compiling kernels, first run only (20 to 60 s)"
# Interval of compilation progress [s]: on a terminal, where the line is rewritten, and elsewhere.
TICK_ON_TERMINAL, TICK = 1.0, 15.0


def watched(
    text: str, *, texts: Mapping[str, str] = MappingProxyType({}), quiet: bool = False
) -> "ProgressBar":
    """Return a watch that announces compilation, and a cache that cannot be written.

    Parameters
    ----------
    text : str
        Names what is watched.
    texts : mapping of str to str
        In place of it, words for the stages of a run.
    quiet : bool
        Whether nothing is shown.
    """
    from turnout.throw.compilation import cache_fault, must_compile

    compiling = must_compile()
    fault = cache_fault()
    if fault and not quiet:
        _print_once(fault)
    return ProgressBar(text, texts=texts, compiling=compiling, quiet=quiet)


@functools.cache
def _print_once(text: str) -> None:
    print(f"turnout: {text}", file=sys.stderr, flush=True)


class ProgressBar:
    """Shows the progress of a run; silent for runs of less than two seconds.

    Use as a context manager, and hand `report` to the run.
    """

    def __init__(
        self,
        text: str = "",
        *,
        texts: Mapping[str, str] = MappingProxyType({}),
        compiling: bool = False,
        quiet: bool = False,
        every: float = SECONDS_BETWEEN_LINES,
    ) -> None:
        self._text, self._quiet, self._every, self._texts = text, quiet, every, texts
        self._clock = _Clock() if compiling and not quiet else None
        self._bar: Bar | None = None
        self._due = time.monotonic() + FIRST_LINE_AFTER

    def __enter__(self) -> "ProgressBar":
        """Announce compilation at once, with the time so far."""
        if self._clock is not None:
            self._clock.start()
        return self

    def __exit__(self, *given: object) -> None:
        """Take the bar off the screen."""
        if self._clock is not None:
            self._clock.stop()
        if self._bar is not None:
            self._bar.stop()

    def report(self, done: int, total: int, *, text: str = "", said: str = "") -> None:
        """Show that `done` of `total` steps are done.

        Parameters
        ----------
        done, total : int
            Steps.
        text : str
            Names the stage that they are of.
        said : str
            In place of the percentage.
        """
        self._text = text or self._text
        if self._clock is not None:
            self._clock.stop()
        now = time.monotonic()
        if self._quiet or (self._bar is None and now < self._due):
            return
        if sys.stderr.isatty():
            self._show_bar(done, total, said)
        elif now >= self._due:
            self._line(f"{self._text}: {said or f'{100 * done / total:.0f} %'}", now)

    def say(self, text: str) -> None:
        """Print a line on progress, if one is due."""
        now = time.monotonic()
        if not self._quiet and now >= self._due:
            self._line(text, now)

    def sweep(self, state: "Progress") -> None:
        """Show done, failed, rate and time left of many throws."""
        text = self._texts.get(state.stage, state.stage) if state.stage else ""
        self.report(state.done, state.total, text=text, said=progress_line(state))

    def _line(self, text: str, now: float) -> None:
        self._due = now + self._every
        print(text, file=sys.stderr, flush=True)

    def _show_bar(self, done: int, total: int, said: str) -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.fields[s]}"),
            )
            self._bar = Progress(
                *(columns if said else Progress.get_default_columns()),
                console=Console(stderr=True),
                transient=True,
            )
            self._bar.start()
            self._bar.add_task(self._text, total=total, s=said)
        task = self._bar.task_ids[0]
        self._bar.update(task, description=self._text, completed=done, total=total, s=said)


def progress_line(state: "Progress") -> str:
    """Return the progress of a sweep in one line."""
    text = f"{state.done} of {state.total} done"
    if state.failed:
        text += f", {state.failed} failed"
    if state.rate:
        text += f", {state.rate:.3g} a second"
    if state.done < state.total and state.left < math.inf:
        text += f", {duration_text(state.left)} left"
    return text


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Clock:
    """Prints the time of a compilation from a thread, since compilers report no progress."""

    def __init__(self) -> None:
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """End the line; a second call does nothing."""
        if not self._done.is_set():
            self._done.set()
            self._thread.join()

    def _run(self) -> None:
        began, terminal = time.perf_counter(), sys.stderr.isatty()
        print(COMPILING, file=sys.stderr, end="" if terminal else "\n", flush=True)
        while not self._done.wait(TICK_ON_TERMINAL if terminal else TICK):
            passed = f"{time.perf_counter() - began:.0f} s so far"
            text = f"\r{COMPILING}: {passed}" if terminal else f"still compiling, {passed}"
            print(text, file=sys.stderr, end="" if terminal else "\n", flush=True)
        if terminal:
            print(file=sys.stderr, flush=True)
