"""Progress on stderr: a bar on a terminal, a plain line now and then elsewhere."""

import functools
import sys
import threading
import time
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

FIRST_LINE_AFTER = 2.0
SECONDS_BETWEEN_LINES = 5.0
COMPILING = "compiling kernels, first run only (20 to 60 s)"
# Interval of compilation progress [s]: on a terminal, where the line is rewritten, and elsewhere.
TICK_ON_TERMINAL, TICK = 1.0, 15.0


def watched(text: str, *, quiet: bool = False) -> "ProgressBar":
    """Return a watch that announces compilation, and a cache that cannot be written."""
    from turnout.throw.compilation import cache_fault, must_compile

    compiling = must_compile()
    fault = cache_fault()
    if fault and not quiet:
        _print_once(fault)
    return ProgressBar(text, compiling=compiling, quiet=quiet)


@functools.cache
def _print_once(text: str) -> None:
    print(f"turnout: {text}", file=sys.stderr, flush=True)


class ProgressBar:
    """Shows the progress of a run; silent for runs of less than two seconds.

    Use as a context manager, and hand `report` to the run.
    """

    def __init__(self, text: str, *, compiling: bool, quiet: bool) -> None:
        self._text = text
        self._clock = _Clock() if compiling and not quiet else None
        self._quiet = quiet
        self._bar: Progress | None = None
        self._due = 0.0

    def __enter__(self) -> "ProgressBar":
        """Announce compilation at once, with the time so far."""
        self._due = time.monotonic() + FIRST_LINE_AFTER
        if self._clock is not None:
            self._clock.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the bar off the screen."""
        if self._clock is not None:
            self._clock.stop()
        if self._bar is not None:
            self._bar.stop()

    def report(self, done: int, total: int, *, text: str = "") -> None:
        """Show that `done` of `total` steps are done; `text` names the stage that they are of."""
        self._text = text or self._text
        if self._clock is not None:
            self._clock.stop()
        now = time.monotonic()
        if self._quiet or (self._bar is None and now < self._due):
            return
        if sys.stderr.isatty():
            self._show_bar(done, total)
        elif now >= self._due:
            self._due = now + SECONDS_BETWEEN_LINES
            print(f"{self._text}: {100 * done / total:.0f} %", file=sys.stderr, flush=True)

    def _show_bar(self, done: int, total: int) -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import Progress

            self._bar = Progress(console=Console(stderr=True), transient=True)
            self._bar.start()
            self._bar.add_task(self._text, total=total)
        self._bar.update(self._bar.task_ids[0], description=self._text, completed=done, total=total)


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
