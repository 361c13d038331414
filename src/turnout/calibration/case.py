"""A panel by name: of the library, a file, or one case of a study, `plausible-panels:17`."""

import re
from collections.abc import Mapping
from pathlib import Path

from turnout.core.errors import FileError, StudyError
from turnout.core.library import names_in_library
from turnout.panel.load import LoadedPanel, as_written, load_panel

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
    # A panel does not wait for what reads studies.
    from turnout.calibration.load_study import load_study
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
