"""Progress on stderr: a bar on a terminal, a plain line now and then elsewhere."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

FIRST_LINE_AFTER = 2.0
SECONDS_BETWEEN_LINES = 5.0


class Watch:
    """Shows how far a run is; silent for what takes less than two seconds.

    Use as a context manager, and hand `report` to the run.
    """

    def __init__(self, text: str, *, compiling: bool, quiet: bool) -> None:
        self._text = text
        self._compiling = compiling
        self._quiet = quiet
        self._bar: Progress | None = None
        self._due = 0.0

    def __enter__(self) -> "Watch":
        """Say at once when kernels must be compiled, as nothing else will be heard for long."""
        self._due = time.monotonic() + FIRST_LINE_AFTER
        if self._compiling and not self._quiet:
            print("compiling kernels, first run only (about 30 s)", file=sys.stderr, flush=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the bar off the screen."""
        if self._bar is not None:
            self._bar.stop()

    def report(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are done."""
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
        self._bar.update(self._bar.task_ids[0], completed=done, total=total)
