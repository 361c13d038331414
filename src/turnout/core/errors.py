"""One error class a stage, so that a caller can distinguish bad input from a failed solution."""

from collections.abc import Iterator
from contextlib import contextmanager


class TurnoutError(Exception):
    """Base of everything that turnout raises on purpose; its text is fit for the screen."""

    def __reduce__(self) -> tuple[object, ...]:
        """Copy and pickle the attributes, since `args` may differ from those of `__init__`."""
        return type(self).__new__, (type(self), *self.args), self.__dict__


class FileError(TurnoutError):
    """A file cannot be read or written; the text names the path and the remedy."""


@contextmanager
def refused_of(source: object) -> Iterator[None]:
    """Turn a fault (ValueError) in the content of a file into a FileError that names the file.

    Examples
    --------
    >>> with refused_of("throw.csv"):
    ...     float("x")
    Traceback (most recent call last):
    turnout.core.errors.FileError: throw.csv: could not convert string to float: 'x'
    """
    try:
        yield
    except ValueError as error:
        message = f"{source}: {error}"
        raise FileError(message) from None


MOST_LISTED, LONGEST_MESSAGE = 200, 2000
"""Problems in the text of an error, and characters of each; a file can have as many as it likes."""


class ListedError(TurnoutError):
    """Input with problems, reported all at once.

    Parameters
    ----------
    problems : sequence of str
        Every problem found, each naming the key's path, the value and what is allowed.
    source : str
        Origin of the values (a file, a library panel, an option).
    """

    def __init__(self, problems: list[str] | tuple[str, ...], *, source: str) -> None:
        self.problems = tuple(problems)
        self.source = source
        count = len(self.problems)
        heading = f"{source}: {count} problem{'s' if count != 1 else ''}"
        listed = tuple(
            text if len(text) <= LONGEST_MESSAGE else f"{text[:LONGEST_MESSAGE]} ..."
            for text in self.problems[:MOST_LISTED]
        )
        if count > MOST_LISTED:
            listed = (*listed, f"and {count - MOST_LISTED} more")
        super().__init__("\n  - ".join((heading, *listed)))


class PanelError(ListedError):
    """A panel, an override or a foreign object is not valid; same arguments as `ListedError`."""

    def __init__(self, problems: list[str] | tuple[str, ...], *, source: str = "panel") -> None:
        super().__init__(problems, source=source)


class MeasurementError(ListedError):
    """A recording, a channel map or a campaign is not valid; same arguments as `ListedError`."""

    def __init__(
        self, problems: list[str] | tuple[str, ...], *, source: str = "measurement"
    ) -> None:
        super().__init__(problems, source=source)


class StudyError(ListedError):
    """A study of many throws is not valid; same arguments as `ListedError`."""

    def __init__(self, problems: list[str] | tuple[str, ...], *, source: str = "study") -> None:
        super().__init__(problems, source=source)


class MechanicsError(TurnoutError):
    """A mesh, a reduction or a mechanism cannot be built from its input."""


class SolverError(TurnoutError):
    """A simulation ended early; see `turnout.solver.outcome` for its attributes."""


class ResponseError(TurnoutError):
    """A response cannot be made, read or written."""


class MachineError(ListedError):
    """A point machine, or a change to it, is not valid; same arguments as `ListedError`."""

    def __init__(self, problems: list[str] | tuple[str, ...], *, source: str = "machine") -> None:
        super().__init__(problems, source=source)
