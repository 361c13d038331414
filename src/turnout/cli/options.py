"""Options that several commands share, and output paths checked before a long run."""

import inspect
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from turnout.cli.output import INCOMPLETE, INTERRUPTED, Output, note, refuse
from turnout.core.errors import FileError, TurnoutError

if TYPE_CHECKING:
    import xarray as xr

    from turnout.calibration.result import Calibration
    from turnout.panel.load import LoadedPanel


FIGURES = (".png", ".pdf", ".svg")


def check_outputs(paths: Mapping[str, Path | None], suffixes: Mapping[str, Sequence[str]]) -> None:
    """Refuse every output path that could not be written, all at once.

    Parameters
    ----------
    paths : mapping of option to path
        None where the option was not given.
    suffixes : mapping of option to suffixes
        What each option can write.

    Raises
    ------
    FileError
        Naming option, path and remedy for each.
    """
    problems = []
    seen: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        problem = _problem(path, suffixes[option])
        if problem:
            problems.append(f"{option} {path}: {problem}")
        resolved = path.resolve()
        if resolved in seen:
            problems.append(f"{option} {path}: is also the file of {seen[resolved]}; name another")
        seen[resolved] = option
    if problems:
        raise FileError("\n".join(problems))


def _problem(path: Path, suffixes: Sequence[str]) -> str | None:
    if path.is_dir():
        return "is a folder; name a file inside it"
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join(suffixes)
        return f"the name must end in {allowed}"
    # A link is written through, so check the folder of its target.
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.exists():
        return f"there is no folder {folder}; create it first"
    if not folder.is_dir():
        return f"{folder} is no folder"
    if not os.access(folder, os.W_OK):
        return f"folder {folder} is not writable; choose another or change its permissions"
    if path.exists() and not os.access(path, os.W_OK):
        return "exists and is not writable; choose another name or change its permissions"
    return _refused(folder)


def _refused(folder: Path) -> str | None:
    """Try to make a file: root may write despite missing permissions, but not everywhere."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return f"no file can be made in {folder} ({error.strerror}); choose another folder"


def made_folder(option: str, folder: Path) -> Path:
    """Make a folder for files unless it exists; refuse a file, or a folder that has no parent."""
    from turnout.core.files import make_folder

    if not folder.parent.exists():
        refuse(f"{option} {folder}: there is no folder {folder.parent}; create it first")
    try:
        make_folder(folder)
    except FileError as error:
        refuse(f"{option} {error}")
    if not os.access(folder, os.W_OK):
        refuse(f"{option} {folder}: is not writable; choose another or change its permissions")
    return folder


def end_code(dataset: "xr.Dataset") -> int:
    """Return the exit code that a throw ends a command with, 0 if it is complete."""
    if dataset.attrs["complete"]:
        return 0
    return INTERRUPTED if dataset.attrs["outcome"] == "interrupted" else INCOMPLETE


def option(names: str, text: str, *, default: Any = None, **more: Any) -> Any:
    """Return an option of a command as its help shows it.

    Parameters
    ----------
    names : str
        Long name, short name and value, each if there is one: "--out -o FILE.nc". An option
        without a value is a flag.
    text : str
        Its help.
    default : object
        Value where it is not given; `...` for one that must be given, or has its default in the
        signature of a command. A flag is off.
    **more
        As of `typer.Option`.

    Examples
    --------
    >>> found = option("--out -o FILE.nc", "Write it.")
    >>> found.default, found.param_decls, found.metavar
    (None, ('--out', '-o'), 'FILE.nc')
    """
    parts = names.split()
    own = [part for part in parts if part.startswith("-")]
    flag = len(own) == len(parts) and default is None
    metavar = " ".join(parts[len(own) :]) or None
    return typer.Option(False if flag else default, *own, metavar=metavar, help=text, **more)


def argument(metavar: str, text: str, *, default: Any = ..., **more: Any) -> Any:
    """Return an argument of a command: its name in the help, and its help."""
    return typer.Argument(default, metavar=metavar, help=text, **more)


DEFAULT_PANEL = "uic60-760-1-15"

PanelArgument = Annotated[
    str | None,
    argument(
        "PANEL",
        "Library panel, path of a panel file (.toml), or case N of a study (STUDY:N). "
        "Default that of --calibration, or "
        f"{DEFAULT_PANEL}.",
        show_default=False,
    ),
]
PanelOption = Annotated[
    str | None,
    option(
        "--panel PANEL",
        f"Library panel or panel file. Default that of --calibration, or {DEFAULT_PANEL}.",
        show_default=False,
        default=...,
    ),
]
SetOption = Annotated[
    list[str],
    option(
        "--set KEY=VALUE",
        "Change a value of the panel, with its unit: drive.2.stiffness='81 kN/m'. Repeatable.",
        default=...,
    ),
]
CalibrationOption = Annotated[
    Path | None,
    option(
        "--calibration FILE", "Values from `turnout calibrate`; --set overrides them.", default=...
    ),
]
WorkersOption = Annotated[
    int, option("--workers N", "Processes; default one a core.", min=0, default=...)
]
TogetherOption = Annotated[
    list[str],
    option(
        "--together NAME=DRIVES",
        "One transformer around the leads of several drives: switch=1,2. Repeatable.",
        default=...,
    ),
]


@dataclass(frozen=True, slots=True)
class PanelOptions:
    """The panel of a command, with the values that are changed of it."""

    panel: PanelArgument = None
    settings: SetOption = ()  # type: ignore[assignment]  # typer gives lists
    calibration: CalibrationOption = None

    def opened(self) -> "LoadedPanel":
        """Return the panel, or that of the calibration, or the default one, with its changes.

        If the calibration is of another panel, a note goes to stderr; if the panel lacks a
        calibrated key, that is an error. Settings are applied on top.
        """
        from turnout.calibration.load_study import load_panel_or_case

        name, settings, calibration = self.panel, self.settings, self.calibration
        if calibration is None:
            panel = load_panel_or_case(name if name is not None else DEFAULT_PANEL)
            return panel.with_settings(settings) if settings else panel
        from turnout.calibration.result import check_provenance, load_calibration

        known = load_calibration(calibration)
        panel = calibrated_panel(known, calibration) if name is None else load_panel_or_case(name)
        changed = panel.with_settings(settings) if settings else panel
        for text in check_provenance(known, panel, changed):
            note(f"{calibration}: {text}")
        found = known.apply(panel)
        return found.with_settings(settings) if settings else found

    def given(self) -> "LoadedPanel | None":
        """Return the panel, changed; None if neither it nor a change is named."""
        named = self.panel is not None or self.calibration is not None or self.settings
        return self.opened() if named else None


@dataclass(frozen=True, slots=True)
class GivenPanelOptions(PanelOptions):
    """The panel of a command that must name one."""

    panel: Annotated[
        str | None,
        argument("PANEL", "Library panel, panel file (.toml), or case N of a study (STUDY:N)."),
    ] = ...  # type: ignore[assignment]


@dataclass(frozen=True, slots=True)
class NamedPanelOptions(PanelOptions):
    """The panel of a command that names it by an option."""

    panel: PanelOption = None


@dataclass(frozen=True, slots=True)
class File:
    """A file that a command writes.

    Attributes
    ----------
    names, text : str
        Of its option, as for `option`.
    suffixes : tuple of str
        Suffixes that its name may have; if empty, that of the option's value.
    default : Path, optional
        Where it is not given.
    """

    names: str
    text: str
    suffixes: tuple[str, ...] = ()
    default: Any = None

    @property
    def option(self) -> str:
        """Its long name."""
        return self.names.split()[0]

    @property
    def allowed(self) -> tuple[str, ...]:
        """Suffixes that its name may have."""
        return self.suffixes or (Path(self.names.split()[-1]).suffix,)


DATASET = File("--out -o FILE.nc", "Write the dataset (netCDF).")
FIGURE = File("--plot FILE", "Write a figure (.png, .pdf or .svg).", FIGURES)
SCHEMA = File("--out -o FILE.json", "Write it to a file.")
QUIET = option("--quiet -q", "Show nothing but errors.", default=...)
JSON = option("--json", "Print the result as JSON, in SI units; see docs.", default=...)


def gives(
    command: str,
    *,
    json: bool = True,
    quiet: bool = False,
    width: int = 12,
    **files: File,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command its `Output`, by options for files, `--json` and `--quiet`.

    Its other options are its parameters; one whose type is a dataclass stands for its fields. Paths
    are checked before it begins.

    Parameters
    ----------
    command : str
        Such as "sweep map".
    json : bool
        Whether it has `--json`.
    quiet : bool
        Whether it has `--quiet`.
    width : int
        Column behind the headings of its lines.
    **files : File
        What it may write, by the name in its output.
    """
    flags = {"as_json": JSON} if json else {}
    flags |= {"quiet": QUIET} if quiet else {}
    made = [
        _parameter(
            name, Annotated[Path | None, option(item.names, item.text, default=...)], item.default
        )
        for name, item in files.items()
    ] + [_parameter(name, Annotated[bool, flag], False) for name, flag in flags.items()]
    suffixes = {item.option: item.allowed for item in files.values()}

    def decorated(run: Callable[..., None]) -> Callable[..., None]:
        records, parameters = dict[str, Any](), list[inspect.Parameter]()
        for item in inspect.signature(run).parameters.values():
            if is_dataclass(item.annotation):
                records[item.name] = item.annotation
                parameters += _of_record(item.annotation)
            elif item.annotation is not Output:
                parameters.append(item)

        @wraps(run)
        def called(**given: Any) -> None:
            paths = {name: given.pop(name) for name in files}
            check_outputs({files[name].option: path for name, path in paths.items()}, suffixes)
            output = Output(
                command, **{name: given.pop(name) for name in flags}, width=width, files=paths
            )
            for name, record in records.items():
                given[name] = record(
                    **{part.name: given.pop(part.name) for part in _of_record(record)}
                )
            run(output=output, **given)

        whole = [_parameter(p.name, p.annotation, p.default) for p in parameters] + made
        called.__signature__ = inspect.Signature(whole)  # type: ignore[attr-defined]
        called.__annotations__ = {item.name: item.annotation for item in whole}
        return called

    return decorated


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    """Return a parameter of a command's signature; one with the default `...` must be given."""
    default = inspect.Parameter.empty if default is ... else default
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def _of_record(record: Any) -> list[inspect.Parameter]:
    return list(inspect.signature(record).parameters.values())


def first_sentence(text: str) -> str:
    """Return the first sentence of a description, without its full stop.

    Examples
    --------
    >>> first_sentence("A switch. From a paper.")
    'A switch'
    """
    return " ".join(text.split()).split(". ")[0].rstrip(".")


def calibrated_panel(calibration: "Calibration", source: Path) -> "LoadedPanel":
    """Load the calibrated panel, which must be a library panel."""
    from turnout.panel.load import library_names, load_panel

    if calibration.panel not in library_names():
        refuse(f"{source}: is of panel '{calibration.panel}'; name the file of that panel")
    return load_panel(calibration.panel)


def read_texts(
    texts: Mapping[str, str | None], read: Callable[[str, str], float]
) -> dict[str, float]:
    """Return the values of the options that were given; refuse all at once that cannot be read.

    Parameters
    ----------
    texts : mapping of str to str
        Text of each option; empty or None if it was not given.
    read : callable
        Gives the value of an option and its text, or raises a ValueError.
    """
    found, problems = dict[str, float](), []
    for name, text in texts.items():
        try:
            if text:
                found[name] = read(name, text)
        except ValueError as error:
            problems.append(f"{name} {text}: {error}")
    if problems:
        refuse("\n".join(problems))
    return found


def collect_errors(*parts: Callable[[], Any]) -> list[Any]:
    """Read parts of a command line that do not need each other.

    Parameters
    ----------
    *parts : callable
        Each returns its part or raises a `TurnoutError`.

    Raises
    ------
    TurnoutError
        The only one there is, or one `FileError` with the texts of all.

    Examples
    --------
    >>> collect_errors(lambda: 1, lambda: "two")
    [1, 'two']
    """
    errors: list[TurnoutError] = []
    found: list[Any] = []
    for part in parts:
        try:
            found.append(part())
        except TurnoutError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        refuse("\n".join(str(error) for error in errors))
    return found
