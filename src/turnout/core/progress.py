"""What a long computation tells whoever watches it; how that is shown is not its business."""

from typing import Protocol


class Progress(Protocol):
    """Receives the state of a long computation."""

    def start(self, total: float, text: str) -> None:
        """Begin a task of a given size, with a short text for the reader."""

    def update(self, done: float) -> None:
        """Report how much of the total is done so far."""

    def finish(self) -> None:
        """End the task, finished or not."""


class Silent:
    """A progress that shows nothing.

    Examples
    --------
    >>> progress: Progress = Silent()
    >>> progress.start(10.0, "simulating")
    """

    def start(self, total: float, text: str) -> None:
        """Do nothing."""

    def update(self, done: float) -> None:
        """Do nothing."""

    def finish(self) -> None:
        """Do nothing."""
