"""JSON schema of a study file as a user writes it, for editors that complete and check TOML."""

from typing import Any

from turnout.panel.schema import DRAFT, tidy
from turnout.study.distribution import PARAMETERS
from turnout.study.records import StudyRecord
from turnout.study.variables import CHOICE


def study_schema() -> dict[str, Any]:
    """Give the JSON schema of a study file.

    Whether a key exists and a value has the right unit depends on the panel, so that is checked
    when the file is loaded, not here.

    Returns
    -------
    dict
        A JSON schema, draft 2020-12.

    Examples
    --------
    >>> record = study_schema()["$defs"]["VariableRecord"]
    >>> "lognormal" in record["properties"]["distribution"]["enum"]
    True
    """
    schema = StudyRecord.model_json_schema(mode="validation")
    tidy(schema)
    for name, more in (("VariableRecord", [CHOICE]), ("FieldRecord", [])):
        schema["$defs"][name]["properties"]["distribution"]["enum"] = [*PARAMETERS, *more]
    return {"$schema": DRAFT, **schema, "title": "turnout study"}
