"""Studies and panels by name: of the library, a file, or one case of a study as a panel.

A study may name a calibration, whose values its panel then has. `plausible-panels:17` is a case.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from turnout.core.errors import FileError, PanelError, StudyError
from turnout.core.library import names_in_library, open_toml, text_in_library
from turnout.core.toml import TomlFile
from turnout.panel.load import LoadedPanel, as_written, load_named_panel, load_panel

if TYPE_CHECKING:
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


def load_study(name_or_path: str | Path, *, calibration: Path | None = None) -> "Study":
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


def study_from_file(file: TomlFile, *, calibration: Path | None = None) -> "Study":
    """Make a study from a TOML document that was already read."""
    # A panel does not wait for what reads studies.
    from turnout.study.read_study import read_parts, read_record
    from turnout.study.study import Study

    record, problems = read_record(file)
    if calibration is None and record.calibration is not None:
        calibration = file.path_of(record.calibration)
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


_CASE = re.compile(r"(?P<study>.*\S):(?P<number>\d+)")


def load_panel_or_case(
    name_or_path: str | Path, *, overrides: Mapping[str, object] | None = None
) -> LoadedPanel:
    """Load a panel of the library by its name, a panel file by its path, or a case of a study.

    Parameters
    ----------
    name_or_path : str or Path
        A library name, or a path; a text with ".toml" or a path separator is a path. With ":N"
        behind it, it is a study, and its case N is meant, counted from 0.
    overrides : mapping, optional
        Changes, as for `LoadedPanel.with_overrides`. In a panel they are set before anything is
        checked, so they may replace what is wrong in the file.

    Returns
    -------
    LoadedPanel
        The checked panel.

    Raises
    ------
    FileError
        When the file cannot be read or is not TOML.
    PanelError, StudyError
        When what it says is not a valid panel or study, or the study has no such case; with all
        problems at once.

    Examples
    --------
    >>> load_panel_or_case("sb1").drive["1"].stiffness
    750000.0
    >>> load_panel_or_case("plausible-panels:17").name
    'uic60-760-1-15'
    """
    found = None if isinstance(name_or_path, Path) else _CASE.fullmatch(str(name_or_path).strip())
    if found is None:
        try:
            return load_panel(name_or_path, overrides=overrides)
        except FileError:
            _refuse_study(str(name_or_path))
            raise
    panel = case_panel(found["study"], int(found["number"]))
    return panel.with_overrides(overrides) if overrides else panel


def case_name(name_or_path: str | Path | None) -> str | None:
    """Return a name without blanks around it if it is that of a case of a study, else None.

    Examples
    --------
    >>> case_name("plausible-panels:7")
    'plausible-panels:7'
    >>> case_name("sb1")
    """
    if isinstance(name_or_path, str) and _CASE.fullmatch(name_or_path.strip()):
        return name_or_path.strip()
    return None


def shown_name(panel: LoadedPanel, name_or_path: str | Path | None) -> str:
    """Return the name of a panel, behind that of the case of a study by which it was asked for.

    Examples
    --------
    >>> shown_name(load_panel_or_case("plausible-panels:7"), "plausible-panels:7")
    'plausible-panels:7, a case of uic60-760-1-15'
    >>> shown_name(load_panel_or_case("sb1"), "sb1")
    'sb1'
    """
    case = case_name(name_or_path)
    return f"{case}, a case of {panel.name}" if case else panel.name


def _refuse_study(name: str) -> None:
    """Refuse a study of the library where one of its cases is wanted, with or without a number."""
    study, colon, number = name.strip().partition(":")
    if study in names_in_library("turnout.study"):
        what = f"'{number}' is no number of a case" if colon else "it is a study, not a panel"
        raise StudyError([f"{what}; name one, counted from 0, as in {study}:0"], source=study)


def case_panel(study_name: str | Path, number: int) -> LoadedPanel:
    """Return the panel of a case of a study, counted from 0.

    Raises
    ------
    StudyError
        When the study has no such case, or its cases are more than a panel.
    """
    from turnout.study.variable import OBJECT_KEYS, RECORDER_KEYS

    study = load_study(study_name)
    keys = [variable.key for variable in study.variables.values()]
    other = [key for key in keys if key in OBJECT_KEYS or key in RECORDER_KEYS]
    if other:
        message = (
            f"its cases are more than a panel, they have {other[0]}; "
            "name a study that varies the panel only"
        )
        raise StudyError([message], source=str(study_name))
    if number >= study.count:
        message = f"there is no case {number}; there are 0 to {study.count - 1}"
        raise StudyError([message], source=str(study_name))
    return as_written(study.panel.with_overrides(study.scenario(number).overrides))
