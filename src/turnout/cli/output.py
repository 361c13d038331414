"""Results of commands: lines, files and the one JSON object of `--json`; notes on stderr."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from turnout.core.errors import FileError
from turnout.core.value_text import size_text

if TYPE_CHECKING:
    import xarray as xr

JSON_VERSION = 1
"""Raised when a documented key changes its meaning or disappears."""
FINDINGS, INCOMPLETE, INTERRUPTED = 1, 3, 130
"""Exit codes: findings with --strict, no convergence or an inaccurate throw, interrupted."""
COLOURS = {"good": typer.colors.GREEN, "look": typer.colors.YELLOW, "bad": typer.colors.RED}


class Output:
    """Lines, files and JSON of one command.

    Parameters
    ----------
    command : str
        Such as "sweep map".
    as_json : bool
        Whether one JSON object takes the place of lines.
    quiet : bool
        Whether nothing is shown.
    width : int
        Column behind the headings of lines.
    files : mapping of str to Path or None, optional
        Files that were asked for, by the names of their options: `output["plot"]`.
    """

    def __init__(
        self,
        command: str,
        *,
        as_json: bool = False,
        quiet: bool = False,
        width: int = 12,
        files: Mapping[str, Path | None] | None = None,
    ) -> None:
        self.command, self.as_json, self.quiet = command, as_json, quiet
        self.silent = quiet or as_json
        self.width, self.written, self._files = width, list[Path](), dict(files or {})

    def __getitem__(self, name: str) -> Path | None:
        """Return a file that was asked for, or None."""
        return self._files[name]

    def show(self, *lines: str, heading: str = "") -> None:
        """Print lines, the first one behind a heading if there is one."""
        for text in () if self.silent else lines:
            typer.echo(f"{heading:<{self.width}}{text}" if heading else text)

    def lines(self, *parts: Iterable[str]) -> None:
        """Print lines that are made one by one, unless nothing is shown."""
        for part in () if self.silent else parts:
            self.show(*part)

    def rows(self, heading: str, texts: Iterable[str]) -> None:
        """Print texts in the column behind a heading, which stands at the first."""
        for number, text in enumerate(texts):
            self.show(f"{heading if not number else '':<{self.width}}{text}")

    def wrote(self, path: Path) -> None:
        """Print the name and size of a file that was written."""
        self.written.append(path)
        self.show(f"{path} ({size_text(path.stat().st_size)})", heading="written")

    def write(self, path: Path | None, content: str | bytes | Callable[[], str | bytes]) -> None:
        """Write content, or the result of a function, whole or not at all, if there is a path."""
        from turnout.core.files import write_atomic

        if path is not None:
            write_atomic(path, content() if callable(content) else content)
            self.wrote(path)

    def save(self, path: Path | None, save: Callable[[Path], None]) -> None:
        """Let a function write a file if there is a path."""
        if path is not None:
            save(path)
            self.wrote(path)

    def figure(self, path: Path | None, draw: Callable[..., Any], *given: Any, **more: Any) -> None:
        """Write the figure that a function draws, if there is a path."""
        if path is not None:
            from turnout.figures.style import rendered

            self.write(path, lambda: rendered(draw(*given, **more), path.suffix))

    def dataset(self, path: Path | None, dataset: "xr.Dataset") -> None:
        """Write a dataset if there is a path."""
        if path is not None:
            from turnout.throw.store import save_response

            self.save(path, lambda path: save_response(dataset, path))

    def json(
        self, record: Callable[..., Any], *given: Any, units: Mapping[str, str] | None = None
    ) -> None:
        """Print the result as one JSON object, see `json_text`, if that was asked for.

        Parameters
        ----------
        record : callable
            Gives it from what is given, or it and the units of its keys.
        units : mapping of str to str, optional
            Units of its keys where the function does not say them.
        """
        if self.as_json:
            found = record(*given)
            whole, own = found if isinstance(found, tuple) else (found, units)
            typer.echo(json_text(self.command, whole, units=own, written=self.written))


def json_text(
    command: str,
    record: Mapping[str, Any],
    *,
    units: Mapping[str, str] | None = None,
    written: Iterable[Path] = (),
) -> str:
    """Return a result as the text of one JSON object.

    Parameters
    ----------
    command : str
        Such as "sweep map".
    record : mapping of str to object
        Its keys; dataclasses and arrays become objects and lists, NaN and infinity null.
    units : mapping of str to str, optional
        SI unit of every key of `record`, at any depth, that has one.
    written : iterable of Path
        Files that the command wrote.

    Examples
    --------
    >>> print(json_text("demo", {"size": float("nan")}, units={"size": "m"}))
    {
      "command": "demo",
      "json_version": 1,
      "size": null,
      "units": {
        "size": "m"
      },
      "written": []
    }
    """
    import json

    from turnout.core.json_files import to_plain

    origin = origin_of(command)
    whole = {
        "command": command,
        "json_version": JSON_VERSION,
        **({"origin": origin} if origin else {}),
        **record,
        "units": dict(units or {}),
        "written": [str(path) for path in written],
    }
    return json.dumps(to_plain(whole, nonfinite=lambda _: None), indent=2, allow_nan=False)


def origin_of(command: str) -> str:
    """Return the origin of the sizes and rates of a command on detection; empty for others.

    Examples
    --------
    >>> origin_of("limit")
    'all switches are simulated; no field recording was compared with these results'
    """
    from turnout.detection.conditions import CAMPAIGN, SIMULATED, TRAINED

    if command in ("limit", "plan-test", "detect train"):
        return SIMULATED
    return TRAINED if command.startswith("detect ") else CAMPAIGN if command == "pod" else ""


def table(columns: Mapping[str, int], rows: Iterable[Iterable[object]]) -> Iterator[str]:
    """Yield the line of headings of a table, then a line for each row.

    Parameters
    ----------
    columns : mapping of str to int
        Width of each column by its heading; negative where texts stand at its left.
    rows : iterable of iterable of object
        What stands in each row, as text.

    Examples
    --------
    >>> list(table({"place": -8, "size": 6}, [("toe", "5.0"), ("heel", "12.0")]))
    ['place     size', 'toe        5.0', 'heel      12.0']
    """
    for row in (columns, *rows):
        yield "".join(
            f"{item!s:>{width}}" if width >= 0 else f"{item!s:<{-width}}"
            for item, width in zip(row, columns.values(), strict=True)
        ).rstrip()


def coloured(text: str, level: str) -> str:
    """Return a line with its head, up to the first colon, in the colour of a level.

    Parameters
    ----------
    text : str
        A line for `typer.echo`, which leaves colours out where the output is no terminal.
    level : str
        "good", "look" or "bad"; others get no colour.

    Examples
    --------
    >>> coloured("Sound: no object", "fact")
    'Sound: no object'
    >>> coloured("Sound: no object", "good").endswith(": no object")
    True
    """
    if level not in COLOURS:
        return text
    head, colon, rest = text.partition(":")
    return typer.style(head, fg=COLOURS[level], bold=True) + colon + rest


def note(text: str) -> None:
    """Print a note on stderr."""
    typer.echo(f"turnout: {text}", err=True)


def refuse(text: str) -> NoReturn:
    """Refuse a command line: one message, exit code 2."""
    raise FileError(text)


@contextmanager
def resumable(text: str) -> Iterator[None]:
    """End a command on Ctrl-C with a note on kept results and the way to continue."""
    try:
        yield
    except KeyboardInterrupt:
        note(f"interrupted; {text}")
        raise typer.Exit(INTERRUPTED) from None


def picked(item: object, *names: str) -> dict[str, Any]:
    """Return some values of a record by their names; None each if there is no record."""
    return {name: getattr(item, name) if item is not None else None for name in names}


def print_schema(output: Output, schema: dict[str, Any]) -> None:
    """Show a JSON schema, or write it to the file that was asked for."""
    import json

    text = json.dumps(schema, indent=2)
    output.write(output["out"], text + "\n")
    output.show(*([] if output["out"] else [text]))


def print_library(output: Output, family: str, found: Mapping[str, str]) -> None:
    """Print the names and descriptions of members of a library, such as "panels"."""
    output.json(lambda: {family: [{"name": n, "description": v} for n, v in found.items()]})
    width = max(map(len, found)) + 2
    output.show(*(f"{name:<{width}}{text}" for name, text in found.items()))
