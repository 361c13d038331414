"""Load a study of the library or a file, with the values of a calibration where it names one."""

from collections.abc import Mapping
from pathlib import Path

from turnout.core.errors import PanelError
from turnout.core.files import user_path
from turnout.core.library import names_in_library, open_toml, text_in_library
from turnout.core.toml import TomlFile
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.read_study import read_parts, read_record
from turnout.study.study import Study


def study_names() -> tuple[str, ...]:
    """List the studies that come with the program.

    Examples
    --------
    >>> "paper-campaign" in study_names()
    True
    """
    return names_in_library("turnout.study")


def study_text(name: str) -> str:
    """Give the TOML text of a library study, to start an own study file from.

    Raises
    ------
    FileError
        When there is no such study; the text lists those there are.
    """
    return text_in_library("turnout.study", name, kind="study")


def open_study(name_or_path: str | Path) -> TomlFile:
    """Read a study of the library by its name, or a study file by its path."""
    return open_toml("turnout.study", name_or_path, kind="study")


def load_named_panel(name: str, file: TomlFile) -> LoadedPanel:
    """Load the panel that a study names; a path starts at the folder of the study."""
    return load_panel(resolve_path(name, file) if name.endswith(".toml") else name)


def resolve_path(name: str, file: TomlFile) -> Path:
    """Return a path that a study names; one that is not absolute starts at the study's folder."""
    path = user_path(name)
    return path if path.is_absolute() or file.folder is None else file.folder / path


def load_study(name_or_path: str | Path, *, calibration: Path | None = None) -> Study:
    """Load a study of the library by its name, or a study file by its path.

    Parameters
    ----------
    name_or_path : str or Path
        A library name, or a path; a text with ".toml" or a path separator is a path.
    calibration : Path, optional
        Whose values are put in the panel, in place of the calibration that the study names. What
        the study sets goes on top.

    Returns
    -------
    Study
        Completely checked against its panel.

    Raises
    ------
    FileError
        When the file cannot be read or is not TOML.
    StudyError, PanelError
        With all problems at once.

    Examples
    --------
    >>> load_study("sleeper-6").count
    11
    """
    return study_from_file(open_study(name_or_path), calibration=calibration)


def study_from_file(file: TomlFile, *, calibration: Path | None = None) -> Study:
    """Make a study from a TOML document that was already read."""
    record, problems = read_record(file)
    if calibration is None and record.calibration is not None:
        calibration = resolve_path(record.calibration, file)
    panel = load_named_panel(record.panel, file)
    panel, remarks = apply_calibration(panel, calibration)
    panel, set_problems = set_values(panel, record.set)
    parts = read_parts(record, panel, source=file.source, problems=[*problems, *set_problems])
    return Study(
        name=record.name,
        description=record.description,
        panel=parts.panel,
        scheme=parts.scheme,
        output=parts.output,
        seed=record.seed,
        design=parts.design,
        variables=parts.variables,
        fields=parts.fields,
        law=parts.law,
        rule=parts.rule,
        split=parts.split,
        remarks=remarks,
    )


def apply_calibration(
    panel: LoadedPanel, calibration: Path | None
) -> tuple[LoadedPanel, tuple[str, ...]]:
    """Return a panel with calibrated values, and remarks where these are of another panel."""
    if calibration is None:
        return panel, ()
    # Only a study that names a calibration waits for what reads it.
    from turnout.calibration.result import check_provenance, load_calibration

    known = load_calibration(calibration)
    remarks = tuple(f"{calibration}: {text}" for text in check_provenance(known, panel))
    return known.apply(panel), remarks


def set_values(panel: LoadedPanel, values: Mapping[str, object]) -> tuple[LoadedPanel, list[str]]:
    """Return a panel with the values that a study sets in every throw, or what is wrong in them."""
    if not values:
        return panel, []
    try:
        return panel.with_overrides(values, si=False), []
    except PanelError as error:
        return panel, [f"set.{text}" for text in error.problems]
