"""The study of a sweep folder as JSON, for the workers.

It holds the whole study with its panel, so that studies made in Python can be kept too, and nothing
else is needed to throw it. Reading makes records that are checked, and runs nothing.
"""

from functools import lru_cache
from pathlib import Path
from typing import Any

from turnout.core.errors import FileError, TurnoutError
from turnout.core.json_files import from_plain, read_sealed, sealed_json, to_plain
from turnout.panel.stored import panel_data, panel_from_data
from turnout.study.study import Study

STUDY = "study.json"
MOST_STUDIES = 24
"""Studies that a process keeps: of a detector there are 15, of 3 MB each."""
LARGEST_STUDY = 1_000_000_000
"""Of a study file; rails that come as matrices may be large [bytes]."""


def study_data(study: Study) -> dict[str, Any]:
    """Return a study as nested plain data.

    Raises
    ------
    TypeError
        When something of it is nothing that a file can hold.
    """
    return {**to_plain(study), "panel": panel_data(study.panel)}


def study_from_data(data: dict[str, Any]) -> Study:
    """Make a study of plain data, with its panel checked as one from a file is.

    Raises
    ------
    TurnoutError
        When the panel or the scheme is not valid.
    ValueError, TypeError, KeyError
        When the data are not of the form that `study_data` gives.

    Examples
    --------
    >>> from turnout.calibration.load_study import load_study
    >>> study = load_study("sleeper-6")
    >>> study_from_data(study_data(study)).digest == study.digest
    True
    """
    return from_plain(Study, {**data, "panel": panel_from_data(data["panel"])})


def serialize_study(study: Study) -> str:
    """Return the text of the file of a study, after a check that the same study is made of it.

    Raises
    ------
    FileError
        When it holds what a file cannot hold.
    """
    try:
        data = study_data(study)
        text = sealed_json(data)
        same = study_from_data(data).digest == study.digest
    except (TurnoutError, ValueError, TypeError, KeyError, AttributeError) as error:
        message = f"study '{study.name}': cannot be stored ({error}); make it of plain values"
        raise FileError(message) from None
    if not same:
        message = f"study '{study.name}': changes when it is stored; make it of plain values"
        raise FileError(message)
    return text


@lru_cache(maxsize=MOST_STUDIES)
def load_stored_study(folder: Path, digest: str) -> Study:
    """Return the study of a folder as its run has left it for the processes that throw it.

    Raises
    ------
    FileError
        When it is not there, is damaged, or is another one than requested.
    """
    path = folder / STUDY
    remedy = "run `turnout sweep run` again, which writes it again"
    try:
        data, fault = read_sealed(path, largest=LARGEST_STUDY)
        if fault:
            message = f"{path}: {fault}; {remedy}"
            raise FileError(message)
        study = study_from_data(data)
    except FileError as error:
        message = f"{error}; the folder must be shared by all workers"
        raise FileError(message if not path.exists() else str(error)) from None
    except (TurnoutError, ValueError, TypeError, KeyError, AttributeError) as error:
        message = f"{path}: does not hold a study ({error!r}); {remedy}"
        raise FileError(message) from None
    if study.digest != digest:
        message = f"{path}: is not the study that is being run; {remedy}"
        raise FileError(message)
    return study
